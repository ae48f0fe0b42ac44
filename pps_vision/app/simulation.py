"""The closed loop in simulation: rendered eyes, a policy that commands the robot, and a robot that obeys.

with open_scene(noise_sigma=2.0, seed=0) as scene:
    episode = make_episode("approach", scene, "left_forearm:3", "ball", rng, speed_m_s=0.1)
    for step in simulate(scene, episode, new_pipeline(scene, memory).step):
        ...
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from control.fixation import gaze_at
from learning.pps.memory import PPSMemory
from learning.reach.map import ReachableMap
from pps_vision.app.pipeline import Pipeline, PipelineParams, PipelineStep
from pps_vision.app.progress import progress
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import icub_setup
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.robot_setup import RobotSetup
from pps_vision.robot.silhouette import Silhouette
from pps_vision.robot.skin import INNER_FOREARM, TOUCH_RADIUS_M, Skin, icub_skin, touched_taxels
from pps_vision.types import Array, Mask, Reachability, Status, StereoFrame
from rendering.eyes import Eyes
from rendering.motions import Motion, Recede, Target, make_approach
from rendering.names import StimulusName
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus
from tracking.tracker import Tracker, TrackerParams

Kind = Literal["approach", "recede", "static", "own_arm", "near_miss"]
Side = Literal["left", "right"]
OwnMotion = Literal["", "arm", "head"]  # body part that moves independently of the commands
Policy = Callable[[StereoFrame, Mask], PipelineStep]
"""Turns a frame and the touched taxels (n,) into a command; `Pipeline.step` is one."""

PERIOD_S = 0.05
SPEED_M_S = (0.05, 0.15)  # range of the speeds of training approaches
_TRAINED_WITH: tuple[StimulusName, ...] = ("ball", "cube")
REACH_M = {"approach": TOUCH_RADIUS_M - 0.003, "recede": TOUCH_RADIUS_M + 0.010}
"""Smallest distance from the object's surface to the nearest taxel's centre: an approach touches, a receding object
does not."""
_TITLES = {"approach": "approaching", "recede": "receding", "static": "at rest", "near_miss": "stopping short"}
_NEAR_MISS_M = (0.04, 0.16)  # from the object's surface to the nearest taxel's centre at the end of a near miss
_REST_M = (0.12, 0.15)  # distance from the taxel of a static object
_CONTACT_FRAMES = 14  # a training episode ends 0.7 s after the touch, so that the withdrawal is not learned
_MARGIN_PX = 25.0  # smallest distance of the object's centre from the image border
_MIN_DISTANCE_M = 0.22  # from the eyes: nearer objects fill the view, and the vergence range ends at 0.2 m


@dataclass(frozen=True)
class Episode:
    """A stimulus on a path, for some time; without a `motion` no object is near.

    An arm with `own_motion` ignores the commands; a head with `own_motion` sways in addition to them.
    """

    title: str
    stimulus: StimulusName
    motion: Motion | None
    seconds: float
    own_motion: OwnMotion = ""


@dataclass(frozen=True)
class SimulationScene:
    """The robot, its skin and eyes, and the random numbers of the simulation."""

    setup: RobotSetup
    eyes: Eyes
    rng: np.random.Generator
    side: Side  # the arm that avoids

    @property
    def robot(self) -> Robot:
        """Its kinematics."""
        return self.setup.robot

    @property
    def rig(self) -> StereoRig:
        """Its cameras."""
        return self.setup.rig

    @property
    def skin(self) -> Skin:
        """Its skin."""
        return self.setup.skin

    @cached_property
    def arm(self) -> list[int]:
        """Where the joints of the arm that avoids are in the configuration vector."""
        return self.robot.indices(self.robot.names.arm(self.side))

    @cached_property
    def trained_taxels(self) -> tuple[str, ...]:
        """The taxels that training approaches: R's of the iCub, else up to 8 of the arm that face both eyes and are
        seen by them at home, from the middle outwards; InputError without any."""
        inner = tuple(f"left_forearm:{i}" for i in INNER_FOREARM)
        if set(inner) <= set(self.skin.taxel_ids):
            return inner
        skin = self.skin.on_arm(self.robot, self.side)
        points = skin.at(self.robot.at(self.home))[0] if skin.parts else np.zeros((0, 3))
        faces = facing_taxels(self.setup, skin, self.home)
        if not faces.any():
            reason = f"none of {len(points)} taxels of the {self.side} arm faces both cameras and is seen at home"
            raise InputError(self.robot.urdf, f"{reason}; expected one that objects can come at in view")
        apart = np.where(faces, np.linalg.norm(points - points[faces].mean(axis=0), axis=1), np.inf)
        return tuple(skin.taxel_ids[k] for k in np.argsort(apart, kind="stable")[: min(faces.sum(), 8)])

    @cached_property
    def home(self) -> Array:
        """(n_joints,) arms at home, eyes on the space before the skin."""
        q = self.setup.home_rad
        positions, normals = self.skin.at(self.robot.at(q))
        return gaze_at(self.robot, q, (positions + 0.12 * normals).mean(axis=0))


@dataclass(frozen=True, slots=True)
class SimulationStep:
    """One frame of a simulation: the images, the policy's step, and the truth.

    `position` (3,) of the object, NaN without one; `taxels` (n, 3) positions; `touched` (n,); `q_rad` (n_joints,)
    before the command was obeyed.
    """

    frame: StereoFrame
    step: PipelineStep
    position: Array
    taxels: Array
    touched: Mask
    q_rad: Array


@dataclass(frozen=True)
class EpisodeLog:
    """An episode as arrays: (T,), (T, 3) in the root frame, or (T, n) for the skin's n taxels; activations also of the
    memory's places of a tool, which come last."""

    title: str
    taxel_ids: tuple[str, ...]
    stamps_s: Array
    status: tuple[Status, ...]
    truth_m: Array
    track_m: Array  # NaN where unknown
    track_std_m: Array
    surface_gap_m: Array  # true distance from the object's surface to each taxel's centre
    activations: Array
    speed_m_s: Array  # commanded speed of the arm's control point
    arm_commanded: Mask  # whether the arm was commanded to move, the return home included
    touched: Mask
    q_rad: Array
    mismatch_rad: Array  # repeated difference of the posture from its prediction; 0: none, or the arm does not obey
    reachability: tuple[Reachability, ...] = ()  # empty without a reachable-space map

    @property
    def was_touched(self) -> bool:
        """Whether the skin was touched."""
        return bool(self.touched.any())

    @property
    def was_commanded(self) -> bool:
        """Whether the arm was commanded to move."""
        return bool(self.arm_commanded.any())


