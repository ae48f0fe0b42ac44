"""Smooth interpolation of values at scattered gaze postures."""

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from learning.reach.lattice import isotropic
from pps_vision.types import Array

_NEIGHBOURS = 30  # 60 reduce the error on a distance field by 2 %, 15 raise it by 10 %
_APART = 1e-4  # isotropic coordinates: nodes closer together make the system singular


class GazeSpline:
    """Triharmonic spline through values (n,) at gaze postures (n, 3), local to the nearest nodes (Carr et al. 2001).

    Of nodes closer together than `_APART` only the first counts.  The triharmonic spline has no unique solution for
    fewer than four nodes or nodes on a plane; there the biharmonic one, with a constant, takes its place.
    """

    def __init__(self, gaze_rad: Array, values: Array) -> None:
        if len(gaze_rad) == 0:
            raise ValueError("no gaze postures to interpolate between; expected at least one")
        at = isotropic(gaze_rad)
        first = first_of_close(at, _APART)
        self._at = at[first]
        self._values = values[first]

    def __call__(self, gaze_rad: Array) -> Array:
        """Values (N,) at gaze postures (N, 3)."""
        at = isotropic(gaze_rad)
        nearest = min(_NEIGHBOURS, len(self._at))
        if len(self._at) >= 4:
            try:
                return np.asarray(RBFInterpolator(self._at, self._values, nearest, kernel="cubic", degree=1)(at))
            except np.linalg.LinAlgError:  # some neighbourhood lies on a plane
                pass
        return np.asarray(RBFInterpolator(self._at, self._values, nearest, kernel="linear", degree=0)(at))


def first_of_close(at: Array, apart: float) -> Array:
    """Indices of the points (n, 3) that are not nearer than `apart` to an earlier one."""
    close = cKDTree(at).query_pairs(apart, output_type="ndarray")
    return np.delete(np.arange(len(at)), np.unique(close[:, 1]))
