"""A robot's recording is read unchanged; damaged rows are named and skipped, or faults end it."""

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded import ROBOT, SETUP, START_S, Written, as_dumped, write_recording

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.icub_eyes import fit_to_images, read_icub_eyes
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.warnings import ProblemKind
from pps_vision.recordings.yarp_writer import YarpWriter
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE


@pytest.fixture
def rec(tmp_path: Path) -> Written:
    return write_recording(tmp_path / "rec", n=4)


def change(log: Path, line: int, text: str) -> None:
    """Replace a line (from 1) of a log."""
    lines = log.read_text().splitlines()
    lines[line - 1] = text
    log.write_text("\n".join(lines) + "\n")


def problems_of(folder: Path) -> tuple[list[tuple[ProblemKind, str, int | None]], list[int]]:
    """(kind, file, line) of every problem and the numbers of the frames that remain."""
    recording = open_recording(folder)
    numbers = [number for number, _ in recording.numbered()]
    return [(p.kind, p.file.relative_to(folder).as_posix(), p.line) for p in recording.problems], numbers


@pytest.mark.parametrize("damage", ["empty", "cut", "missing"])
def test_a_bad_image_is_skipped(rec, damage):
    file = rec.folder / "cam/right/00000002.ppm"
    file.unlink() if damage == "missing" else file.write_bytes(file.read_bytes()[:20] if damage == "cut" else b"")
    assert problems_of(rec.folder) == ([(ProblemKind.IMAGE, "cam/right/data.log", 3)], [0, 1, 3])


def test_a_bad_log_row_is_skipped(rec):
    change(rec.folder / "head/data.log", 2, "1 1512784563.55 1 2 3")
    change(rec.folder / "skin/data.log", 1, f"0 {START_S} left_forearm:x")
    change(rec.folder / "cam/left/data.log", 3, f"2 {START_S + 0.1}")
    problems, numbers = problems_of(rec.folder)
    assert problems == [
        (ProblemKind.ROW, "head/data.log", 2),
        (ProblemKind.ROW, "skin/data.log", 1),
        (ProblemKind.ROW, "cam/left/data.log", 3),
        (ProblemKind.UNPAIRED, "cam/right/data.log", 3),
    ]
    assert numbers == [0, 1, 3]


def test_one_calibration_goes_with_a_robots_recording_and_replaces_its_own(rec, tmp_path):
    own = (rec.folder / "icubEyes.ini").read_text()
    (tmp_path / "other.ini").write_text(own.replace("cx 174.742", "cx 165.742"))
    mine = open_recording(rec.folder).rig
    second_rig = open_recording(rec.folder, calib=tmp_path / "other.ini").rig
    assert mine.left.cx - second_rig.left.cx == pytest.approx(9 * 8 / 320)  # the images are 8 pixels wide, not 320
    with pytest.raises(InputError, match=r"calib has 2 files; expected one icubEyes\.ini with REC"):
        open_recording(rec.folder, calib=[tmp_path / "other.ini"] * 2)


@pytest.mark.parametrize(("side", "later_s"), [("left", -1.0), ("left", 0.05), ("right", 0.055)])
def test_a_stamp_that_goes_back_or_comes_again_is_skipped(rec, side, later_s):
    change(rec.folder / f"cam/{side}/data.log", 3, f"2 {START_S + later_s} 00000002.ppm")
    problems, numbers = problems_of(rec.folder)
    assert problems[0] == (ProblemKind.STAMP, f"cam/{side}/data.log", 3)
    assert numbers == [0, 1, 3]


def test_a_joint_too_many_is_no_second_stamp_and_a_torso_that_was_not_recorded_is_told(rec):
    log = rec.folder / "torso/data.log"
    log.write_text(log.read_text().replace("\n", " 7\n"))
    with pytest.raises(InputError, match=r"torso/data\.log:1: one number too many, which is no second stamp; ex"):
        open_recording(rec.folder)
    log.unlink()
    assert open_recording(rec.folder).warnings == ("no joints of the torso: taken as 0",)


