"""Look around for a target that is not in view: random left–right and up–down turns (J IV.B)."""

from dataclasses import dataclass, field

import numpy as np

from control.head import PITCH, TILT, VERGENCE, YAW, HeadLimits, gaze_columns, gaze_of, gaze_range
from control.rates import rate_bounds
from pps_vision.robot.model import Posture
from pps_vision.types import Array, JointVelocity

_DEG = np.pi / 180


@dataclass(frozen=True)
class SearchParams:
    """How far to look left–right and up–down of the centre, and how fast to turn."""

    yaw_rad: float = 30 * _DEG
    pitch_rad: float = 20 * _DEG
    limits: HeadLimits = field(default_factory=lambda: HeadLimits(neck_rad_s=30 * _DEG, eyes_rad_s=30 * _DEG))
    arrived_rad: float = 1 * _DEG


@dataclass(frozen=True)
class SearchState:
    """`center` (4,) rad is the gaze to search around (`head.gaze_of` of a posture that looks
    there), `goal` (4,) where the head turns next; None before the first step."""

    center: Array
    goal: Array | None = None


def step(
    params: SearchParams,
    state: SearchState,
    posture: Posture,
    dt_s: float,
    rng: np.random.Generator,
    stamp_s: float = 0.0,
) -> tuple[SearchState, JointVelocity]:
    """Head rates towards a random goal within the limits, a new one as each is reached."""
    gaze = gaze_of(posture)
    lower, upper = gaze_range(params.limits.gaze, posture)
    goal = state.goal
    if goal is None or np.abs(goal - gaze).max() < params.arrived_rad:
        goal = _random_goal(params, state.center, lower, upper, rng)
    slowest, fastest = rate_bounds(gaze, lower, upper, params.limits.max_rate, 1 / dt_s)
    rates = np.clip((goal - gaze) / dt_s, slowest, fastest)
    return SearchState(state.center, goal), JointVelocity(stamp_s, gaze_columns(posture.robot) @ rates)


def _random_goal(params: SearchParams, center: Array, lower: Array, upper: Array, rng: np.random.Generator) -> Array:
    """A gaze about the centre; where the neck's pitch ends the eyes' tilt goes on."""
    aside, up = rng.uniform(-1, 1, 2) * (params.yaw_rad, params.pitch_rad)
    pitch = center[PITCH] + center[TILT] + up
    goal = np.empty(4)
    goal[YAW], goal[VERGENCE] = center[YAW] + aside, center[VERGENCE]
    goal[PITCH] = np.clip(pitch, lower[PITCH], upper[PITCH])
    goal[TILT] = pitch - goal[PITCH]
    return np.clip(goal, lower, upper)
