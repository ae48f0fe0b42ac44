"""Motions of a stimulus: functions of time that return position and velocity."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from pps_vision.errors import InputError
from pps_vision.geometry.se3 import rotation_to
from pps_vision.types import Array
from rendering.names import MotionName

START_M = (0.25, 0.30)  # distance from the taxel at which an approach starts (R)
START_ANGLE = np.deg2rad(45.0)  # largest angle to the taxel's normal there (R)
EXTENT_M = (0.05, 0.08)  # amplitude of a motion about a centre
# Standard deviation per axis of a reach's control point, as a share of its length; the path deviates by half of it.
_BOW = 0.15
_OVERSHOOT = 8 / 7  # planned length of a reach, as a share of its length to contact
_PEAK = 15 / 8  # peak speed of a minimum-jerk movement, as a share of its mean speed


@dataclass(frozen=True)
class Target:
    """A point of the skin (3,), its outward normal (3,), and the end point of an approach from a given start."""

    point: Array
    normal: Array
    end_from: Callable[[Array], Array]


class Motion(Protocol):
    """(position (3,) m, velocity (3,) m/s) in the root frame at `t_s` ≥ 0."""

    def __call__(self, t_s: float) -> tuple[Array, Array]:
        """Return position (3,) m and velocity (3,) m/s."""
        ...


@dataclass(frozen=True)
class Static:
    """No motion."""

    position: Array

    def __call__(self, t_s: float) -> tuple[Array, Array]:
        """The same position at all times."""
        return self.position, np.zeros(3)


@dataclass(frozen=True)
class Recede:
    """Straight from `start` to `end` at constant speed; rests there."""

    start: Array
    end: Array
    speed_m_s: float

    @property
    def contact_s(self) -> float:
        """Time of arrival at `end`."""
        return float(np.linalg.norm(self.end - self.start)) / self.speed_m_s

    def __call__(self, t_s: float) -> tuple[Array, Array]:
        """On the way, or resting at the end."""
        if t_s >= self.contact_s:
            return self.end, np.zeros(3)
        ahead = (self.end - self.start) / np.linalg.norm(self.end - self.start)
        return self.start + t_s * self.speed_m_s * ahead, self.speed_m_s * ahead


@dataclass(frozen=True)
class Approach(Recede):
    """Straight from `start` to `end` at constant speed, a dwell there, and back along the same path."""

    dwell_s: float = 0.3

    def __call__(self, t_s: float) -> tuple[Array, Array]:
        """Approach and dwell, then withdrawal and rest at the start."""
        since_withdrawal = t_s - self.contact_s - self.dwell_s
        back = Recede(self.end, self.start, self.speed_m_s)
        return super().__call__(t_s) if since_withdrawal < 0 else back(since_withdrawal)


@dataclass(frozen=True)
class Linear(Recede):
    """Back and forth between two points at constant speed."""

    def __call__(self, t_s: float) -> tuple[Array, Array]:
        """A triangle wave along the segment."""
        passes, since = divmod(t_s, self.contact_s)
        return super().__call__(since) if passes % 2 == 0 else Recede(self.end, self.start, self.speed_m_s)(since)


def _minimum_jerk(tau: float) -> tuple[float, float]:
    """Share of the way at a share τ of the time, 10 τ³ − 15 τ⁴ + 6 τ⁵, and its derivative by τ."""
    return tau**3 * (10 - 15 * tau + 6 * tau**2), 30 * tau**2 * (1 - tau) ** 2


@dataclass(frozen=True)
class ReachMotion:
    """Minimum-jerk reach along a quadratic Bézier curve with control points `start`, `via`, `end`.

    The planned movement is a seventh longer than the way to `end`, so that contact, at `arrives_s`, happens at
    non-zero speed.  `peak_m_s` is the largest speed on a nearly straight curve.
    """

    start: Array
    via: Array
    end: Array
    peak_m_s: float

    @cached_property
    def _whole_s(self) -> float:
        """Duration of the planned movement."""
        return float(_PEAK * _OVERSHOOT * np.linalg.norm(self.end - self.start)) / self.peak_m_s

    @property
    def arrives_s(self) -> float:
        """Time of contact at `end`."""
        return float(brentq(lambda tau: _OVERSHOOT * _minimum_jerk(tau)[0] - 1, 0, 1)) * self._whole_s

    def __call__(self, t_s: float) -> tuple[Array, Array]:
        """Bézier's curve at the share u of the way to `end`."""
        u, du = _OVERSHOOT * np.array(_minimum_jerk(t_s / self._whole_s))
        leg_1 = self.via - self.start
        leg_2 = self.end - self.via
        velocity = 2 * du / self._whole_s * ((1 - u) * leg_1 + u * leg_2)
        return self.start + u * (2 - u) * leg_1 + u**2 * leg_2, velocity


@dataclass(frozen=True)
class Circle:
    """Around `center` at constant speed in the plane of the unit vectors `axes` (2, 3)."""

    center: Array
    axes: Array
    radius_m: float
    speed_m_s: float

    def __call__(self, t_s: float) -> tuple[Array, Array]:
        """At angle speed·t/radius from the first axis."""
        angle = t_s * self.speed_m_s / self.radius_m
        outward = np.array([np.cos(angle), np.sin(angle)])
        ahead = np.array([-outward[1], outward[0]])
        return self.center + self.radius_m * (outward @ self.axes), self.speed_m_s * (ahead @ self.axes)


