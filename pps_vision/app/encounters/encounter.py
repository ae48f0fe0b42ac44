"""Encounters of an arm with an object: who meets whom, where, at what speed, and when they would touch.

Encounter `number` of a seed is always the same, whatever else is drawn.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Literal, NamedTuple, get_args

import coal
import numpy as np

from control.fixation import gaze_at
from pps_vision.app import simulation
from pps_vision.app.simulation import PERIOD_S, REACH_M, OwnMotion, Side
from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.geometry.paths import arrival_s
from pps_vision.geometry.se3 import rotation_to, transform
from pps_vision.robot.icub import home, icub_setup
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.robot_setup import RobotSetup
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import INNER_FOREARM, TOUCH_RADIUS_M, Skin, icub_skin
from pps_vision.types import Array, Mask
from rendering.motions import START_M, Approach, Motion, Recede, in_cap, make_approach
from rendering.names import StimulusName
from rendering.stimuli import make_stimulus

Part = str  # the iCub's "inner forearm", "outer forearm" or "palm", or a part of another robot's skin
Condition = Literal[
    "stop",
    "press",
    "through",
    "reach",
    "harmless_receding",
    "harmless_static",
    "harmless_passing",
    "harmless_head",
    "harmless_own_arm",
    "graze",
    "harmless_near",
]
HAZARDS: tuple[Condition, ...] = ("stop", "press", "through", "graze")
HARMLESS: tuple[Condition, ...] = tuple(c for c in get_args(Condition) if c.startswith("harmless"))
"""In these nothing should be commanded."""
OBJECTS: tuple[StimulusName, ...] = ("ball", "cube", "octopus", "marker")
"""The memory is learned from the first two; the others are unseen."""
SPEED_M_S = (0.05, 0.30)
PRESS_M = 0.03  # how far an object of `press` goes on beyond the would-be contact
BEYOND_M = 0.15  # how far an object of `through` goes on
PASS_M = (0.10, 0.20)  # smallest distance from a passing object's surface to a taxel's centre
NEAR_M = (0.05, 0.10)  # the same of `harmless_near`
GRAZE_M = (0.005, 0.015)  # the same of `graze`: the path is a passing one, the distance one of touch

SessionName = Literal["motor", "visual", "inner", "outer", "palm"]
"""motor, visual: double touches of the inner left forearm with the right index finger, felt or seen (its marker).
inner, outer, palm: a ball and a cube in turn approach the inner or outer left forearm or the right palm."""
TRIALS: dict[SessionName, int] = {"motor": 82, "visual": 45, "inner": 53, "outer": 34, "palm": 77}
"""Trials of each session (R Table 5)."""

SESSIONS: dict[Part, SessionName] = {"inner forearm": "inner", "outer forearm": "outer", "palm": "palm"}
"""R's session with approaches to each body part."""
# Arms in chain order, degrees; both eyes see the taxels aimed at.  The other arm hangs down.
_OUTER_ARM_DEG = (-29.4, 18.2, 87.2, 37.6, 39.1, -16.3, -12.2)
_PALM_ARM_DEG = (-25.6, 24.5, -19.6, 24.2, -41.1, 3.0, -16.0)
_HANGING_ARM_DEG = (0.0, 15.0, 0.0, 20.0, 0.0, 0.0, 0.0)
_SPREAD_RAD = np.deg2rad(15.0)  # range of each arm joint about the part's posture
_TURN_RAD = np.deg2rad(10.0)  # range of torso and neck about upright
_CLEARANCE_M = 0.03  # self-collision distance of a start posture; the controllers keep 25 mm
_MARGIN_RAD = np.deg2rad(3.0)  # from a start posture's arm joints to their limits
_DRAWS = 6  # paths tried for a posture
_POSTURES = 1000  # tried for an encounter
_POSTURES_OF_TAXEL = 200  # of them, before another taxel is drawn
_MIN_CONTACT_S = 0.3  # earliest would-be contact
_MAX_HIDDEN_SHARE = 0.25  # share of the object that the robot's bodies may hide from an eye
_INSTANTS = 4  # at which a path is tested
_RIM = 8  # points about an object's middle, at 0.8 of its radius
_DWELL_S = 0.3  # at the end of an approach
_AFTER_S = 1.2  # from there to the end of the encounter
_WAIT_S = 2.0  # for which an object to reach for stays
_REST_S = 4.0  # length of encounters with an object at rest
_REST_M = (0.10, 0.15)  # from the surface of an object at rest to the nearest taxel's centre
_CLEAR_M = (0.20, 0.25)  # the same while the arm swings, which takes it up to 10 cm nearer
_SHORT_OF_M = 0.05  # from where an object to reach for stops to the would-be contact