@pytest.mark.parametrize("value", ["nan", "inf", "1.2e4"])
def test_a_joint_sample_that_is_no_angle_is_skipped_and_bridged(rec, value):
    change(rec.folder / "torso/data.log", 3, f"2 {START_S + 0.05} 0 {value} 0")
    problems, numbers = problems_of(rec.folder)
    assert problems == [(ProblemKind.JOINTS, "torso/data.log", 3)]
    assert numbers == [0, 1, 2, 3]
    frame_before, after = (rec.frames[i] for i in (0, 1))
    roll = ROBOT.indices(("torso_roll",))[0]
    expected = np.interp(
        START_S + 0.05,
        [frame_before.stamp_right_s, after.stamp_right_s],
        [frame_before.joints_right_rad[roll], after.joints_right_rad[roll]],
    )
    frame = dict(open_recording(rec.folder).numbered())[1]
    assert frame.joints_left_rad[roll] == pytest.approx(expected, abs=1e-6)


def test_frames_that_the_joints_do_not_span(rec):
    # head samples of the first frame only: 20 ms on the last still holds, 50 ms on it does not
    log = rec.folder / "head/data.log"
    first, last = log.read_text().splitlines()[:2]
    log.write_text(f"{first}\n{last}\n")
    problems, numbers = problems_of(rec.folder)
    assert problems == [
        (ProblemKind.JOINTS, f"cam/{side}/data.log", line) for line in (2, 3, 4) for side in ("left", "right")
    ]
    assert numbers == [0]
    words = last.split()
    words[1] = f"{START_S + 0.03:.6f}"
    log.write_text(f"{first}\n{' '.join(words)}\n")
    assert problems_of(rec.folder)[1] == [0, 1]
    neck = ROBOT.indices(("neck_yaw",))[0]
    held = dict(open_recording(rec.folder).numbered())[1].joints_left_rad[neck]
    assert held == pytest.approx(rec.frames[0].joints_right_rad[neck], abs=1e-8)


@pytest.mark.parametrize(
    ("without", "numbers"),
    [
        (range(12, 15), list(range(0, 40))),  # three samples of 20 Hz: 0.2 s between the others
        (range(12, 16), [*range(0, 12), *range(16, 40)]),  # 0.25 s, too much to go between
        (range(12, 32), [*range(0, 12), *range(32, 40)]),
    ],
)
def test_a_hole_in_a_joint_log_is_bridged_only_if_short(tmp_path, without, numbers):
    folder = write_recording(tmp_path / "rec", n=40).folder
    rows = [f"{i} {START_S + 0.05 * i} 0 0 0 0 0 0" for i in range(41) if i not in without]  # to 45 ms past the end
    (folder / "head/data.log").write_text("\n".join(rows))
    problems, kinds = problems_of(folder)
    # right images come 5 ms after the samples: the last one before the hole has no joints on its far side
    expected = [i for i in numbers if i != without[0] - 1 or len(without) == 3]
    assert kinds == expected
    assert {(kind, line) for kind, _, line in problems} == {
        (ProblemKind.JOINTS, i + 1) for i in range(40) if i not in expected
    }


def test_an_unpaired_frame_is_named(rec):
    change(rec.folder / "cam/right/data.log", 2, f"1 {START_S + 0.075} 00000001.ppm")
    problems, numbers = problems_of(rec.folder)
    assert problems == [(ProblemKind.UNPAIRED, f"cam/{side}/data.log", 2) for side in ("left", "right")]
    assert numbers == [0, 2, 3]
    assert len(open_recording(rec.folder, max_skew_s=0.03)) == 4


def test_two_stamps_and_pixel_codes_are_read(rec):
    for log in rec.folder.rglob("data.log"):
        rows = [row.split() for row in log.read_text().splitlines()]
        code = ["[rgb]"] if log.parent.parent.name == "cam" else []
        log.write_text("\n".join(" ".join([r[0], r[1], repr(float(r[1]) + 0.7), *r[2:], *code]) for r in rows))
    recording = open_recording(rec.folder)
    assert recording.problems == []
    assert [f.stamp_left_s for f in recording] == [f.stamp_left_s for f in rec.frames]
    np.testing.assert_allclose(next(iter(recording)).joints_left_rad, rec.frames[0].joints_left_rad, atol=1e-8)
    assert [touch.taxel_ids for touch in recording.touches] == [ids for _, ids in rec.touches]


