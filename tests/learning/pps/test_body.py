"""Touches by a seen ball: what they correct of a robot whose taxels or encoders are off, and of one that is right; the
estimated offsets of the encoders hold in other postures."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from control.fixation import gaze_at
from learning.pps.body import learned_body
from learning.pps.joint_offsets import TouchTrial, joint_offsets, seen_from
from pps_vision.app.encounters.robots import ErrorSources, MiscalibratedRobot
from pps_vision.experiments.pps.erring import calibrated, observe
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.icub import home, icub_rig, load_icub
from pps_vision.robot.skin import INNER_FOREARM, Skin, icub_skin, touched_taxels
from pps_vision.types import Array

ROBOT = load_icub()
SKIN = icub_skin(("left_forearm",))
ARM = ROBOT.indices(ROBOT.names.arm("left"))
INNER = [SKIN.parts[0].ids.index(i) for i in INNER_FOREARM]
RADIUS_M = 0.03
STEP_M = 0.005


def touch(k: int, rng: np.random.Generator) -> TouchTrial:
    """The truth: a ball that comes down about an inner taxel, in the frame of its first touch."""
    q = home(ROBOT)
    q[ARM] += np.deg2rad(8) * rng.uniform(-1, 1, len(ARM))
    positions, normals = SKIN.at(ROBOT.at(q))
    taxel = INNER[k % len(INNER)]
    aim = positions[taxel] + 0.012 * rng.standard_normal(3)
    path = aim + np.arange(0.15, -0.05, -STEP_M)[:, None] * normals[taxel]
    p = path[np.argmax([touched_taxels(positions, p, RADIUS_M).any() for p in path])]
    q = gaze_at(ROBOT, q, p)
    zero = np.zeros((1, 3))
    touched = touched_taxels(positions, p, RADIUS_M)
    return TouchTrial(np.zeros(1), q[None], p[None], zero, np.zeros((1, 3, 3)), np.full(1, RADIUS_M), touched)


def touches_of(
    robot: MiscalibratedRobot, n: int, seed: int, noise_m: float = 0.002
) -> list[tuple[TouchTrial, TouchTrial]]:
    """True touches, and what the robot measures of them: positions 2 mm off, each axis."""
    rng = np.random.default_rng(seed)
    true = [touch(k, rng) for k in range(n)]
    seen = [observe(robot, trial, True, rng) for trial in true]
    return [
        (t, replace(s, positions=s.positions + noise_m * rng.standard_normal((1, 3))))
        for t, s in zip(true, seen, strict=True)
    ]


def robot_off_by(taxels_m: float, encoders_deg: float, seed: int = SEED) -> MiscalibratedRobot:
    rng = np.random.default_rng(seed)
    part = SKIN.parts[0]
    positions = part.positions_m + taxels_m / np.sqrt(3) * rng.standard_normal(part.positions_m.shape)
    offsets = np.deg2rad(encoders_deg) * rng.standard_normal(ROBOT.n_joints)
    right = MiscalibratedRobot.draw(ErrorSources().scaled(0), rng)
    return replace(right, skin=Skin((replace(part, positions_m=positions),)), joint_offsets_rad=offsets)


def misjudged_mm(robot: MiscalibratedRobot, offsets_rad: Array, positions_m: Array) -> float:
    """RMS error of where a touching ball lies relative to the inner taxels, of touches not learned from."""
    off = []
    for true, seen in touches_of(robot, 24, SEED + 1):
        at, believed = (
            seen_from(robot.model, robot.rig, SKIN.parts[0].frame, trial, offsets)
            for trial, offsets in ((true, np.zeros(ROBOT.n_joints)), (seen, offsets_rad))
        )
        off.append((believed - positions_m[INNER]) - (at - SKIN.parts[0].positions_m[INNER]))
    return 1000 * float(np.sqrt(np.mean(np.sum(np.square(off), axis=-1))))


@pytest.mark.parametrize(("taxels_m", "encoders_deg"), [(0.03, 0.0), (0.02, 1.5)])
def test_touches_correct_taxels_and_encoders_that_are_off(taxels_m, encoders_deg):
    robot = robot_off_by(taxels_m, encoders_deg)
    body = learned_body(robot.model, robot.rig, robot.skin, [seen for _, seen in touches_of(robot, 80, SEED)])
    before = misjudged_mm(robot, 0 * body.offsets_rad, robot.skin.parts[0].positions_m)
    after = misjudged_mm(robot, body.offsets_rad, body.positions_m)
    assert before > 18
    assert after < min(0.6 * before, 22), str(body)


def test_a_right_robot_is_left_as_it_is():
    robot = robot_off_by(0.0, 0.0)
    body = learned_body(robot.model, robot.rig, SKIN, [seen for _, seen in touches_of(robot, 40, SEED)])
    assert not body.is_corrected, str(body)
    assert "left as they are" in str(body)


def seen_by(robot: MiscalibratedRobot, n: int, seed: int) -> list[TouchTrial]:
    """What a robot measures of touches, without noise."""
    return [seen for _, seen in touches_of(robot, n, seed, 0.0)]


def miss_mm(robot: MiscalibratedRobot, n: int, seed: int) -> float:
    """Median distance, in the forearm's frame, from where balls are seen to where they are."""

    def on_forearm(trial: TouchTrial) -> Array:
        return move_points(inverse(ROBOT.at(trial.joints_rad[0]).T_root(SKIN.parts[0].frame)), trial.positions[0])

    missed = [on_forearm(seen) - on_forearm(true) for true, seen in touches_of(robot, n, seed, 0.0)]
    return 1000 * float(np.median(np.linalg.norm(missed, axis=1)))


