"""Fixation points and the gaze postures that reach them."""

from pathlib import Path

import numpy as np
import pytest
from data import ARM7
from eyes import fixation_point
from urdf import joint, write_urdf

from pps_vision.errors import InputError
from pps_vision.robot.gaze import GazeLimits, GazeModel, fixation_points, gaze_for_points
from pps_vision.robot.icub import load_icub, set_gaze
from pps_vision.robot.model import FrameNames, Robot

ROBOT = load_icub()
ZERO = np.zeros(ROBOT.n_joints)


def random_gaze(n, limits=None):
    limits = limits or GazeLimits()
    return np.random.default_rng(0).uniform(limits.lower, limits.upper, (n, 3))


def test_the_published_fixation_point_at_20_degrees_of_vergence():
    np.testing.assert_allclose(fixation_points(ROBOT, [[0, 0, np.deg2rad(20)]]), [[-0.2556, 0, 0.3408]], atol=1e-4)


def test_batch_and_posture_agree_and_both_eyes_look_there():
    gaze = random_gaze(30)
    points = fixation_points(ROBOT, gaze)
    for (yaw, pitch, vergence), point in zip(gaze, points, strict=True):
        posture = ROBOT.at(set_gaze(ROBOT, ZERO, yaw=yaw, pitch=pitch, vergence=vergence))
        np.testing.assert_allclose(fixation_point(posture), point, atol=1e-9)
        for eye in ("left_eye", "right_eye"):
            x, y, z = np.linalg.inv(posture.T_root(eye))[:3] @ [*point, 1]
            assert np.hypot(x, y) < 1e-9
            assert z > 0


@pytest.mark.parametrize("vergence_deg", [0.0, -10.0])
def test_eyes_that_do_not_converge_fixate_nothing(vergence_deg):
    vergence = np.deg2rad(vergence_deg)
    assert np.isnan(fixation_points(ROBOT, [[0, 0, vergence]])).all()


@pytest.mark.parametrize("limits", [GazeLimits(), GazeLimits((-1.5, 1.5), (-1.5, 1.5), (0.01, 2.5))])
def test_gaze_of_a_fixation_point_is_the_gaze_posture(limits):
    gaze = random_gaze(500, limits)
    np.testing.assert_allclose(gaze_for_points(ROBOT, fixation_points(ROBOT, gaze), limits), gaze, atol=1e-9)


def test_the_corners_of_the_limits_are_within_them_and_just_beyond_is_not():
    limits = GazeLimits()
    corners = np.stack(np.meshgrid(*np.stack([limits.lower, limits.upper], axis=1), indexing="ij"), -1).reshape(-1, 3)
    gaze = gaze_for_points(ROBOT, fixation_points(ROBOT, corners))
    np.testing.assert_allclose(gaze, corners, atol=1e-9)
    assert ((gaze >= limits.lower) & (gaze <= limits.upper)).all()
    for axis in 1e-6 * np.eye(3):
        outwards = np.where(corners == limits.lower, corners - axis, corners + axis)
        assert np.isnan(gaze_for_points(ROBOT, fixation_points(ROBOT, outwards))).all()


def head(folder: Path, yaw_first: bool) -> Robot:
    """Two neck joints whose axes meet 10 cm beside the root, no torso, eyes that look along x."""
    axes = {"yaw": "0 0 1", "pitch": "0 -1 0"}
    first, second = axes if yaw_first else reversed(axes)
    parts = [joint(first, "base", "neck", "0 0.1 0.3", axes[first]), joint(second, "neck", "skull", axis=axes[second])]
    parts.append(joint("tilt", "skull", "eyes", axis="0 -1 0"))
    for side, y in (("left", 0.03), ("right", -0.03)):
        parts.append(joint(f"pan_{side}", "eyes", f"socket_{side}", f"0.05 {y} 0.02", "0 0 -1"))
        ahead = "-1.5707963267948966 0 -1.5707963267948966"
        parts.append(joint(f"{side}_axis", f"socket_{side}", side, kind="fixed", rpy=ahead))
    names = FrameNames("left", "right", gaze_joints=("yaw", "pitch", "tilt", "pan_left", "pan_right"))
    return Robot(write_urdf(folder / "head.urdf", *parts), names)


def test_another_head_that_pitches_first(tmp_path):
    robot = head(tmp_path, yaw_first=False)
    model = GazeModel(robot)
    gaze = random_gaze(20)
    points = model.points(gaze)
    np.testing.assert_allclose(model.gaze(points), gaze, atol=1e-9)
    assert np.isnan(model.gaze(np.array([[np.nan, 0, 0], [-1.0, 0.1, 0.3]]))).all()  # unknown, behind
    for (yaw, pitch, vergence), point in zip(gaze, points, strict=True):
        posture = robot.at(set_gaze(robot, np.zeros(5), yaw=yaw, pitch=pitch, vergence=vergence))
        for eye in ("left", "right"):
            x, y, z = np.linalg.inv(posture.T_root(eye))[:3] @ [*point, 1]
            assert np.hypot(x, y) < 1e-9
            assert z > 0
    np.testing.assert_allclose(
        model.to_upright(np.ones((1, 5)), np.arange(3.0)), [np.arange(3.0)], atol=1e-12
    )  # no torso


