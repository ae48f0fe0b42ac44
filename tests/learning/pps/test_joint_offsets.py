"""Encoders with known offsets: touches are located, and the estimated offsets hold in other postures."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from control.fixation import gaze_at
from learning.pps.joint_offsets import TouchTrial, felt_position, joint_offsets
from pps_vision.app.encounters.robots import MiscalibratedRobot, errors_from
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.icub import home, icub_rig, load_icub
from pps_vision.robot.skin import INNER_FOREARM, TOUCH_RADIUS_M, SkinPart, icub_skin, touched_taxels
from pps_vision.types import Array

ROBOT = load_icub()
SKIN = icub_skin(("left_forearm", "left_palm"))
ARM = ROBOT.indices(ROBOT.names.arm("left"))
RADIUS_M = 0.035


def robot_off_by(offsets_rad: Array) -> MiscalibratedRobot:
    """The iCub, all right but for its encoders."""
    return replace(
        MiscalibratedRobot.draw(errors_from(), np.random.default_rng(0)), skin=SKIN, joint_offsets_rad=-offsets_rad
    )


def lying_on(taxel: int, rng: np.random.Generator) -> TouchTrial:
    """The truth: a ball on the forearm, within 1 cm of a taxel, the arm about home, the eyes on the ball."""
    q = home(ROBOT)
    q[ARM] += np.deg2rad(8) * rng.uniform(-1, 1, len(ARM))
    positions, normals = SKIN.at(ROBOT.at(q))
    aside = np.cross(normals[taxel], rng.uniform(-0.01, 0.01, 3))
    p = positions[taxel] + (RADIUS_M + rng.uniform(0, 0.01)) * normals[taxel] + aside
    q = gaze_at(ROBOT, q, p)
    touched = touched_taxels(positions, p, RADIUS_M)
    zero = np.zeros((1, 3))
    return TouchTrial(np.zeros(1), q[None], p[None], zero, np.zeros((1, 3, 3)), np.full(1, RADIUS_M), touched)


def lying(n: int, seed: int) -> list[TouchTrial]:
    rng = np.random.default_rng(seed)
    inner = [SKIN.index(f"left_forearm:{i}") for i in INNER_FOREARM]
    return [lying_on(inner[k % len(inner)], rng) for k in range(n)]


def seen(robot: MiscalibratedRobot, trials: list[TouchTrial]) -> list[TouchTrial]:
    rng = np.random.default_rng(0)  # asked for nothing: these robots' joints do not play
    return [robot.observe(trial, True, rng) for trial in trials]


def miss_mm(robot: MiscalibratedRobot, trials: list[TouchTrial]) -> float:
    """Median distance, in the forearm's frame, from where balls are seen to where they lie."""

    def on_forearm(trial: TouchTrial) -> Array:
        return move_points(inverse(ROBOT.at(trial.joints_rad[0]).T_root(SKIN.parts[0].frame)), trial.positions[0])

    missed = [on_forearm(a) - on_forearm(b) for a, b in zip(seen(robot, trials), trials, strict=True)]
    return 1000 * float(np.median(np.linalg.norm(missed, axis=1)))


def test_a_ball_is_located_from_the_taxels_that_it_touches():
    """One taxel of a plane: on its normal, between just felt and pressed on.  Two: between them."""
    apart = 0.02 * np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0)), axis=-1).reshape(-1, 2)
    positions = np.column_stack([apart, np.zeros(16)])
    plane = SkinPart("plane", "frame", tuple(range(16)), positions, np.tile([0.0, 0.0, 1.0], (16, 1)))
    alone = SkinPart("alone", "frame", (0,), positions[5:6], plane.normals[5:6])
    (x, y, z), cov = felt_position(alone, np.ones(1, bool), RADIUS_M)
    np.testing.assert_allclose([x, y], positions[5, :2], atol=0.003)
    assert RADIUS_M / 2 < z < RADIUS_M + TOUCH_RADIUS_M
    assert cov[0, 0] == pytest.approx(cov[1, 1], rel=0.1)
    assert 0.012**2 < cov[2, 2] < cov[0, 0] < 0.05**2, "it may be further aside than off the plane"
    between, _ = felt_position(plane, np.isin(np.arange(16), (5, 6)), 0.005)
    np.testing.assert_allclose(between[:2], positions[5:7, :2].mean(axis=0), atol=0.003)
    rng = np.random.default_rng(SEED)
    missed = []
    sigmas = []
    for _ in range(40):
        ball = np.append(rng.uniform(0, 0.06, 2), RADIUS_M + rng.uniform(0, 0.015))
        mean, cov = felt_position(plane, touched_taxels(positions, ball, RADIUS_M), RADIUS_M)
        missed.append(mean - ball)
        sigmas.append(np.sqrt(missed[-1] @ np.linalg.solve(cov + 0.002**2 * np.eye(3), missed[-1])))
    assert np.median(np.linalg.norm(missed, axis=1)) < 0.015
    assert 1.0 < np.median(sigmas) < 2.2  # of three standard normal numbers: 1.5


@pytest.mark.parametrize("seed", [SEED, SEED + 1])
def test_estimated_offsets_hold_in_other_postures(seed):
    off = robot_off_by(np.deg2rad(2.0) * np.random.default_rng(seed).standard_normal(ROBOT.n_joints))
    better = off.calibrated(seen(off, lying(30, seed)))
    assert miss_mm(better, lying(24, seed + 1)) < min(8, miss_mm(off, lying(24, seed + 1)))


def test_an_error_of_the_vergence_is_not_attributed_to_the_arm():
    pans = ROBOT.indices(("left_eye_pan", "right_eye_pan"))
    offsets = np.zeros(ROBOT.n_joints)
    offsets[pans] = np.deg2rad([2.0, -2.0])
    off = robot_off_by(offsets)
    touches = seen(off, lying(30, SEED))
    estimate = np.rad2deg(joint_offsets(off.model, off.rig, off.skin, touches).offsets_rad)
    assert estimate[pans[0]] - estimate[pans[1]] == pytest.approx(4.0, abs=1.2)
    assert np.abs(np.delete(estimate, pans)).max() < 2.0


def test_one_outlier_changes_little():
    off = robot_off_by(np.deg2rad(2.0) * np.random.default_rng(SEED).standard_normal(ROBOT.n_joints))
    trials = seen(off, lying(20, SEED))
    wild = replace(trials[3], positions=trials[3].positions + np.array([0.1, 0.2, -0.1]))
    without = off.calibrated(trials)
    with_it = off.calibrated([*trials[:3], wild, *trials[4:]])
    others = lying(10, SEED + 1)
    assert miss_mm(with_it, others) < miss_mm(without, others) + 4


def test_without_errors_little_is_estimated_and_without_touches_nothing():
    right = robot_off_by(np.zeros(ROBOT.n_joints))
    trials = seen(right, lying(20, SEED))
    assert miss_mm(right.calibrated(trials), lying(10, SEED + 1)) < 8
    untouched = [replace(trial, touched=np.zeros_like(trial.touched)) for trial in trials]
    unseen = [replace(trial, positions=np.full((1, 3), np.nan)) for trial in trials]
    of_no_size = [replace(trial, radius_m=np.full(1, np.nan)) for trial in trials]
    for nothing in ([], untouched, unseen, of_no_size):
        estimate = joint_offsets(ROBOT, icub_rig(ROBOT), SKIN, nothing)
        np.testing.assert_array_equal(estimate.offsets_rad, 0)
        assert len(estimate.before_m) == len(estimate.after_m) == 0
