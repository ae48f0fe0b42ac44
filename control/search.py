"""Search for a target that is not in view: over the whole gaze range in bounded time, or at random (J IV.B).

The covering search visits the points of a grid, always the nearest unvisited one.  Half of the grid's spacing, 20° and
15°, is less than the half field of view of an iCub eye, 33° and 25°; the remainder allows for the vergence: at 20° both
eyes see objects 8 cm to many metres away, at 60° nearer ones.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from control.differential_kinematics import rate_limits
from control.head import PITCH, TILT, VERGENCE, YAW, HeadLimits, gaze_columns, gaze_of, gaze_range
from control.limits import check_times
from pps_vision.robot.model import Posture
from pps_vision.types import Array, JointVelocity

_DEG = np.pi / 180


@dataclass(frozen=True)
class SearchParams:
    """Range and speed of the search.

    Covering: all directions, nearest first, alternating the vergence; random: about the centre, at its vergence (J).
    """

    pattern: Literal["covering", "random"] = "covering"
    spacing_rad: tuple[float, float] = (
        40 * _DEG,
        30 * _DEG,
    )  # covering: the grid's points in yaw and pitch, at most
    vergence_rad: tuple[float, float] = (20 * _DEG, 60 * _DEG)  # covering: alternating vergences
    yaw_rad: float = 30 * _DEG  # random: largest turn to the left and right of the centre
    pitch_rad: float = 20 * _DEG  # random: largest turn up and down from the centre
    gain_per_s: float = 8.0  # rate of the head towards a goal, per remaining angle
    limits: HeadLimits = field(default_factory=lambda: HeadLimits(neck_rad_s=30 * _DEG, eyes_rad_s=30 * _DEG))
    arrived_rad: float = 1 * _DEG  # largest angle from a goal that counts as having reached it

    def __post_init__(self) -> None:
        if self.pattern not in ("covering", "random") or not min(self.spacing_rad) > 0:
            problem = f"search {self.pattern!r}, spacing {self.spacing_rad}"
            raise ValueError(f"{problem}; expected covering or random, above 0")


@dataclass(frozen=True)
class SearchState:
    """A search under way."""

    center: Array  # (4,) rad, the gaze to search around (`head.gaze_of`)
    goal: Array | None = None  # (4,) rad, the gaze that the head turns to; None before the first step
    unvisited: Array = field(default_factory=lambda: np.empty((0, 4)))  # (k, 4) rad, covering: goals at this vergence
    visits: int = 0  # number of visits to the whole grid that have begun


def step(
    params: SearchParams,
    state: SearchState,
    posture: Posture,
    hold_s: float,
    rng: np.random.Generator,
    stamp_s: float = 0.0,
) -> tuple[SearchState, JointVelocity]:
    """Head rates towards a goal within the limits, the next one as each is reached.

    No joint leaves its limits within `hold_s`.  InputError unless the stamp is finite, and `hold_s` in (0, 0.5].
    """
    check_times("search", stamp_s, hold_s)
    gaze = gaze_of(posture)
    lower, upper = gaze_range(params.limits.gaze, posture)
    goal = state.goal
    unvisited = state.unvisited
    visits = state.visits
    if goal is None or np.abs(goal - gaze).max() < params.arrived_rad:
        if params.pattern == "random":
            aside, up = rng.uniform(-1, 1, 2) * (params.yaw_rad, params.pitch_rad)
            yaw, pitch, tilt, vergence = state.center
            goal = _goal(yaw + aside, pitch + tilt + up, vergence, lower, upper)
        else:
            if not len(unvisited):
                unvisited = _grid(params, params.vergence_rad[visits % 2], lower, upper)
                visits += 1
            nearest = int(np.argmin(np.abs(unvisited - gaze)[:, :VERGENCE].max(axis=1)))
            goal = unvisited[nearest]
            unvisited = np.delete(unvisited, nearest, axis=0)
    slowest, fastest = rate_limits(gaze, lower, upper, params.limits.max_rate, 1 / hold_s)
    rates = np.clip(params.gain_per_s * (goal - gaze), slowest, fastest)
    command = JointVelocity(stamp_s, gaze_columns(posture.robot) @ rates, hold_s)
    return SearchState(state.center, goal, unvisited, visits), command


def _grid(params: SearchParams, vergence: float, lower: Array, upper: Array) -> Array:
    """(k, 4) goals from half a spacing inside one end of the gaze's range to half a spacing inside the other."""
    low = lower[[YAW, PITCH]]
    low[1] += lower[TILT]
    high = upper[[YAW, PITCH]]
    high[1] += upper[TILT]
    counts = np.ceil((high - low) / params.spacing_rad).astype(int).clip(1)
    yaws, ups = (a + (b - a) * (np.arange(n) + 0.5) / n for a, b, n in zip(low, high, counts, strict=True))
    return np.array([_goal(yaw, up, vergence, lower, upper) for up in ups for yaw in yaws])


def _goal(yaw: float, up: float, vergence: float, lower: Array, upper: Array) -> Array:
    """(4,) the gaze to the side and up, within its limits; the eyes' tilt continues where the neck's pitch ends."""
    pitch = np.clip(up, lower[PITCH], upper[PITCH])
    return np.clip([yaw, pitch, up - pitch, vergence], lower, upper)
