"""The whole of Jamone et al. in one run: babbling, forward model, inverse kinematics, both maps, and their scores.

The hand is fixated by kinematics within joint limits; inverse kinematics runs on the forward model learned from that,
never on the robot's own.  Maps are judged against the learned kinematics, as in J, and against the true ones.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.reach.babbling import Babbled, babble
from learning.reach.forward_model import RevoluteArm
from learning.reach.labels import HandModel, ReachOracle
from learning.reach.map import MapPrediction
from learning.reach.params import MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments.reach import jamone, paper_figures
from pps_vision.experiments.reach.map_truth import MapTruth, closed_form, first, gaze_rmse_deg, judge_by_labels
from pps_vision.experiments.study import SeededStudy
from pps_vision.experiments.tables import Table
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.types import Array

_N_TEST = 700
_PARAMS = MapParams()
_OURS, _JAMONE = "ours", "J: LWPR on labels everywhere"
_EXTREMES_OF_J = {"C, farthest": (11.17, 15.0), "D, closest": (89.15, 105.0)}  # vergence, elbow (degrees)


@dataclass(frozen=True)
class WholePaper(SeededStudy):
    """Forward model, Basic and Enhanced map from babbling alone, ours and as in J: JE, FN, FP and RMSE."""

    n_tried: int = 20_000
    """Arm postures babbled."""
    labels: int = 24_000
    """Inverse-kinematics solutions of our map."""
    labels_of_j: int = 52_000
    """Inverse-kinematics solutions of J's map."""
    n_test: int = 10_000
    """Gaze postures the maps are judged on."""

    def run(self) -> dict[str, Any]:
        """Return by map its scores against the learned and the true kinematics; slices and planes; extreme postures."""
        robot, rng = load_icub(), np.random.default_rng(self.seed)
        babbled, model = babble(robot, "right", self.n_tried, rng), RevoluteArm()
        model.learn(babbled.arm_rad, babbled.gaze_rad)
        hand = HandModel(model.forward, model.points, model.gaze)
        params = replace(_PARAMS, n_labels=self.labels, round_labels=min(_PARAMS.round_labels, self.labels // 2))
        learned = train_reachable_map(robot, "right", rng, params, hand)
        limits, error_m = params.gaze_limits, learned.max_error_m
        gaze = rng.uniform(limits.lower, limits.upper, (self.labels_of_j, 3))
        labels = ReachOracle(robot, "right", params, rng, hand).label(gaze)
        lwpr = jamone.lwpr_map(labels, error_m, limits)
        maps: dict[str, jamone.MapQuery] = {_OURS: learned.query, _JAMONE: lwpr}
        test_rng = np.random.default_rng(self.seed + 1_000_000)
        truth = MapTruth.of(robot, self.n_test, test_rng)
        believed = ReachOracle(robot, "right", params, test_rng, hand).label(truth.gaze_rad)
        test = first(babble(robot, "right", 4 * _N_TEST, test_rng), _N_TEST)
        return {
            "fixated": len(babbled.arm_rad),
            "forward_model_deg": gaze_rmse_deg(model, test)[0],
            "unanswered": {_OURS: learned.unanswered, _JAMONE: int((~labels.answered).sum())},
            "maps": {
                name: {"true": truth.judge(query, error_m), "learned": judge_by_labels(query, believed, error_m)}
                for name, query in maps.items()
            },
            "extremes": extremes(babbled),
            "drawn": paper_figures.sample({"true kinematics": exact_map(robot, error_m), **maps}, robot, babbled),
            "space": paper_figures.sample_space(learned.labels, learned.query, error_m, test_rng),
        }  # fmt: skip

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw gaze space (J Figs 4, 7), and R on slices of it (J Fig 8) and in the box of locations (J Fig 9)."""
        drawn = numbers["drawn"]
        return {
            "space": paper_figures.space(numbers["space"]),
            "slices": paper_figures.slices(drawn, numbers["extremes"]),
            "box": paper_figures.box(drawn),
        }

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the scores against the true / the learned kinematics beside J's (against its labels)."""
        keys = {"JE (%)": "je", "FN (%)": "fn", "FP (%)": "fp", "RMSE of R": "degree_rmse"}
        rows = [
            [name, *(f"{row['true'][key]:.2g} / {row['learned'][key]:.2g}" for key in keys.values()),
             f"{row['true']['box_je']:.2g}"]
            for name, row in numbers["maps"].items()
        ]  # fmt: skip
        rows.append(["J's figures", *(f"{jamone.RESULTS[key]:g}" for key in keys.values()), "–"])
        return {"": Table(["map: true / learned kinematics", *keys, "JE in J's box (%)"], rows)}


def extremes(babbled: Babbled) -> dict[str, dict[str, float]]:
    """Return points C and D of J Fig 3, the farthest and the closest that were reached, in degrees beside J's."""
    vergence, elbow = np.rad2deg(babbled.gaze_rad[:, 2]), np.rad2deg(babbled.arm_rad[:, 3])
    found = {}
    ends = (vergence.argmin(), vergence.argmax())
    for (name, (vergence_of_j, elbow_of_j)), k in zip(_EXTREMES_OF_J.items(), ends, strict=True):
        found[name] = {
            "yaw_deg": float(np.rad2deg(babbled.gaze_rad[k, 0])),
            "vergence_deg": float(vergence[k]),
            "elbow_deg": float(elbow[k]),
            "vergence_deg_of_j": vergence_of_j,
            "elbow_deg_of_j": elbow_of_j,
        }
    return found


def exact_map(robot: Robot, max_error_m: float) -> jamone.MapQuery:
    """Return what the true kinematics say: verdict in closed form, distance by the oracle."""
    arm, oracle = closed_form(robot), ReachOracle(robot, "right", MapParams(), np.random.default_rng(0))

    def query(gaze: Array) -> MapPrediction:
        _, effort = arm.least_effort(fixation_points(robot, gaze), 21)
        reachable = np.isfinite(effort)
        degree = jamone.degree(reachable, 1 - effort, oracle.label(gaze).error_m, max_error_m)
        return MapPrediction(np.ones(len(gaze), bool), reachable, reachable.astype(float), degree)

    return query
