"""Search for a target that is not in view by random left–right and up–down turns of the head (J IV.B)."""

from dataclasses import dataclass, field

import numpy as np

from control.differential_kinematics import rate_limits
from control.head import PITCH, TILT, VERGENCE, YAW, HeadLimits, gaze_columns, gaze_of, gaze_range
from control.limits import check_times
from pps_vision.robot.model import Posture
from pps_vision.types import Array, JointVelocity

_DEG = np.pi / 180


@dataclass(frozen=True)
class SearchParams:
    """Range and speed of the search."""

    yaw_rad: float = 30 * _DEG
    """Largest turn to the left and right of the centre."""
    pitch_rad: float = 20 * _DEG
    """Largest turn up and down from the centre."""
    gain_per_s: float = 8.0
    """The head nears a goal no faster than this times the angle left."""
    limits: HeadLimits = field(default_factory=lambda: HeadLimits(neck_rad_s=30 * _DEG, eyes_rad_s=30 * _DEG))
    """Range and speed of the head."""
    arrived_rad: float = 1 * _DEG
    """Largest angle from a goal that counts as having reached it."""


@dataclass(frozen=True)
class SearchState:
    """A search under way."""

    center: Array
    """(4,) rad, the gaze to search around (`head.gaze_of`)."""
    goal: Array | None = None
    """(4,) rad, the gaze that the head turns to; None before the first step."""


def step(
    params: SearchParams,
    state: SearchState,
    posture: Posture,
    dt_s: float,
    rng: np.random.Generator,
    stamp_s: float = 0.0,
) -> tuple[SearchState, JointVelocity]:
    """Head rates towards a random goal within the limits, a new one as each is reached.

    The rates may be held for `dt_s`: no joint leaves its limits meanwhile.  InputError for a stamp that is not finite
    or a `dt_s` out of (0, 0.5].
    """
    check_times("search", stamp_s, dt_s)
    gaze = gaze_of(posture)
    lower, upper = gaze_range(params.limits.gaze, posture)
    goal = state.goal
    if goal is None or np.abs(goal - gaze).max() < params.arrived_rad:
        goal = _random_goal(params, state.center, lower, upper, rng)
    slowest, fastest = rate_limits(gaze, lower, upper, params.limits.max_rate, 1 / dt_s)
    rates = np.clip(params.gain_per_s * (goal - gaze), slowest, fastest)
    return SearchState(state.center, goal), JointVelocity(stamp_s, gaze_columns(posture.robot) @ rates, dt_s)


def _random_goal(params: SearchParams, center: Array, lower: Array, upper: Array, rng: np.random.Generator) -> Array:
    """A random gaze about the centre; the eyes' tilt continues where the neck's pitch ends."""
    aside, up = rng.uniform(-1, 1, 2) * (params.yaw_rad, params.pitch_rad)
    pitch = center[PITCH] + center[TILT] + up
    goal = np.empty(4)
    goal[YAW], goal[VERGENCE] = center[YAW] + aside, center[VERGENCE]
    goal[PITCH] = np.clip(pitch, lower[PITCH], upper[PITCH])
    goal[TILT] = pitch - goal[PITCH]
    return np.clip(goal, lower, upper)