@pytest.mark.parametrize("with_info", [True, False])
def test_ports_are_found_by_other_names(rec, with_info):
    names = {
        "cam/left": "icub/cam/left/rgbImage_o",
        "cam/right": "icub/cam/right/rgbImage_o",
        "head": "icub/head/state_o",
        "right_arm": "rightArm",
    }
    for old, new in names.items():
        (rec.folder / new).parent.mkdir(parents=True, exist_ok=True)
        (rec.folder / old).rename(rec.folder / new)
    shutil.rmtree(rec.folder / "left_arm")
    (rec.folder / "imu_left").mkdir()
    (rec.folder / "imu_left/data.log").write_text("0 1.0 2 3\n")
    if not with_info:
        for info in rec.folder.rglob("info.log"):
            info.unlink()
    recording = open_recording(rec.folder)
    assert (len(recording), recording.problems) == (4, [])
    joints = next(iter(recording)).joints_left_rad
    right, left = (ROBOT.indices(ROBOT.names.arm(side)) for side in ("right", "left"))
    np.testing.assert_allclose(joints[right], rec.frames[0].joints_left_rad[right], atol=1e-8)
    np.testing.assert_array_equal(joints[left], 0)


def without_info(rec: Written) -> None:
    for info in rec.folder.rglob("info.log"):
        info.unlink()


@pytest.mark.parametrize("kind", ["image", "image_jpg", "image_png", "mkv", "avi"])
@pytest.mark.parametrize("with_info", [True, False])
def test_all_images_that_the_dumper_writes_are_read(rec, kind, with_info):
    as_dumped(rec.folder, kind)
    if not with_info:
        without_info(rec)
    recording = open_recording(rec.folder)
    frames = list(recording)
    assert (len(frames), recording.problems) == (4, [])
    for frame, written in zip(frames, rec.frames, strict=True):
        assert (frame.stamp_left_s, frame.stamp_right_s) == (written.stamp_left_s, written.stamp_right_s)
        np.testing.assert_allclose(frame.joints_left_rad, written.joints_left_rad, atol=1e-8)
        for image, true in ((frame.left, written.left), (frame.right, written.right)):
            if kind == "image_jpg":  # of random pixels
                assert np.corrcoef(image.ravel(), true.ravel())[0, 1] > 0.5
            else:
                np.testing.assert_array_equal(image, true)


def test_a_row_without_a_frame_of_the_video_is_named(rec):
    as_dumped(rec.folder, "mkv")
    change(rec.folder / "cam/left/data.log", 2, f"1 {START_S + 0.05} frame_00000004")
    problems, numbers = problems_of(rec.folder)
    assert problems[0] == (ProblemKind.IMAGE, "cam/left/data.log", 2)
    assert numbers == [0, 2, 3]
    said = "frame_00000004 of 4 frames in video.mkv; expected a frame for each row"
    assert said in str(open_recording(rec.folder).problems[0])
    (rec.folder / "cam/left/video.mkv").unlink()
    with pytest.raises(InputError, match=r"left/data\.log: names frames of a video; expected video\.mkv or video\.avi"):
        open_recording(rec.folder)


@pytest.mark.parametrize("with_info", [True, False])
def test_distances_are_no_images(rec, with_info):
    as_dumped(rec.folder, "depth")
    if not with_info:
        without_info(rec)
    with pytest.raises(InputError, match=r"left/data\.log: holds distances, no images; expected left images"):
        open_recording(rec.folder)


def test_without_truth_touches_and_calibration(rec):
    (rec.folder / "truth.csv").unlink()
    (rec.folder / "icubEyes.ini").unlink()
    shutil.rmtree(rec.folder / "skin")
    recording = open_recording(rec.folder)
    assert (recording.truth, recording.touches, recording.rig) == ((), (), None)


