"""One encounter without rendering: the arm obeys, the object moves on its path, the skin is touched or not."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from control.limits import MAX_HOLD_S, LimitParams, limit
from learning.pps import learner
from learning.pps.learner import LearnerState, SkinFrame
from learning.pps.memory import PPSMemory
from learning.pps.receptive_field import NEAR, ReceptiveField
from pps_vision.app.encounters.encounter import HARMLESS, Encounter, EncounterScene, felt
from pps_vision.app.encounters.registry import ArmScene, Controller
from pps_vision.app.simulation import PERIOD_S, own_rate
from pps_vision.robot.skin import TOUCH_RADIUS_M, touched_taxels
from pps_vision.types import Array, JointVelocity, Track3D

_CHECKS_PER_FRAME = 5  # instants between two frames at which the distance to the skin is computed
_AFTER_COMMAND_S = 0.5  # for which a harmless encounter goes on after the first command
_COPIED = ("condition", "number", "speed_m_s", "side", "part", "taxel")  # from an encounter to its result
_MOVES_RAD_S = 1e-4  # slower is rest
_TOLERANCE_RAD = 1e-6  # beyond a joint limit


@dataclass(frozen=True)
class EncounterResult:
    """Outcome of an encounter: a row of encounters.json."""

    condition: str
    number: int
    controller: str
    object: str
    speed_m_s: float
    side: str
    part: str
    taxel: str
    posture_deg: tuple[float, ...]  # the arm's joints at the start
    touched: bool
    touched_part: str  # the body part touched first, or ""
    distance_m: float  # smallest distance left until a touch, over the encounter
    contact_s: float | None  # when the object would touch the arm at rest
    first_command_s: float | None  # when the arm was first commanded to move
    lead_s: float | None  # from the first command to the would-be contact; None without either
    commands: int  # frames in which the arm was commanded to move
    self_distance_m: float  # smallest self-collision distance
    faults: tuple[str, ...]  # limits that were left, rates that are no numbers


class FrameLog(NamedTuple):
    """One frame of an encounter, for figures."""

    t_s: float
    q_rad: Array  # (n_joints,)
    distance_m: Array  # (n,) from the object's surface to the taxels' centres
    activations: Array  # (n,) of D and TTC, also where a map of D alone moves the arm
    speed_m_s: float  # speed of the taxel with the largest activation, taken as the control point
    touching: bool  # whether a taxel is touched


class EncounterMonitor:
    """Accumulates an encounter's result frame by frame: distances, touches, commands and limits."""

    def __init__(self, scene: EncounterScene, encounter: Encounter) -> None:
        self.scene = scene
        self.encounter = encounter
        self.distance_m = np.inf
        self.touched_part = ""
        self.first_command_s = np.inf
        self.commands = 0
        self.self_distance_m = np.inf
        self.faults: tuple[str, ...] = ()

    def add_motion(self, t: float, taxels: Array, later: Array) -> None:
        """Update the distance to the skin, which moves from `taxels` to `later` (n, 3) in the frame from `t` on."""
        skin = self.scene.skins[self.encounter.side]
        shares = np.arange(1, _CHECKS_PER_FRAME + 1) / _CHECKS_PER_FRAME
        centers = np.array([self.encounter.motion(t + share * PERIOD_S)[0] for share in shares])
        positions = taxels + shares[:, None, None] * (later - taxels)
        gap = np.linalg.norm(centers[:, None] - positions, axis=2) - self.encounter.radius_m - TOUCH_RADIUS_M
        self.distance_m = min(self.distance_m, float(gap.min()))
        touching = np.argwhere(gap <= 0)
        if len(touching) and not self.touched_part:
            self.touched_part = self.scene.body_part(skin.taxel_ids[touching[0][1]])

    def add_command(self, t: float, dq: Array, arm: Sequence[int]) -> None:
        """Count a command (n_joints,) that moves the arm."""
        if np.abs(dq[arm]).max() > _MOVES_RAD_S:
            self.commands += 1
            self.first_command_s = min(self.first_command_s, t)

    def add_posture(self, q: Array) -> None:
        """Check joint limits and self-collision distance."""
        robot = self.scene.robot
        self.self_distance_m = min(self.self_distance_m, self.scene.self_collision.distance_m(q))
        excess = float(np.maximum(q - robot.upper_rad, robot.lower_rad - q).max())
        if not excess <= _TOLERANCE_RAD:
            self.faults = (*self.faults, f"joint limit left by {excess:.2g} rad")

    def result(self, controller: str) -> EncounterResult:
        """Return the row."""
        encounter = self.encounter
        contact_s = encounter.contact_s if np.isfinite(encounter.contact_s) else None
        first_s = self.first_command_s if self.commands else None
        return EncounterResult(
            **{name: getattr(encounter, name) for name in _COPIED},
            controller=controller,
            object=encounter.stimulus,
            posture_deg=tuple(np.rad2deg(encounter.q_rad[self.scene.arm(encounter.side)]).round(2).tolist()),
            touched=bool(self.touched_part),
            touched_part=self.touched_part,
            distance_m=self.distance_m,
            contact_s=contact_s,
            first_command_s=first_s,
            lead_s=None if contact_s is None or first_s is None else contact_s - first_s,
            commands=self.commands,
            self_distance_m=self.self_distance_m,
            faults=self.faults,
        )


