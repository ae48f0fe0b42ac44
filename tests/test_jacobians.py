"""Every Jacobian of robot and control against central differences, at random postures."""

from collections.abc import Callable

import numpy as np
import pytest

from control.arm import KeepIn
from control.fixation import features
from pps_vision.robot.icub import load_icub, set_gaze
from pps_vision.types import Array

ROBOT = load_icub()
POINT = np.array([0.03, -0.05, 0.08])


def central_differences(f: Callable[[Array], Array], x: Array, h: float = 1e-6) -> Array:
    """(m, n) derivatives of f (m,) by x (n,)."""
    return np.column_stack([(f(x + h * e) - f(x - h * e)) / (2 * h) for e in np.eye(len(x))])


def point_of(frame: str) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    return lambda q: ROBOT.at(q).point(frame, POINT), lambda q: ROBOT.at(q).jacobian(frame, POINT)[:3]


TARGET = np.array([-0.35, 0.05, 0.2])
KEEP_IN = KeepIn("left_palm", np.array([-0.2, -0.1, 0.1]), 0.2)
BY_JOINTS = {
    "palm": point_of("left_palm"),
    "forearm": point_of("right_forearm"),
    "eye": point_of("left_eye"),
    "fingertip": point_of("right_index_tip"),
    "features of fixation": (lambda q: features(ROBOT.at(q), TARGET)[0], lambda q: features(ROBOT.at(q), TARGET)[1]),
    "distance from a sphere's centre": (
        lambda q: np.linalg.norm(ROBOT.at(q).point("left_palm") - KEEP_IN.center_root, keepdims=True),
        lambda q: KEEP_IN.row(ROBOT.at(q), list(range(ROBOT.n_joints)))[0][None],
    ),
}


@pytest.fixture(params=range(4))
def q(request: pytest.FixtureRequest) -> Array:
    """Any posture, whose eyes look ahead."""
    rng = np.random.default_rng((3, request.param))
    yaw, pitch, tilt = rng.uniform([-0.9, -0.6, -0.3], [0.9, 0.5, 0.2])
    return set_gaze(ROBOT, rng.uniform(ROBOT.lower_rad, ROBOT.upper_rad), yaw, pitch, tilt, 0.1, 0.3)


@pytest.mark.parametrize("name", BY_JOINTS)
def test_derivatives_by_the_joints(name, q):
    f, jacobian = BY_JOINTS[name]
    np.testing.assert_allclose(jacobian(q), central_differences(f, q), atol=1e-6)


def test_features_of_fixation_by_the_target(q):
    expected = central_differences(lambda p: features(ROBOT.at(q), p)[0], TARGET)
    np.testing.assert_allclose(features(ROBOT.at(q), TARGET)[2], expected, atol=1e-6)
