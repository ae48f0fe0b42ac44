"""One encounter without rendering: the arm obeys, the object moves on its path, the skin is touched or not."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from control.limits import MAX_HOLD_S, LimitParams, limit
from learning.reach.track_reachability import TrackReachability
from pps_vision.app.encounters.controllers import RADIUS_M, Controller, Setting
from pps_vision.app.encounters.encounter import Arena, Encounter
from pps_vision.app.encounters.training import FIELD, Memories
from pps_vision.app.pipeline import Taxels, activation_by
from pps_vision.app.simulation import PERIOD_S, own_rate
from pps_vision.robot.skin import INNER_FOREARM, TOUCH_RADIUS_M
from pps_vision.types import Array, JointVelocity, Track3D

_BETWEEN = 5  # instants between two frames at which the skin is looked at
_ENOUGH_S = 0.5  # for which a harmless encounter goes on after a command: it is decided
_MOVES_RAD_S = 1e-4  # slower is rest
_TOLERANCE = 1e-6  # rad, of a joint limit
_SHORT_M = 1e-4  # of what a posture is asked for
_STARTS = 3  # random postures from which one that touches is searched
_CLEAR_M = 0.025  # self-collision distance that our arm keeps


@dataclass(frozen=True)
class Outcome:
    """What became of an encounter: a row of `--json`."""

    condition: str
    """What the object did."""
    number: int
    """Of the encounter among those of the condition."""
    controller: str
    """Name of the controller."""
    object: str
    """Name of the object."""
    speed_m_s: float
    """Speed of the object."""
    side: str
    """The arm."""
    part: str
    """The body part aimed at."""
    taxel: str
    """The taxel aimed at."""
    posture_deg: tuple[float, ...]
    """The arm's joints at the start."""
    touched: bool
    """Whether a taxel was touched."""
    touched_part: str
    """The body part touched first, or ""."""
    distance_m: float
    """Smallest distance left until a touch, over the encounter."""
    contact_s: float | None
    """When the object would touch the arm at rest."""
    first_command_s: float | None
    """When the arm was first commanded to move."""
    lead_s: float | None
    """From the first command to the would-be contact; None without either."""
    commands: int
    """Frames in which the arm was commanded to move."""
    self_distance_m: float
    """Smallest self-collision distance."""
    faults: tuple[str, ...]
    """Limits that were left, rates that are no numbers."""


class Frame(NamedTuple):
    """What a figure shows of a frame."""

    t_s: float
    q_rad: Array
    """(n_joints,)."""
    distance_m: Array
    """(n,) from the object's surface to the taxels' centres."""
    activations: Array
    """(n,) of D and TTC, also where a map of D alone moves the arm."""
    speed_m_s: float
    """Speed of the control point, taken to be the taxel with the largest activation."""
    touching: bool
    """Whether a taxel is touched."""


@dataclass
class Watch:
    """Watches an arm from frame to frame: how near the object comes, what is touched, whether limits hold."""

    arena: Arena
    """Robot and skin."""
    encounter: Encounter
    """Path of the object."""
    distance_m: float = np.inf
    touched_part: str = ""
    first_command_s: float = np.inf
    commands: int = 0
    self_distance_m: float = np.inf
    faults: tuple[str, ...] = ()

    def move(self, t: float, taxels: Array, later: Array) -> None:
        """Look at the skin, which moves from `taxels` to `later` (n, 3) in the frame that begins at `t`."""
        motion, encounter = self.encounter.motion, self.encounter
        skin = self.arena.skins[encounter.side]
        shares = np.arange(1, _BETWEEN + 1) / _BETWEEN
        objects = np.array([motion(t + share * PERIOD_S)[0] for share in shares])
        skins = taxels + shares[:, None, None] * (later - taxels)
        left = np.linalg.norm(objects[:, None] - skins, axis=2) - encounter.radius_m - TOUCH_RADIUS_M
        self.distance_m = min(self.distance_m, float(left.min()))
        touching = np.argwhere(left <= 0)
        if len(touching) and not self.touched_part:
            self.touched_part = body_part(skin.taxel_ids[touching[0][1]])

    def command(self, t: float, dq: Array, arm: Sequence[int]) -> None:
        """Count a command (n_joints,)."""
        if np.abs(dq[arm]).max() > _MOVES_RAD_S:
            self.commands += 1
            self.first_command_s = min(self.first_command_s, t)

    def posture(self, q: Array) -> None:
        """Check joint limits and self-collision distance."""
        robot = self.arena.robot
        self.self_distance_m = min(self.self_distance_m, self.arena.self_collision.distance_m(q))
        beyond = float(np.maximum(q - robot.upper_rad, robot.lower_rad - q).max())
        if not beyond <= _TOLERANCE:
            self.faults = (*self.faults, f"joint limit left by {beyond:.2g} rad")

    def outcome(self, controller: str) -> Outcome:
        """Return the row."""
        e = self.encounter
        contact_s = e.contact_s if np.isfinite(e.contact_s) else None
        first_s = self.first_command_s if self.commands else None
        lead_s = None if contact_s is None or first_s is None else contact_s - first_s
        posture = tuple(np.rad2deg(e.q_rad[self.arena.arm(e.side)]).round(2).tolist())
        who = e.condition, e.number, controller, e.stimulus, e.speed_m_s, e.side, e.part, e.taxel, posture
        found = bool(self.touched_part), self.touched_part, self.distance_m, contact_s, first_s, lead_s, self.commands
        return Outcome(*who, *found, self.self_distance_m, self.faults)