@dataclass(frozen=True)
class Encounter:
    """One object, one path, one posture."""

    number: int  # index of the encounter, by seed and condition
    condition: Condition  # motion of the object
    side: Side  # the arm it is about
    part: Part  # the body part aimed at
    taxel: str  # the taxel "part:id" aimed at
    stimulus: StimulusName  # the object
    radius_m: float  # its radius
    speed_m_s: float  # its speed
    motion: Motion  # its path
    seconds: float  # length of the encounter
    contact_s: float  # when it would touch the arm at rest; inf if it would not
    q_rad: Array  # (n_joints,) the robot at the start, its eyes on the object

    @property
    def own_motion(self) -> OwnMotion:
        """Motion of the robot that no controller commands."""
        return {"harmless_own_arm": "arm", "harmless_head": "head"}.get(self.condition, "")  # type: ignore[return-value]


class EncounterScene:
    """The robot and its skin, as the encounters of one process share them."""

    def __init__(self, setup: RobotSetup | None = None) -> None:
        """By default the iCub, without error."""
        self.setup = setup or icub_setup()
        self.robot: Robot = self.setup.robot
        self.rig: StereoRig = self.setup.rig
        self.self_collision = SelfCollision(self.robot)
        skin = self.setup.skin
        self.is_icub = set(icub_skin().taxel_ids) <= set(skin.taxel_ids)
        self.skins: dict[Side, Skin] = {side: skin.on_arm(self.robot, side) for side in get_args(Side)}

    def setup_of(self, encounter: Encounter) -> RobotSetup:
        """Return the robot with the skin of an encounter's arm, at home in its posture."""
        return replace(self.setup, skin=self.skins[encounter.side], home_rad=encounter.q_rad)

    @cached_property
    def targets(self) -> tuple[tuple[Side, Part], ...]:
        """Arms and their parts at which objects come; for a robot other than the iCub, the parts that its cameras see
        at home. InputError without any."""
        if self.is_icub:
            return tuple(product(self.skins, SESSIONS))
        parts = [(side, part.name) for side, skin in self.skins.items() for part in skin.parts]
        if seen := tuple(target for target in parts if self.taxels(*target)):
            return seen
        problem = f"no part of {', '.join(name for _, name in parts)[:200]} faces both cameras and is seen at home"
        raise InputError(self.robot.urdf, f"{problem}; expected one that objects can come at in view")

    def taxels(self, side: Side, part: Part) -> list[int]:
        """Return the indices of a part's taxels at which objects come."""
        skin = self.skins[side]
        faces = None if self.is_icub else simulation.facing_taxels(self.setup, skin, self.setup.home_rad)
        own = (k for k, id_ in enumerate(skin.taxel_ids) if self.body_part(id_) == part)
        return [k for k in own if faces is None or faces[k]]

    def body_part(self, taxel_id: str) -> Part:
        """Return the body part of a taxel."""
        part, number = taxel_id.split(":")
        if not self.is_icub:
            return part
        if not part.endswith("forearm"):
            return part.partition("_")[2]
        return "inner forearm" if int(number) in INNER_FOREARM else "outer forearm"

    def arm(self, side: Side) -> list[int]:
        """Return the indices of an arm's joints in the configuration vector."""
        return self.robot.indices(self.robot.names.arm(side))

    def may_swing(self, q_rad: Array, side: Side) -> bool:
        """Return whether an arm that swings by itself keeps clear of the body."""
        times = np.arange(0.0, _REST_S, PERIOD_S)
        swing = PERIOD_S * np.cumsum([simulation.own_rate(self.robot, "arm", self.arm(side), t) for t in times], axis=0)
        return min(self.self_collision.distance_m(self.robot.clamp(q_rad + dq)) for dq in swing) > _CLEARANCE_M

    def hidden_share(self, posture: Posture, eye: Array, center: Array, radius_m: float) -> float:
        """Return the share of a ball about `center` (3,) that the robot's bodies hide from an eye at `eye` (3,).

        Of its middle and of points about it: whether a body meets the straight line to the eye, by coal.
        """
        turn = rotation_to(center - eye)
        angles = np.arange(_RIM) * 2 * np.pi / _RIM
        rim = 0.8 * radius_m * (np.cos(angles)[:, None] * turn[:, 0] + np.sin(angles)[:, None] * turn[:, 1])
        poses = [_pose(posture.T_root(body.frame) @ body.T_frame_body) for body in self.robot.bodies]
        shapes = [shape.geometry for shape in self.robot.geometry.geometryObjects]
        hidden = 0
        for point in (center, *(center + rim)):
            line = coal.Capsule(1e-4, float(np.linalg.norm(point - eye)))
            at = _pose(transform(rotation_to(point - eye), (eye + point) / 2))
            hidden += any(
                coal.collide(shape, T, line, at, coal.CollisionRequest(), coal.CollisionResult())
                for shape, T in zip(shapes, poses, strict=True)
            )
        return hidden / (1 + _RIM)

    def shows(self, q_rad: Array, motion: Motion, radius_m: float, until_s: float) -> bool:
        """Return whether a posture's own bodies leave most of an object on its path visible to both fixating eyes."""
        for t in np.linspace(0.0, until_s, _INSTANTS)[::-1]:  # near the arm most is hidden
            center = motion(float(t))[0]
            q = gaze_at(self.robot, q_rad, center)
            view = self.rig.view(q)
            posture = self.robot.at(q)
            for eye in (view.left, view.right):
                if self.hidden_share(posture, eye.center, center, radius_m) > _MAX_HIDDEN_SHARE:
                    return False
        return True


