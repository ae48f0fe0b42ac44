"""Reachable-space map: error over inverse-kinematics solutions spent, calibration, and time of a query (J Figs 4–9)."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree
from tqdm import tqdm

from learning.pps.scores import expected_calibration_error, reliability
from learning.reach.map import Lattice, ReachableMap, isotropic
from learning.reach.training import MapParams, ReachOracle, train_reachable_map
from pps_vision.experiments import charts
from pps_vision.experiments.reach import jamone
from pps_vision.experiments.reach.map_truth import MapTruth, rates
from pps_vision.experiments.study import Study
from pps_vision.experiments.tables import Table
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array, Mask

_MAX_FP = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
_N_SINGLE = 2000


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
class Maps(Study):
    """Basic and Enhanced map of the right arm over the labels spent, with true kinematics, judged by closed form."""

    seed: int = 0
    """Seed of the labels; the postures the maps are judged on have another."""
    n_test: int = 20_000
    """Gaze postures they are judged on."""
    labels: tuple[int, ...] = (750, 1500, 3000, 6000, 12_000, 24_000, 52_000)
    """Inverse-kinematics solutions spent."""

    def run(self) -> dict[str, Any]:
        """Return scores (percent, RMS of R) by method and labels; of the largest map calibration, thresholds, time."""
        robot = load_icub()
        truth = MapTruth.of(robot, self.n_test, np.random.default_rng(self.seed + 1_000_000))
        oracle = ReachOracle(robot, "right", MapParams(), np.random.default_rng(self.seed))
        ours: list[dict[str, float]] = []
        others: dict[str, list[dict[str, float]]] = {name: [] for name in BASELINES}
        for n in tqdm(self.labels, desc="labels", disable=None):
            begun = time.process_time()
            params = replace(MapParams(), n_labels=n, round_labels=min(MapParams().round_labels, n // 2))
            learned = train_reachable_map(robot, "right", np.random.default_rng(self.seed), params)
            seconds = time.process_time() - begun
            scores = truth.judge(learned.query, learned.max_error_m)
            ours.append({"labels": n, **scores, "expected_je": 100 * learned.expected_error, "processor_s": seconds})
            for name, baseline in BASELINES.items():
                verdict, spent = baseline(oracle, n, np.random.default_rng(self.seed))
                others[name].append({"labels": spent, **rates(verdict(truth.gaze_rad), truth.reachable)})
        return {"ours": ours, "baselines": others, "calibration": calibration(learned, truth),
                "thresholds": thresholds(learned, truth), "query": query_time(learned, truth.gaze_rad)}  # fmt: skip

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw errors over the labels spent; what a stricter threshold costs, and calibration."""
        return {"": _over_labels(numbers), "threshold": _thresholds(numbers)}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the scores of our map by labels, beside the baselines' JE."""
        keys = {
            "JE (%)": "je",
            "FN (%)": "fn",
            "FP (%)": "fp",
            "RMSE of R": "degree_rmse",
            "JE in J's box (%)": "box_je",
        }
        keys["time (s)"] = "processor_s"
        rows = [
            [
                str(row["labels"]),
                *(f"{row[key]:.2g}" for key in keys.values()),
                *(f"{other['je']:.2g}" for other in others),
            ]
            for row, *others in zip(numbers["ours"], *numbers["baselines"].values(), strict=True)
        ]
        return {"": Table(["labels", *keys, *(f"{name}: JE (%)" for name in numbers["baselines"])], rows)}


def calibration(learned: ReachableMap, truth: MapTruth) -> dict[str, Any]:
    """Return the expected calibration error of all and of the uncertain postures (0.01 < p < 0.99), and their bins."""
    p = learned.query(truth.gaze_rad).probability
    uncertain = (p > 0.01) & (p < 0.99)
    return {
        "ece": expected_calibration_error(truth.reachable, p),
        "uncertain_percent": 100 * float(uncertain.mean()),
        "uncertain_ece": expected_calibration_error(truth.reachable[uncertain], p[uncertain]),
        "uncertain_bins": asdict(reliability(truth.reachable[uncertain], p[uncertain])),
    }


def thresholds(learned: ReachableMap, truth: MapTruth) -> list[dict[str, float]]:
    """Return what `--max-fp` is asked for (percent), and the rates found."""
    said = {fp: learned.query(truth.gaze_rad, learned.threshold(fp)).reachable for fp in _MAX_FP}
    return [{"max_fp": 100 * fp, **rates(verdict, truth.reachable)} for fp, verdict in said.items()]


def query_time(learned: ReachableMap, gaze: Array) -> dict[str, Any]:
    """Return quartiles of processor time (µs) of single queries, and the median per posture of ten batches."""

    def spent_us(postures: Array) -> float:
        begun = time.process_time_ns()
        learned.query(postures)
        return (time.process_time_ns() - begun) / 1e3 / len(postures)

    single = np.percentile([spent_us(one) for one in gaze[:_N_SINGLE, None]], (25, 50, 75))
    return {"single_us": single.tolist(), "batch_us": float(np.median([spent_us(gaze) for _ in range(10)]))}


def _over_labels(numbers: dict[str, Any]) -> Figure:
    figure, (basic, enhanced) = charts.panels(2)
    for name, rows in {"ours": numbers["ours"], **numbers["baselines"]}.items():
        je = {name: [row["je"] for row in rows]}
        charts.curves(basic, [row["labels"] for row in rows], je, "inverse-kinematics solutions", "misjudged, JE (%)")
    rmse = {"ours": [row["degree_rmse"] for row in numbers["ours"]]}
    at = [row["labels"] for row in numbers["ours"]]
    charts.curves(enhanced, at, rmse, "inverse-kinematics solutions", "RMS error of the degree R (Enhanced map)")
    basic.plot(jamone.RESULTS["labels"], jamone.RESULTS["je"], "k*", ms=10, label="J (against its own labels)")
    enhanced.plot(jamone.RESULTS["labels"], jamone.RESULTS["degree_rmse"], "k*", ms=10)
    basic.set(xscale="log", yscale="log")
    enhanced.set(xscale="log", ylim=(0, None))
    basic.legend(fontsize=8)
    return figure


def _thresholds(numbers: dict[str, Any]) -> Figure:
    figure, (strict, calibrated) = charts.panels(2)
    rows = numbers["thresholds"]
    asked = [row["max_fp"] for row in rows]
    found = {name: [row[key] for row in rows] for key, name in (("fp", "false positives"), ("fn", "false negatives"))}
    charts.curves(strict, asked, {**found, "as asked": asked}, "asked for by --max-fp (%)", "misjudged (%)")
    strict.set(xscale="log")
    strict.set_yscale("symlog", linthresh=0.01)
    strict.set_ylim(0, None)
    strict.legend(fontsize=8)
    bins = numbers["calibration"]["uncertain_bins"]
    stated, happened = (list(100 * np.array(bins[key])) for key in ("predicted", "happened"))
    charts.calibration(calibrated, stated, {"uncertain postures": happened}, "reachable (%)")
    calibrated.set(xlabel="stated probability of being reachable (%)")
    return figure
