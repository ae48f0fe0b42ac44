"""The iCub's URDF against its published Denavit–Hartenberg tables (retyped here) and checks."""

from dataclasses import replace

import numpy as np
import pytest
from data import shared_data

from pps_vision.errors import InputError
from pps_vision.experiments.films.scenes import denavit_hartenberg, head_pose
from pps_vision.recordings.icub_eyes import read_icub_eyes
from pps_vision.robot import icub
from pps_vision.robot.model import FrameNames, Robot
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array

ROOT = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
TORSO = [(0.032, 0, 90, 0), (0, -0.0055, 90, -90)]
# A, D (m), α, offset (degrees)
LEFT_ARM = [
    (0.0233647, -0.1433, -90, 105),
    (0, 0.10774, -90, 90),
    (0, 0, 90, -90),
    (0.015, 0.15228, -90, 75),
    (-0.015, 0, 90, 0),
    (0, 0.1373, 90, -90),
    (0, 0, 90, 90),
    (0.0625, -0.016, 0, 0),
]
RIGHT_ARM = [
    (-0.0233647, -0.1433, 90, -105),
    (0, -0.10774, 90, -90),
    (0, 0, -90, -90),
    (-0.015, -0.15228, -90, -105),
    (0.015, 0, 90, 0),
    (0, -0.1373, 90, -90),
    (0, 0, 90, 90),
    (0.0625, 0.016, 0, 180),
]
TORSO_JOINTS = ("torso_pitch", "torso_roll", "torso_yaw")
ARM_JOINTS = (
    "shoulder_pitch",
    "shoulder_roll",
    "shoulder_yaw",
    "elbow",
    "wrist_prosupination",
    "wrist_pitch",
    "wrist_yaw",
)
CHAINS = {
    "left_palm": (TORSO + LEFT_ARM, TORSO_JOINTS + tuple(f"left_{j}" for j in ARM_JOINTS)),
    "right_palm": (TORSO + RIGHT_ARM, TORSO_JOINTS + tuple(f"right_{j}" for j in ARM_JOINTS)),
    "left_forearm": (TORSO + LEFT_ARM[:6], TORSO_JOINTS + tuple(f"left_{j}" for j in ARM_JOINTS[:5])),
    "right_forearm": (TORSO + RIGHT_ARM[:6], TORSO_JOINTS + tuple(f"right_{j}" for j in ARM_JOINTS[:5])),
}
LIMITS_DEG = {
    "torso_pitch": (-22, 84), "torso_roll": (-39, 39), "torso_yaw": (-59, 59),
    "shoulder_pitch": (-95.5, 5), "shoulder_roll": (0, 160.8), "shoulder_yaw": (-37, 100), "elbow": (5.5, 106),
    "wrist_prosupination": (-50, 50), "wrist_pitch": (-65, 10), "wrist_yaw": (-25, 25),
    "neck_pitch": (-40, 30), "neck_roll": (-70, 60), "neck_yaw": (-55, 55),
    "eyes_tilt": (-35, 15), "eye_pan": (-50, 50),
}  # fmt: skip


def end_of(rows: list[tuple[float, float, float, float]], q: Array) -> Array:
    T = ROOT
    for (a, d, alpha_deg, offset_deg), angle in zip(rows, q, strict=True):
        T = T @ denavit_hartenberg(a, d, np.deg2rad(alpha_deg), angle + np.deg2rad(offset_deg))
    return T


@pytest.mark.parametrize("frame", CHAINS)
def test_every_chain_is_its_denavit_hartenberg_table(robot, frame):
    rows, joints = CHAINS[frame]
    columns = robot.indices(joints)
    rng = np.random.default_rng(11)
    for _ in range(1000):
        q = rng.uniform(robot.lower_rad, robot.upper_rad)
        np.testing.assert_allclose(robot.at(q).T_root(frame), end_of(rows, q[columns]), rtol=0, atol=1e-9)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_eyes_are_those_of_the_films_table(robot, side):
    rng = np.random.default_rng(11)
    for _ in range(1000):
        q = rng.uniform(robot.lower_rad, robot.upper_rad)
        pose = head_pose(dict(zip(robot.joint_names, q, strict=True)), side)
        np.testing.assert_allclose(robot.at(q).T_root(f"{side}_eye"), pose, rtol=0, atol=1e-9)


