"""Files of stamps in the units and forms that recorders write, and clocks that begin apart; by `open_recording`."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import cv2
import numpy as np
import pytest
from videos import write_video

from pps_vision.errors import InputError
from pps_vision.recordings.open import open_recording

N = 8
STEP_S = 1 / 30
BEGAN_S = 1_700_000_000


def lines(row: Callable[[int], object], header: str = "") -> str:
    return header + "".join(f"{row(k)}\n" for k in range(N))


def dated(k: int) -> str:
    """As KITTI's raw drives write it, with nanoseconds."""
    moment = datetime.fromtimestamp(BEGAN_S, UTC) + timedelta(seconds=k * STEP_S)
    return f"{moment:%Y-%m-%d %H:%M:%S.%f}000"


FORMS = {
    "s": lines(lambda k: f"{k * STEP_S:.6f}"),
    "ms of OpenCV": lines(lambda k: f"{1e3 * k * STEP_S:.3f}"),
    "ms since 1970": lines(lambda k: round(1e3 * (BEGAN_S + k * STEP_S))),
    "us of a device's clock": lines(lambda k: 12_500_000 + round(1e6 * k * STEP_S)),
    "ns of a device's clock": lines(lambda k: 98_765_432_100 + round(1e9 * k * STEP_S)),
    "ns since 1970": lines(lambda k: BEGAN_S * 10**9 + round(1e9 * k * STEP_S)),
    "a header": lines(lambda k: round(1e6 * k * STEP_S), "timestamp [us]\n"),
    "a commented header": lines(lambda k: f"{1e3 * k * STEP_S}", "#camera\n# t_ms\n"),
    "counted": lines(lambda k: f"{k},{1e3 * k * STEP_S}", "frame,time_ms\n"),
    "counted without a header": lines(lambda k: f"{k + 1} {k * STEP_S}"),
    "a unit in words": lines(lambda k: 10**6 + 1e3 * k * STEP_S, "Time (milliseconds)\n"),
    "quoted": lines(lambda k: f'"{k}","{k * STEP_S}"', '"frame","time_s"\n'),
    "UTF-16": lines(lambda k: f"{k * STEP_S:.6f}"),
    "dates": lines(dated),
    "ISO dates": lines(lambda k: dated(k).replace(" ", "T") + "Z"),
    "times of day": lines(lambda k: dated(k).split()[1]),
}


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Left and right videos at 30 frames a second; the right one has two frames more."""
    folder = tmp_path_factory.mktemp("videos")
    for side, n in (("left", N), ("right", N + 2)):
        write_video(folder / f"{side}.mp4", [k * STEP_S for k in range(n)])
    return {side: str(folder / f"{side}.mp4") for side in ("left", "right")}


@pytest.mark.parametrize("form", FORMS)
def test_stamps_are_read_in_their_unit(videos, tmp_path, form):
    (tmp_path / "times.txt").write_text(FORMS[form], "utf-16" if form == "UTF-16" else "utf-8")
    recording = open_recording(left=videos["left"], right=videos["left"], times=tmp_path / "times.txt")
    stamps_s = np.array([left.stamp_s for left, _ in recording.pairs])
    np.testing.assert_allclose(
        stamps_s - stamps_s[0], STEP_S * np.arange(N), atol=1.1e-3 if "ms since" in form else 2e-6
    )
    assert recording.warnings == ()


def test_each_side_may_have_its_own_file_and_number_of_frames(videos, tmp_path):
    files = [tmp_path / "left.txt", tmp_path / "right.txt"]
    for file, n in zip(files, (N, N + 2), strict=True):
        file.write_text("".join(f"{40 + 1e3 * k * STEP_S}\n" for k in range(n)))
    recording = open_recording(**videos, times=files)
    assert len(recording) == N
    np.testing.assert_allclose([left.stamp_s for left, _ in recording.pairs], 0.04 + STEP_S * np.arange(N), atol=1e-6)
    with pytest.raises(InputError, match=r"8 stamps for 10 images of the video; expected .* --times LEFT RIGHT"):
        open_recording(**videos, times=files[0])
    files[1].write_text("0.1 a.png\n0.2 a.png\n")
    with pytest.raises(InputError, match=r"right\.txt:2: image a.png again; expected .*, and each image once"):
        open_recording(**videos, times=files)
    with pytest.raises(InputError, match="3 files of times; expected one, or one for each side"):
        open_recording(**videos, times=[*files, files[0]])


def test_stamps_that_disagree_with_the_video_are_told(videos, tmp_path):
    (tmp_path / "t.txt").write_text(lines(lambda k: k / 25))
    recording = open_recording(left=videos["left"], right=videos["left"], times=tmp_path / "t.txt")
    assert recording.warnings == (f"--times {tmp_path / 't.txt'} (25 frames/s) replaces the files' own 30.04",)


def images(folder: Path, stamps: list[str]) -> str:
    folder.mkdir()
    for stamp in stamps:
        cv2.imwrite(str(folder / f"{stamp}.png"), np.zeros((6, 8, 3), np.uint8))
    return str(folder)


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        (33.333, "0.03 in s, 30 in ms; expected --times-unit s or ms"),
        (33_333, "0.03 in ms, 30 in us; expected --times-unit ms or us"),
        (0.0333, None),
    ],
)
def test_the_unit_is_asked_where_no_video_tells_it(tmp_path, step, expected):
    sides = {side: images(tmp_path / side, [f"{k:03}" for k in range(N)]) for side in ("left", "right")}
    (tmp_path / "t.txt").write_text(lines(lambda k: k * step))
    if expected is None:
        assert open_recording(**sides, times=tmp_path / "t.txt").fps == pytest.approx(30, rel=0.01)
        return
    with pytest.raises(InputError, match=rf"t\.txt: its stamps a second are {expected}"):
        open_recording(**sides, times=tmp_path / "t.txt")
    unit = expected.rsplit(" ", 1)[1]
    assert open_recording(**sides, times=tmp_path / "t.txt", times_unit=unit).fps == pytest.approx(30, rel=0.01)


@pytest.mark.parametrize(("apart_s", "is_refused"), [(5.0, True), (0.1, False)])
def test_clocks_that_begin_apart_are_named_with_the_way_out(tmp_path, apart_s, is_refused):
    began = {"left": 1_700_000_000.0, "right": 1_700_000_000.0 + apart_s}
    sides = {side: images(tmp_path / side, [f"{t + k * STEP_S:.6f}" for k in range(N)]) for side, t in began.items()}
    if is_refused:
        with pytest.raises(
            InputError, match=r"begin \+5\.000 s from the left ones: no two are within 20 ms.* --fps, which"
        ):
            open_recording(**sides)
    else:
        (warning,) = open_recording(**sides).warnings
        assert "the right images begin and end +0.100 s from the left ones" in warning
    for folder in sides.values():
        for k, file in enumerate(sorted(Path(folder).iterdir())):
            file.rename(Path(folder) / f"{k}.png")
    assert len(open_recording(**sides, fps=30)) == N


def test_a_raw_drive_of_kitti(tmp_path):
    """Dated stamps of each camera, and the calibration beside the drive: the colour pair is 0.532 m apart there."""
    drive = tmp_path / "2011_09_26" / "2011_09_26_drive_0001_sync"
    for camera in ("image_02", "image_03"):
        (drive / camera).mkdir(parents=True)
        images(drive / camera / "data", [f"{k:010}" for k in range(N)])
        (drive / camera / "timestamps.txt").write_text(lines(dated))
    rows = [
        f"S_rect_0{k}: 8 6\nP_rect_0{k}: 10 0 4 {-10 * x} 0 10 3 0 0 0 1 0\n"
        for k, x in enumerate((0, 0.5, -0.06, 0.472))
    ]
    (drive.parent / "calib_cam_to_cam.txt").write_text("calib_time: 09-Jan-2012 13:57:47\n" + "".join(rows))
    sides = {"left": drive / "image_02" / "data", "right": drive / "image_03" / "data"}
    times = [drive / camera / "timestamps.txt" for camera in ("image_02", "image_03")]
    named = open_recording(**sides, calib=drive.parent / "calib_cam_to_cam.txt", times=times)
    for recording in (open_recording(drive), named):
        assert recording.rig is not None
        np.testing.assert_allclose(recording.rig.view().right.center, [0.532, 0, 0], atol=1e-12)
        stamps_s = [left.stamp_s - BEGAN_S for left, _ in recording.pairs]
        np.testing.assert_allclose(stamps_s, STEP_S * np.arange(N), atol=2e-6)
