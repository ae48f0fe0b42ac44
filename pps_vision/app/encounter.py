"""Encounters: a robot, one stimulus and the pipeline, closed in a loop without a robot.

An approach is aimed at a taxel's home position, ends there at the first would-be contact and
withdraws along its path, whatever the arm does.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from control.fixation import gaze_at
from pps_vision.app.in_view import can_follow
from pps_vision.app.pipeline import Pipeline, PipelineStep
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import home
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.skin import TOUCH_RADIUS_M, Skin, touched_taxels
from pps_vision.types import Array, Mask, Reachability, Status, StereoFrame
from rendering.eyes import Eyes
from rendering.motions import Motion, Recede, Target, make_approach
from rendering.names import StimulusName
from rendering.scene import SceneState
from rendering.stimuli import make_stimulus

Kind = Literal["approach", "recede", "static", "own_arm"]
STEP_S = 0.05
# How near the nearest taxel's centre the surface comes: an approach surely touches, what recedes never did.
REACH_M = {"approach": TOUCH_RADIUS_M - 0.003, "recede": TOUCH_RADIUS_M + 0.010}
_STANDS_M = (0.12, 0.15)  # how far from the taxel what stands still does


@dataclass(frozen=True)
class Encounter:
    """What is shown: a stimulus on a path (None: nothing but the robot's own arm, which then moves)."""

    title: str
    stimulus: StimulusName
    motion: Motion | None
    seconds: float


@dataclass(frozen=True)
class EncounterLog:
    """What happened, per frame: (T,), (T, 3) root frame, or (T, n) for the skin's n taxels."""

    title: str
    taxel_ids: tuple[str, ...]
    stamps_s: Array
    status: tuple[Status, ...]
    truth_m: Array
    track_m: Array  # NaN while unknown
    track_std_m: Array
    surface_gap_m: Array  # from the object's surface to each taxel's centre, true
    activations: Array
    speed_m_s: Array  # of the control point, commanded and obeyed
    arm_commanded: Mask  # the way home after an answer included
    touched: Mask
    q_rad: Array
    reachability: tuple[Reachability, ...] = ()  # empty without a reachable-space map

    @property
    def was_touched(self) -> bool:
        """Whether the skin was touched at all."""
        return bool(self.touched.any())

    @property
    def was_commanded(self) -> bool:
        """Whether the arm was told to move by what it saw."""
        return bool(self.arm_commanded.any())


class World:
    """The robot at its posture among what it sees; the only one who knows the truth."""

    def __init__(self, robot: Robot, rig: StereoRig, skin: Skin, eyes: Eyes, rng: np.random.Generator) -> None:
        self.robot, self.rig, self.skin, self.eyes, self.rng = robot, rig, skin, eyes, rng
        self.home = watching(robot, skin, home(robot))

    def meet(self, encounter: Encounter, pipeline: Pipeline, avoid: bool, start_s: float = 0.0) -> "Meeting":
        """Begin an encounter with the robot at home."""
        stimulus = make_stimulus(encounter.stimulus)
        self.eyes.set_stimulus(stimulus)
        return Meeting(self, encounter, pipeline, avoid, stimulus.radius_m, start_s)


class Meeting:
    """One encounter under way: iterate over its frames, then ask for the log."""

    def __init__(
        self, world: World, encounter: Encounter, pipeline: Pipeline, avoid: bool, radius_m: float, start_s: float
    ) -> None:
        self.world, self.encounter, self.pipeline, self.avoid = world, encounter, pipeline, avoid
        self.radius_m, self.start_s = radius_m, start_s
        q = world.home
        if encounter.motion is not None:
            q = gaze_at(world.robot, q, encounter.motion(0.0)[0])
        self.q = q
        self._rows: list[tuple[StereoFrame, PipelineStep, Array, Array, Mask]] = []

    def __iter__(self) -> "Meeting":
        return self

    def __next__(self) -> tuple[StereoFrame, PipelineStep]:
        """Render, let the pipeline act, and move the robot as it says."""
        k = len(self._rows)
        t = k * STEP_S
        if t >= self.encounter.seconds:
            raise StopIteration
        world, moving = self.world, self.encounter.motion
        taxels, _ = world.skin.at(world.robot.at(self.q))
        p, v = moving(t) if moving is not None else (np.full(3, np.nan), np.zeros(3))
        touched = touched_taxels(taxels, p, self.radius_m)
        state = SceneState(self.q, None if moving is None else p, v)
        frame = world.eyes.render(state, self.start_s + t, world.rng)
        step = self.pipeline.step(frame, touched)
        self._rows.append((frame, step, p, taxels, touched))
        self.q = world.robot.clamp(self.q + STEP_S * self._dq(step, t))
        return frame, step

    def _dq(self, step: PipelineStep, t: float) -> Array:
        dq = step.command.dq_rad_s.copy()
        arm = self.world.robot.indices(self.world.robot.names.arm("left"))
        if not self.avoid:
            dq[arm] = 0.0
        if self.encounter.motion is None:
            dq[arm] = _swing_rate(t)
        return dq

    def log(self) -> EncounterLog:
        """All that happened so far."""
        frames, steps, truth, taxels, touched = zip(*self._rows, strict=True)
        track = [s.tracking.track for s in steps]
        arm = self.world.robot.indices(self.world.robot.names.arm("left"))
        p = np.array(truth)
        return EncounterLog(
            title=self.encounter.title,
            taxel_ids=self.world.skin.taxel_ids,
            stamps_s=np.array([f.stamp_s for f in frames]),
            status=tuple(t.status for t in track),
            truth_m=p,
            track_m=np.array([t.position for t in track]),
            track_std_m=np.array([np.sqrt(np.diag(t.cov)[:3]) for t in track]),
            surface_gap_m=np.linalg.norm(p[:, None] - np.array(taxels), axis=2) - self.radius_m,
            activations=np.array([s.activation.probability for s in steps]),
            speed_m_s=np.array([self.avoid * float(np.linalg.norm(s.response.velocity_root)) for s in steps]),
            arm_commanded=np.array([self.avoid and bool(np.any(s.command.dq_rad_s[arm])) for s in steps]),
            touched=np.array(touched),
            q_rad=np.array([f.joints_left_rad for f in frames]),
            reachability=tuple(s.reachability for s in steps if s.reachability),
        )


def watching(robot: Robot, skin: Skin, q: Array) -> Array:
    """The configuration `q` with the eyes on the space before the skin."""
    positions, normals = skin.at(robot.at(q))
    return gaze_at(robot, q, (positions + 0.12 * normals).mean(axis=0))


def make_encounter(
    kind: Kind,
    world: World,
    taxel: str,
    stimulus: StimulusName,
    rng: np.random.Generator,
    speed_m_s: float,
    reach_m: float | None = None,
) -> Encounter:
    """A random encounter of a kind about a taxel's home position, in view of both eyes from its start.

    approach: until the surface is within `reach_m` (default: a touch) of a taxel's home position, and
    back; recede: from just out of touch away; static: 5 cm away from the skin, then still, 12–15 cm from the taxel;
    own_arm: nothing is there.
    """
    if kind == "own_arm":
        return Encounter("own arm moving", stimulus, None, 4.0)
    posture = world.robot.at(world.home)
    index = world.skin.index(taxel)
    taxels, _ = world.skin.at(posture)
    point = taxels[index]
    radius = make_stimulus(stimulus).radius_m
    aim = at_taxel(world.skin, posture, index, radius + (REACH_M.get(kind, 0.0) if reach_m is None else reach_m))
    for _ in range(200):
        visit = make_approach(rng, aim, speed_m_s)
        if kind == "approach":
            motion: Motion = visit
            seconds, title = 2 * visit.contact_s + visit.dwell_s + 0.5, "approaching"
        elif kind == "recede":
            motion = Recede(visit.end, visit.start, speed_m_s)
            seconds, title = visit.contact_s + 0.5, "receding"
        else:
            away = _unit(visit.start - point)
            stop = point + rng.uniform(*_STANDS_M) * away
            motion = Recede(stop - 0.05 * away, stop, speed_m_s)
            seconds, title = 5.0, "standing still"
        begins_touching = touched_taxels(taxels, motion(0.0)[0], radius).any()
        if not begins_touching and can_follow(world.robot, world.rig, world.home, motion, seconds):
            return Encounter(f"{stimulus} {title}", stimulus, motion, seconds)
    raise ValueError(f"no {kind} about {taxel} stays in view of both eyes; expected a taxel the home posture shows")


def at_taxel(skin: Skin, posture: Posture, index: int, reach_m: float) -> Target:
    """An aim at a taxel as it is now; a centre that moves to it ends where `reach_m` of any taxel is met."""
    positions, normals = skin.at(posture)
    point = positions[index]
    return Target(point, normals[index], lambda start: first_contact(start, point, positions, reach_m))


def first_contact(start: Array, target: Array, taxels: Array, reach_m: float) -> Array:
    """Where a centre that moves straight from `start` to a `target` taxel first comes within `reach_m` of one
    (those it starts beside are passed)."""
    way = target - start
    length = float(np.linalg.norm(way))
    u = way / length
    along = (taxels - start) @ u
    aside2 = np.sum((taxels - start) ** 2, axis=1) - along**2
    hit = aside2 < reach_m**2
    travelled = along[hit] - np.sqrt(reach_m**2 - aside2[hit])
    return start + float(travelled[travelled > 0].min()) * u


def _unit(vector: ArrayLike) -> Array:
    v = np.asarray(vector, dtype=float)
    return v / np.linalg.norm(v)


def _swing_rate(t: float) -> Array:
    """The left arm's own movement, rad/s: elbow, shoulder and wrist swing a few degrees about home."""
    amplitude = np.deg2rad([6.0, 5.0, 6.0, 10.0, 12.0, 0.0, 0.0])
    frequency = 2 * np.pi * np.array([0.35, 0.3, 0.4, 0.45, 0.5, 0.5, 0.5])
    rate: Array = amplitude * frequency * np.cos(frequency * t)
    return rate