def test_index_tips_in_their_palms(robot):
    posture = robot.at(np.full(robot.n_joints, 0.1))
    np.testing.assert_allclose(
        posture.point("right_index_tip"), posture.point("right_palm", (0.0739, -0.0601, -0.0079))
    )
    np.testing.assert_allclose(posture.point("left_index_tip"), posture.point("left_palm", (0.0739, -0.0601, 0.0079)))


def test_joint_limits_are_the_published_ones(robot):
    for name, lower, upper in zip(robot.joint_names, robot.lower_rad, robot.upper_rad, strict=True):
        kind = name.removeprefix("left_").removeprefix("right_")
        assert (np.rad2deg(lower), np.rad2deg(upper)) == pytest.approx(LIMITS_DEG[kind])


def test_set_gaze_changes_only_what_is_named(robot):
    q = icub.set_gaze(robot, icub.home(robot), yaw=0.1, pitch=-0.2, tilt=0.05, version=0.06, vergence=0.2)
    again = icub.set_gaze(robot, q, version=-0.02)
    expected = q.copy()
    expected[robot.indices(("left_eye_pan", "right_eye_pan"))] = (0.08, -0.12)
    np.testing.assert_allclose(again, expected, atol=1e-12)
    np.testing.assert_allclose(q[robot.indices(robot.names.gaze_joints)], [0.1, -0.2, 0.05, 0.16, -0.04])
    pans = icub.set_gaze(robot, q, vergence=0.3)[robot.indices(("left_eye_pan", "right_eye_pan"))]
    np.testing.assert_allclose(pans, [0.06 + 0.15, 0.06 - 0.15])


def test_the_cameras_are_those_of_the_robots_own_calibration():
    assert read_icub_eyes(shared_data("icub_files", "icubEyes.ini")) == (icub.LEFT_EYE, icub.RIGHT_EYE)


def test_the_setup_has_all_taxels_or_those_given_and_both_arms_at_home(robot):
    setup = icub.icub_setup()
    assert len(setup.skin.taxel_ids) == 2 * (12 + 4)
    assert icub.icub_setup(icub_skin(("left_palm",))).skin.taxel_ids[0] == "left_palm:101"
    assert (setup.side, setup.required) == ("left", ("head",))
    for side, palm in (("left", [-0.30, -0.20, 0.05]), ("right", [-0.30, 0.20, 0.05])):
        q = np.zeros(robot.n_joints)
        q[robot.indices(robot.names.arm(side))] = setup.home_arm(side)
        np.testing.assert_allclose(robot.at(q).point(f"{side}_palm"), palm, atol=1e-4)


def test_a_robot_acts_with_its_left_arm_or_else_its_right_one(robot):
    setup = icub.icub_setup()
    right = replace(setup, robot=Robot(robot.urdf, FrameNames(left_arm=())))
    assert right.side == "right"
    without = replace(setup, robot=Robot(robot.urdf, FrameNames(left_arm=(), right_arm=())))
    with pytest.raises(InputError, match=r"icub\.urdf: has no arm; expected left_arm or right_arm in robot\.toml"):
        print(without.side)


def test_an_arm_port_with_too_few_encoders_is_refused():
    with pytest.raises(ValueError, match="shorter"):
        icub.icub_setup().configuration({"left_arm": np.zeros(5)})


def test_encoders_to_joints_and_back(robot):
    rng = np.random.default_rng(5)
    setup = icub.icub_setup()
    for _ in range(20):
        q = rng.uniform(robot.lower_rad, robot.upper_rad)
        ports = setup.encoders(q)
        assert {name: len(values) for name, values in ports.items()} == {
            "torso": 3, "head": 6, "left_arm": 16, "right_arm": 16,
        }  # fmt: skip
        np.testing.assert_allclose(setup.configuration(ports), q, atol=1e-12)


@pytest.mark.parametrize(
    ("eye", "ahead_px", "beside_px"),
    [("left", (174.742, 102.874), (219.057, 0)), ("right", (157.858, 113.51), (225.904, 0))],
)
def test_each_eye_sees_by_its_own_calibration(eye, ahead_px, beside_px):
    """The principal point, and without its lens's distortion a point at 45° to its right."""
    camera = getattr(icub.icub_rig(icub.load_icub()), eye)
    lens = replace(camera, distortion=(0.0,) * 5)
    np.testing.assert_allclose(camera.project(np.array([0.0, 0, 1])), ahead_px, atol=1e-9)
    np.testing.assert_allclose(lens.project(np.array([1.0, 0, 1])), np.add(ahead_px, beside_px), atol=1e-9)
