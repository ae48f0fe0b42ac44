"""The map that `reach train` learns by default, of both arms and with several seeds, judged by closed form."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from tqdm import tqdm

from learning.reach.params import MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments.reach.error_bound import ARMS
from pps_vision.experiments.reach.map_truth import MapTruth
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table
from pps_vision.robot.icub import load_icub


@dataclass(frozen=True)
class RepeatedMaps(SampledStudy):
    """Basic and Enhanced map of both arms, each learned anew with every seed."""

    n: int = 5
    """Maps of each arm."""
    n_labels: int = 24_000
    """Inverse-kinematics solutions of a map."""
    n_test: int = 20_000
    """Gaze postures it is judged on."""
    lattice: float = MapParams.lattice
    """Step of its lattice."""

    def run(self) -> dict[str, Any]:
        """Return the scores (percent, RMS of R) of every map."""
        robot, maps = load_icub(), []
        rounds = min(MapParams.round_labels, self.n_labels // 2)
        params = MapParams(n_labels=self.n_labels, round_labels=rounds, lattice=self.lattice)
        for seed in tqdm(self.seeds, desc="seeds", unit="pair of maps", disable=None):
            for side in ARMS:
                truth = MapTruth.of(robot, self.n_test, np.random.default_rng(seed + 1_000_000), side)
                learned = train_reachable_map(robot, side, np.random.default_rng(seed), params)
                maps.append({"seed": seed, "arm": side, **truth.judge(learned.query, learned.max_error_m)})
        return {"maps": maps}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return mean and largest score of each arm's maps."""
        keys = {
            "JE (%)": "je",
            "FN (%)": "fn",
            "FP (%)": "fp",
            "RMSE of R": "degree_rmse",
            "JE in J's box (%)": "box_je",
        }
        rows = []
        for side in ARMS:
            of = [one for one in numbers["maps"] if one["arm"] == side]
            scores = ([one[key] for one in of] for key in keys.values())
            rows.append([side, str(len(of)), *(f"{np.mean(some):.2g} / {max(some):.2g}" for some in scores)])
        return {"": Table(["arm", "maps", *(f"{name}: mean / largest" for name in keys)], rows)}
