"""Maps of other end points and other measures of a posture, judged over the whole curve of postures in closed form."""

from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from tqdm import tqdm

from learning.reach import MeasureName
from learning.reach.measures import hand_and_params
from learning.reach.params import ArmLimits, MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.experiments.study import SampledStudy, interval, percent, rms
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.end_point import EndPoint
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.self_motion import DirectionCoverage
from pps_vision.types import Array

_CURVE, _ROWS = 121, 100  # postures per curve; gaze postures at a time
_TAXEL = "left_forearm:27"
_GAZE = GazeLimits(pitch_rad=(np.deg2rad(-80), np.deg2rad(40)))  # down to the forearm, with the eyes' tilt


@dataclass(frozen=True)
class Measures(SampledStudy):
    """Maps of the right palm by joint limits, manipulability, isotropy, approach directions, and of a left taxel."""

    n: int = 5
    """Maps of each measure."""
    n_labels: int = 3000
    """Inverse-kinematics solutions per map."""
    n_test: int = 1000
    """Gaze postures they are judged on."""
    measures: tuple[MeasureName, ...] = get_args(MeasureName)
    """Of the palm."""

    def run(self) -> dict[str, Any]:
        """Return by measure JE (%), RMS error of the measure, share reachable (%) and spread of the truth, with 95 %
        over maps."""
        robot = load_icub()
        cases = [*(("right", "palm", name) for name in self.measures), ("left", _TAXEL, "joint-limits")]
        maps = [(case, seed) for case in cases for seed in self.seeds]
        rows: dict[str, list[dict[str, float]]] = {}
        for (side, end_point, measure), seed in tqdm(maps, desc="maps", disable=None):
            rows.setdefault(f"{end_point}, {measure}", []).append(self._judged(robot, side, end_point, measure, seed))
        return {
            "measures": {
                name: {key: interval([[row[key]] for row in of]) for key in of[0]} for name, of in rows.items()
            }
        }

    def _judged(self, robot: Robot, side: str, end_point: str, measure: MeasureName, seed: int) -> dict[str, float]:
        """Learn a map and compare it with the truth at gaze postures of its own."""
        test = np.random.default_rng(seed + 1_000_000).uniform(_GAZE.lower, _GAZE.upper, (self.n_test, 3))
        base = MapParams(_GAZE, n_labels=self.n_labels, round_labels=min(1500, self.n_labels // 2))
        hand, params = hand_and_params(robot, side, end_point, measure, base)
        learned = train_reachable_map(robot, side, np.random.default_rng(seed), params, hand)
        said, true = learned.query(test), best_measure(robot, side, end_point, params, test)
        reachable = np.isfinite(true)
        return {
            "je": percent(said.reachable != reachable),
            "reachable": percent(reachable),
            "rmse": rms((2 * said.degree - 1 - true)[said.reachable & reachable]),
            "spread": float(np.std(true[reachable])),
        }

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the learned measure's error beside the spread of the truth."""
        header = ["map of", "reachable (%)", "JE (%)", "RMS error of the measure", "its standard deviation"]
        keys = ("reachable", "je", "rmse", "spread")
        rows = [[name, *(estimate(row[key], 2) for key in keys)] for name, row in numbers["measures"].items()]
        return {"": Table(header, rows)}


def best_measure(robot: Robot, side: str, end_point: str, params: MapParams, gaze: Array) -> Array:
    """Return (N,) the measure of the best posture that reaches, or the share of directions; NaN out of reach.

    Closed form: the whole curve of postures that reach what gaze postures (N, 3) fixate, 121 of each.
    """
    limits = ArmLimits()
    lower, upper = np.array(limits.lower_rad), np.array(limits.upper_rad)
    point = EndPoint.of(robot, side, end_point, 4)
    tip = point.chain.T_root_frame.copy()
    tip[:3, 3] += tip[:3, :3] @ point.point
    arm = SphericalArm.of(replace(point.chain, T_root_frame=tip), lower, upper)
    places = fixation_points(robot, gaze)
    exact = arm.solve(places)
    best = np.full(len(gaze), np.nan)
    for some in np.array_split(np.flatnonzero(np.isfinite(exact[:, 0])), max(len(gaze) // _ROWS, 1)):
        q = np.concatenate([arm.curves(places[some], _CURVE), exact[some, None]], axis=1)
        known = np.isfinite(q[..., 0])
        if isinstance(params.measure, DirectionCoverage):
            near, directions = np.cos(params.measure.within_rad), params.measure.directions
            normals = [point.normals(one[ok]) for one, ok in zip(q, known, strict=True)]
            best[some] = [(normal @ directions.T >= near).any(axis=0).mean() for normal in normals]
        elif len(some):
            value = np.full(known.shape, -np.inf)
            value[known] = params.measure(lower, upper)(q[known], point.positions(q[known])[1])
            best[some] = value.max(axis=1)
    return best
