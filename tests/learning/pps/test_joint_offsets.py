"""Encoders with known offsets: touches are located, and the estimated offsets hold in other postures."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from control.fixation import gaze_at
from learning.pps.joint_offsets import TouchTrial, joint_offsets
from pps_vision.app.encounters.robots import ErrorSources, MiscalibratedRobot
from pps_vision.experiments.pps.erring import calibrated, observe
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.icub import home, icub_rig, load_icub
from pps_vision.robot.skin import INNER_FOREARM, icub_skin, touched_taxels
from pps_vision.types import Array

ROBOT = load_icub()
SKIN = icub_skin(("left_forearm", "left_palm"))
ARM = ROBOT.indices(ROBOT.names.arm("left"))
RADIUS_M = 0.035
STEP_M = 0.005


def robot_off_by(offsets_rad: Array) -> MiscalibratedRobot:
    """The iCub, all right but for its encoders."""
    return replace(
        MiscalibratedRobot.draw(ErrorSources().scaled(0), np.random.default_rng(0)),
        skin=SKIN,
        joint_offsets_rad=-offsets_rad,
    )


def touching(taxel: int, rng: np.random.Generator) -> TouchTrial:
    """The truth: a ball that comes within 1 cm of a taxel's normal, when it is first felt; the arm about home, the eyes
    on the ball."""
    q = home(ROBOT)
    q[ARM] += np.deg2rad(8) * rng.uniform(-1, 1, len(ARM))
    positions, normals = SKIN.at(ROBOT.at(q))
    aside = np.cross(normals[taxel], rng.uniform(-0.01, 0.01, 3))
    path = positions[taxel] + aside + np.arange(0.12, 0.0, -STEP_M)[:, None] * normals[taxel]
    p = path[np.argmax([touched_taxels(positions, p, RADIUS_M).any() for p in path])]
    q = gaze_at(ROBOT, q, p)
    touched = touched_taxels(positions, p, RADIUS_M)
    zero = np.zeros((1, 3))
    return TouchTrial(np.zeros(1), q[None], p[None], zero, np.zeros((1, 3, 3)), np.full(1, RADIUS_M), touched)


def touches(n: int, seed: int) -> list[TouchTrial]:
    rng = np.random.default_rng(seed)
    inner = [SKIN.index(f"left_forearm:{i}") for i in INNER_FOREARM]
    return [touching(inner[k % len(inner)], rng) for k in range(n)]


def seen(robot: MiscalibratedRobot, trials: list[TouchTrial]) -> list[TouchTrial]:
    rng = np.random.default_rng(0)  # asked for nothing: these robots' joints do not play
    return [observe(robot, trial, True, rng) for trial in trials]


def miss_mm(robot: MiscalibratedRobot, trials: list[TouchTrial]) -> float:
    """Median distance, in the forearm's frame, from where balls are seen to where they are."""

    def on_forearm(trial: TouchTrial) -> Array:
        return move_points(inverse(ROBOT.at(trial.joints_rad[0]).T_root(SKIN.parts[0].frame)), trial.positions[0])

    missed = [on_forearm(a) - on_forearm(b) for a, b in zip(seen(robot, trials), trials, strict=True)]
    return 1000 * float(np.median(np.linalg.norm(missed, axis=1)))


@pytest.mark.parametrize("seed", [SEED, SEED + 1])
def test_estimated_offsets_hold_in_other_postures(seed):
    off = robot_off_by(np.deg2rad(2.0) * np.random.default_rng(seed).standard_normal(ROBOT.n_joints))
    better = calibrated(off, seen(off, touches(30, seed)))
    assert miss_mm(better, touches(24, seed + 1)) < min(8, miss_mm(off, touches(24, seed + 1)))


def test_an_error_of_the_vergence_is_not_attributed_to_the_arm():
    pans = ROBOT.indices(("left_eye_pan", "right_eye_pan"))
    offsets = np.zeros(ROBOT.n_joints)
    offsets[pans] = np.deg2rad([2.0, -2.0])
    off = robot_off_by(offsets)
    seen_touches = seen(off, touches(30, SEED))
    estimate = np.rad2deg(joint_offsets(off.model, off.rig, off.skin, seen_touches).offsets_rad)
    assert estimate[pans[0]] - estimate[pans[1]] == pytest.approx(4.0, abs=1.2)
    assert np.abs(np.delete(estimate, pans)).max() < 2.0


def test_one_outlier_changes_little():
    off = robot_off_by(np.deg2rad(2.0) * np.random.default_rng(SEED).standard_normal(ROBOT.n_joints))
    trials = seen(off, touches(20, SEED))
    wild = replace(trials[3], positions=trials[3].positions + np.array([0.1, 0.2, -0.1]))
    without = calibrated(off, trials)
    with_it = calibrated(off, [*trials[:3], wild, *trials[4:]])
    others = touches(10, SEED + 1)
    assert miss_mm(with_it, others) < miss_mm(without, others) + 4


def test_without_errors_little_is_estimated_and_without_touches_nothing():
    right = robot_off_by(np.zeros(ROBOT.n_joints))
    trials = seen(right, touches(20, SEED))
    assert miss_mm(calibrated(right, trials), touches(10, SEED + 1)) < 1
    untouched = [replace(trial, touched=np.zeros_like(trial.touched)) for trial in trials]
    unseen = [replace(trial, positions=np.full((1, 3), np.nan)) for trial in trials]
    of_no_size = [replace(trial, radius_m=np.full(1, np.nan)) for trial in trials]
    for nothing in ([], untouched, unseen, of_no_size):
        estimate = joint_offsets(ROBOT, icub_rig(ROBOT), SKIN, nothing)
        np.testing.assert_array_equal(estimate.offsets_rad, 0)
        assert len(estimate.before_m) == len(estimate.after_m) == 0
