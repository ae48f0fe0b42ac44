"""Closed-form inverse kinematics of an arm with a spherical shoulder and an elbow: the truth for solvers and maps.

The elbow alone determines the distance of the hand from the shoulder.  The three shoulder joints turn the hand's
direction to the target's, with one redundant degree of freedom: the postures form a curve, parametrized by the third
joint, which separates the first two (Paden–Kahan).  A stretch of the curve within the joint limits ends at a limit or
is a closed loop with a turning point, so testing limits and turning points is sufficient.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.robot.chain import Chain
from pps_vision.types import Array

_LIMIT_TOLERANCE_RAD = 1e-7
_CHUNK = 4000  # targets at a time, to bound the memory


@dataclass(frozen=True)
class SphericalArm:
    """Geometry with all joints at zero (root frame, m) and joint limits."""

    axes: Array  # (3, 3) axes of the shoulder joints, each at right angles to the next
    shoulder: Array  # (3,) where they meet
    elbow_axis: Array  # (3,) axis of the elbow
    elbow: Array  # (3,) a point on it
    hand: Array  # (3,) end point
    lower_rad: Array  # (4,) lower limits
    upper_rad: Array  # (4,) upper limits

    @classmethod
    def of(cls, chain: Chain, lower_rad: ArrayLike, upper_rad: ArrayLike) -> "SphericalArm":
        """Make it from a chain of four joints, shoulder first.

        Raises:
            ValueError: The chain is no such arm.
        """
        v = chain.screws[:, :3]
        w = chain.screws[:, 3:]
        if len(w) != 4 or chain.order != (0, 1, 2, 3):
            raise ValueError(f"a chain of {', '.join(chain.joints)}: expected four joints, from the shoulder on")
        # p is on the axis (v, w) where p × w + v = 0, that is (1 − w wᵀ) p = w × v
        across = np.eye(3) - w[:3, :, None] * w[:3, None, :]
        shoulder = np.linalg.lstsq(across.reshape(9, 3), np.cross(w[:3], v[:3]).ravel(), rcond=None)[0]
        offset = np.abs(np.cross(w[:3], shoulder) + v[:3]).max()
        if offset > 1e-9 or abs(w[0] @ w[1]) > 1e-9 or abs(w[1] @ w[2]) > 1e-9:
            raise ValueError("the first three axes do not meet at right angles; expected a spherical shoulder")
        limits = (np.asarray(limit, dtype=float) for limit in (lower_rad, upper_rad))
        return cls(w[:3], shoulder, w[3], np.cross(w[3], v[3]), chain.T_root_frame[:3, 3], *limits)

    def solve(self, points: ArrayLike) -> Array:
        """Return (N, 4) a posture that brings the hand to each point (N, 3); NaN where out of reach."""
        return _in_chunks(self._best, points)

    def least_effort(self, points: ArrayLike, samples: int = 61) -> tuple[Array, Array]:
        """Return the posture (N, 4) of least M (J IV.5) that reaches each point (N, 3), and M (N,); NaN out of reach.

        M is the mean squared deviation of the joints from the middle of their ranges, relative to half a range.
        """
        q = _in_chunks(lambda chunk: self._best(chunk, samples), points)
        return q, self._effort(q)

    def curves(self, points: ArrayLike, samples: int) -> Array:
        """Return (N, 4·samples, 4) postures that reach points (N, 3), at equal steps of the third joint; or NaN."""
        target = np.asarray(points, dtype=float) - self.shoulder
        third = np.linspace(self.lower_rad[2], self.upper_rad[2], samples)
        return self._postures(target, np.broadcast_to(third, (len(target), 2, samples)))

    def _effort(self, q: Array) -> Array:
        half = np.maximum(self.upper_rad - self.lower_rad, 1e-12) / 2  # a joint that is stuck has no range
        return np.asarray(np.mean(((q - self.lower_rad) / half - 1) ** 2, axis=-1))

    def _cheapest(self, q: Array) -> Array:
        """(N, 4) of postures (N, K, 4) that of least effort."""
        k = np.argmin(np.nan_to_num(self._effort(q), nan=np.inf), axis=1)
        return np.asarray(np.take_along_axis(q, k[:, None, None], axis=1)[:, 0])

    def _best(self, points: Array, samples: int = 0) -> Array:
        """(N, 4) cheapest of the postures at limits and turning points; with `samples`, the posture of least effort:
        sampled along each curve, then twice around the best sample."""
        target = points - self.shoulder
        best = self._cheapest(self._postures(target, self._third_joint(target)))
        if not samples:
            return best
        lower = self.lower_rad[2]
        upper = self.upper_rad[2]
        span = upper - lower
        third = np.broadcast_to(np.linspace(lower, upper, samples), (len(points), 2, samples))
        for _ in range(3):
            best = self._cheapest(np.concatenate([self._postures(target, third), best[:, None]], axis=1))
            span *= 4 / samples
            around = best[:, 2, None] + span * np.linspace(-0.5, 0.5, samples)
            third = np.broadcast_to(np.clip(around, lower, upper)[:, None], third.shape)
        return best

    def _elbow(self, target: Array) -> Array:
        """(N, 2) elbow angles at which the hand is as far from the shoulder as the target; NaN beyond the limits."""
        upper_arm = self.elbow - self.shoulder
        forearm = self.hand - self.elbow
        n = self.elbow_axis
        along = (upper_arm @ n) * (n @ forearm)
        dot = 0.5 * (np.sum(target**2, axis=1) - upper_arm @ upper_arm - forearm @ forearm) - along
        return self._within(_solve_angle(upper_arm @ forearm - along, upper_arm @ np.cross(n, forearm), dot), 3)

    def _hand(self, elbow: Array) -> Array:
        """(N, 2, 3) hand relative to the shoulder, with the shoulder's joints at zero."""
        return self.elbow - self.shoulder + _rotated(self.hand - self.elbow, self.elbow_axis, elbow)

    def _third_joint(self, target: Array) -> Array:
        """(N, 2, 14) angles of the third joint at the limits of the three joints and at turning points."""
        first, second, third = self.axes
        hand = self._hand(self._elbow(target))
        angles = [np.broadcast_to(np.array([self.lower_rad[2], self.upper_rad[2]]), (*hand.shape[:2], 2))]
        for limit in (self.lower_rad[1], self.upper_rad[1]):
            direction = _rotated(first, second, np.array(-limit))
            angles.append(_solve_component(direction, third, hand, (target @ first)[:, None]))
        for limit in (self.lower_rad[0], self.upper_rad[0]):
            along = _rotated(target, first, np.array(-limit)) @ second
            angles.append(_solve_component(second, third, hand, along[:, None]))
        most = np.sqrt(np.maximum(np.sum(target**2, axis=1) - (target @ first) ** 2, 0.0))
        angles += [_solve_component(second, third, hand, sign * most[:, None]) for sign in (-1.0, 1.0)]
        return np.concatenate(angles, axis=2)

    def _postures(self, target: Array, third: Array) -> Array:
        """(N, 4·K, 4) postures with the third joint at angles (N, 2, K); NaN where none is within the limits."""
        elbow = self._elbow(target)
        axis_1, axis_2, axis_3 = self.axes
        hand = _rotated(self._hand(elbow)[:, :, None], axis_3, third)  # (N, 2, K, 3)
        t = target[:, None, None]
        along_1 = t @ axis_1
        along_2 = hand @ axis_2
        square = np.sum(t * t, axis=-1)
        left = square - along_1**2 - along_2**2
        height = np.sqrt(np.where(left > -1e-9 * square, np.maximum(left, 0.0), np.nan))
        postures = []
        for sign in (-1.0, 1.0):
            between = along_1[..., None] * axis_1 + along_2[..., None] * axis_2
            between = between + (sign * height)[..., None] * np.cross(axis_1, axis_2)
            q = [_angle(axis_1, between, t), _angle(axis_2, hand, between), third, elbow[:, :, None] + 0 * third]
            postures.append(np.stack([self._within(angle, k) for k, angle in enumerate(q)], axis=-1))
        flat = np.concatenate(postures, axis=2).reshape(len(target), 4 * third.shape[2], 4)
        return np.where(np.isnan(flat).any(axis=-1, keepdims=True), np.nan, flat)

    def _within(self, angle: Array, joint: int) -> Array:
        """The angle modulo 2π within the joint's limits; NaN beyond them."""
        lower = self.lower_rad[joint]
        upper = self.upper_rad[joint]
        wrapped = lower - _LIMIT_TOLERANCE_RAD + np.mod(angle - lower + _LIMIT_TOLERANCE_RAD, 2 * np.pi)
        return np.where(wrapped <= upper + _LIMIT_TOLERANCE_RAD, np.clip(wrapped, lower, upper), np.nan)


