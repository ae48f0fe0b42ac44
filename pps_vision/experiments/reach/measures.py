"""Other measures of how well a place is reached, and another point of the arm that reaches it: what a map says of each,
against the whole curve of postures that reach a place, in closed form."""

from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.map import ReachableMap
from learning.reach.measures import hand_and_params
from learning.reach.names import MeasureName
from learning.reach.training import ArmLimits, MapParams, train_reachable_map
from pps_vision.experiments.chart import panels
from pps_vision.experiments.study import Study
from pps_vision.robot.end_point import EndPoint
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.self_motion import Approach, Measure
from pps_vision.robot.spherical_arm import SphericalArm
from pps_vision.types import Array

_SAMPLES, _ROWS = 121, 100
_SHOWN_VERGENCE_DEG, _SHOWN_N = 20, 60
_TAXEL = "left_forearm:27"
_GAZE = GazeLimits(pitch_rad=(np.deg2rad(-80), np.deg2rad(40)))  # as far down as forearms are, with the eyes' tilt


@dataclass(frozen=True)
class Measures(Study):
    """Maps of the right palm for each of the four measures, and of a taxel of the left forearm."""

    seed: int = 0
    """Seed of the maps' labels; the postures they are judged on have another."""
    n_labels: int = 3000
    """Inverse-kinematics solutions a map."""
    n_test: int = 1000
    """Gaze postures they are judged on."""

    def run(self) -> dict[str, Any]:
        """By case: misjudged (%), and of what both call reachable the RMS error of the measure and its truth's mean and
        spread; of the palm's the rank correlation of the truths, and the truths' slices."""
        if self.n_test < 100:
            raise ValueError(f"bench reach measures: --n-test {self.n_test}; expected at least 100")
        robot = load_icub()
        test = np.random.default_rng(self.seed + 1_000_000).uniform(_GAZE.lower, _GAZE.upper, (self.n_test, 3))
        cases = [("right", "palm", name) for name in get_args(MeasureName)] + [("left", _TAXEL, "joint-limits")]
        rows: dict[str, dict[str, Any]] = {}
        truths = []
        for side, end_point, measure in tqdm(cases, desc="maps", disable=None):
            params = MapParams(_GAZE, n_labels=self.n_labels, round_labels=min(1500, self.n_labels // 2))
            hand, params = hand_and_params(robot, side, end_point, measure, params)
            learned = train_reachable_map(robot, side, np.random.default_rng(self.seed), params, hand)
            true = truth(robot, side, end_point, params, test)
            truths.append(true)
            rows[f"{end_point}, {measure}"] = _judged(learned, test, true) | {"shown": _slice(learned)}
        both = np.isfinite(truths[0])
        return {"maps": rows, "correlation": np.corrcoef([t[both] for t in truths[:4]]).round(3).tolist()}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """What the maps say at one vergence, and how far off they are."""
        figure, axes = panels(len(numbers["maps"]), 3.1, 4.2)
        extent = (-55, 55, -80, 40)
        for axis, (name, row) in zip(axes, numbers["maps"].items(), strict=True):
            shown = np.array(row["shown"], dtype=float)
            image = axis.imshow(shown, origin="lower", extent=extent, aspect="auto", cmap="viridis")
            axis.set_title(
                f"{name}\nRMS error {row['rmse']:.3f}, truth {row['mean']:.2f} ± {row['spread']:.2f}", fontsize=8
            )
            axis.set_xlabel("neck yaw (°)")
            figure.colorbar(image, ax=axis, location="bottom", label="best posture, as learned")
        axes[0].set_ylabel(f"neck pitch (°), at vergence {_SHOWN_VERGENCE_DEG}°")
        return figure


def truth(robot: Robot, side: str, end_point: str, params: MapParams, gaze: Array) -> Array:
    """(N,) the measure of the best posture, or the share of directions, over the whole curve of postures that reach
    what gaze postures (N, 3) fixate; NaN out of reach."""
    limits = ArmLimits()
    lower, upper = np.array(limits.lower_rad), np.array(limits.upper_rad)
    point = EndPoint.of(robot, side, end_point, 4)
    tip = point.chain.T_root_frame.copy()
    tip[:3, 3] += tip[:3, :3] @ point.point
    arm = SphericalArm.of(replace(point.chain, T_root_frame=tip), lower, upper)
    places = fixation_points(robot, gaze)
    reached = np.flatnonzero(np.isfinite(arm.solve(places)[:, 0]))
    best = np.full(len(gaze), np.nan)
    for some in np.array_split(reached, max(len(reached) // _ROWS, 1)):
        q = np.concatenate([arm.curves(places[some], _SAMPLES), arm.solve(places[some])[:, None]], axis=1)
        if isinstance(params.measure, Approach):
            best[some] = _faced(point, q, params.measure)
        else:
            best[some] = _greatest(point, q, params.measure(lower, upper))
    return best


def _greatest(point: EndPoint, q: Array, measure: Measure) -> Array:
    known = np.isfinite(q[..., 0])
    value = np.full(known.shape, -np.inf)
    value[known] = measure(q[known], point.positions(q[known])[1])
    most: Array = value.max(axis=1)
    return most


def _faced(point: EndPoint, q: Array, approach: Approach) -> Array:
    near = np.cos(approach.within_rad)
    share = [(point.normals(of[np.isfinite(of[:, 0])]) @ approach.directions.T >= near).any(axis=0).mean() for of in q]
    return np.array(share)


def _judged(learned: ReachableMap, gaze: Array, true: Array) -> dict[str, float]:
    said, reachable = learned.query(gaze), np.isfinite(true)
    both = said.reachable & reachable
    off = 2 * said.degree[both] - 1 - true[both]
    return {
        "misjudged_percent": 100 * float(np.mean(said.reachable != reachable)),
        "reachable_percent": 100 * float(reachable.mean()),
        "rmse": float(np.sqrt(np.mean(off**2))),
        "mean": float(true[reachable].mean()),
        "spread": float(true[reachable].std()),
    }


def _slice(learned: ReachableMap) -> list[list[float | None]]:
    """What it says over yaw and pitch at one vergence; None out of reach."""
    low, high = learned.limits.lower, learned.limits.upper
    yaw, pitch = (np.linspace(low[k], high[k], _SHOWN_N) for k in (0, 1))
    Y, P = np.meshgrid(yaw, pitch)
    gaze = np.stack([Y.ravel(), P.ravel(), np.full(Y.size, np.deg2rad(_SHOWN_VERGENCE_DEG))], axis=1)
    said = learned.query(gaze)
    value = np.where(said.reachable, 2 * said.degree - 1, np.nan).reshape(Y.shape)
    return [[round(float(v), 3) if np.isfinite(v) else None for v in row] for row in value]
