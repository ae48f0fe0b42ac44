"""Small bags that rosbags writes: ROS 1, ROS 2 and MCAP, raw and compressed images, calibration and joints."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from bags import BagWriter
from calibrations import store
from data import ARM7

from pps_vision.errors import InputError
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.recording import Recording
from pps_vision.robot.icub import icub_setup

START_S = 1512784563
SIZE = (24, 16)
N = 5
KINDS = ("ros1.bag", "ros2", "ros2_mcap", "one.mcap")


@contextmanager
def writing(folder: Path, kind: str) -> Iterator[BagWriter]:
    """A bag of one kind in a folder; `one.mcap` is the only file of a ROS 2 bag, moved out of it."""
    storage = "ros1" if kind == "ros1.bag" else "mcap" if "mcap" in kind else "sqlite3"
    alone = kind == "one.mcap"
    with BagWriter(folder / ("written" if alone else kind), storage) as bag:
        yield bag
    if alone:
        bag.path = next(bag.path.glob("*.mcap")).rename(folder / kind)


def projection(baseline_m: float) -> np.ndarray:
    return np.array([[30.0, 0, 11.5, -30 * baseline_m], [0, 30, 7.5, 0], [0, 0, 1, 0]])


def images() -> np.ndarray:
    return np.random.default_rng(5).integers(0, 256, (2, N, SIZE[1], SIZE[0], 3), dtype=np.uint8)


def stamp(side: int, k: int) -> float:
    return START_S + 0.05 * k + 0.004 * side


def write(folder: Path, kind: str, with_joints: bool = False, calibrated: bool = True) -> Path:
    """Images that arrive late and a while after each other; raw on the left, PNG on the right."""
    shown = images()
    with writing(folder, kind) as bag:
        for side, (name, baseline_m) in enumerate((("left", 0.0), ("right", 0.12))):
            if calibrated:
                bag.write(f"/stereo/{name}/camera_info", bag.camera_info(projection(baseline_m), SIZE), START_S)
            for k in range(N):
                at = stamp(side, k)
                if side == 0:
                    bag.write("/stereo/left/image_raw", bag.image(shown[0, k][..., ::-1], "bgr8", at), at + 0.3)
                else:
                    bag.write("/stereo/right/image_raw/compressed", bag.png(shown[1, k][..., ::-1], at), at + 0.1)
        if with_joints:
            robot = icub_setup().robot
            for k in range(-2, 22):
                q = 0.01 * k * np.arange(1, robot.n_joints + 1)
                bag.write("/joint_states", bag.joints(robot.joint_names, q, START_S + 0.0125 * k), START_S)
    return bag.path


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_is_read(tmp_path, kind):
    recording = open_recording(write(tmp_path, kind))
    shown = images()
    for _ in range(2):  # again from the beginning
        frames = list(recording)
        assert len(frames) == N
        for k, frame in enumerate(frames):
            np.testing.assert_array_equal(frame.left, shown[0, k])
            np.testing.assert_array_equal(frame.right, shown[1, k])
            assert (frame.stamp_left_s, frame.stamp_right_s) == pytest.approx((stamp(0, k), stamp(1, k)), abs=1e-6)
    np.testing.assert_array_equal(recording.pairs[1][0].load(), shown[0, 1])  # and out of order
    assert (recording.problems, recording.warnings) == ([], ())
    assert len(open_recording(recording.name, fps=30).warnings) == 1
    view = recording.rig.view()
    np.testing.assert_allclose(view.right.center, [0.12, 0, 0], atol=1e-12)
    assert (recording.rig.left.fx, recording.rig.left.cx) == (30, 11.5)


def test_rectified_topics_have_the_rectified_cameras(tmp_path):
    """Their K is the projection's and they have no lens, unlike the raw camera's."""
    raw = np.array([[33.0, 0, 10.0], [0, 34, 8.0], [0, 0, 1]])
    P = [projection(0.0), projection(0.12)]
    for kind, lens in (("image_rect", 0.0), ("image_raw", -0.1)):
        with writing(tmp_path, "ros1.bag" if lens else "ros2") as bag:
            for side, name in enumerate(("left", "right")):
                info = bag.camera_info(P[side], SIZE, (-0.1, 0, 0, 0, 0))
                setattr(info, "K" if lens else "k", raw.ravel())
                bag.write(f"/stereo/{name}/camera_info", info, START_S)
                for k in range(2):
                    bag.write(
                        f"/stereo/{name}/{kind}", bag.image(images()[side, k], "rgb8", stamp(side, k)), stamp(side, k)
                    )
        rig = open_recording(bag.path).rig
        assert rig is not None
        assert rig.left.distortion[0] == lens
        assert rig.left.fx == (33.0 if lens else 30.0)
        assert rig.view().right.center == pytest.approx([0.12, 0, 0])


def test_joints_of_a_robot_are_interpolated(tmp_path):
    setup = icub_setup()
    recording: Recording = open_recording(write(tmp_path, "ros2_mcap", with_joints=True), robot=setup)
    assert recording.robot is setup.robot
    assert (recording.rig.left.fx, recording.rig.eye_poses) == (30, setup.robot.eye_poses)
    for k, frame in enumerate(recording):
        for side, q in enumerate((frame.joints_left_rad, frame.joints_right_rad)):
            expected = 0.01 * (stamp(side, k) - START_S) / 0.0125 * np.arange(1, setup.robot.n_joints + 1)
            np.testing.assert_allclose(q, expected, atol=1e-5)


@pytest.mark.parametrize(("robot", "message"), [(ARM7, "expected a1, a2, .*a7"), ("none.toml", "none.toml: cannot be")])
def test_a_robot_may_be_named_by_its_file(tmp_path, robot, message):
    with pytest.raises(InputError, match=message):
        open_recording(write(tmp_path, "ros2_mcap", with_joints=True), robot=robot)


def test_encodings(tmp_path):
    """Grey, alpha, and Bayer patterns of red alone, whose inside is red; a pattern is called by its first four pixels,
    row by row."""
    rgb = images()[0, 0]
    grey = images()[0, 0, ..., :1]
    bayer = {pattern: np.zeros((SIZE[1], SIZE[0], 1), np.uint8) for pattern in ("rggb", "bggr", "gbrg", "grbg")}
    for pattern, image in bayer.items():
        row, column = divmod(pattern.index("r"), 2)
        image[row::2, column::2] = 200
    written = {"mono8": grey, "8UC1": grey, "rgba8": np.dstack([rgb, grey]), "8UC3": rgb[..., ::-1]}
    written |= {"bgra8": np.dstack([rgb[..., ::-1], grey]), "rgb8": rgb}
    written |= {f"bayer_{pattern}8": image for pattern, image in bayer.items()} | {"yuv9": grey}
    with writing(tmp_path, "ros2") as bag:
        for k, (encoding, image) in enumerate(written.items()):
            for side in ("left", "right"):
                bag.write(f"/{side}", bag.image(image, encoding, 10 + k), 10 + k)
    K = projection(0)[:, :3]
    calib = store(tmp_path / "calib.yml", K1=K, K2=K, R=np.eye(3), T=np.array([-0.12, 0, 0]))
    recording = open_recording(bag.path, calib=[calib])
    loaded = [pair[0].load() for pair in recording.pairs]
    np.testing.assert_array_equal(loaded[:2], [np.repeat(grey, 3, axis=2)] * 2)
    np.testing.assert_array_equal(loaded[2:6], [rgb] * 4)
    for image in loaded[6:10]:
        assert np.asarray(image)[4:-4, 4:-4].mean(axis=(0, 1)).tolist() == [200, 0, 0]
    assert "encoding 'yuv9'" in str(loaded[10])
    list(recording)
    assert "encoding 'yuv9'" in str(recording.problems[0])


@pytest.mark.parametrize(
    ("name", "rectified"),
    [
        ("image_rect", True),
        ("image_rect_color/compressed", True),
        ("direct/image_raw", False),
        ("image_correct", False),
        ("rect/camera/image_raw", False),
    ],
)
def test_only_rectified_topics_are_taken_as_rectified(tmp_path, name, rectified):
    with writing(tmp_path, "ros2") as bag:
        for side, baseline_m in (("left", 0.0), ("right", 0.12)):
            at = f"/{side}/{name}".removesuffix("/compressed").rsplit("/", 1)[0]
            message = bag.camera_info(projection(baseline_m), SIZE, (0.1, 0, 0, 0, 0))
            bag.write(f"{at}/camera_info", message, 10)
            for k in range(2):
                bag.write(f"/{side}/{name}", bag.image(images()[0, k], "rgb8", 10 + k), 10 + k)
    rig = open_recording(bag.path).rig
    assert any(rig.left.distortion) != rectified


def test_what_a_bag_lacks(tmp_path):
    bag = write(tmp_path, "ros2", calibrated=False)
    bare = open_recording(bag)
    assert (bare.rig, bare.calibration_at) == (None, "/stereo/left/camera_info, or one by --calib")
    second = bare.pairs[1][0]
    np.testing.assert_array_equal(second.load(), images()[0, 1])  # before any other
    assert (second.number, second.title) == (1, "/stereo/left/image_raw 1")
    with pytest.raises(InputError, match=r"no topic /a among /stereo/left/image_raw, /stereo/right"):
        open_recording(bag, left=["/a"], right=["/stereo/left/image_raw"])
    bag = write(tmp_path, "ros1.bag")
    with pytest.raises(InputError, match="no JointState with all joints of head"):
        open_recording(bag, robot=icub_setup())
    with pytest.raises(InputError, match=r"joints j\.csv without a robot"):
        open_recording(bag, joints="j.csv")
    with pytest.raises(InputError, match=r"taxels t\.ini without skin"):
        open_recording(bag, taxels="t.ini")
    with pytest.raises(InputError, match="either REC, or left and right"):
        open_recording(tmp_path, left=["a"], right=["b"], calib=["c"])


def test_a_camera_info_names_a_lens_that_is_known_or_none(tmp_path):
    for lens in ("", "fisheye of my own"):
        with writing(tmp_path / (lens or "none"), "ros2") as bag:
            for side in (0, 1):
                info = bag.camera_info(projection(0.12 * side), SIZE)
                info.distortion_model = lens
                bag.write(f"/{'lr'[side]}/camera_info", info, 10)
                bag.write(f"/{'lr'[side]}/image", bag.image(images()[side, 0], "rgb8", 10), 10)
        if lens:
            with pytest.raises(InputError, match="distortion_model fisheye of my own; expected one of"):
                open_recording(bag.path, left="/l/image", right="/r/image")
        else:
            assert open_recording(bag.path, left="/l/image", right="/r/image").rig is not None


def test_of_two_topics_of_one_side_one_is_to_be_named(tmp_path):
    topics = ("/a/left", "/b/left", "/right")
    with writing(tmp_path, "ros2") as bag:
        for topic in topics:
            bag.write(topic, bag.image(images()[0, topics.index(topic)], "rgb8", 10), 10)
        robot = icub_setup().robot
        for k in range(2):
            bag.write("/joint_states", bag.joints(robot.joint_names, np.zeros(robot.n_joints), 20 + k), 20)
    with pytest.raises(InputError, match="2 left image topics among /a/left, /b/left, /right; expected one, by --left"):
        open_recording(bag.path)
    recording = open_recording(bag.path, left="/b/left", right="/right")
    np.testing.assert_array_equal(recording.pairs[0][0].load(), images()[0, 1])
    with pytest.raises(InputError, match=r"no pair has joints; .* has no .* joints"):  # which begin ten seconds later
        open_recording(bag.path, left="/b/left", right="/right", robot=icub_setup())


def test_taxels_do_not_go_with_a_bag_and_a_bag_needs_rosbags(tmp_path, monkeypatch):
    bag = write(tmp_path, "ros2")
    with pytest.raises(InputError, match=r"taxels t\.ini with a ROS bag; expected it with an iCub's folder REC"):
        open_recording(bag, robot=icub_setup(), taxels="t.ini")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(
        InputError, match=r"ros2: is a ROS bag; expected the extra ros: pip install 'pps-vision\[ros\]'"
    ):
        open_recording(bag)


@pytest.mark.parametrize("kind", ["ros1.bag", "one.mcap"])
def test_damaged_bags_are_read_or_refused(tmp_path, kind):
    sound = write(tmp_path, kind).read_bytes()
    rng = np.random.default_rng(3)
    ends = set()
    for k in range(8):
        content = bytearray(sound[: int(rng.integers(len(sound)))] if k % 3 == 0 else sound)
        for at in rng.integers(0, len(content), 1 + k):
            content[at] = rng.integers(256)
        (tmp_path / kind).write_bytes(content)
        try:
            ends.add(len(list(open_recording(tmp_path / kind))))
        except InputError as error:
            ends.add("refused" if kind in str(error) else str(error))
    assert "refused" in ends
    assert all(end == "refused" or isinstance(end, int) for end in ends)


@pytest.mark.parametrize("order", ["<", ">"])
def test_sixteen_bits_keep_the_highest_in_use(tmp_path, order):
    """A camera of 12 bits; its pixels in either order of bytes."""
    levels = np.random.default_rng(3).integers(0, 4096, (N, SIZE[1], SIZE[0], 1), dtype=np.uint16)
    with writing(tmp_path, "ros2") as bag:
        for side in ("left", "right"):
            for k in range(N):
                bag.write(
                    f"/{side}/image", bag.image(levels[k].astype(f"{order}u2"), "mono16", stamp(0, k)), stamp(0, k)
                )
    for k, frame in enumerate(open_recording(bag.path)):
        np.testing.assert_array_equal(frame.left, np.repeat(levels[k] >> 4, 3, axis=2).astype(np.uint8))


@pytest.mark.parametrize(("encoding", "luma"), [("yuv422", 1), ("yuv422_yuy2", 0)])
def test_pixels_that_share_their_colour(tmp_path, encoding, luma):
    """By ITU-R BT.601: Y 81, U 90, V 240 is red, Y 145, U 54, V 34 green."""
    pixels = np.empty((SIZE[1], SIZE[0], 2), np.uint8)
    pixels[..., luma] = 81
    pixels[:, ::2, 1 - luma] = 90
    pixels[:, 1::2, 1 - luma] = 240
    pixels[: SIZE[1] // 2, :, luma] = 145
    pixels[: SIZE[1] // 2, ::2, 1 - luma] = 54
    pixels[: SIZE[1] // 2, 1::2, 1 - luma] = 34
    with writing(tmp_path, "ros1.bag") as bag:
        for side in ("left", "right"):
            bag.write(f"/{side}/image", bag.image(pixels, encoding, stamp(0, 0)), START_S)
    (frame,) = open_recording(bag.path)
    np.testing.assert_allclose(frame.left[-1, 0].astype(float), (255, 0, 0), atol=4)
    np.testing.assert_allclose(frame.left[0, 0].astype(float), (0, 255, 0), atol=4)
