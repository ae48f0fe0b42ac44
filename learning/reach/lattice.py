"""Gaze space in coordinates that are equally fine in all directions, and values on a lattice in it."""

from dataclasses import dataclass

import numpy as np

from pps_vision.robot.gaze import GazeLimits
from pps_vision.types import Array

_ROWS = 1 << 14  # interpolated at a time: 1 << 20 take half as long again
_CORNERS = np.array(list(np.ndindex(2, 2, 2)))


def isotropic(gaze_rad: Array) -> Array:
    """Gaze postures (…, 3) as yaw, pitch and ln tan(vergence/2), minus the logarithm of the distance: a step
    of 0.01 is 1 % of the viewing distance in any direction (per rad of vergence the fixation point
    moves 1/sin(vergence) times as far as per rad of yaw)."""
    coordinates = gaze_rad.copy()
    coordinates[..., 2] = np.log(np.tan(gaze_rad[..., 2] / 2))
    return coordinates


@dataclass(frozen=True)
class Lattice:
    """Values (a, b, c) at equal steps of `isotropic` coordinates between the corners of the gaze limits."""

    limits: GazeLimits
    shape: tuple[int, int, int]

    @classmethod
    def of_spacing(cls, limits: GazeLimits, spacing: float) -> "Lattice":
        """The coarsest whose steps are no longer than `spacing`."""
        a, b, c = (np.ceil((isotropic(limits.upper) - isotropic(limits.lower)) / spacing).astype(int) + 1).tolist()
        return cls(limits, (a, b, c))

    @property
    def gaze_rad(self) -> Array:
        """(a·b·c, 3) the gaze postures of the lattice's points."""
        ends = zip(isotropic(self.limits.lower), isotropic(self.limits.upper), self.shape, strict=True)
        axes = [np.linspace(low, high, n) for low, high, n in ends]
        yaw, pitch, log_tan = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        return np.stack([yaw, pitch, 2 * np.arctan(np.exp(log_tan))], axis=1)

    def interpolate(self, values: Array, gaze_rad: Array) -> Array:
        """(N, m) of values (a·b·c, m) at gaze postures (N, 3) within the limits, linear between the eight nearest;
        cubic splines measured no better."""
        low = isotropic(self.limits.lower)
        cells = np.array(self.shape) - 1
        per_unit = cells / (isotropic(self.limits.upper) - low)
        strides = np.array([self.shape[1] * self.shape[2], self.shape[2], 1])
        between = np.zeros((len(gaze_rad), values.shape[1]))
        for begin in range(0, len(gaze_rad), _ROWS):
            at = (isotropic(gaze_rad[begin : begin + _ROWS]) - low) * per_unit
            cell = np.minimum(at.astype(np.intp), cells - 1)
            shares = np.stack([1 - (at - cell), at - cell])  # (2, n, 3)
            first = cell @ strides
            for corner in _CORNERS:
                weight = shares[corner[0], :, 0] * shares[corner[1], :, 1] * shares[corner[2], :, 2]
                between[begin : begin + _ROWS] += weight[:, None] * values[first + corner @ strides]
        return between
