"""Reachable-space map: error over the inverse-kinematics solutions spent, thresholds and calibration (J Figs 4–9)."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree
from tqdm import tqdm

from learning.reach.labels import ReachOracle
from learning.reach.lattice import Lattice, isotropic
from learning.reach.map import ReachableMap
from learning.reach.params import MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments import charts
from pps_vision.experiments.pps.scores import expected_calibration_error, reliability
from pps_vision.experiments.reach import jamone
from pps_vision.experiments.reach.map_truth import SCORES, MapTruth, rates
from pps_vision.experiments.study import SeededStudy
from pps_vision.experiments.tables import Table
from pps_vision.experiments.timing import timed
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array, Mask

_MAX_FP = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)


def nearest_label(oracle: ReachOracle, n: int, rng: np.random.Generator) -> tuple[Callable[[Array], Mask], int]:
    """Return the verdict of the nearest of `n` labels drawn everywhere, and how many labels were spent."""
    limits = oracle.params.gaze_limits
    labels = oracle.label(rng.uniform(limits.lower, limits.upper, (n, 3)))
    tree = cKDTree(isotropic(labels.gaze_rad))
    return lambda gaze: labels.reachable[tree.query(isotropic(gaze))[1]], n


def regular_grid(oracle: ReachOracle, n: int, _: np.random.Generator) -> tuple[Callable[[Array], Mask], int]:
    """Return the verdict of a regular grid of about `n` labels, interpolated linearly, and how many it has."""
    limits = oracle.params.gaze_limits
    extent = isotropic(limits.upper) - isotropic(limits.lower)
    lattice = Lattice.of_spacing(limits, float((np.prod(extent) / n) ** (1 / 3)))
    labels = oracle.label(lattice.gaze_rad)
    values = labels.reachable.astype(float)[:, None]
    return lambda gaze: lattice.interpolate(values, gaze)[:, 0] > 0.5, len(labels.gaze_rad)


BASELINES = {"nearest of labels everywhere": nearest_label, "regular grid": regular_grid}


@dataclass(frozen=True)
class Maps(SeededStudy):
    """Basic and Enhanced map of the right arm over the labels spent, with true kinematics, judged by closed form."""

    SHORT: ClassVar[Mapping[str, Any]] = {"labels": (600, 1200)}

    n_test: int = 20_000
    """Gaze postures they are judged on."""
    labels: tuple[int, ...] = (750, 1500, 3000, 6000, 12_000, 24_000, 52_000)
    """Inverse-kinematics solutions spent."""

    def run(self) -> dict[str, Any]:
        """Return scores (percent, RMS of R) by method and labels; of the largest map thresholds and calibration."""
        robot = load_icub()
        truth = MapTruth.of(robot, self.n_test, np.random.default_rng(self.seed + 1_000_000))
        oracle = ReachOracle(robot, "right", MapParams(), np.random.default_rng(self.seed))
        ours: list[dict[str, float]] = []
        others: dict[str, list[dict[str, float]]] = {name: [] for name in BASELINES}
        for n in tqdm(self.labels, desc="labels", disable=None):
            params = replace(MapParams(), n_labels=n, round_labels=min(MapParams().round_labels, n // 2))
            rng = np.random.default_rng(self.seed)
            learned, ms = timed(partial(train_reachable_map, robot, "right", rng, params))
            ours.append({"labels": n, **truth.judge(learned.query, learned.max_error_m), "processor_s": ms / 1000})
            for name, baseline in BASELINES.items():
                verdict, spent = baseline(oracle, n, np.random.default_rng(self.seed))
                others[name].append({"labels": spent, **rates(verdict(truth.gaze_rad), truth.reachable)})
        return {"n": 1, "ours": ours, "baselines": others, **probabilities(learned, truth)}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw JE over the labels spent, what a stricter threshold costs, and calibration."""
        figure, (over, strict, calibrated) = charts.panels(3)
        for name, rows in {"ours": numbers["ours"], **numbers["baselines"]}.items():
            spent, je = [row["labels"] for row in rows], [row["je"] for row in rows]
            charts.curves(over, spent, {name: je}, "inverse-kinematics solutions", "misjudged, JE (%)")
        over.plot(jamone.RESULTS["labels"], jamone.RESULTS["je"], "k*", ms=10, label="J (against its own labels)")
        over.set(xscale="log", yscale="log")
        asked = [row["max_fp"] for row in numbers["thresholds"]]
        found = {
            name: [row[key] for row in numbers["thresholds"]]
            for key, name in (("fp", "false positives"), ("fn", "false negatives"))
        }
        charts.curves(strict, asked, {**found, "as asked": asked}, "asked for by --max-fp (%)", "misjudged (%)")
        strict.set(xscale="log")
        strict.set_yscale("symlog", linthresh=0.01)
        strict.set_ylim(0, None)
        bins = numbers["calibration"]["uncertain_bins"]
        stated, happened = (list(100 * np.array(bins[key])) for key in ("predicted", "happened"))
        charts.calibration(calibrated, stated, {"0.01 < p < 0.99": happened}, "reachable (%)")
        calibrated.set(xlabel="stated probability of being reachable (%)")
        for axis in (over, strict):
            axis.legend(fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the scores of our map by labels, beside the baselines' JE."""
        keys = SCORES | {"time (s)": "processor_s"}
        rows = [
            [str(row["labels"]), *(f"{row[key]:.2g}" for key in keys.values()), *(f"{o['je']:.2g}" for o in others)]
            for row, *others in zip(numbers["ours"], *numbers["baselines"].values(), strict=True)
        ]
        return {"": Table(["labels", *keys, *(f"{name}: JE (%)" for name in numbers["baselines"])], rows)}


def probabilities(learned: ReachableMap, truth: MapTruth) -> dict[str, Any]:
    """Return the rates (percent) found for what `--max-fp` asks, and the calibration error of all probabilities.

    Of the uncertain ones (0.01 < p < 0.99) also their bins.
    """
    p = learned.query(truth.gaze_rad).probability
    thresholds = [{"max_fp": 100 * fp, **rates(p > learned.threshold(fp), truth.reachable)} for fp in _MAX_FP]
    uncertain = (p > 0.01) & (p < 0.99)
    calibration = {
        "ece": expected_calibration_error(truth.reachable, p),
        "uncertain_percent": 100 * float(uncertain.mean()),
        "uncertain_ece": expected_calibration_error(truth.reachable[uncertain], p[uncertain]),
        "uncertain_bins": asdict(reliability(truth.reachable[uncertain], p[uncertain])),
    }
    return {"thresholds": thresholds, "calibration": calibration}