def test_a_head_that_yaws_first_is_refused(tmp_path):
    with pytest.raises(InputError, match="expected a neck that pitches, then yaws"):
        GazeModel(head(tmp_path, yaw_first=True))


def test_beyond_the_limits_is_nan_and_wider_limits_help():
    points = [[-0.30, -0.20, 0.05], [0.3, 0, 0.3], [np.nan, 0, 0], [-3.0, 0, 0.3]]  # low, behind, unknown, far
    assert np.isnan(gaze_for_points(ROBOT, points)).all()
    wide = GazeLimits(pitch_rad=(np.deg2rad(-80), np.deg2rad(40)))
    gaze = gaze_for_points(ROBOT, points, wide)
    assert np.rad2deg(gaze[0, 1]) == pytest.approx(-51, abs=1)  # the home hand
    np.testing.assert_allclose(fixation_points(ROBOT, gaze[:1])[0], points[0], atol=1e-6)
    assert np.isnan(gaze[1:]).all()


@pytest.mark.parametrize(
    "limits", [{"yaw_rad": (1.0, -1.0)}, {"pitch_rad": (0.2, 0.2)}, {"vergence_rad": (0.0, 1.0)}], ids=str
)
def test_limits_out_of_order_or_of_eyes_that_do_not_converge_are_refused(limits):
    with pytest.raises(ValueError, match="lower below upper and vergence above 0"):
        GazeLimits(**limits)


def watched(left_deg: float, link: str = "base", palms: tuple[str, str] = ("", "palm")) -> Robot:
    """An arm watched by two cameras 10 cm apart that look along y, the left one turned by an angle to its left."""
    mounted = {}
    for name, x, turn in (("left", 0.35, np.deg2rad(left_deg)), ("right", 0.45, 0.0)):
        mounted[name] = link, np.eye(4)
        mounted[name][1][:3, :3] = np.array(
            [[np.cos(turn), 0, -np.sin(turn)], [np.sin(turn), 0, np.cos(turn)], [0, -1, 0]]
        )
        mounted[name][1][:3, 3] = x, 0.2, 0.7
    return Robot(ARM7.with_name("arm.urdf"), FrameNames("left", "right", palms, gaze_joints=()), None, mounted)


@pytest.mark.parametrize("left_deg", [0.0, 8.0])
def test_a_point_seen_by_fixed_cameras_by_hand(left_deg):
    """From the middle between them: ahead is half the angle to the left, but at right angles to the baseline, so y."""
    model = GazeModel(watched(left_deg))
    points = np.array([[0.4, 1.2, 0.7], [-0.2, 1.0, 0.7], [0.4, 1.0, 1.1]])
    expected = np.array(
        [
            [0.0, 0.0, 2 * np.arctan(0.05 / 1.0)],
            [np.arcsin(0.6), 0.0, 2 * np.arctan(0.05 / 1.0)],  # 0.6 m to the left, 0.8 m ahead
            [0.0, np.arctan2(0.4, 0.8), 2 * np.arctan(0.05 / np.hypot(0.4, 0.8))],
        ]
    )
    np.testing.assert_allclose(model.gaze(points, GazeLimits(vergence_rad=(0.01, 1.0))), expected, atol=1e-12)
    np.testing.assert_allclose(model.points(expected), points, atol=1e-12)
    gaze_samples = np.random.default_rng(0).uniform([-0.9, -0.9, 0.1], [0.9, 0.9, 1.9], (50, 3))
    np.testing.assert_allclose(
        model.gaze(model.points(gaze_samples), GazeLimits((-1, 1), (-1, 1), (0.05, 2.0))), gaze_samples
    )
    assert np.isnan(model.points(np.array([[0.1, 0.1, 0.0], [0.1, 0.1, -0.2]]))).all()


@pytest.mark.parametrize(
    ("link", "palms", "carries"),
    [("base", ("", "palm"), 0), ("upper", ("", "palm"), None), ("upper", ("elbow", "palm"), None),
     ("palm", ("shoulder", "palm"), 1)],
)  # fmt: skip
def test_the_joints_that_move_cameras_and_hands_alike_carry_a_point(link, palms, carries):
    """All joints before the cameras' link, but none that does not move each palm, too."""
    robot = watched(0.0, link, palms)
    q = np.linspace(0.2, 0.8, robot.n_joints)
    point = np.array([0.3, -0.2, 0.5])
    joints_moved = robot.moving(link) if carries is None else robot.joint_names[:carries]
    bent = np.where(np.isin(robot.joint_names, joints_moved), q, 0.0)
    T_camera, T_camera_upright = (
        robot.at(configuration).T_root("left") for configuration in (bent, np.zeros(robot.n_joints))
    )
    expected = (T_camera_upright @ np.linalg.inv(T_camera) @ [*point, 1])[:3]
    np.testing.assert_allclose(GazeModel(robot).to_upright(q[None], point)[0], expected, atol=1e-12)
