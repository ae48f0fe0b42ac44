"""What moves towards the skin in R's three milestones: the robot's own finger, and what a hand holds."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import count, cycle, islice
from typing import Literal, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from control.double_touch import FINGERTIP_RADIUS_M, DoubleTouch, DoubleTouching
from control.fixation import gaze_at
from pps_vision.app.in_view import can_follow
from pps_vision.robot.icub import home, icub_rig, load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import INNER_FOREARM, OUTER_FOREARM, Skin, icub_skin, taxel_frame, touched_taxels
from pps_vision.types import Array, Mask
from rendering.motions import make_reach
from rendering.names import StimulusName
from rendering.stimuli import make_stimulus

Condition = Literal["motor", "visual", "inner", "outer", "palm"]
TRIALS = {"motor": 82, "visual": 45, "inner": 53, "outer": 34, "palm": 77}
"""How many R made of each (Table 5)."""
STEP_S = 0.05

_PALM = (101, 103, 118, 137)
_AIMED = {"outer": ("left_forearm", OUTER_FOREARM), "palm": ("right_palm", _PALM)}
# Arms in chain order, degrees; these show what is aimed at to both eyes.  The arm that is not aimed at hangs.
_OUTER_ARM_DEG = (-29.4, 18.2, 87.2, 37.6, 39.1, -16.3, -12.2)
_PALM_ARM_DEG = (-25.6, 24.5, -19.6, 24.2, -41.1, 3.0, -16.0)
_HANGING_ARM_DEG = (0.0, 15.0, 0.0, 20.0, 0.0, 0.0, 0.0)
_OBJECTS: tuple[StimulusName, ...] = ("ball", "cube")
_START_M = (0.21, 0.25)  # just beyond the receptive field, so that the eyes have it when it enters
_PEAK_M_S = (0.10, 0.25)
_SCATTER_M = 0.025  # how far from the taxel it is aimed at a hand lands, each way: standard deviation
_MISS_M = (0.06, 0.10)  # how far beside it one that misses passes
_DEEPEST_M = -0.005  # on its way nothing sinks deeper into a taxel
_MARGIN_PX = 15.0  # a fingertip's distance from the image's rim
_BATCH = 12  # double touches planned at once
_BEGIN = 0.15  # of the time to the touch: before, a reach hardly moves


@dataclass(frozen=True, slots=True)
class Movement:
    """What really happens: stamps (T,) s, the last that of the touch; joints (T, k) rad, their eyes where the
    movement starts; the object's positions, velocities (T, 3) in the root frame and how it is turned (3, 3);
    the taxels `touched` (n,) in the end, of the whole skin, and the one aimed at."""

    stimulus: StimulusName
    rotation: Array
    stamps_s: Array
    joints_rad: Array
    positions: Array
    velocities: Array
    touched: Mask
    aimed: str

    @property
    def radius_m(self) -> float:
        """Of the object."""
        return make_stimulus(self.stimulus, fineness=0).radius_m


@cache  # several figures start from the same
def movements(condition: Condition, n: int, seed: int, touching: bool = True) -> tuple[Movement, ...]:
    """What happens in the first `n` trials of a seed; trial k is the same however many are asked for.

    motor, visual: double touches of the inner forearm with the right index fingertip, a green marker on it.  inner,
    outer, palm: a ball and a cube in turn come to the inner or outer left forearm or the right palm; with
    `touching` off they pass beside it.
    """
    if condition not in get_args(Condition):
        raise ValueError(f"trials {condition!r}; expected one of {', '.join(get_args(Condition))}")
    if n < 1:
        raise ValueError(f"{n} trials of {condition}; expected at least 1")
    if condition in ("motor", "visual"):
        if not touching:
            raise ValueError(f"near misses of {condition} trials; expected inner, outer or palm: a finger always hits")
        return tuple(islice(_double_touches(condition, seed), n))
    return tuple(_approach(condition, k, seed, touching) for k in range(n))


def home_of(robot: Robot, condition: Condition) -> Array:
    """The configuration in which a part of the skin awaits objects: within sight of both eyes."""
    q = home(robot)
    arms = {"outer": (_OUTER_ARM_DEG, _HANGING_ARM_DEG), "palm": (_HANGING_ARM_DEG, _PALM_ARM_DEG)}.get(condition, ())
    for side, degrees in zip(("left", "right"), arms, strict=False):
        q[robot.indices(robot.names.arm(side))] = np.deg2rad(degrees)
    return q


@cache
def _world() -> tuple[Robot, Skin, DoubleTouching]:
    robot = load_icub()
    return robot, icub_skin(), DoubleTouching(robot, icub_skin(("left_forearm",)).parts[0])


def _approach(condition: Condition, k: int, seed: int, touching: bool) -> Movement:
    """Trial `k`: drawn until it does (or does not) touch and the eyes can follow it."""
    robot, skin, _ = _world()
    rng = np.random.default_rng((seed, get_args(Condition).index(condition), touching, k))
    part, ids = _AIMED.get(condition, ("left_forearm", INNER_FOREARM))
    aimed = f"{part}:{ids[k % len(ids)]}"
    stimulus = _OBJECTS[k % len(_OBJECTS)]
    radius = make_stimulus(stimulus, fineness=0).radius_m
    q = home_of(robot, condition)
    positions, normals = skin.at(robot.at(q))
    T = taxel_frame(positions[skin.index(aimed)], normals[skin.index(aimed)])
    for _ in range(500):
        beside = _SCATTER_M * rng.standard_normal(2) if touching else _in_ring(rng, *_MISS_M)
        end = T[:3, :3] @ np.array([*beside, radius]) + T[:3, 3]
        reach = make_reach(rng, end, T[:3, 2], rng.uniform(*_START_M), rng.uniform(*_PEAK_M_S))
        stamps = _until(reach.arrives_s)
        path, velocities = (np.array(a) for a in zip(*(reach(float(t)) for t in stamps), strict=True))
        touched = np.array([touched_taxels(positions, p, radius) for p in path])
        gap = np.linalg.norm(path[:, None] - positions, axis=2).min(axis=1) - radius
        right = touched[-1].any() == touching and (touching or not touched.any()) and gap.min() > _DEEPEST_M
        if right and can_follow(robot, icub_rig(robot), q, reach, reach.arrives_s):
            turned = Rotation.random(random_state=rng).as_matrix()
            joints = np.tile(gaze_at(robot, q, path[0]), (len(stamps), 1))
            return Movement(stimulus, turned, stamps - stamps[0], joints, path, velocities, touched[-1], aimed)
    raise ValueError(f"no approach to {aimed} stays in view of both eyes; expected a taxel that its posture shows")


def _until(end_s: float) -> Array:
    """Stamps every step back from the end to where something happens."""
    return end_s - STEP_S * np.arange(int((1 - _BEGIN) * end_s / STEP_S), -1, -1)


def _in_ring(rng: np.random.Generator, inner: float, outer: float) -> Array:
    azimuth, radius = rng.uniform(0, 2 * np.pi), rng.uniform(inner, outer)
    return radius * np.array([np.cos(azimuth), np.sin(azimuth)])


def _double_touches(condition: Condition, seed: int) -> Iterator[Movement]:
    """Double touches of the inner taxels in turn; of visual ones, those the eyes can see."""
    planner = _world()[2]
    plans = {i: _plans(condition, planner.part.ids.index(i), seed) for i in INNER_FOREARM}
    for i in cycle(INNER_FOREARM):
        yield next(plans[i])


def _plans(condition: Condition, taxel: int, seed: int) -> Iterator[Movement]:
    """Double touches of one taxel."""
    robot, skin, planner = _world()
    for batch in count():
        rng = np.random.default_rng((seed, get_args(Condition).index(condition), taxel, batch))
        for touch in planner.plan(taxel, _BATCH, rng):
            if isinstance(touch, DoubleTouch):
                movement = _of_finger(robot, skin, touch, f"{planner.part.name}:{planner.part.ids[taxel]}")
                if condition == "motor" or _is_in_view(robot, movement):
                    yield movement


def _of_finger(robot: Robot, skin: Skin, touch: DoubleTouch, aimed: str) -> Movement:
    """What moves is the fingertip."""
    tip = np.array([robot.at(q).point(robot.names.index_tips[1]) for q in touch.joints_rad])
    velocities = np.gradient(tip, touch.stamps_s, axis=0, edge_order=2)
    joints = np.where(of_gaze(robot), gaze_at(robot, touch.joints_rad[0], tip[0]), touch.joints_rad)
    positions, _ = skin.at(robot.at(joints[-1]))
    touched = touched_taxels(positions, tip[-1], FINGERTIP_RADIUS_M)
    return Movement("marker", np.eye(3), touch.stamps_s, joints, tip, velocities, touched, aimed)


def _is_in_view(robot: Robot, movement: Movement) -> bool:
    """Whether both eyes, turned to it, have the fingertip in their image along its way."""
    rig = icub_rig(robot)
    for q, tip in zip(movement.joints_rad[::-8], movement.positions[::-8], strict=True):
        view = rig.view(gaze_at(robot, q, tip))
        if not (view.left.sees(tip, _MARGIN_PX) and view.right.sees(tip, _MARGIN_PX)):
            return False
    return True


def of_gaze(robot: Robot) -> Mask:
    """(k,) which joints turn head and eyes."""
    mask = np.zeros(robot.n_joints, dtype=bool)
    mask[robot.indices(robot.names.gaze_joints)] = True
    return mask