@pytest.mark.parametrize("name", ["../../secret.ppm", "/etc/passwd", "a/../../b.ppm"])
def test_a_file_name_that_points_outside_is_refused(rec, name):
    change(rec.folder / "cam/left/data.log", 2, f"1 {START_S + 0.05} {name}")
    with pytest.raises(InputError, match=r"cam/left/data\.log:2: file name .* points outside"):
        open_recording(rec.folder)


@pytest.mark.parametrize(
    ("log", "text", "message"),
    [
        ("head", "what is this\n", r"head/data\.log:1: 'what is this'; expected index, stamp and 6 numbers"),
        ("head", f"0 {START_S} nan 0 0 0 0 0\n", r"head/data\.log: no readable sample"),
        ("head", "", r"head/data\.log: no readable sample"),
        ("skin", "0 1.0 (1 2 (3))\n", r"skin/data\.log:1: '\(1'; expected touched taxels"),
        ("cam/left", "\x00\x01\x02\n", r"cam/left/data\.log:1: "),
        ("cam/left", "", r"cam/left/data\.log: names no image"),
        ("cam/right", "\n", r"cam/right/data\.log: names no image"),
        ("cam/left", f"0 {START_S - 60} 00000000.ppm\n", r"no usable frame.*cam/left/data\.log:1"),
        ("cam/left", f"0 {START_S}\n", r"cam/left/data\.log: names no image.*cam/left/data\.log:1: 0 words"),
        ("cam/left", f"0 {START_S} none.ppm\n", "no usable frame"),
    ],
)
def test_what_cannot_be_read_at_all_is_refused(rec, log, text, message):
    (rec.folder / log / "data.log").write_text(text)
    with pytest.raises(InputError, match=message):
        open_recording(rec.folder)


def test_without_kinematics_a_robots_recording_is_refused(rec, monkeypatch):
    monkeypatch.setitem(sys.modules, "pps_vision.robot.icub", None)
    with pytest.raises(InputError, match=r"is of a robot, and .* is not installed; expected the whole of pps-vision's"):
        open_recording(rec.folder)


def test_a_recording_is_called_as_it_was_given(rec, monkeypatch):
    monkeypatch.chdir(rec.folder)
    assert (open_recording(Path("../rec")).name, open_recording(rec.folder).name) == ("../rec", str(rec.folder))


@pytest.mark.parametrize(("port", "message"), [("cam/left", "no left images"), ("head", "no head joints")])
def test_a_missing_port_is_named(rec, port, message):
    shutil.rmtree(rec.folder / port)
    with pytest.raises(InputError, match=message):
        open_recording(rec.folder)


def test_offsets_are_added_to_the_encoders(rec, tmp_path):
    (tmp_path / "joints.csv").write_text("joint,offset_deg\nneck_yaw,3\n")
    plain = open_recording(rec.folder)
    offset = open_recording(rec.folder, joints=tmp_path / "joints.csv")
    added = [b.joints_left_rad - a.joints_left_rad for a, b in zip(plain, offset, strict=True)]
    expected = np.zeros(len(added[0]))
    expected[ROBOT.indices(("neck_yaw",))] = np.deg2rad(3)
    np.testing.assert_allclose(added, [expected] * 4, atol=1e-12)


def test_a_folder_of_no_known_format_is_named(tmp_path):
    with pytest.raises(InputError, match=f"{tmp_path}: an empty folder; expected a EuRoC folder, .*; or a yarpdata"):
        open_recording(tmp_path)
    (tmp_path / "notes.txt").touch()
    with pytest.raises(InputError, match=f"{tmp_path}: no recording; expected a EuRoC folder"):
        open_recording(tmp_path)