def simulate_encounter(
    scene: EncounterScene,
    memory: PPSMemory,
    encounter: Encounter,
    name: str,
    new_controller: Callable[[ArmScene], Controller],
    tracks: Sequence[Track3D],
    frames: list[FrameLog] | None = None,
    erring: tuple[EncounterScene, Array] | None = None,
    field: ReceptiveField = NEAR,
    hold_s: float = MAX_HOLD_S,
) -> EncounterResult:
    """Simulate an encounter with a controller, without rendering.

    It ends with the first touch, a harmless one 0.5 s after the first command; with `frames`, to which every frame is
    appended, it goes on to the end. Every controller's commands pass `control.limits`. In
    `harmless_own_arm` the arm swings independently of commands, in `harmless_head` the head sways. `erring`: the robot
    as it takes itself to be, and its encoders' errors (n_joints,); `tracks` are then as it sees them. `field`: of its
    taxels; `hold_s`: for which its commands may be held.
    """
    believed, reading = erring or (scene, np.zeros(scene.robot.n_joints))
    skin = scene.skins[encounter.side]
    arm = scene.arm(encounter.side)
    is_harmless = encounter.condition in HARMLESS
    believed_skin = memory.skin_of(believed.skins[encounter.side])
    home_rad = encounter.q_rad + reading
    robot = believed.robot, believed_skin, encounter.side, home_rad, believed.self_collision
    arm_scene = ArmScene(*robot, hold_s)
    act = new_controller(arm_scene)
    monitor = EncounterMonitor(scene, encounter)
    q = encounter.q_rad
    posture = believed.robot.at(home_rad)
    felt_at, normals = believed_skin.at(posture)
    taxels = skin.at(scene.robot.at(q))[0]
    learned = LearnerState(memory)
    last: JointVelocity | None = None
    last_q: Array | None = None
    monitor.add_posture(q)
    for track in tracks:
        t = track.stamp_s
        touched = felt(skin, believed_skin, touched_taxels(taxels, encounter.motion(t)[0], encounter.radius_m))
        perceived = believed_skin.taxel_ids, felt_at, normals, touched, [track], track.track_id, believed_skin.margins
        skin_frame = SkinFrame(t, *perceived)
        learned, output = learner.step(field, learned, skin_frame)
        activations = output.activation.probability
        rates = act(activations, track, posture)
        command: JointVelocity | None = None
        if np.any(rates) or (last is not None and np.any(last.dq_rad_s)):
            requested = JointVelocity(t, rates, arm_scene.hold_s)
            command = limit(LimitParams(), believed.self_collision, posture, requested, last, last_q)
            monitor.add_command(t, command.dq_rad_s, arm)
        last = command
        last_q = posture.q_rad
        dq = own_rate(scene.robot, encounter.own_motion, arm, t)
        if encounter.own_motion != "arm" and command is not None:
            dq = dq + command.dq_rad_s
        previous = taxels
        if np.any(dq):
            q = q + PERIOD_S * dq
            if encounter.own_motion or erring:
                q = scene.robot.clamp(q)
            posture = believed.robot.at(q + reading)
            felt_at, normals = believed_skin.at(posture)
            taxels = skin.at(scene.robot.at(q))[0]
            monitor.add_posture(q)
        monitor.add_motion(t, previous, taxels)
        if frames is not None:
            gap = np.linalg.norm(taxels - encounter.motion(t + PERIOD_S)[0], axis=1) - encounter.radius_m
            speed = float(np.linalg.norm((taxels - previous)[activations.argmax()])) / PERIOD_S
            frames.append(FrameLog(t, q, gap, activations, speed, bool((gap <= TOUCH_RADIUS_M).any())))
        elif monitor.touched_part or (is_harmless and t > monitor.first_command_s + _AFTER_COMMAND_S):
            break
    return monitor.result(name)
