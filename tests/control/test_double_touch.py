"""Double touch: the fingertip truly arrives, along the normal, within every limit, by Pinocchio's own kinematics."""

from typing import get_args

import numpy as np
import pytest
from data import SEED

from control.double_touch import (
    FINGERTIP_RADIUS_M,
    DoubleTouch,
    DoubleTouching,
    DoubleTouchParams,
    Infeasible,
)
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import SkinPart, icub_skin

PART = icub_skin(("left_forearm",)).parts[0]
TAXELS = (27, 183, 135)  # the inner forearm's corners


@pytest.fixture(scope="module")
def planned(robot: Robot) -> dict[int, tuple[DoubleTouch | Infeasible, ...]]:
    planner = DoubleTouching(robot, PART)
    return {i: planner.plan(PART.ids.index(i), 8, np.random.default_rng((SEED, i))) for i in TAXELS}


@pytest.fixture(scope="module")
def touches(planned) -> list[tuple[int, DoubleTouch]]:
    return [(i, touch) for i, outcome in planned.items() for touch in outcome if isinstance(touch, DoubleTouch)]


def by_the_skin(robot: Robot, taxel: int, touch: DoubleTouch) -> tuple[np.ndarray, np.ndarray]:
    """Height (T,) of the fingertip's centre over a taxel, and how far beside the normal it is (T,)."""
    k = PART.ids.index(taxel)
    height = []
    aside = []
    for q in touch.joints_rad:
        posture = robot.at(q)
        normal = posture.T_root("left_forearm")[:3, :3] @ PART.normals[k]
        offset = posture.point("right_index_tip") - posture.point("left_forearm", PART.positions_m[k])
        height.append(offset @ normal)
        aside.append(np.linalg.norm(offset - height[-1] * normal))
    return np.array(height), np.array(aside)


def test_most_starts_lead_to_a_touch_and_the_others_have_a_reason(planned):
    outcomes = [outcome for plans_of_taxel in planned.values() for outcome in plans_of_taxel]
    reasons = [outcome for outcome in outcomes if not isinstance(outcome, DoubleTouch)]
    print(f"seed {SEED}: {len(outcomes)} starts, {reasons}")
    assert len(reasons) <= 0.4 * len(outcomes)
    assert set(reasons) <= set(get_args(Infeasible))


def test_the_fingertip_arrives_along_the_normal(robot, touches):
    """The finger opposes it, at the speed of a minimum-jerk movement that presses on."""
    finger = next(b for b in robot.bodies if b.name == "right_palm_4")  # as the robot's description draws it
    starts_aside = []
    for taxel, touch in touches:
        height, aside = by_the_skin(robot, taxel, touch)
        assert height[-1] == pytest.approx(FINGERTIP_RADIUS_M, abs=1e-4)
        assert aside[-1] < 1e-4
        assert aside[height < 0.05].max() < 0.005
        assert np.all(np.diff(height) < 0)
        assert 0.209 < height[0] < 0.2191
        starts_aside.append(aside[0])
        speed = -np.diff(height) / 0.05
        assert 0.097 < speed.max() < 0.162
        assert 0.4 < speed[-1] / speed.max() < 0.9  # still moving when it touches
        assert speed[0] < 0.2 * speed.max()
        posture = robot.at(touch.joints_rad[-1])
        points = posture.T_root("right_palm")[:3, :3] @ finger.T_frame_body[:3, 2]
        normal = posture.T_root("left_forearm")[:3, :3] @ PART.normals[PART.ids.index(taxel)]
        assert points @ normal < -np.cos(np.deg2rad(3))
    assert 0.04 < max(starts_aside) < 0.06


def test_joints_of_both_arms_move_from_varied_starts_keep_their_limits_and_never_jump(robot, touches):
    left, right = (robot.indices(robot.names.arm(side)) for side in ("left", "right"))
    for _, touch in touches:
        assert np.all(touch.joints_rad >= robot.lower_rad - 1e-9)
        assert np.all(touch.joints_rad <= robot.upper_rad + 1e-9)
        steps = np.diff(touch.stamps_s)
        np.testing.assert_allclose(steps, 0.05)
        rates = np.diff(touch.joints_rad, axis=0) / steps[:, None]
        assert np.abs(rates).max() <= np.deg2rad(60)
        assert np.abs(np.diff(rates, axis=0)).max() < np.deg2rad(25)  # 500°/s²: no jump in velocity either
        moved = np.ptp(touch.joints_rad, axis=0)
        assert min(moved[left].max(), moved[right].max()) > np.deg2rad(2)
    starts = np.rad2deg([touch.joints_rad[0] for _, touch in touches])
    assert starts[:, left[:5] + right].std(axis=0).min() > 4


def test_every_reason_of_failure_is_reported(robot):
    rng = np.random.default_rng(1)
    rushed = DoubleTouching(robot, PART, DoubleTouchParams(max_rate_rad_s=np.deg2rad(2.0)))
    assert set(rushed.plan(0, 2, rng)) == {"too fast"}
    shy = DoubleTouching(robot, PART, DoubleTouchParams(clearance_m=0.2))
    assert set(shy.plan(0, 2, rng)) == {"self-collision"}
    distant = SkinPart("far", "left_forearm", (1,), np.array([[0.0, 0.9, 0.0]]), np.array([[0.0, 1.0, 0.0]]))
    assert set(DoubleTouching(robot, distant).plan(0, 2, rng)) == {"out of reach"}
