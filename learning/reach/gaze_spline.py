"""Smooth functions of the gaze posture, from values at scattered ones: triharmonic splines through the nearest of them,
the usual choice for surfaces in 3D (Carr et al. 2001).

SciPy's RBFInterpolator gives the same to 1e-10 and is no faster, but has no answer where nodes lie on a plane (an elbow
that is stuck), are fewer than four (few labels), or one is asked twice: there this one has.
"""

import numpy as np
from scipy.spatial import cKDTree

from learning.reach.map import isotropic
from pps_vision.types import Array

_NEIGHBOURS = 30
_APART = 1e-4  # of the map's isotropic coordinates: what is nearer to another says the same
_FLAT = 1e-9  # of the neighbourhood's size: along what its nodes do not tell, the spline does not lean
_ROWS = 2000  # postures at a time, for the memory's sake


class GazeSpline:
    """Values (n,) at gaze postures (n, 3), of those nearer to one another than `apart` only the first's; nodes that lie
    on a plane, or are few, do for it too: it is then as level across as they let it be.  ValueError for none."""

    def __init__(self, gaze_rad: Array, values: Array, apart: float = _APART) -> None:
        if len(gaze_rad) == 0:
            raise ValueError("no gaze postures to interpolate between; expected one at least")
        at = isotropic(gaze_rad)
        kept = first_of_close(at, apart)
        self._at, self._values = at[kept], values[kept]
        self._tree = cKDTree(self._at)

    def __call__(self, gaze_rad: Array) -> Array:
        """Values (N,) at gaze postures (N, 3)."""
        at = isotropic(gaze_rad)
        parts = [self._between(at[k : k + _ROWS]) for k in range(0, len(at), _ROWS)]
        return np.concatenate([np.zeros(0), *parts])

    def _between(self, at: Array) -> Array:
        n = min(_NEIGHBOURS, len(self._at))
        distance, index = self._tree.query(at, k=range(1, n + 1))
        size = np.maximum(distance[:, -1], _APART)
        nodes = (self._at[index] - at[:, None]) / size[:, None, None]  # the posture asked for is the origin
        system, right = np.zeros((len(at), n + 4, n + 4)), np.zeros((len(at), n + 4, 1))
        square = np.sum(nodes**2, axis=2)
        apart = square[:, :, None] + square[:, None] - 2 * nodes @ nodes.swapaxes(1, 2)
        system[:, :n, :n] = np.maximum(apart, 0) ** 1.5
        system[:, :n, n] = system[:, n, :n] = 1
        system[:, :n, n + 1 :] = nodes
        system[:, n + 1 :, :n] = nodes.swapaxes(1, 2)
        system[:, range(n + 1, n + 4), range(n + 1, n + 4)] = -_FLAT
        right[:, :n, 0] = self._values[index]
        weights = np.linalg.solve(system, right)[:, :, 0]
        between: Array = np.sum(weights[:, :n] * square**1.5, axis=1) + weights[:, n]
        return between


def first_of_close(at: Array, apart: float) -> Array:
    """Indices of those of (n, 3) that are not nearer than `apart` to an earlier one."""
    close = cKDTree(at).query_pairs(apart, output_type="ndarray")
    return np.delete(np.arange(len(at)), np.unique(close[:, 1]))