@contextmanager
def open_scene(
    noise_sigma: float, seed: int, setup: RobotSetup | None = None, side: Side | None = None
) -> Iterator[SimulationScene]:
    """A robot, by default the iCub with the skin of its left forearm and palm; `noise_sigma` of the pixels in grey
    levels of 255; `side`: the arm that avoids, by default its first."""
    setup = setup or icub_setup(icub_skin(("left_forearm", "left_palm")))
    with Eyes(setup.robot, setup.rig, make_stimulus("ball"), sensor=Sensor(noise_sigma=noise_sigma)) as eyes:
        yield SimulationScene(setup, eyes, np.random.default_rng(seed), side or setup.side)


def new_pipeline(
    scene: SimulationScene,
    memory: PPSMemory,
    stopwatch: Stopwatch | None = None,
    reachable_map: ReachableMap | None = None,
) -> Pipeline:
    """A pipeline with a new tracker and an earlier memory."""
    params = PipelineParams.of(scene.setup, scene.side)
    timing = {} if stopwatch is None else {"stages": stopwatch}
    tracker = Tracker(TrackerParams(), scene.rig, scene.rng, own_body=Silhouette(scene.robot), **timing)
    return Pipeline(params, scene.robot, scene.skin, tracker, memory, scene.rng, reachable_map)


def simulate(scene: SimulationScene, episode: Episode, policy: Policy, avoid: bool = True) -> Iterator[SimulationStep]:
    """Yield the frames of an episode: render, let the policy command, move the robot.

    The robot begins at home with its eyes on the object.  Without `avoid` the arm does not obey.
    """
    robot = scene.robot
    stimulus = make_stimulus(episode.stimulus)
    scene.eyes.set_stimulus(stimulus)
    arm = scene.arm
    q = scene.home
    if episode.motion is not None:
        q = gaze_at(robot, q, episode.motion(0.0)[0])
    for k in range(int(np.ceil(episode.seconds / PERIOD_S - 1e-9))):
        t = k * PERIOD_S
        taxels, _ = scene.skin.at(robot.at(q))
        p, v = episode.motion(t) if episode.motion is not None else (np.full(3, np.nan), np.zeros(3))
        touched = touched_taxels(taxels, p, stimulus.radius_m)
        state = SceneState(q, None if episode.motion is None else p, v)
        frame = scene.eyes.render(state, t, scene.rng)
        step = policy(frame, touched)
        yield SimulationStep(frame, step, p, taxels, touched, q)
        dq = step.command.dq_rad_s.copy()
        if not avoid or episode.own_motion == "arm":
            dq[arm] = 0.0
        q = q + PERIOD_S * (dq + own_rate(robot, episode.own_motion, arm, t))
        if episode.own_motion:
            q = robot.clamp(q)  # commands keep the limits, own motion does not


