"""How good a reachable-space map is for how many inverse-kinematics solutions (J Figs 4–9), against the true arm.

Ours asks where the border is and learns the signed distance to it.  Beside it, what one would do at first: labels
everywhere and the nearest of them, or a regular grid of labels and linearly between.  Judged by the arm in closed
form, on gaze postures and Cartesian locations that none of them saw.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from learning.reach.map import Lattice, ReachableMap, isotropic
from learning.reach.training import MapParams, ReachOracle, train_reachable_map
from pps_vision.experiments.chart import panels
from pps_vision.experiments.reach.map_test import MapTest
from pps_vision.experiments.study import Study
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array, Mask

_PAPER = {"labels": 52_000, "je": 1.3, "fn": 4.7, "fp": 0.4, "degree_rmse": 0.022}
_OURS = "ours: where the border is"
_DEFAULT_LABELS = 24_000


@dataclass(frozen=True)
class Maps(Study):
    """Basic and Enhanced map of the right arm: misjudged postures and error of the degree over the labels spent."""

    seed: int = 0
    """Seed of the labels; the postures the maps are judged on have another."""
    n_test: int = 20_000
    """Gaze postures they are judged on."""
    labels: tuple[int, ...] = (750, 1500, 3000, 6000, 12_000, 24_000, 52_000)
    """Inverse-kinematics solutions spent."""

    def run(self) -> dict[str, object]:
        """By method and labels JE, FN of the reachable, FP of the others (percent); of ours the degree's RMSE and J's
        box of locations too; of the largest probability, threshold, and what a query takes."""
        if not self.labels or min(self.labels) < 100:
            raise ValueError(f"bench reach maps: labels {self.labels}; expected one number or more, of 100 at least")
        robot = load_icub()
        test = MapTest.of(robot, self.n_test, np.random.default_rng(self.seed + 1_000_000))
        oracle = ReachOracle(robot, "right", MapParams(), np.random.default_rng(self.seed))
        rows: dict[str, list[dict[str, float]]] = {name: [] for name in (_OURS, *_PEERS)}
        for n in self.labels:
            begun = time.process_time()
            params = replace(MapParams(), n_labels=n, round_labels=min(MapParams().round_labels, n // 2))
            learned = train_reachable_map(robot, "right", np.random.default_rng(self.seed), params)
            spent = time.process_time() - begun
            rows[_OURS].append(
                {"labels": n, **test.judge(learned), "expected": 100 * learned.expected_error, "s": spent}
            )
            for name, peer in _PEERS.items():
                said, used = peer(oracle, n, np.random.default_rng(self.seed))
                rows[name].append({"labels": used, **test.verdict(said(test.gaze_rad))})
        return {
            "methods": rows,
            "paper": _PAPER,
            "calibration": test.calibration(learned),
            "thresholds": test.thresholds(learned),
            "query": _timing(learned, test.gaze_rad),
        }

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Errors over the labels spent; what a stricter threshold costs, and whether a probability is one."""
        return {"": _over_labels(numbers), "threshold": _thresholds(numbers)}


def _nearest(oracle: ReachOracle, n: int, rng: np.random.Generator) -> tuple[Callable[[Array], Mask], int]:
    """The verdict of the nearest of `n` labels everywhere."""
    limits = oracle.params.gaze_limits
    labels = oracle.label(rng.uniform(limits.lower, limits.upper, (n, 3)))
    tree = cKDTree(isotropic(labels.gaze_rad))
    return lambda gaze: labels.reachable[tree.query(isotropic(gaze))[1]], n


def _grid(oracle: ReachOracle, n: int, rng: np.random.Generator) -> tuple[Callable[[Array], Mask], int]:
    """Labels on a regular grid of about `n`, linearly between."""
    limits = oracle.params.gaze_limits
    extent = isotropic(limits.upper) - isotropic(limits.lower)
    lattice = Lattice.of_spacing(limits, float((np.prod(extent) / n) ** (1 / 3)))
    labels = oracle.label(lattice.gaze_rad)
    values = labels.reachable.astype(float)[:, None]
    return lambda gaze: lattice.interpolate(values, gaze)[:, 0] > 0.5, len(labels.gaze_rad)


