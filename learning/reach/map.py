"""The reachable-space map: whether the hand can reach the fixation point of the eyes, and how well (J).

The map lives in gaze space: a fixation point is its gaze posture (neck yaw, neck pitch, vergence).
It interpolates the signed distance to the border of the reachable region, which is smooth where
the verdict itself jumps, on a lattice: a query costs no more than eight neighbours.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit

from learning.archive import read_archive, write_archive
from learning.reach.labels import Labels
from learning.reach.lattice import Lattice
from learning.reach.params import MAP
from pps_vision.errors import InputError
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask, Reachability, ReachStatus, Track3D

_VERSION = 6
_TEXTS = ("side", "end_point", "measure", "kinematics")
_FIELDS = ("signed_distance", "optimality", "error_m")
_NUMBERS = ("max_error_m", "softness", "expected_error", "unanswered", "error_bound")
OWN_MODEL = "the robot's own model"
_LABELS = tuple(f.name for f in fields(Labels))
_TORCH_ROWS = 1 << 18  # gaze postures at a time on a torch device, which take about 100 MB


@dataclass(frozen=True)
class MapPrediction:
    """Prediction for N gaze postures."""

    within_limits: Mask  # (N,) whether the map covers the posture; elsewhere `reachable` is False and the rest NaN
    reachable: Mask  # (N,) whether the probability exceeds the threshold of the query
    probability: Array  # (N,) of being reachable
    degree: Array  # (N,) degree of reachability R in [0, 1], above 0.5 where reachable (J IV.6–IV.7)


@dataclass(frozen=True)
class ReachableMap:
    """Map of one arm, or of both."""

    side: str
    """One of left, right and both."""
    limits: GazeLimits
    """Gaze limits that the lattice spans."""
    signed_distance: Array
    """(a, b, c) to the border in `isotropic` coordinates, positive inside."""
    optimality: Array
    """(a, b, c) of the best posture, 1 − M of J IV.5, inside."""
    error_m: Array
    """(a, b, c) distance left between hand and fixation point, outside."""
    max_error_m: float
    """The largest such distance."""
    softness: float
    """Standard uncertainty of the border in `isotropic` coordinates."""
    expected_error: float
    """Share of gaze postures misjudged, estimated from the last labels."""
    labels: Labels
    """Training data; training can go on from them."""
    unanswered: int
    """Number of further problems for which inverse kinematics did not converge."""
    end_point: str = "palm"
    """Point of the arm that reaches: "palm" or a taxel."""
    measure: str = "joint-limits"
    """Name of the measure of `optimality`."""
    kinematics: str = OWN_MODEL
    """Where the hand's kinematics are from: `OWN_MODEL`, or the recordings in which it was seen."""
    error_bound: float = 1.0
    """Upper bound of the share misjudged, from a test on postures not learned from; 1 without a test."""

    def __post_init__(self) -> None:
        shape = self.signed_distance.shape
        if len(shape) != 3 or min(shape) < 2 or not self.optimality.shape == self.error_m.shape == shape:
            raise ValueError(
                f"signed distance {shape}, optimality {self.optimality.shape}, error {self.error_m.shape}: "
                "expected the same (a, b, c), at least 2 each"
            )
        if not (self.softness > 0 and self.max_error_m > 0):
            raise ValueError(f"softness {self.softness}, largest error {self.max_error_m} m: expected both above 0")

    def save(self, path: Path | str) -> None:
        """Write the map as .npz, whole or not at all."""
        arrays: dict[str, ArrayLike] = {name: getattr(self, name) for name in (*_TEXTS, *_FIELDS, *_NUMBERS)}
        arrays["limits_rad"] = np.array([self.limits.yaw_rad, self.limits.pitch_rad, self.limits.vergence_rad])
        arrays |= {f"label_{name}": getattr(self.labels, name) for name in _LABELS}
        write_archive(Path(path), MAP, _VERSION, arrays)

    @classmethod
    def load(cls, path: Path | str) -> "ReachableMap":
        """Read a map that `pps-vision reach train` or `save` wrote; InputError names the file and the fault."""
        stored = (*_TEXTS, *_FIELDS, *_NUMBERS, "limits_rad", *(f"label_{name}" for name in _LABELS))
        data = read_archive(Path(path), MAP, _VERSION, stored)
        try:
            (y0, y1), (p0, p1), (v0, v1) = np.asarray(data["limits_rad"], dtype=float).reshape(3, 2).tolist()
            limits = GazeLimits((y0, y1), (p0, p1), (v0, v1))
            label = {name: np.asarray(data[f"label_{name}"], dtype=float) for name in _LABELS}
            values: dict[str, Any] = {name: str(data[name]) for name in _TEXTS}
            values |= {name: np.asarray(data[name], dtype=float) for name in _FIELDS}
            values |= {name: float(np.asarray(data[name], dtype=float)) for name in _NUMBERS}
            values["unanswered"] = int(values["unanswered"])
            labels = Labels(**{**label, "reachable": label["reachable"] > 0})
            return cls(limits=limits, labels=labels, **values)
        except (ValueError, TypeError, OverflowError) as error:
            raise InputError(path, f"{MAP} that does not fit together: {error}") from error

    @cached_property
    def lattice(self) -> Lattice:
        """The lattice of the values."""
        a, b, c = self.signed_distance.shape
        return Lattice(self.limits, (a, b, c))

    @cached_property
    def _fields(self) -> Array:
        """(3, a, b, c) signed distance, optimality, and error relative to the largest."""
        return np.stack([self.signed_distance, self.optimality, self.error_m / self.max_error_m])

    def threshold(self, max_false_positives: float) -> float:
        """Least probability, at least 0.5, above which no more than this share of the unreachable postures is called
        reachable, according to the map's own probabilities."""
        if not 0 < max_false_positives < 1:
            raise InputError(MAP, f"a share of {max_false_positives} false positives: expected above 0 and below 1")
        probability = np.sort(expit(self.signed_distance.ravel() / self.softness))
        order = np.argsort(self.signed_distance.ravel())
        # weight of a lattice point: its spacing in vergence, since the lattice is densest where the eyes verge least
        share = (1 - probability) * np.sin(self.lattice.gaze_rad[order, 2])
        wrong = np.cumsum(share[::-1])[::-1] / share.sum()  # if all from here on are called reachable
        first = int(np.searchsorted(-wrong, -max_false_positives))
        return max(float(probability[first - 1]), 0.5) if first else 0.5

    def query(self, gaze_rad: ArrayLike, threshold: float = 0.5, device: str | None = None) -> MapPrediction:
        """Predict for gaze postures (N, 3): reachable above the `threshold` of probability.  `device`: compute with
        torch there (cpu, cuda, …)."""
        gaze = np.asarray(gaze_rad, dtype=float)
        if gaze.ndim != 2 or gaze.shape[1] != 3:
            raise ValueError(f"gaze postures of shape {gaze.shape}: expected (N, 3)")
        within: Mask = np.asarray(((gaze >= self.limits.lower) & (gaze <= self.limits.upper)).all(axis=1))
        gaze = np.where(within[:, None], gaze, self.limits.lower)
        if device is not None and len(gaze):
            probability, degree = self._query_by_torch(gaze, device)
        else:
            signed, good, bad = self.lattice.interpolate(self._fields, gaze)
            degree = np.where(signed > 0, 0.5 + 0.5 * good, 0.5 - 0.5 * bad).clip(0, 1)
            probability = expit(signed / self.softness)
        probability[~within] = degree[~within] = np.nan
        return MapPrediction(within, within & (probability > threshold), probability, degree)

    def _query_by_torch(self, gaze_rad: Array, device: str) -> tuple[Array, Array]:
        """Probability and degree (N,) of gaze postures (N, 3) within the limits, on a torch device."""
        import torch  # takes seconds to load
        from torch.nn import functional

        def isotropic(gaze: Array) -> torch.Tensor:  # as `lattice.isotropic`
            tensor = torch.from_numpy(gaze).to(device)
            return torch.cat([tensor[..., :2], torch.tan(tensor[..., 2:] / 2).log()], dim=-1)

        values = torch.from_numpy(self._fields)[None].to(device)
        low = isotropic(self.limits.lower)
        high = isotropic(self.limits.upper)
        results = []
        for gaze in torch.split(isotropic(gaze_rad), _TORCH_ROWS):
            place = (2 * (gaze - low) / (high - low) - 1).flip(-1).view(1, -1, 1, 1, 3)  # the last axis comes first
            between = functional.grid_sample(values, place, "bilinear", "border", align_corners=True)
            signed, good, bad = between.view(3, -1)
            degree = torch.where(signed > 0, 0.5 + 0.5 * good, 0.5 - 0.5 * bad).clamp(0, 1)
            results.append(torch.stack([torch.sigmoid(signed / self.softness), degree]))
        probability, degrees = torch.cat(results, dim=1).cpu().numpy()
        return probability, degrees


