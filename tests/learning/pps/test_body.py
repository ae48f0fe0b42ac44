"""Touches by a seen ball: what they correct of a robot whose taxels or encoders are off, and of one that is right."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from control.fixation import gaze_at
from learning.pps.body import learned_body
from learning.pps.joint_offsets import TouchTrial, seen_from
from pps_vision.app.encounters.robots import ErrorSources, MiscalibratedRobot
from pps_vision.experiments.pps.erring import observe
from pps_vision.robot.icub import home, load_icub
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


def touches_of(robot: MiscalibratedRobot, n: int, seed: int) -> list[tuple[TouchTrial, TouchTrial]]:
    """True touches, and what the robot measures of them: positions 2 mm off, each axis."""
    rng = np.random.default_rng(seed)
    true = [touch(k, rng) for k in range(n)]
    seen = [observe(robot, trial, True, rng) for trial in true]
    return [
        (t, replace(s, positions=s.positions + 0.002 * rng.standard_normal((1, 3))))
        for t, s in zip(true, seen, strict=True)
    ]


def robot_off_by(taxels_m: float, encoders_deg: float) -> MiscalibratedRobot:
    rng = np.random.default_rng(SEED)
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