def _in_chunks(function: Callable[[Array], Array], points: ArrayLike) -> Array:
    array = np.asarray(points, dtype=float)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"points of shape {array.shape}: expected (N, 3)")
    return np.concatenate([function(chunk) for chunk in np.array_split(array, max(-(-len(array) // _CHUNK), 1))])


def _rotated(vector: Array, axis: Array, angle: Array) -> Array:
    """Vectors (…, 3) rotated about a unit axis by angles (…), Rodrigues."""
    along = (vector @ axis)[..., None] * axis
    cosine = np.cos(angle)[..., None]
    return np.asarray(along + cosine * (vector - along) + np.sin(angle)[..., None] * np.cross(axis, vector))


def _angle(axis: Array, a: Array, b: Array) -> Array:
    """Angle about an axis from a (…, 3) to b."""
    return np.asarray(np.arctan2(np.cross(a, b) @ axis, np.sum(a * b, axis=-1) - (a @ axis) * (b @ axis)))


def _solve_component(direction: Array, axis: Array, vector: Array, component: Array) -> Array:
    """(…, 2) angles about `axis` after which `vector` (…, 3) has a given component (…) along `direction`."""
    along = (vector @ axis) * (direction @ axis)
    return _solve_angle(vector @ direction - along, np.cross(axis, vector) @ direction, component - along)


def _solve_angle(cosine: ArrayLike, sine: ArrayLike, value: Array) -> Array:
    """(…, 2) solutions x of cosine · cos x + sine · sin x = value, or NaN."""
    amplitude = np.hypot(cosine, sine)
    ratio = value / np.where(amplitude > 0, amplitude, np.nan)
    half = np.arccos(np.where(np.abs(ratio) <= 1 + 1e-12, np.clip(ratio, -1, 1), np.nan))
    middle = np.arctan2(sine, cosine)
    return np.stack([middle - half, middle + half], axis=-1)
