"""R's sessions and J's motor babbling, rendered as recordings: `pps-vision session`.

R's three milestones: the robot's own finger, or an object in a hand, touches the skin.  J's: an arm moves at random
while the eyes fixate the hand.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import count, cycle, islice
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from control import fixation
from control.double_touch import FINGERTIP_RADIUS_M, DoubleTouch, DoubleTouching, minimum_jerk
from control.fixation import gaze_at
from learning.pps.joint_offsets import TouchTrial
from learning.reach.babbling import gaze_at_hand, random_arms
from pps_vision.app.encounters.encounter import SessionName, start_posture
from pps_vision.app.encounters.robots import true_robot
from pps_vision.app.progress import progress
from pps_vision.app.render import write_recording
from pps_vision.app.simulation import Side, can_follow
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import icub_setup
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import INNER_FOREARM, OUTER_FOREARM, Skin, icub_skin, taxel_frame, touched_taxels
from pps_vision.types import Array, Mask
from rendering.eyes import Eyes
from rendering.motions import make_reach
from rendering.names import CarrierName, StimulusName
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus

AIMED: dict[SessionName, tuple[str, tuple[int, ...]]] = {
    **dict.fromkeys(("motor", "visual", "inner"), ("left_forearm", INNER_FOREARM)),
    "outer": ("left_forearm", OUTER_FOREARM),
    "palm": ("right_palm", (101, 103, 118, 137)),
}
"""The skin part and its taxels that each session aims at."""
STEP_S = 0.05
_OBJECTS: tuple[StimulusName, ...] = ("ball", "cube")
_START_M = (0.21, 0.25)  # just beyond the receptive field: the eyes fixate the object when it enters
_PEAK_M_S = (0.10, 0.25)
_SCATTER_M = 0.025  # standard deviation of the end point about the taxel aimed at, each axis
_DEEPEST_M = -0.005  # greatest penetration of a taxel on the way
_MARGIN_PX = 15.0  # smallest distance of a fingertip from the image's edge
_BATCH = 12  # double touches planned at once
_SKIPPED_SHARE = 0.15  # the first part of a reach, in which it hardly moves
_HAND_M = 0.06  # radius of the marker about the hand of a robot that babbles: fingers and wrist stand out of it
_MAX_RATE_RAD_S = np.deg2rad(60.0)  # rate of a babbling arm
_DRAWN = 64  # arm postures drawn at once


class Movement(NamedTuple):
    """An object, its orientation, and the true trial, with the eyes as at the start."""

    stimulus: StimulusName
    rotation: Array  # (3, 3) from the object's to the root frame
    trial: TouchTrial  # with `touched` (n,) of the whole skin


@cache  # several parts use the same movements
def movements(session: SessionName, n: int, seed: int) -> tuple[Movement, ...]:
    """Return the first `n` movements of a session; movement k does not depend on `n`."""
    if session in ("motor", "visual"):
        return tuple(islice(_double_touches(session, seed), n))
    return tuple(_approach(session, k, seed) for k in range(n))


def gaze_mask(robot: Robot) -> Mask:
    """Return a mask (k,) of the joints that turn head and eyes."""
    mask = np.zeros(robot.n_joints, dtype=bool)
    mask[robot.indices(robot.names.gaze_joints)] = True
    return mask


def _approach(session: SessionName, k: int, seed: int) -> Movement:
    """Draw approach `k` until it touches the skin and the eyes can follow it."""
    robot, rig, skin = true_robot()
    rng = np.random.default_rng((seed, get_args(SessionName).index(session), 1, k))
    part, ids = AIMED[session]
    aimed = skin.index(f"{part}:{ids[k % len(ids)]}")
    stimulus = _OBJECTS[k % len(_OBJECTS)]
    radius = make_stimulus(stimulus, fineness=0).radius_m
    q = start_posture(robot, session)
    positions, normals = skin.at(robot.at(q))
    T = taxel_frame(positions[aimed], normals[aimed])
    for _ in range(500):
        end = T[:3, :3] @ np.array([*(_SCATTER_M * rng.standard_normal(2)), radius]) + T[:3, 3]
        reach = make_reach(rng, end, T[:3, 2], rng.uniform(*_START_M), rng.uniform(*_PEAK_M_S))
        n = int((1 - _SKIPPED_SHARE) * reach.arrives_s / STEP_S)
        stamps = reach.arrives_s - STEP_S * np.arange(n, -1, -1)
        path, velocities = (np.array(samples) for samples in zip(*(reach(float(t)) for t in stamps), strict=True))
        touched = touched_taxels(positions, path[-1], radius)
        gap = np.linalg.norm(path[:, None] - positions, axis=2).min(axis=1) - radius
        is_allowed = touched.any() and gap.min() > _DEEPEST_M
        if is_allowed and can_follow(robot, rig, q, reach, reach.arrives_s):
            rotation = Rotation.random(random_state=rng).as_matrix()
            joints = np.tile(gaze_at(robot, q, path[0]), (len(stamps), 1))
            return Movement(stimulus, rotation, _true_trial(stamps, joints, path, velocities, touched, radius))
    problem = f"no approach to {skin.taxel_ids[aimed]} stays in view of both eyes"
    raise ValueError(f"{problem}; expected a taxel that its posture shows")


def _double_touches(session: SessionName, seed: int) -> Iterator[Movement]:
    """Double touches of the inner taxels, one after another; in the visual session only those in view of both eyes."""
    robot, rig, skin = true_robot()
    planner = DoubleTouching(robot, icub_skin(("left_forearm",)).parts[0])
    key = (seed, get_args(SessionName).index(session))
    touches = {i: (_finger_movement(robot, skin, plan) for plan in _plans(planner, i, key)) for i in INNER_FOREARM}
    for i in cycle(INNER_FOREARM):
        yield next(movement for movement in touches[i] if session == "motor" or _is_in_view(robot, rig, movement.trial))


def _plans(planner: DoubleTouching, taxel_id: int, key: tuple[int, ...]) -> Iterator[DoubleTouch]:
    """Feasible double touches of one taxel within reach, drawn with the seed `key`."""
    taxel = planner.part.ids.index(taxel_id)
    for batch in count():
        plans = planner.plan(taxel, _BATCH, np.random.default_rng((*key, taxel, batch)))
        yield from (plan for plan in plans if isinstance(plan, DoubleTouch))


def _finger_movement(robot: Robot, skin: Skin, touch: DoubleTouch) -> Movement:
    """The true movement of the right index fingertip, which ends with a touch of the skin."""
    tip = np.array([robot.at(q).point(robot.names.index_tips[1]) for q in touch.joints_rad])
    velocities = np.gradient(tip, touch.stamps_s, axis=0, edge_order=2)
    joints = np.where(gaze_mask(robot), gaze_at(robot, touch.joints_rad[0], tip[0]), touch.joints_rad)
    positions, _ = skin.at(robot.at(joints[-1]))
    touched = touched_taxels(positions, tip[-1], FINGERTIP_RADIUS_M)
    trial = _true_trial(touch.stamps_s, joints, tip, velocities, touched, FINGERTIP_RADIUS_M)
    return Movement("marker", np.eye(3), trial)


def _true_trial(
    stamps_s: Array, joints_rad: Array, path: Array, velocities: Array, touched: Mask, radius_m: float
) -> TouchTrial:
    """The trial of an object without errors, its stamps from 0."""
    n = len(path)
    covs = np.zeros((n, 3, 3))
    return TouchTrial(stamps_s - stamps_s[0], joints_rad, path, velocities, covs, np.full(n, radius_m), touched)


def _is_in_view(robot: Robot, rig: StereoRig, trial: TouchTrial) -> bool:
    """Whether both eyes, fixating the fingertip, have it in their image along its way."""
    samples = zip(trial.joints_rad[::-8], trial.positions[::-8], strict=True)
    views = ((rig.view(gaze_at(robot, q, tip)), tip) for q, tip in samples)
    return all(view.left.sees(tip, _MARGIN_PX) and view.right.sees(tip, _MARGIN_PX) for view, tip in views)


def babbling(side: Side, n: int, seed: int) -> Movement:
    """Return `n` samples of an arm that moves between random postures, with a marker about its palm (J IV C).

    The postures are uniform within J's limits, of those whose hand the eyes can fixate; each joint moves at up to 60°/s
    with minimum jerk.  The other arm hangs down.
    """
    robot, _, skin = true_robot()
    rng = np.random.default_rng((seed, get_args(Side).index(side)))
    q = start_posture(robot, "palm" if side == "left" else "outer")
    arm = robot.indices(robot.names.arm(side))
    q[arm] = 0.0
    pieces: list[Array] = []
    at: Array | None = None
    while sum(map(len, pieces)) < n:
        postures = random_arms(_DRAWN, rng)
        for to in postures[np.isfinite(gaze_at_hand(robot, side, postures)).all(axis=1)]:
            if at is not None:
                steps = int(np.ceil(1.875 * np.abs(to - at).max() / (_MAX_RATE_RAD_S * STEP_S)))
                pieces.append(at + minimum_jerk(np.arange(steps) / steps)[:, None] * (to - at))
            at = to
    joints = np.tile(q, (n, 1))
    joints[:, arm[: len(to)]] = np.concatenate(pieces)[:n]
    stamps = STEP_S * np.arange(n)
    hand = np.array([robot.at(q).point(robot.names.palm(side)) for q in joints])
    joints[0] = gaze_at(robot, joints[0], hand[0])
    velocities = np.gradient(hand, stamps, axis=0)
    nothing = np.zeros(len(skin.taxel_ids), dtype=bool)
    return Movement("marker", np.eye(3), _true_trial(stamps, joints, hand, velocities, nothing, _HAND_M))


def watched(movement: Movement) -> Iterator[tuple[float, SceneState]]:
    """Yield stamp and state of each sample, the head and the eyes fixating the object."""
    robot, _, _ = true_robot()
    trial = movement.trial
    gains = fixation.FixationParams(gain_per_s=min(8.0, 0.6 / STEP_S))
    q = trial.joints_rad[0]
    for t, arms, p, v in zip(trial.stamps_s, trial.joints_rad, trial.positions, trial.velocities, strict=True):
        q = np.where(gaze_mask(robot), q, arms)
        dq = fixation.step(gains, robot.at(q), p, v, STEP_S).dq_rad_s
        yield float(t), SceneState(q, p, v, dq, movement.rotation)
        q = robot.clamp(q + STEP_S * dq)


def record(session: Sequence[Movement], out: Path, noise: float, seed: int) -> list[Path]:
    """Render each movement into a recording, in the folder `out` or, if there are several, in out/001, out/002, ….

    Returns the recordings; InputError if a folder is not new or empty.
    """
    setup = icub_setup()
    rng = np.random.default_rng(seed)
    folders = [out / f"{k + 1:03d}" for k in range(len(session))] if len(session) > 1 else [out]
    for folder, movement in zip(progress(folders, desc="session", unit="trial"), session, strict=True):
        stimulus = make_stimulus(movement.stimulus, float(movement.trial.radius_m[0]))
        carrier: CarrierName = "none" if movement.stimulus == "marker" else "hand"
        with Eyes(setup.robot, setup.rig, stimulus, carrier, Sensor(noise)) as eyes:
            feels = setup.skin if movement.trial.touched.any() else None
            write_recording(folder, setup, eyes, list(watched(movement)), rng, feels, {"seed": seed})
    return folders