def felt(surface: Skin, skin: Skin, touched: Mask) -> Mask:
    """Return the taxels (n,) of a `skin` that report touches of points (m,) of a surface: the same points, and all of
    the hand for parts of the surface beyond the skin's, such as a stick in it; none of a place that it has learned."""
    both = sum(a.name == b.name for a, b in zip(surface.parts, skin.parts, strict=False))
    n = sum(len(part.ids) for part in skin.parts[:both])
    reported = np.zeros(len(skin.taxel_ids), dtype=bool)
    reported[:n] = touched[:n]
    for k, part in enumerate(surface.parts[both:], both):
        if touched[surface.part_index == k].any():
            reported[:n] |= np.array([skin.parts[i].frame == part.frame for i in skin.part_index[:n]])
    return reported


class Aim(NamedTuple):
    """Conditions of a path."""

    skin: Skin
    posture: Posture
    taxel: int  # number of the taxel aimed at
    radius_m: float
    speed_m_s: float
    rng: np.random.Generator


Path = tuple[Motion, float, float]  # a motion, the length of the encounter and the time of the would-be contact
DrawPath = Callable[[Aim], Path]


def draw(scene: EncounterScene, condition: Condition, number: int, seed: int) -> Encounter:
    """Return encounter `number` of a condition: parts, sides and objects by rotation, everything else at random."""
    rng = np.random.default_rng((seed, get_args(Condition).index(condition), number))
    side, part = scene.targets[number % len(scene.targets)]
    stimulus = OBJECTS[number // len(scene.targets) % len(OBJECTS)]
    speed = float(rng.uniform(*SPEED_M_S))
    return draw_one(scene, condition, side, part, stimulus, speed, rng, number)


def draw_one(
    scene: EncounterScene,
    condition: Condition,
    side: Side,
    part: Part,
    stimulus: StimulusName,
    speed_m_s: float,
    rng: np.random.Generator,
    number: int = 0,
    path: DrawPath | None = None,
) -> Encounter:
    """Return a random encounter in which both eyes see the object until it would touch, or all the time: it is in their
    fields of view, and the robot's own bodies hide little of it.

    `path`: draws the path in place of the condition's own.
    """
    radius = make_stimulus(stimulus, fineness=0).radius_m
    for k in range(_POSTURES):
        if k % _POSTURES_OF_TAXEL == 0:
            taxel = int(rng.choice(scene.taxels(side, part)))
        q = draw_posture(scene, side, part, rng)
        if condition == "harmless_own_arm" and not scene.may_swing(q, side):
            continue
        aim = Aim(scene.skins[side], scene.robot.at(q), taxel, radius, speed_m_s, rng)
        for _ in range(_DRAWS):
            if encounter := draw_visible(scene, aim, condition, side, part, stimulus, number, path):
                return encounter
    problem = f"no {condition} at {side} {part} in view in {_POSTURES} postures"
    raise InputError(scene.robot.urdf, f"{problem}; expected cameras that see the space before the skin at home")


def draw_visible(
    scene: EncounterScene,
    aim: "Aim",
    condition: Condition,
    side: Side,
    part: Part,
    stimulus: StimulusName,
    number: int,
    path: DrawPath | None = None,
) -> Encounter | None:
    """Return the encounter of one path, or None if the eyes do not see the object as `draw_one` demands."""
    motion, seconds, contact_s = (path or PATHS[condition])(aim)
    if contact_s <= _MIN_CONTACT_S:
        return None
    q = gaze_at(scene.robot, aim.posture.q_rad, motion(0.0)[0])
    until_s = min(seconds, contact_s)
    if not scene.shows(q, motion, aim.radius_m, until_s):
        return None
    if not simulation.can_follow(scene.robot, scene.rig, q, motion, until_s, 3):
        return None
    target = side, part, aim.skin.taxel_ids[aim.taxel]
    return Encounter(number, condition, *target, stimulus, aim.radius_m, aim.speed_m_s, motion, seconds, contact_s, q)


def start_posture(robot: Robot, session: SessionName) -> Array:
    """Return the joints (k,) rad in which the skin awaits objects: within sight of both eyes."""
    q = home(robot)
    arms = {"outer": (_OUTER_ARM_DEG, _HANGING_ARM_DEG), "palm": (_HANGING_ARM_DEG, _PALM_ARM_DEG)}.get(session, ())
    for side, degrees in zip(("left", "right"), arms, strict=False):
        q[robot.indices(robot.names.arm(side))] = np.deg2rad(degrees)
    return q


def draw_posture(scene: EncounterScene, side: Side, part: Part, rng: np.random.Generator) -> Array:
    """Return joints (n_joints,) about those in which R's robot awaited touches of the part, torso and neck turned; of
    another robot about home."""
    robot = scene.robot
    arm = scene.arm(side)
    base = scene.setup.home_rad.copy()
    turned: list[int] = []
    if scene.is_icub:
        base = start_posture(robot, SESSIONS[part])
        base[arm] = base[scene.arm("right" if part == "palm" else "left")]
        base[scene.arm("right" if side == "left" else "left")] = start_posture(robot, "palm")[scene.arm("left")]
        turned = robot.indices(("torso_yaw", "torso_pitch", "torso_roll", "neck_pitch", "neck_roll", "neck_yaw"))
    for _ in range(_POSTURES):
        q = base.copy()
        q[arm] += rng.uniform(-_SPREAD_RAD, _SPREAD_RAD, len(arm))
        q[turned] += rng.uniform(-_TURN_RAD, _TURN_RAD, len(turned))
        q[arm] = np.clip(q[arm], robot.lower_rad[arm] + _MARGIN_RAD, robot.upper_rad[arm] - _MARGIN_RAD)
        q = robot.clamp(q)
        if scene.self_collision.distance_m(q) > _CLEARANCE_M:
            return q
    problem = f"no posture about home keeps {100 * _CLEARANCE_M:g} cm between its bodies"
    raise InputError(robot.urdf, f"{problem}; expected another home_deg in robot.toml")


def approach(end_m: float, dwell_s: float = _DWELL_S) -> DrawPath:
    """Return the drawing of approaches that end `end_m` beyond (below 0: before) the would-be contact.

    They stay there for `dwell_s`.
    """

    def path(aim: Aim) -> Path:
        speed = aim.speed_m_s
        target = simulation.at_taxel(aim.skin, aim.posture, aim.taxel, aim.radius_m + REACH_M["approach"])
        visit = make_approach(aim.rng, target, speed)
        ahead = (visit.end - visit.start) / np.linalg.norm(visit.end - visit.start)
        end = visit.end + end_m * ahead
        taxels, _ = aim.skin.at(aim.posture)
        contact_s = float(arrival_s(taxels, visit.start, speed * ahead, aim.radius_m + TOUCH_RADIUS_M))
        arrives_s = float(np.linalg.norm(end - visit.start)) / speed
        if end_m > 2 * PRESS_M:
            return Recede(visit.start, end, speed), arrives_s + dwell_s, contact_s
        return Approach(visit.start, end, speed, dwell_s), arrives_s + dwell_s + _AFTER_S, contact_s

    return path


def _recede(aim: Aim) -> Path:
    target = simulation.at_taxel(aim.skin, aim.posture, aim.taxel, aim.radius_m + REACH_M["recede"])
    visit = make_approach(aim.rng, target, aim.speed_m_s)
    return Recede(visit.end, visit.start, aim.speed_m_s), visit.contact_s + 0.5, np.inf


def _rest(rest_m: tuple[float, float]) -> DrawPath:
    """Return the drawing of objects that move 5 cm away from the skin, so that they are detected, and rest."""

    def path(aim: Aim) -> Path:
        positions, normals = aim.skin.at(aim.posture)
        distance = aim.radius_m + aim.rng.uniform(*rest_m)
        away = in_cap(aim.rng, normals[aim.taxel])
        start = positions[aim.taxel] + (distance + START_M[1]) * away
        end = simulation.first_contact(start, positions[aim.taxel], positions, distance)
        return Recede(end - 0.05 * away, end, aim.speed_m_s), _REST_S, np.inf

    return path


def passing(distance_m: tuple[float, float]) -> DrawPath:
    """Return the drawing of straight paths past the arm, this far from the skin where they are nearest."""

    def path(aim: Aim) -> Path:
        taxels, normals = aim.skin.at(aim.posture)
        distance = aim.rng.uniform(*distance_m)
        out = in_cap(aim.rng, normals[aim.taxel])
        sideways = rotation_to(out)[:, :2] @ _unit(aim.rng.standard_normal(2))
        start = taxels[aim.taxel] + 2 * out - START_M[1] * sideways
        d = taxels - start
        aside = d @ np.cross(out, sideways)
        reach = aim.radius_m + distance
        near = np.abs(aside) < reach
        start = start - out * np.min(-(d[near] @ out) - np.sqrt(reach**2 - aside[near] ** 2))  # lowered until near
        length = 2 * START_M[1]
        contact_s = float(arrival_s(taxels, start, aim.speed_m_s * sideways, aim.radius_m + TOUCH_RADIUS_M))
        return Recede(start, start + length * sideways, aim.speed_m_s), length / aim.speed_m_s + 0.3, contact_s

    return path


def _pose(T: Array) -> coal.Transform3s:
    return coal.Transform3s(T[:3, :3], T[:3, 3])


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


PATHS: dict[Condition, DrawPath] = {
    "stop": approach(0.0),
    "press": approach(PRESS_M),
    "through": approach(BEYOND_M),
    "reach": approach(-_SHORT_OF_M, _WAIT_S),
    "harmless_receding": _recede,
    "harmless_static": _rest(_REST_M),
    "harmless_passing": passing(PASS_M),
    "harmless_head": _rest(_REST_M),
    "harmless_own_arm": _rest(_CLEAR_M),
    "graze": passing(GRAZE_M),
    "harmless_near": passing(NEAR_M),
}