@dataclass(frozen=True)
class Figure8:
    """Along the lemniscate of Gerono, (sin a, sin a · cos a), at constant speed (within 0.1 %)."""

    center: Array
    axes: Array
    radius_m: float
    speed_m_s: float

    @cached_property
    def _length_table(self) -> tuple[Array, Array]:
        """Curve parameter a and arc length of the unit curve up to it, over one period."""
        a = np.linspace(0, 2 * np.pi, 4001)
        pace = np.hypot(np.cos(a), np.cos(2 * a))
        return a, np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(a))])

    def __call__(self, t_s: float) -> tuple[Array, Array]:
        """At arc length speed·t."""
        a_table, length = self._length_table
        a = np.interp((t_s * self.speed_m_s / self.radius_m) % length[-1], length, a_table)
        position = self.center + self.radius_m * (np.array([np.sin(a), 0.5 * np.sin(2 * a)]) @ self.axes)
        tangent = np.array([np.cos(a), np.cos(2 * a)])
        return position, self.speed_m_s * (tangent / np.linalg.norm(tangent)) @ self.axes


@dataclass(frozen=True)
class Jerk:
    """Stop and go: minimum-jerk moves along a closed tour of `waypoints` (n, 3) with a pause at each.

    `speed_m_s` is the peak speed of each move; at t = 0 the first move is at its peak.
    """

    waypoints: Array
    speed_m_s: float
    pause_s: float = 0.2

    @cached_property
    def _moves(self) -> tuple[Array, Array]:
        """Vector and duration of the move that leaves each waypoint."""
        ways = np.roll(self.waypoints, -1, axis=0) - self.waypoints
        return ways, _PEAK * np.linalg.norm(ways, axis=1) / self.speed_m_s

    def __call__(self, t_s: float) -> tuple[Array, Array]:
        """Minimum jerk along the current move, then at rest."""
        ways, durations = self._moves
        ends = np.cumsum(durations + self.pause_s)
        t = (t_s + 0.5 * durations[0]) % ends[-1]
        i = int(np.searchsorted(ends, t, side="right"))
        tau = min((t - (ends[i] - durations[i] - self.pause_s)) / durations[i], 1.0)
        share, rate = _minimum_jerk(tau)
        return self.waypoints[i] + ways[i] * share, ways[i] * (rate / durations[i])


def make_motion(
    kind: MotionName, rng: np.random.Generator, center: ArrayLike, speed_m_s: float, target: Target | None = None
) -> Motion:
    """Draw a random motion of a kind.

    An approach is aimed at `target`; recede is its reverse.  The other kinds stay within 8 cm of `center`.
    The path may leave the view: the caller checks and draws again.
    """
    if kind not in get_args(MotionName):
        raise InputError("motion", f"{kind!r}; expected one of {', '.join(get_args(MotionName))}")
    if not (np.isfinite(speed_m_s) and speed_m_s > 0):
        raise InputError("motion", f"speed {speed_m_s} m/s; expected a positive number")
    middle = np.array(center, dtype=float)
    if kind in ("approach", "recede"):
        if target is None:
            raise InputError("motion", f"{kind!r} needs a target: a point of the skin and its normal")
        approach = make_approach(rng, target, speed_m_s)
        return approach if kind == "approach" else Recede(approach.end, approach.start, speed_m_s)
    if kind == "static":
        return Static(middle)
    if kind == "jerk":
        return Jerk(middle + np.array([_in_ball(rng) for _ in range(8)]), speed_m_s)
    plane = rotation_to(rng.standard_normal(3))
    extent = rng.uniform(*EXTENT_M)
    if kind == "linear":
        return Linear(middle - extent * plane[:, 2], middle + extent * plane[:, 2], speed_m_s)
    return (Circle if kind == "circle" else Figure8)(middle, plane[:, :2].T, extent, speed_m_s)


def make_approach(rng: np.random.Generator, target: Target, speed_m_s: float) -> Approach:
    """Draw a straight approach; the start is uniform in distance and over the cap about the normal."""
    away = in_cap(rng, target.normal)
    start = target.point + rng.uniform(*START_M) * away
    return Approach(start, target.end_from(start), speed_m_s)


def make_reach(rng: np.random.Generator, end: Array, normal: Array, start_m: float, peak_m_s: float) -> ReachMotion:
    """Draw a reach from a start over the cap about the normal, `start_m` away, with a random curvature."""
    start = end + start_m * in_cap(rng, normal)
    return ReachMotion(start, 0.5 * (start + end) + _BOW * start_m * rng.standard_normal(3), end, peak_m_s)


def in_cap(rng: np.random.Generator, normal: Array) -> Array:
    """Draw a direction, uniform over the cap about a normal."""
    cosine = rng.uniform(np.cos(START_ANGLE), 1.0)
    azimuth = rng.uniform(0, 2 * np.pi)
    sine = np.sqrt(1 - cosine**2)
    return np.asarray(rotation_to(normal) @ np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine]))


def _in_ball(rng: np.random.Generator) -> Array:
    """Draw a point, uniform in the ball of 8 cm."""
    direction = rng.standard_normal(3)
    return direction / np.linalg.norm(direction) * EXTENT_M[1] * rng.uniform() ** (1 / 3)
