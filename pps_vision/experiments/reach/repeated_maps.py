"""The map that `reach train` learns by default, of either arm and of both at once, with several seeds, judged by closed
form."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.map import MapPrediction, ReachableMap, both
from learning.reach.params import MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments.reach import paper_figures
from pps_vision.experiments.reach.error_bound import ARMS
from pps_vision.experiments.reach.jamone import MapQuery
from pps_vision.experiments.reach.map_truth import SCORES, MapTruth, exact_map
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.types import Array


@dataclass(frozen=True)
class RepeatedMaps(SampledStudy):
    """Basic and Enhanced map of each arm, and of what both reach at once, learned anew with every seed."""

    SHORT: ClassVar[Mapping[str, Any]] = {"lattice": 0.1}

    n: int = 5
    """Maps of each arm."""
    n_labels: int = 24_000
    """Inverse-kinematics solutions of a map."""
    n_test: int = 20_000
    """Gaze postures it is judged on."""
    lattice: float = MapParams.lattice
    """Step of its lattice."""

    def run(self) -> dict[str, Any]:
        """Return the scores (percent, RMS of R) and the reachable share (percent) of every map; of the first of both
        hands also slices."""
        robot, maps, drawn = load_icub(), [], {}
        rounds = min(MapParams.round_labels, self.n_labels // 2)
        params = MapParams(n_labels=self.n_labels, round_labels=rounds, lattice=self.lattice)
        for seed in tqdm(self.seeds, desc="seeds", unit="pair of maps", disable=None):
            truths = [MapTruth.of(robot, self.n_test, np.random.default_rng(seed + 1_000_000), side) for side in ARMS]
            learned = [train_reachable_map(robot, side, np.random.default_rng(seed), params) for side in ARMS]
            of_both = both(*learned)
            for truth, one in zip((*truths, truths[0].both(truths[1])), (*learned, of_both), strict=True):
                scores = truth.judge(one.query, one.max_error_m)
                maps.append({"seed": seed, "arm": one.side, "reachable": 100 * float(truth.reachable.mean()), **scores})
            if seed == self.seed:
                drawn = paper_figures.sample_slices(
                    {"both hands, true kinematics": exact_both(robot, of_both), "both hands, map": of_both.query}
                )
        return {"maps": maps, "drawn": drawn}

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw R of what both hands reach on slices of gaze space: by the true kinematics, and by the map."""
        return {"both": paper_figures.slices(numbers["drawn"], {})}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return mean and largest score of the maps of each arm, and of both."""
        rows = []
        for side in dict.fromkeys(one["arm"] for one in numbers["maps"]):
            of = [one for one in numbers["maps"] if one["arm"] == side]
            reachable = f"{np.mean([one['reachable'] for one in of]):.3g}"
            scores = ([one[key] for one in of] for key in SCORES.values())
            rows.append([side, str(len(of)), reachable, *(f"{np.mean(some):.2g} / {max(some):.2g}" for some in scores)])
        return {"": Table(["arm", "maps", "reachable (%)", *(f"{name}: mean / largest" for name in SCORES)], rows)}


def exact_both(robot: Robot, learned: ReachableMap) -> MapQuery:
    """Return what the true kinematics say of both hands at once: the degree of the worse."""
    exact = [exact_map(robot, learned.max_error_m, side) for side in ARMS]

    def query(gaze: Array) -> MapPrediction:
        left, right = (one(gaze) for one in exact)
        reachable = left.reachable & right.reachable
        degree = np.minimum(left.degree, right.degree)
        return MapPrediction(left.within_limits, reachable, reachable.astype(float), degree)

    return query