def meet(
    arena: Arena,
    memories: Memories,
    encounter: Encounter,
    name: str,
    new_controller: Callable[[Setting], Controller],
    tracks: Sequence[Track3D],
    frames: list[Frame] | None = None,
    reachability: TrackReachability | None = None,
) -> Outcome:
    """Return what becomes of an encounter with a controller; it ends with the first touch, a harmless one after the
    first command. Every frame is added to `frames`, if given; then no touch ends it.

    The last stage of every command (`control.limits`) is the same for all controllers. In `harmless_own_arm` the arm
    swings whatever is commanded, in `harmless_head` the head sways.
    """
    skin, arm = arena.skins[encounter.side], arena.arm(encounter.side)
    behaviour = "reach" if encounter.condition == "reach" else "avoid"
    setting = Setting(
        *(arena.robot, skin, encounter.side, encounter.q_rad, arena.self_collision, memories.of_distance),
        behaviour,  # type: ignore[arg-type]
        reachability,
    )
    act, watch = new_controller(setting), Watch(arena, encounter)
    q, posture = encounter.q_rad, arena.robot.at(encounter.q_rad)
    taxels, normals = skin.at(posture)
    velocities, last, last_q = np.zeros_like(taxels), None, None
    watch.posture(q)
    for track in tracks:
        t = track.stamp_s
        activations = activation_by(FIELD, memories.of_both, track, Taxels(taxels, normals, velocities))
        wanted = act(activations, track, posture)
        command: JointVelocity | None = None
        if np.any(wanted) or (last is not None and np.any(last.dq_rad_s)):
            command = limit(
                LimitParams(), arena.self_collision, posture, JointVelocity(t, wanted, MAX_HOLD_S), last, last_q
            )
            watch.command(t, command.dq_rad_s, arm)
        last, last_q = command, q
        rates = own_rate(arena.robot, encounter.own_motion, arm, t)
        if encounter.own_motion != "arm" and command is not None:
            rates = rates + command.dq_rad_s
        before = taxels
        if np.any(rates):
            q = q + PERIOD_S * rates
            if encounter.own_motion:
                q = arena.robot.clamp(q)
            posture = arena.robot.at(q)
            taxels, normals = skin.at(posture)
            watch.posture(q)
        velocities = (taxels - before) / PERIOD_S
        watch.move(t, before, taxels)
        if frames is not None:
            gap = np.linalg.norm(taxels - encounter.motion(t + PERIOD_S)[0], axis=1) - encounter.radius_m
            speed = float(np.linalg.norm(velocities[activations.argmax()]))
            frames.append(Frame(t, q, gap, activations, speed, bool((gap <= TOUCH_RADIUS_M).any())))
        elif watch.touched_part or (encounter.is_harmless and t > watch.first_command_s + _ENOUGH_S):
            break
    return watch.outcome(name)


def can_touch(arena: Arena, encounter: Encounter, rng: np.random.Generator) -> bool:
    """Return whether the part aimed at can touch the object where it waits: whether some posture of the arm, within its
    limits and the palm's sphere and clear of the body, brings one of its taxels there.

    Least squares over the arm's joints, from the posture at the start and random ones; shares nothing with the
    controllers but the robot's kinematics.
    """
    robot, arm, skin = arena.robot, arena.arm(encounter.side), arena.skins[encounter.side]
    at, palm = encounter.motion(encounter.contact_s)[0], robot.names.palm(encounter.side)
    home, lower, upper = robot.at(encounter.q_rad).point(palm), robot.lower_rad[arm], robot.upper_rad[arm]
    touching_m = encounter.radius_m + TOUCH_RADIUS_M
    aimed_at = [i for i, one in enumerate(skin.taxel_ids) if body_part(one) == encounter.part]

    def posture(joints: Array) -> Array:
        q = encounter.q_rad.copy()
        q[arm] = joints
        return q

    def short_of(joints: Array, taxel: int) -> Array:
        there = robot.at(posture(joints))
        d = skin.at(there)[0][taxel] - at
        outside = float(np.linalg.norm(there.point(palm) - home)) - RADIUS_M
        near = _CLEAR_M - arena.self_collision.distance_m(there.q_rad)
        return np.append(d * max(1 - touching_m / np.linalg.norm(d), 0.0), np.maximum([outside, near], 0.0))

    starts = [encounter.q_rad[arm], *rng.uniform(lower, upper, (_STARTS, len(arm)))]
    for taxel, start in product(aimed_at, starts):
        begun = np.clip(start, lower + _TOLERANCE, upper - _TOLERANCE)
        if np.abs(least_squares(short_of, begun, bounds=(lower, upper), args=(taxel,)).fun).max() < _SHORT_M:
            return True
    return False


def body_part(taxel_id: str) -> str:
    """Return the name of the body part of a taxel."""
    part, number = taxel_id.split(":")
    if part.endswith("palm"):
        return "palm"
    return "inner forearm" if int(number) in INNER_FOREARM else "outer forearm"