def log_of(scene: SimulationScene, episode: Episode, steps: Iterable[SimulationStep], avoid: bool = True) -> EpisodeLog:
    """The arrays of the frames of an episode; `avoid` as in `simulate`."""
    rows = list(steps)
    arm = scene.arm
    radius_m = make_stimulus(episode.stimulus).radius_m
    tracks = [row.step.tracking.track for row in rows]
    truth = np.array([row.position for row in rows])
    taxels = np.array([row.taxels for row in rows])
    speed = np.array([float(np.linalg.norm(row.step.response.velocity_root)) for row in rows])
    return EpisodeLog(
        title=episode.title,
        taxel_ids=scene.skin.taxel_ids,
        stamps_s=np.array([row.frame.stamp_s for row in rows]),
        status=tuple(track.status for track in tracks),
        truth_m=truth,
        track_m=np.array([track.position for track in tracks]),
        track_std_m=np.array([np.sqrt(np.diag(track.cov)[:3]) for track in tracks]),
        surface_gap_m=np.linalg.norm(truth[:, None] - taxels, axis=2) - radius_m,
        activations=np.array([row.step.activation.probability for row in rows]),
        speed_m_s=avoid * speed,
        arm_commanded=np.array([avoid and bool(np.any(row.step.command.dq_rad_s[arm])) for row in rows]),
        touched=np.array([row.touched for row in rows]),
        q_rad=np.array([row.q_rad for row in rows]),
        mismatch_rad=avoid * np.array([row.step.mismatch_rad for row in rows]),
        reachability=tuple(row.step.reachability for row in rows if row.step.reachability),
    )


def train(scene: SimulationScene, trials: int, touch_every: int = 1) -> PPSMemory:
    """The memory after `trials` approaches, with alternating taxels and objects.

    One in `touch_every` approaches ends in a touch; the others are near misses.
    """
    if trials < 1:
        raise InputError("training", f"{trials} trials; expected at least one")
    memory = PPSMemory.empty(scene.skin)
    for trial in progress(range(trials), desc="training", unit="approach", after_s=0.0):
        number, is_near_miss = divmod(trial, touch_every)
        taxel = scene.trained_taxels[number % len(scene.trained_taxels)]
        stimulus = _TRAINED_WITH[number % len(_TRAINED_WITH)]
        speed = scene.rng.uniform(*SPEED_M_S)
        kind: Kind = "near_miss" if is_near_miss else "approach"
        episode = make_episode(kind, scene, taxel, stimulus, scene.rng, speed, None if is_near_miss else 0.0)
        pipeline = new_pipeline(scene, memory)
        contact_frames = 0
        for step in simulate(scene, episode, pipeline.step, avoid=False):
            contact_frames += bool(step.touched.any())
            if contact_frames == _CONTACT_FRAMES:
                break
        memory = pipeline.miss() if is_near_miss else pipeline.finish()
    return memory


