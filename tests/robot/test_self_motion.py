"""Walking along the postures that leave the hand where it is; reaching, then improving: the arm in closed form."""

import numpy as np
import pytest
from data import SEED

from pps_vision.robot.self_motion import (
    FarFromLimits,
    Manipulability,
    WalkParams,
    walk,
)

LOWER = np.full(3, -np.pi)
UPPER = np.full(3, np.pi)


def planar(q):
    """Three links of 1 m in a plane."""
    angles = np.cumsum(q, axis=1)
    ends = np.stack([np.cos(angles), np.sin(angles)], axis=1)  # (N, 2, 3)
    J = np.cumsum(np.stack([-ends[:, 1], ends[:, 0]], axis=1)[:, :, ::-1], axis=2)[:, :, ::-1]
    return ends.sum(axis=2), J


def test_postures_off_the_target_do_not_count():
    """Steps so long that two corrections do not bring the hand back, although the limits allow them."""
    rng = np.random.default_rng(SEED)
    q = rng.uniform(-1.5, 1.5, (300, 3))
    targets, _ = planar(q)
    walked, _ = walk(planar, targets, q, LOWER, UPPER, FarFromLimits(LOWER, UPPER), WalkParams(step_rad=1.5, steps=4))
    assert np.abs(walked - q).max() > 0.1
    assert np.linalg.norm(planar(walked)[0] - targets, axis=1).max() <= WalkParams().tolerance


def test_manipulability_is_the_volume_and_vanishes_where_the_arm_is_straight():
    _, J = planar(np.array([[0.3, 0.0, 0.0], [0.3, 1.2, 0.4]]))
    volume = Manipulability()(None, J)
    assert volume[0] == pytest.approx(0, abs=1e-9)
    assert volume[1] == pytest.approx(np.sqrt(np.linalg.det(J[1] @ J[1].T)))
    assert Manipulability(2.0)(None, J)[1] == pytest.approx(volume[1] / 2)
    even = Manipulability(isotropy=True)(None, J)
    assert even[0] == pytest.approx(0, abs=1e-9)
    assert even[1] == pytest.approx(1 / np.linalg.cond(J[1]))
