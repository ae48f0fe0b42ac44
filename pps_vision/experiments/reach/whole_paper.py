"""The whole of Jamone et al. in one run: babbling, forward model, inverse kinematics, both maps, and their scores.

The hand is fixated by kinematics within joint limits; inverse kinematics runs on the forward model learned from that,
never on the robot's own.  Maps are judged against the learned kinematics, as in J, and against the true ones.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.babbling import Babbled, babble
from learning.reach.forward_model import RevoluteArm
from learning.reach.labels import HandModel, ReachOracle
from learning.reach.params import MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments.reach import jamone, paper_figures
from pps_vision.experiments.reach.map_truth import SCORES, MapTruth, exact_map, first, gaze_rmse_deg, judge_by_labels
from pps_vision.experiments.study import SampledStudy, interval
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot

_N_TEST, _N_FIXATED_OF_J = 700, 4400
_PARAMS = MapParams()
_OURS, _JAMONE = "ours", "J: LWPR on labels everywhere"
_EXTREMES_OF_J = {"C, farthest": (11.17, 15.0), "D, closest": (89.15, 105.0)}  # vergence, elbow (degrees)


@dataclass(frozen=True)
class WholePaper(SampledStudy):
    """Forward model, Basic and Enhanced map from babbling alone, ours and as in J: JE, FN, FP and RMSE."""

    SHORT: ClassVar[Mapping[str, Any]] = {"n_tried": 500, "labels": 600, "labels_of_j": 600}

    n: int = 5
    """Times that everything is learned anew."""
    n_tried: int = 20_000
    """Arm postures babbled."""
    labels: int = 24_000
    """Inverse-kinematics solutions of our map."""
    labels_of_j: int = 52_000
    """Inverse-kinematics solutions of J's map."""
    n_test: int = 10_000
    """Gaze postures the maps are judged on."""
    repetitions: int = 1000
    """Babblings whose extreme postures are compared with J's."""

    def run(self) -> dict[str, Any]:
        """Return by map its scores against the learned and the true kinematics: means, and 95 % over repeats.

        Slices, planes, extreme postures and the forward model are those of the first repeat.
        """
        repeats = [self._once(seed) for seed in tqdm(self.seeds, desc="repeats", disable=None)]
        estimated = {
            name: {
                truth: {key: interval([[one["maps"][name][truth][key]] for one in repeats]) for key in of}
                for truth, of in scores.items()
            }
            for name, scores in repeats[0]["maps"].items()
        }
        means = {
            name: {truth: {key: value[0] for key, value in of.items()} for truth, of in scores.items()}
            for name, scores in estimated.items()
        }
        return {**repeats[0], "maps": means, "estimated": estimated}

    def _once(self, seed: int) -> dict[str, Any]:
        """Learn both maps from babbling and judge them; of the first repeat also what is drawn."""
        robot, rng = load_icub(), np.random.default_rng(seed)
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
        test_rng = np.random.default_rng(seed + 1_000_000)
        truth = MapTruth.of(robot, self.n_test, test_rng)
        believed = ReachOracle(robot, "right", params, test_rng, hand).label(truth.gaze_rad)
        found = {
            "maps": {
                name: {"true": truth.judge(query, error_m), "learned": judge_by_labels(query, believed, error_m)}
                for name, query in maps.items()
            }
        }
        if seed != self.seed:
            return found
        test = first(babble(robot, "right", 4 * _N_TEST, test_rng), _N_TEST)
        exact = {"true kinematics": exact_map(robot, error_m)}
        return {
            "fixated": len(babbled.arm_rad),
            "forward_model_deg": gaze_rmse_deg(model, test)[0],
            "unanswered": {_OURS: learned.unanswered, _JAMONE: int((~labels.answered).sum())},
            **found,
            "extremes": extremes(babbled),
            "repeated_extremes": repeated_extremes(robot, self.repetitions, self.n_tried, test_rng),
            "drawn": paper_figures.sample({**exact, **maps}, robot, babbled),
            "space": paper_figures.sample_space(learned.labels, learned.query, error_m, test_rng),
        }

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw gaze space (J Figs 4, 7), and R on slices of it (J Fig 8) and in the box of locations (J Fig 9)."""
        drawn = numbers["drawn"]
        return {
            "space": paper_figures.space(numbers["space"]),
            "slices": paper_figures.slices(drawn["slices"], numbers["extremes"]),
            "box": paper_figures.box(drawn),
        }

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the scores against the true and the learned kinematics beside J's (against its labels)."""
        rows = [
            [f"{name}; {truth} kinematics", *(estimate(of[key], 2) if key in of else "–" for key in SCORES.values())]
            for name, scores in numbers["estimated"].items()
            for truth, of in scores.items()
        ]
        rows.append(["J's figures", *(f"{jamone.RESULTS[key]:g}" for key in list(SCORES.values())[:-1]), "–"])
        points = [
            [
                name,
                f"{at['vergence_deg_of_j']:g}",
                f"{at['vergence_deg']:.1f}",
                estimate(repeated),
                f"{at['elbow_deg_of_j']:g}",
                f"{at['elbow_deg']:.0f}",
            ]
            for (name, at), repeated in zip(numbers["extremes"].items(), numbers["repeated_extremes"], strict=True)
        ]
        header = [
            "point of J Fig 3",
            "vergence: J (°)",
            "ours (°)",
            "median and 95 % of babblings (°)",
            "elbow: J (°)",
            "ours (°)",
        ]
        return {"": Table(["map; judged against", *SCORES], rows), "extremes": Table(header, points)}


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


def repeated_extremes(robot: Robot, n: int, n_tried: int, rng: np.random.Generator) -> list[list[float]]:
    """Return the vergences (degrees) of points C and D in `n` babblings of as many fixated postures as J's: median, and
    where 95 % of them lie."""
    some = (first(babble(robot, "right", n_tried, rng), _N_FIXATED_OF_J).gaze_rad[:, 2] for _ in range(n))
    ends = np.rad2deg([(vergence.min(), vergence.max()) for vergence in some])
    return [np.percentile(of, (50, 2.5, 97.5)).tolist() for of in ends.T]