@pytest.mark.parametrize("seed", [SEED, SEED + 1])
def test_estimated_offsets_hold_in_other_postures(seed):
    off = robot_off_by(0.0, 2.0, seed)
    better = calibrated(off, seen_by(off, 30, seed))
    assert miss_mm(better, 24, seed + 1) < min(8, miss_mm(off, 24, seed + 1))


def test_an_error_of_the_vergence_is_not_attributed_to_the_arm():
    pans = ROBOT.indices(("left_eye_pan", "right_eye_pan"))
    offsets = np.zeros(ROBOT.n_joints)
    offsets[pans] = np.deg2rad([2.0, -2.0])
    off = replace(robot_off_by(0.0, 0.0), joint_offsets_rad=-offsets)
    estimate = np.rad2deg(joint_offsets(off.model, off.rig, off.skin, seen_by(off, 30, SEED)).offsets_rad)
    assert estimate[pans[0]] - estimate[pans[1]] == pytest.approx(4.0, abs=1.2)
    assert np.abs(np.delete(estimate, pans)).max() < 2.0


def test_one_outlier_changes_little():
    off = robot_off_by(0.0, 2.0)
    trials = seen_by(off, 20, SEED)
    wild = replace(trials[3], positions=trials[3].positions + np.array([0.1, 0.2, -0.1]))
    without = calibrated(off, trials)
    with_it = calibrated(off, [*trials[:3], wild, *trials[4:]])
    assert miss_mm(with_it, 10, SEED + 1) < miss_mm(without, 10, SEED + 1) + 4


def test_without_errors_little_is_estimated_and_without_touches_nothing():
    right = robot_off_by(0.0, 0.0)
    trials = seen_by(right, 20, SEED)
    assert miss_mm(calibrated(right, trials), 10, SEED + 1) < 1
    untouched = [replace(trial, touched=np.zeros_like(trial.touched)) for trial in trials]
    unseen = [replace(trial, positions=np.full((1, 3), np.nan)) for trial in trials]
    of_no_size = [replace(trial, radius_m=np.full(1, np.nan)) for trial in trials]
    for nothing in ([], untouched, unseen, of_no_size):
        estimate = joint_offsets(ROBOT, icub_rig(ROBOT), SKIN, nothing)
        np.testing.assert_array_equal(estimate.offsets_rad, 0)
        assert len(estimate.before_m) == len(estimate.after_m) == 0
