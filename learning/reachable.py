"""The reachable-space map: can the hand get to what the eyes fixate, and how well (J).

The map lives in gaze space: a fixation point is its gaze posture (neck yaw, neck pitch, vergence).
It interpolates the signed distance to the border of the reachable region, which is smooth where
the verdict itself jumps.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import RBFInterpolator
from scipy.special import expit

from learning.archive import read_archive, write_archive
from pps_vision.robot.gaze import GazeLimits
from pps_vision.types import Array, Mask

_KIND, _VERSION = "reachable-space map", 1
_NEIGHBOURS = 30
_NUMBERS = ("nodes", "signed_distance", "inside", "optimality", "outside", "error_m")
_ARRAYS = ("side", "limits_rad", "softness", *_NUMBERS)


def isotropic(gaze_rad: Array) -> Array:
    """Gaze postures (…, 3) as yaw, pitch and ln tan(vergence/2), minus the logarithm of the distance: a step
    of 0.01 is 1 % of the viewing distance in any direction (per rad of vergence the fixation point
    moves 1/sin(vergence) times as far as per rad of yaw)."""
    return np.concatenate([gaze_rad[..., :2], np.log(np.tan(gaze_rad[..., 2:] / 2))], axis=-1)


class GazeInterpolator:
    """Triharmonic splines through the nearest nodes, the usual choice for surfaces in 3D."""

    def __init__(self, gaze_rad: Array, values: Array) -> None:
        self._rbf = RBFInterpolator(isotropic(gaze_rad), values, neighbors=_NEIGHBOURS, kernel="cubic")

    def __call__(self, gaze_rad: Array) -> Array:
        """Values (N,) at gaze postures (N, 3)."""
        values: Array = self._rbf(isotropic(gaze_rad))
        return values


@dataclass(frozen=True)
class Reachability:
    """The verdict on N gaze postures.

    `within_limits`: the map knows this posture; elsewhere `reachable` is False, the rest NaN.
    `probability` of being reachable; `degree` R in [0, 1], above 0.5 where reachable (J IV.6–IV.7).
    """

    within_limits: Mask
    reachable: Mask
    probability: Array
    degree: Array


@dataclass(frozen=True)
class ReachableMap:
    """What was learned for one arm; all gaze postures in rad.

    `nodes` (n, 3) carry the `signed_distance` (n,) to the border in `isotropic` coordinates, positive inside.
    `inside` (m, 3) carry the `optimality` (m,) 1 − M of J IV.5, `outside` (k, 3) the `error_m` (k,) left
    between hand and fixation point.  `softness` is how uncertain the border's place is, in the same
    coordinates.
    """

    side: str
    limits: GazeLimits
    nodes: Array
    signed_distance: Array
    inside: Array
    optimality: Array
    outside: Array
    error_m: Array
    softness: float

    def __post_init__(self) -> None:
        for name, at, values in (
            ("border", self.nodes, self.signed_distance),
            ("inside", self.inside, self.optimality),
            ("outside", self.outside, self.error_m),
        ):
            if at.ndim != 2 or at.shape[1] != 3 or values.shape != at.shape[:1] or len(at) < _NEIGHBOURS:
                raise ValueError(
                    f"{name}: {at.shape} postures with {values.shape} values, expected (n, 3) with n, n ≥ {_NEIGHBOURS}"
                )
        if not self.softness > 0:
            raise ValueError(f"softness {self.softness}: expected above 0")

    @cached_property
    def _border(self) -> GazeInterpolator:
        return GazeInterpolator(self.nodes, self.signed_distance)

    @cached_property
    def _optimality(self) -> GazeInterpolator:
        return GazeInterpolator(self.inside, self.optimality)

    @cached_property
    def _error(self) -> GazeInterpolator:
        return GazeInterpolator(self.outside, self.error_m)

    def query(self, gaze_rad: ArrayLike) -> Reachability:
        """The verdict on gaze postures (N, 3)."""
        gaze = np.asarray(gaze_rad, dtype=float)
        if gaze.ndim != 2 or gaze.shape[1] != 3:
            raise ValueError(f"gaze postures of shape {gaze.shape}: expected (N, 3)")
        within = np.all((gaze >= self.limits.lower) & (gaze <= self.limits.upper), axis=1)
        probability, degree = np.full(len(gaze), np.nan), np.full(len(gaze), np.nan)
        if np.any(within):
            signed = self._border(gaze[within])
            probability[within] = expit(signed / self.softness)
        reachable = probability > 0.5
        beyond = within & ~reachable
        if np.any(reachable):
            degree[reachable] = 0.5 + 0.5 * np.clip(self._optimality(gaze[reachable]), 0, 1)
        if np.any(beyond):
            degree[beyond] = 0.5 - 0.5 * np.clip(self._error(gaze[beyond]) / self.error_m.max(), 0, 1)
        return Reachability(within, reachable, probability, degree)


def save_map(path: Path, reachable_map: ReachableMap) -> None:
    """Write a map as .npz, whole or not at all."""
    m = reachable_map
    limits = np.array([m.limits.yaw_rad, m.limits.pitch_rad, m.limits.vergence_rad])
    arrays = {name: getattr(m, name) for name in _ARRAYS if name != "limits_rad"}
    write_archive(path, _KIND, _VERSION, {"limits_rad": limits, **arrays})


def load_map(path: Path) -> ReachableMap:
    """Read a map; ValueError names the file and what is wrong with it."""
    data = read_archive(path, _KIND, _VERSION, _ARRAYS)
    try:
        (y0, y1), (p0, p1), (v0, v1) = np.asarray(data["limits_rad"], dtype=float).tolist()
        limits = GazeLimits((y0, y1), (p0, p1), (v0, v1))
        numbers = {name: np.asarray(data[name], dtype=float) for name in _NUMBERS}
        softness = float(np.asarray(data["softness"], dtype=float))
        return ReachableMap(side=str(data["side"]), limits=limits, softness=softness, **numbers)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {_KIND} that does not fit together: {error}") from error
