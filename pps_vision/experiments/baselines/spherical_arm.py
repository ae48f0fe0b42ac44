"""Inverse kinematics in closed form of an arm whose first three joints meet in the shoulder and whose fourth bends
the elbow: the truth that solvers and maps are judged by.

The elbow alone sets how far the hand is from the shoulder.  What is left, three rotations that turn the hand's
direction to the target's, is one freedom too many: a curve of postures, along which the third joint parts the first
two (Paden–Kahan).  Where a stretch of that curve lies within the limits, it ends at one, or is a whole loop, which
turns; so it is enough to look at limits and turning points.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.robot.chain import Chain
from pps_vision.types import Array

_SAME_RAD = 1e-7  # a joint this far beyond its limit stands at it
_ROWS = 4000  # targets at a time, for the memory's sake


@dataclass(frozen=True)
class SphericalArm:
    """Three axes (3, 3) through `shoulder` (3,), each at right angles to the next, the elbow's `axis` through `elbow`,
    and where the `hand` is with all joints at zero (root frame, m); limits (4,) rad."""

    axes: Array
    shoulder: Array
    elbow_axis: Array
    elbow: Array
    hand: Array
    lower_rad: Array
    upper_rad: Array

    @classmethod
    def of(cls, chain: Chain, lower_rad: ArrayLike, upper_rad: ArrayLike) -> "SphericalArm":
        """From a chain of four joints, shoulder first; ValueError where it is no such arm."""
        v, w = chain.screws[:, :3], chain.screws[:, 3:]
        if len(w) != 4 or chain.order != (0, 1, 2, 3):
            raise ValueError(f"a chain of {', '.join(chain.joints)}: expected four joints, from the shoulder on")
        # p lies on the axis (v, w) where p × w + v = 0, that is (1 − w wᵀ) p = w × v
        across = np.eye(3) - w[:3, :, None] * w[:3, None, :]
        shoulder = np.linalg.lstsq(across.reshape(9, 3), np.cross(w[:3], v[:3]).ravel(), rcond=None)[0]
        apart = np.abs(np.cross(w[:3], shoulder) + v[:3]).max()
        if apart > 1e-9 or abs(w[0] @ w[1]) > 1e-9 or abs(w[1] @ w[2]) > 1e-9:
            raise ValueError("the first three axes do not meet at right angles; expected a spherical shoulder")
        lower, upper = np.asarray(lower_rad, dtype=float), np.asarray(upper_rad, dtype=float)
        return cls(w[:3], shoulder, w[3], np.cross(w[3], v[3]), chain.T_root_frame[:3, 3], lower, upper)

    def solve(self, points: ArrayLike) -> Array:
        """(N, 4) a posture that brings the hand to each point (N, 3); NaN where none does."""
        chunks = _chunks(np.asarray(points, dtype=float))
        return np.concatenate([_least(q, np.isnan(q[..., 0]) * 1.0) for q in map(self._corners, chunks)])

    def least_effort(self, points: ArrayLike, samples: int = 61) -> tuple[Array, Array]:
        """Of all postures that reach each point (N, 3) the one (N, 4) of least M (J IV.5), and that M (N,): the mean
        squared distance of the joints from the middle of their ranges, of half a range; NaN where out of reach."""
        chunks = _chunks(np.asarray(points, dtype=float))
        q = np.concatenate([self._best(chunk, samples) for chunk in chunks])
        return q, self._effort(q)

    def curves(self, points: ArrayLike, samples: int) -> Array:
        """(N, 4·samples, 4) postures that reach points (N, 3), at equal steps of the third joint; NaN where none."""
        towards = np.asarray(points, dtype=float) - self.shoulder
        bends = self._bends(towards)
        turns = np.linspace(self.lower_rad[2], self.upper_rad[2], samples)
        return self._postures(towards, bends, np.broadcast_to(turns, (len(towards), 2, samples)))

    def _effort(self, q: Array) -> Array:
        middle, half = (self.upper_rad + self.lower_rad) / 2, (self.upper_rad - self.lower_rad) / 2
        effort: Array = np.mean(((q - middle) / half) ** 2, axis=-1)
        return effort

    def _best(self, points: Array, samples: int) -> Array:
        """Postures sampled along each curve, then twice more around the best; its ends and turning points too."""
        towards = points - self.shoulder
        bends = self._bends(towards)
        best = self._corners(points)
        best = _least(best, self._effort(best))
        span = self.upper_rad[2] - self.lower_rad[2]
        grid = np.linspace(self.lower_rad[2], self.upper_rad[2], samples)
        turns = np.broadcast_to(grid, (len(points), 2, samples))
        for _ in range(3):
            q = self._postures(towards, bends, turns)
            q = np.concatenate([q, best[:, None]], axis=1)
            best = _least(q, self._effort(q))
            span *= 4 / samples
            around = best[:, 2, None] + span * np.linspace(-0.5, 0.5, samples)
            turns = np.broadcast_to(np.clip(around, self.lower_rad[2], self.upper_rad[2])[:, None], turns.shape)
        return best

    def _corners(self, points: Array) -> Array:
        """(N, 56, 4) the postures at limits and turning points; NaN where there is none within the limits."""
        towards = points - self.shoulder
        bends = self._bends(towards)
        return self._postures(towards, bends, self._turns(towards, bends))

    def _bends(self, towards: Array) -> Array:
        """(N, 2) elbow angles at which the hand is as far from the shoulder as the target; NaN beyond the limits."""
        d, w, n = self.elbow - self.shoulder, self.hand - self.elbow, self.elbow_axis
        along = (d @ n) * (n @ w)
        rest = 0.5 * (np.sum(towards**2, axis=1) - d @ d - w @ w) - along
        bends = _angles(d @ w - along, d @ np.cross(n, w), rest)
        return self._within(bends, 3)

    def _hands(self, bends: Array) -> Array:
        """(N, 2, 3) the hand from the shoulder, its three joints at zero."""
        return self.elbow - self.shoulder + _turned(self.hand - self.elbow, self.elbow_axis, bends)

    def _turns(self, towards: Array, bends: Array) -> Array:
        """(N, 2, 14) angles of the third joint at its limits, where the others are at theirs, and where it turns."""
        first, second, third = self.axes
        hand = self._hands(bends)
        n = len(towards)
        found = [np.broadcast_to(np.array([self.lower_rad[2], self.upper_rad[2]]), (n, 2, 2))]
        for limit in (self.lower_rad[1], self.upper_rad[1]):
            seen = _turned(first, second, np.array(-limit))
            found.append(_turning(seen, third, hand, (towards @ first)[:, None]))
        for limit in (self.lower_rad[0], self.upper_rad[0]):
            seen = _turned(towards, first, np.array(-limit))
            found.append(_turning(second, third, hand, (seen @ second)[:, None]))
        most = np.sqrt(np.maximum(np.sum(towards**2, axis=1) - (towards @ first) ** 2, 0.0))
        found += [_turning(second, third, hand, sign * most[:, None]) for sign in (-1.0, 1.0)]
        return np.concatenate(found, axis=2)

    def _postures(self, towards: Array, bends: Array, turns: Array) -> Array:
        """(N, 2·K·2, 4) postures with the elbow at `bends` (N, 2) and the third joint at `turns` (N, 2, K)."""
        first, second, third = self.axes
        hand = _turned(self._hands(bends)[:, :, None], third, turns)  # (N, 2, K, 3)
        t = towards[:, None, None]
        along_first, along_second = t @ first, hand @ second
        left = np.sum(t * t, axis=-1) - along_first**2 - along_second**2
        left = np.where(left > -1e-9 * np.sum(t * t, axis=-1), np.maximum(left, 0.0), np.nan)
        out = []
        for sign in (-1.0, 1.0):
            between = (
                along_first[..., None] * first
                + along_second[..., None] * second
                + (sign * np.sqrt(left))[..., None] * np.cross(first, second)
            )
            q = [_angle(first, between, t), _angle(second, hand, between), turns, bends[:, :, None] + 0 * turns]
            out.append(np.stack([self._within(angle, k) for k, angle in enumerate(q)], axis=-1))
        n, elbows, several, joints = np.shape(both := np.concatenate(out, axis=2))
        q_all = both.reshape(n, elbows * several, joints)
        return np.where(np.isnan(q_all).any(axis=-1, keepdims=True), np.nan, q_all)

    def _within(self, angle: Array, joint: int) -> Array:
        """The angle as the joint counts it; NaN beyond its limits."""
        lower, upper = self.lower_rad[joint], self.upper_rad[joint]
        counted = lower - _SAME_RAD + np.mod(angle - lower + _SAME_RAD, 2 * np.pi)
        return np.where(counted <= upper + _SAME_RAD, np.clip(counted, lower, upper), np.nan)


def _chunks(points: Array) -> list[Array]:
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points of shape {points.shape}: expected (N, 3)")
    return np.array_split(points, max(-(-len(points) // _ROWS), 1))


def _least(q: Array, cost: Array) -> Array:
    """(N, 4) of the postures (N, K, 4) the cheapest that exists; NaN where there is none."""
    k = np.argmin(np.where(np.isnan(q[..., 0]), np.inf, cost), axis=1)
    least: Array = np.take_along_axis(q, k[:, None, None], axis=1)[:, 0]
    return least


def _turned(vector: Array, axis: Array, angle: Array) -> Array:
    """Vectors (…, 3) turned about a unit axis by angles (…), Rodrigues."""
    cosine, sine = np.cos(angle)[..., None], np.sin(angle)[..., None]
    along = (vector @ axis)[..., None] * axis
    turned: Array = along + cosine * (vector - along) + sine * np.cross(axis, vector)
    return turned


def _angle(axis: Array, a: Array, b: Array) -> Array:
    """The angle about an axis that brings a (…, 3) to b."""
    angle: Array = np.arctan2(np.cross(a, b) @ axis, np.sum(a * b, axis=-1) - (a @ axis) * (b @ axis))
    return angle


def _turning(seen: Array, axis: Array, vector: Array, wanted: Array) -> Array:
    """(…, 2) angles about `axis` after which the component of `vector` (…, 3) along `seen` is as `wanted` (…)."""
    along = (vector @ axis) * (seen @ axis)
    return _angles(vector @ seen - along, np.cross(axis, vector) @ seen, wanted - along)


def _angles(cosine: ArrayLike, sine: ArrayLike, value: Array) -> Array:
    """(…, 2) angles x with cosine · cos x + sine · sin x = value; NaN where there are none."""
    amplitude, middle = np.hypot(cosine, sine), np.arctan2(sine, cosine)
    ratio = value / np.where(amplitude > 0, amplitude, np.nan)
    ratio = np.where(np.abs(ratio) <= 1 + 1e-12, np.clip(ratio, -1, 1), np.nan)
    off = np.arccos(ratio)
    return np.stack([middle - off, middle + off], axis=-1)