def test_a_missing_folder_and_a_port_found_twice_are_named(rec):
    with pytest.raises(InputError, match="none: no such file or folder"):
        open_recording(rec.folder / "none")
    shutil.copytree(rec.folder / "head", rec.folder / "old" / "head")
    with pytest.raises(InputError, match=r"a second log for head; expected one, and .*head/data\.log is there"):
        open_recording(rec.folder)


def test_what_is_written_is_read(tmp_path):
    written = write_recording(tmp_path / "rec")
    recording = open_recording(tmp_path / "rec")
    assert (recording.name, recording.image_size, recording.problems) == (str(tmp_path / "rec"), (8, 6), [])
    frames = list(recording)
    assert len(recording) == len(frames) == len(written.frames)
    for back, frame in zip(frames, written.frames, strict=True):
        np.testing.assert_array_equal(back.left, frame.left)
        np.testing.assert_array_equal(back.right, frame.right)
        assert (back.stamp_left_s, back.stamp_right_s) == (frame.stamp_left_s, frame.stamp_right_s)
        np.testing.assert_allclose(back.joints_left_rad, frame.joints_left_rad, atol=1e-8)
        np.testing.assert_allclose(back.joints_right_rad, frame.joints_right_rad, atol=1e-8)
    assert [(touch.stamp_s, touch.taxel_ids) for touch in recording.touches] == written.touches
    assert [row.stamp_s for row in recording.truth] == [row.stamp_s for row in written.truth]
    assert read_icub_eyes(tmp_path / "rec" / "icubEyes.ini") == (LEFT_EYE, RIGHT_EYE)
    assert recording.rig is not None
    assert recording.rig.left == fit_to_images(LEFT_EYE, (8, 6), tmp_path)


def test_the_layout_is_yarpdatadumpers(tmp_path):
    write_recording(tmp_path / "rec", n=2)
    files = sorted(str(file.relative_to(tmp_path / "rec")) for file in (tmp_path / "rec").rglob("*") if file.is_file())
    ports = ("cam/left", "cam/right", "head", "left_arm", "right_arm", "skin", "torso")
    expected = [f"{port}/{name}" for port in ports for name in ("data.log", "info.log")]
    expected += [f"cam/{side}/0000000{i}.ppm" for side in ("left", "right") for i in (0, 1)]
    assert files == sorted([*expected, "icubEyes.ini", "truth.csv"])
    assert (tmp_path / "rec/cam/left/info.log").read_text() == "Type: Image:ppm;\n"
    assert (tmp_path / "rec/cam/left/data.log").read_text().splitlines()[0] == "0 1512784563.547172 00000000.ppm"
    assert (tmp_path / "rec/skin/data.log").read_text().splitlines()[1].split()[2:] == ["left_forearm:27"]


def test_encoders_are_in_the_robots_order_and_degrees(tmp_path):
    q = np.zeros(ROBOT.n_joints)
    names = ("torso_yaw", "neck_pitch", "left_eye_pan", "right_eye_pan", "right_elbow")
    q[ROBOT.indices(names)] = np.deg2rad([3, -20, 15, 5, 40])
    with YarpWriter(tmp_path / "rec", SETUP) as writer:
        writer.write_joints(1.0, q)
    rows = {
        port: np.array((tmp_path / "rec" / port / "data.log").read_text().split(), dtype=float)
        for port in ("torso", "head", "right_arm")
    }
    np.testing.assert_allclose(rows["torso"], [0, 1, 3, 0, 0])
    np.testing.assert_allclose(rows["head"], [0, 1, -20, 0, 0, 0, 10, 10])
    np.testing.assert_allclose(rows["right_arm"], [0, 1, 0, 0, 0, 40, *[0] * 12])


def test_cameras_the_calibration_cannot_hold_leave_nothing(tmp_path):
    bent = LEFT_EYE.__class__(8, 6, 5, 5, 4, 3, (0, 0, 0, 0, 0.1))
    setup = replace(SETUP, rig=StereoRig(LEFT_EYE, bent, ROBOT.eye_poses))
    with pytest.raises(ValueError, match="k3"), YarpWriter(tmp_path / "rec", setup):
        pass
    assert list(tmp_path.iterdir()) == []