_PEERS = {"nearest of labels everywhere": _nearest, "regular grid": _grid}


def _timing(learned: ReachableMap, gaze: Array) -> dict[str, float]:
    """Microseconds of processor a query, one alone (least and median) and each of a batch."""
    alone = []
    for one in gaze[:2000, None]:
        begun = time.process_time_ns()
        learned.query(one)
        alone.append((time.process_time_ns() - begun) / 1e3)
    batches = []
    for _ in range(10):
        begun = time.process_time_ns()
        learned.query(gaze)
        batches.append((time.process_time_ns() - begun) / 1e3 / len(gaze))
    return {"alone_us": float(np.median(alone)), "least_alone_us": min(alone), "in_batch_us": min(batches)}


def _over_labels(numbers: dict[str, Any]) -> Figure:
    figure, (basic, degree) = panels(2)
    paper = numbers["paper"]
    for k, (name, rows) in enumerate(numbers["methods"].items()):
        basic.plot([r["labels"] for r in rows], [r["je"] for r in rows], "o-", ms=4, color=f"C{k}", label=name)
    ours = numbers["methods"][_OURS]
    for r in ours:
        if r["labels"] == _DEFAULT_LABELS:
            basic.plot(r["labels"], r["je"], "o", ms=11, mfc="none", mec="0.2", label="default")
            degree.plot(r["labels"], r["degree_rmse"], "o", ms=11, mfc="none", mec="0.2")
    basic.plot(paper["labels"], paper["je"], "*", ms=11, color="0.2", label="J (against its own labels)")
    degree.plot([r["labels"] for r in ours], [r["degree_rmse"] for r in ours], "o-", ms=4, color="C0")
    degree.plot(paper["labels"], paper["degree_rmse"], "*", ms=11, color="0.2")
    basic.set(xscale="log", yscale="log", ylabel="misjudged gaze postures, JE (%)")
    degree.set(xscale="log", ylabel="RMS error of the degree R (Enhanced map)", ylim=(0, None))
    _labelled(basic, degree)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure


def _labelled(*axes: Axes) -> None:
    for axis in axes:
        axis.set_xlabel("inverse-kinematics solutions")
        axis.grid(alpha=0.25, which="both")


def _thresholds(numbers: dict[str, Any]) -> Figure:
    figure, (strict, calibrated) = panels(2)
    rows = numbers["thresholds"]
    asked = [r["asked_fp"] for r in rows]
    strict.plot(asked, [r["fp"] for r in rows], "o-", color="C3", label="false positives (of the unreachable)")
    strict.plot(asked, [r["fn"] for r in rows], "s-", color="C0", label="false negatives (of the reachable)")
    strict.plot(asked, asked, "--", color="0.4", lw=1, label="as asked")
    strict.set(xscale="log", yscale="symlog", xlabel="asked by --max-fp (%)", ylabel="misjudged (%)")
    strict.set_yscale("symlog", linthresh=0.01)
    strict.set_ylim(0, None)
    strict.legend(fontsize=8)
    strict.grid(alpha=0.25)
    reliable = numbers["calibration"]["reliability"]
    calibrated.plot([0, 1], [0, 1], "--", color="0.4", lw=1)
    calibrated.scatter(reliable["predicted"], reliable["happened"], s=np.sqrt(reliable["n"]) * 8, color="C0")
    calibrated.set(xlabel="probability of being reachable", ylabel="share that is", xlim=(0, 1), ylim=(0, 1))
    calibrated.set_title("postures that are not plain; area: how many", fontsize=9)
    calibrated.grid(alpha=0.25)
    return figure