def make_episode(
    kind: Kind,
    scene: SimulationScene,
    taxel: str,
    stimulus: StimulusName,
    rng: np.random.Generator,
    speed_m_s: float,
    reach_m: float | None = None,
) -> Episode:
    """A random episode about a taxel's home position, in view of both eyes.

    approach: until the surface is within `reach_m` of a taxel's home position, then back; recede: from just out of
    touch; static: 5 cm away from the skin, then at rest 12–15 cm from the taxel; own_arm: no object; near_miss: the
    approach ends `reach_m` before the skin. By default `reach_m` is a touch, or 4–16 cm for a near miss.

    InputError if the skin has no such taxel, no such episode stays in view, or the object starts within `reach_m`.
    """
    if kind == "own_arm":
        return Episode("own arm moving", stimulus, None, 4.0, "arm")
    q_home = scene.home
    posture = scene.robot.at(q_home)
    index = scene.skin.index(taxel)
    taxels, _ = scene.skin.at(posture)
    point = taxels[index]
    radius = make_stimulus(stimulus).radius_m
    if reach_m is None:
        reach_m = rng.uniform(*_NEAR_MISS_M) if kind == "near_miss" else REACH_M.get(kind, 0.0)
    aim = at_taxel(scene.skin, posture, index, radius + reach_m)
    for _ in range(200):
        visit = make_approach(rng, aim, speed_m_s)
        motion: Motion = visit
        seconds = visit.contact_s
        if kind == "approach":
            seconds = 2 * visit.contact_s + visit.dwell_s + 0.5
        elif kind == "recede":
            motion = Recede(visit.end, visit.start, speed_m_s)
            seconds = visit.contact_s + 0.5
        elif kind == "static":
            away = (visit.start - point) / np.linalg.norm(visit.start - point)
            end = point + rng.uniform(*_REST_M) * away
            motion = Recede(end - 0.05 * away, end, speed_m_s)
            seconds = 5.0
        begins_touching = touched_taxels(taxels, motion(0.0)[0], radius).any()
        if not begins_touching and can_follow(scene.robot, scene.rig, q_home, motion, seconds):
            return Episode(f"{stimulus} {_TITLES[kind]}", stimulus, motion, seconds)
    problem = f"no {kind} about {taxel} stays in view of both eyes"
    raise InputError("episode", f"{problem}; expected a taxel that they see at home")


def facing_taxels(setup: RobotSetup, skin: Skin, q_rad: Array) -> Mask:
    """(n,) taxels that face both eyes and are seen by them."""
    view = setup.rig.view(q_rad)
    points, normals = skin.at(setup.robot.at(q_rad)) if skin.parts else np.zeros((2, 0, 3))
    return np.array(
        [
            all(eye.sees(point, _MARGIN_PX) and normal @ (eye.center - point) > 0 for eye in (view.left, view.right))
            for point, normal in zip(points, normals, strict=True)
        ],
        dtype=bool,
    )


def can_follow(robot: Robot, rig: StereoRig, q_rad: Array, motion: Motion, seconds: float, points: int = 9) -> bool:
    """Whether both eyes can see a motion when they fixate it, tested at `points` points of the path."""
    for t in np.linspace(0, seconds, points):
        p, _ = motion(float(t))
        view = rig.view(gaze_at(robot, q_rad, p))
        for eye in (view.left, view.right):
            if not eye.sees(p, _MARGIN_PX) or np.linalg.norm(p - eye.center) < _MIN_DISTANCE_M:
                return False
    return True


def at_taxel(skin: Skin, posture: Posture, index: int, reach_m: float) -> Target:
    """The target of an approach to a taxel: it ends where the object's centre is within `reach_m` of any taxel."""
    positions, normals = skin.at(posture)
    point = positions[index]
    return Target(point, normals[index], lambda start: first_contact(start, point, positions, reach_m))


def first_contact(start: Array, target: Array, taxels: Array, reach_m: float) -> Array:
    """(3,) where a centre that moves straight from `start` to `target` comes within `reach_m` of a taxel.

    Taxels within `reach_m` of `start` are ignored; InputError if that leaves none.
    """
    way = target - start
    u = way / float(np.linalg.norm(way))
    along = (taxels - start) @ u
    aside2 = np.sum((taxels - start) ** 2, axis=1) - along**2
    hit = aside2 < reach_m**2
    travelled = along[hit] - np.sqrt(reach_m**2 - aside2[hit])
    if not (travelled > 0).any():
        message = (
            f"the object's centre starts {np.linalg.norm(way):.3g} m from a taxel, to stop {reach_m:.3g} m from it"
        )
        raise InputError("approach", f"{message}; expected a smaller object or reach")
    return start + float(travelled[travelled > 0].min()) * u


def own_rate(robot: Robot, own_motion: OwnMotion, arm: list[int], t: float) -> Array:
    """(n_joints,) rad/s of an `arm` whose first five joints swing a few degrees, or of a `head` that sways at 14°/s."""
    rate = np.zeros(robot.n_joints)
    if own_motion == "arm":
        amplitude = np.deg2rad([6.0, 5.0, 6.0, 10.0, 12.0])
        frequency = 2 * np.pi * np.array([0.35, 0.3, 0.4, 0.45, 0.5])
        rate[arm[:5]] = (amplitude * frequency * np.cos(frequency * t))[: len(arm)]
    elif own_motion == "head":
        yaw_pitch = robot.indices(robot.names.gaze_joints)[:2]
        rate[yaw_pitch] = np.deg2rad(10.0) * np.cos(2 * np.pi * np.array([0.5, 0.4]) * t)
    return rate
