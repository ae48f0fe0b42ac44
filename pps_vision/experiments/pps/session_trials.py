"""R's three milestones: the robot's own finger, or an object in a hand, touches the skin; trials of these movements,
exact, or rendered and tracked while the eyes follow."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from hashlib import sha256
from itertools import count, cycle, islice
from typing import NamedTuple, get_args

import numpy as np
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from control.double_touch import FINGERTIP_RADIUS_M, DoubleTouch, DoubleTouching
from control.fixation import gaze_at
from learning.pps.joint_offsets import TouchTrial
from learning.pps.memory import PPSMemory
from pps_vision.app.encounters.encounter import TRIALS, SessionName, start_posture
from pps_vision.app.encounters.robots import true_robot
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.app.simulation import can_follow
from pps_vision.experiments.study import NOISE_SIGMA, PartsStudy
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.silhouette import Silhouette
from pps_vision.robot.skin import INNER_FOREARM, OUTER_FOREARM, Skin, icub_skin, taxel_frame, touched_taxels
from pps_vision.types import Array, Mask, Track3D
from pps_vision.worker_pool import worker_pool
from rendering.eyes import Eyes
from rendering.motions import make_reach
from rendering.names import StimulusName
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus
from tracking.tracker import Tracker, TrackerParams

AIMED: dict[SessionName, tuple[str, tuple[int, ...]]] = {
    "motor": ("left_forearm", INNER_FOREARM),
    "visual": ("left_forearm", INNER_FOREARM),
    "inner": ("left_forearm", INNER_FOREARM),
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
_PROCESSES = 2


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
    raise ValueError(
        f"no approach to {skin.taxel_ids[aimed]} stays in view of both eyes; expected a taxel that its posture shows"
    )


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


@dataclass(frozen=True)
class SessionStudy(PartsStudy):
    """Base of the studies of R's sessions."""

    share: float = 1.0  # share of the trials of every session

    def size(self, n: int) -> int:
        """Return the share of `n` trials."""
        return max(round(self.share * n), 1)

    def measured_trials(
        self, session: SessionName, n: int | None = None, seed_offset: int = 0
    ) -> tuple[TouchTrial, ...]:
        """Return a session's trials (default: as many as R's): the felt double touch exact, all others rendered."""
        n = self.size(n or TRIALS[session])
        if session == "motor":
            return exact_trials(session, n, self.seed + seed_offset)
        return rendered_trials(session, n, self.seed + seed_offset)


def exact_trials(session: SessionName, n: int, seed: int) -> tuple[TouchTrial, ...]:
    """Return the first `n` trials of a session with the true path of the object."""
    return tuple(movement.trial for movement in movements(session, n, seed))


@cache  # several parts use the same trials
def rendered_trials(session: SessionName, n: int, seed: int) -> tuple[TouchTrial, ...]:
    """Return the first `n` trials of a session (not motor, which is felt) as tracked in rendered eye views."""
    planned = movements(session, n, seed)
    with worker_pool(min(_PROCESSES, n)) as pool:
        return tuple(tqdm(pool.map(_render, planned), "rendering", n, unit="trial", disable=None))


def _render(movement: Movement) -> TouchTrial:
    """The trial of a movement as tracked in rendered eye views, the eyes following the track."""
    is_marker = movement.stimulus == "marker"
    icub = load_icub()
    skin = icub_skin()
    rig = icub_rig(icub)
    rng = _noise_rng(movement)
    tracker = Tracker(TrackerParams("marker" if is_marker else "generic"), rig, rng, own_body=Silhouette(icub))
    pipeline = Pipeline(PipelineParams(), icub, skin, tracker, PPSMemory.empty(skin), rng)
    tracks: list[Track3D] = []
    joints: list[Array] = []
    true = movement.trial
    q = true.joints_rad[0]
    stimulus = make_stimulus(movement.stimulus)
    with Eyes(icub, rig, stimulus, "none" if is_marker else "hand", Sensor(noise_sigma=NOISE_SIGMA)) as eyes:
        for t, arms, p in zip(true.stamps_s, true.joints_rad, true.positions, strict=True):
            q = np.where(gaze_mask(icub), q, arms)
            step = pipeline.step(eyes.render(SceneState(q, p, rotation=movement.rotation), t, rng))
            tracks.append(step.tracking.track)
            joints.append(q)
            q = icub.clamp(q + STEP_S * step.command.dq_rad_s)
    return replace(
        true,
        joints_rad=np.array(joints),
        positions=np.array([track.position for track in tracks]),
        velocities=np.array([track.velocity for track in tracks]),
        velocity_covs=np.array([track.cov[3:6, 3:6] for track in tracks]),
        radius_m=np.array([track.radius_m for track in tracks]),
    )


def _noise_rng(movement: Movement) -> np.random.Generator:
    """Generator of the images' noise, which the movement determines."""
    trial = movement.trial
    arrays = (movement.rotation, trial.stamps_s, trial.joints_rad, trial.positions)
    key = f"{movement.stimulus} {NOISE_SIGMA}".encode() + b"".join(array.tobytes() for array in arrays)
    return np.random.default_rng(int(sha256(key).hexdigest()[:24], 16))