def both(left: ReachableMap, right: ReachableMap) -> ReachableMap:
    """Map of what both hands reach at once, with the degree of the worse; ValueError where limits or lattices differ.

    It has no labels, so that training cannot go on from it.  Its `error_bound` may fail wherever one of theirs does.
    """
    if left.limits != right.limits or left.signed_distance.shape != right.signed_distance.shape:
        raise ValueError(f"maps of {left.limits} and {right.limits}: expected the same limits and lattice")
    return replace(
        left,
        side="both",
        signed_distance=np.minimum(left.signed_distance, right.signed_distance),
        optimality=np.minimum(left.optimality, right.optimality),
        error_m=np.maximum(left.error_m, right.error_m),
        max_error_m=max(left.max_error_m, right.max_error_m),
        softness=max(left.softness, right.softness),
        expected_error=left.expected_error + right.expected_error,
        labels=left.labels.only(np.zeros(0, np.intp)),
        unanswered=left.unanswered + right.unanswered,
        error_bound=min(left.error_bound + right.error_bound, 1.0),
    )


class TrackReachability:
    """Reachability of the tracked object: track → gaze that fixates it → map (J, "Reachable space map")."""

    def __init__(
        self, robot: Robot, reachable_map: ReachableMap, max_false_positives: float, touch_m: float | None = None
    ) -> None:
        """At most the share `max_false_positives` of the unreachable postures is called reachable, by the map's own
        probabilities: a false positive dooms a reach, a false negative only moves the body (J).

        `touch_m`: an object is reachable when the end point gets this near to its surface; None: when it gets to the
        point fixated.
        """
        self.map = reachable_map
        self.touch_m = touch_m
        self.threshold = reachable_map.threshold(max_false_positives)
        self.gaze_model = GazeModel(robot)

    def __call__(self, q_rad: Array, track: Track3D) -> Reachability:
        """Reachability of a track in the root frame, with the robot at configuration `q_rad` (n_joints,).

        Only the object's position relative to the torso counts, not the posture of the eyes and arms that it carries.
        """
        if not track.is_known:
            return Reachability.without_answer(track.stamp_s, ReachStatus.UNKNOWN)
        point = self.gaze_model.to_upright(q_rad[None], track.position)
        gaze = self.gaze_model.gaze(point, self.map.limits)
        predicted = self.map.query(gaze, self.threshold)
        if not predicted.within_limits[0]:
            return Reachability.without_answer(track.stamp_s, ReachStatus.NOT_FIXATED)
        is_reachable = predicted.reachable[0]
        if self.touch_m is not None:
            left_m = (1 - 2 * predicted.degree[0]) * self.map.max_error_m  # J IV.7, solved for the distance left
            is_reachable = left_m <= track.radius_m + self.touch_m
        status = ReachStatus.REACHABLE if is_reachable else ReachStatus.UNREACHABLE
        return Reachability(track.stamp_s, gaze[0], float(predicted.probability[0]), float(predicted.degree[0]), status)

    def reachable(self, gaze: Array) -> Mask:
        """The map's verdict (N,) on gaze postures (N, 3); False for NaN."""
        return self.map.query(gaze, self.threshold).reachable
