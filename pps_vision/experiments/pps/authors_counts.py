"""The authors' published counts, counted again from their released paths, and the offsets that they read from them."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learning.pps.memory import MemoryParams, count_samples
from learning.pps.receptive_field import ReceptiveField, distance_and_ttc
from pps_vision.experiments.baselines.single_taxel import empty_map, from_landing
from pps_vision.experiments.pps.taxel_offsets import orthogonal_line
from pps_vision.experiments.pps.taxel_trials import load_trials
from pps_vision.experiments.study import DATA, Study
from pps_vision.experiments.tables import Table
from pps_vision.types import Array, Mask

Counts = NDArray[np.int64]
Path3D = tuple[Array, Array, Mask]
"""Displacements and velocities (T, n, 3) in the taxels' frames, and what was touched (n,)."""

FIG9_TRIALS = {1: (17,), 4: (14, 15, 16, 17)}
"""Trials behind Fig 9, found by comparing every trial and every four in a row with the published counts."""
PAPER_CM = {"inner forearm": 2.11, "outer forearm": 1.73, "palm": 1.16}
"""R Fig 8: mean offsets by body part, in the order of the released file's `part`."""
_FIG3_OFFSET_M = -0.10
_FIG3_AXIS_M = (0.10, np.inf)  # greatest distances of a sample from the normal through the path's end
_UP = np.array([0.0, 0.0, 1.0])
_NO_CONE = ReceptiveField(base_radius_m=10.0, length_m=10.0)  # the authors' counts know no cone


@dataclass(frozen=True)
class AuthorsCounts(Study):
    """Counts of R's Monte Carlos (Figs 2, 3) and of its Fig 9, from the released paths, against the published counts.

    D and TTC are measured from the path's last sample or from the taxel. The difference is L1, in percent. Offsets of
    R Fig 8 from the released counts and landscapes.
    """

    data: Path = DATA
    """Folder of pps_real_robot (default: PPS_VISION_DATA, else ../shared/data)."""

    def run(self) -> dict[str, Any]:
        """Return the differences; only "skipped" without the data."""
        folder = self.data / "pps_real_robot"
        if not folder.exists():
            return {"skipped": f"no {folder}"}
        return {
            "monte_carlo": monte_carlo(folder),
            "fig3": fig3(folder),
            "fig9": fig9(folder),
            "ridge_cm": ridge_cm(folder),
            "fig8": fig8(folder),
        }

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the differences."""
        keys = ("l1_percent", "only_ours", "only_theirs", "samples")
        measured = {name: numbers[name] for name in ("monte_carlo", "fig3", "fig9") if name in numbers}
        rows = [
            [f"{name}, from {point}", *(f"{of[key]:g}" for key in keys)]
            for name, points in measured.items()
            for point, of in points.items()
        ]
        header = ["counts", "L1 difference (%)", "only ours", "only the authors'", "samples"]
        fig8_rows = [
            [weights, *(f"{mean:.2f}" for mean in of["means_cm"]), f"{of['largest_error_mm']:.2f}"]
            for weights, of in numbers.get("fig8", {}).items()
        ]
        parts = [f"{part}, R {paper} cm" for part, paper in PAPER_CM.items()]
        return {
            "": Table(header, rows),
            "fig8": Table(["weights, bins at", *parts, "largest error of ten taxels (mm)"], fig8_rows),
        }


def monte_carlo(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the differences for the Monte Carlo (500 objects)."""
    with np.load(folder / "monte_carlo_500_events.npz") as file:
        data = dict(file)
    theirs = np.stack([data["positive_counts"], data["negative_counts"]], axis=-1).astype(np.int64)
    spans = zip(data["offsets"][:-1], data["offsets"][1:], strict=True)
    paths = [(data["position_m"][a:b, None], data["velocity_m_s"][a:b, None]) for a, b in spans]
    # a second taxel, touched when the first is not, makes the misses count as the first's negative samples
    pairs = [
        (np.repeat(d, 2, 1), np.repeat(v, 2, 1), np.array([hit, not hit]))
        for (d, v), hit in zip(paths, data["outcome"] > 0, strict=True)
    ]
    return {
        "the last sample": _compare(_counts((_from_last(*p) for p in pairs), 2, 3.0)[0], theirs),
        "the taxel": _compare(_counts((_from_taxel(*p) for p in pairs), 2, 3.0)[0], theirs),
    }


def fig3(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the differences for the noisy Monte Carlo behind R Fig 3.

    D and TTC (R eqs 1–2) are both measured from a point 10 cm above the path's end along the normal.
    """
    with np.load(folder / "monte_carlo_500_noisy_events.npz") as file:
        data = dict(file)
    theirs = np.stack([data["positive_counts"], data["negative_counts"]], axis=-1).astype(np.int64)
    p, v, starts = data["position_m"].astype(float), data["velocity_m_s"].astype(float), data["offsets"]
    event = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    from_end = p - p[starts[1:] - 1][event]
    d = from_end + _FIG3_OFFSET_M * _UP
    D, TTC, _ = _from_taxel(d[:, None], v[:, None], np.ones(1, bool))
    aside, found = np.linalg.norm(from_end[:, :2], axis=1), {}
    for most in _FIG3_AXIS_M:
        signs = []
        for hit in (True, False):
            used = (aside < most) & ((data["outcome"] > 0)[event] == hit)
            memory = count_samples(empty_map(1, MemoryParams()), D[used], TTC[used], np.ones(1, bool))
            signs.append(memory.counts[0, ..., 0])
        label = "the last sample, shifted by 10 cm" + (
            "" if np.isinf(most) else f", within {100 * most:g} cm of its normal"
        )
        found[label] = _compare(np.stack(signs, axis=-1).astype(np.int64), theirs)
    return found


def ridge_cm(folder: Path) -> dict[str, float]:
    """Return where the regression line through the noisy Monte Carlo's published counts crosses TTC = 0."""
    with np.load(folder / "monte_carlo_500_noisy_events.npz") as file:
        positive, negative = file["positive_counts"], file["negative_counts"]
    weights = {"positive counts": positive, "f": positive / np.maximum(positive + negative, 1)}
    bins = {"bin centres": _bins(True), "spread over the ranges": _bins(False)}
    return {
        f"{name}, {where}": 100 * _crossing(w, *axes) for name, w in weights.items() for where, axes in bins.items()
    }


def fig8(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the offsets of ten taxels (R Fig 8) by what the bins weigh and where they lie, against the stated ones.

    The authors spread the bins over the ranges (first bin at the lower end, last one at the upper), TTC to 3 s.
    """
    with np.load(folder / "systematic_offsets.npz") as file:
        data = dict(file)
    edited, counts = data["edited_landscape"], data["positive_counts"]
    weighted = {
        "edited landscape, spread over the ranges (R)": (edited, _bins(False)),
        "edited landscape, bin centres": (edited, _bins(True)),
        "positive counts, spread over the ranges": (counts, _bins(False)),
        "positive counts, bin centres": (counts, _bins(True)),
    }
    found = {}
    for name, (weights, (distance, ttc)) in weighted.items():
        offset = np.array([_crossing(w, distance, ttc) for w in weights])
        found[name] = {
            "means_cm": [100 * float(offset[data["part"] == part].mean()) for part in range(len(PAPER_CM))],
            "largest_error_mm": 1000 * float(np.abs(offset - data["offset_m"]).max()),
        }
    return found


def _bins(centres: bool) -> tuple[Array, Array]:
    """D (8,) m and TTC (4,) s of the paper's bins: their centres, or as many points from end to end of the ranges."""
    (d0, d1), (t0, t1) = MemoryParams().distance_range_m, MemoryParams().ttc_range_s
    if not centres:
        return np.linspace(d0, d1, 8), np.linspace(t0, t1, 4)
    return d0 + (np.arange(8) + 0.5) * (d1 - d0) / 8, t0 + (np.arange(4) + 0.5) * (t1 - t0) / 4


def _crossing(weights: Array, distance: Array, ttc: Array) -> float:
    """Where the line crosses TTC = 0, m; NaN without a line."""
    line = orthogonal_line(*np.meshgrid(distance, ttc, indexing="ij"), weights)
    return np.nan if line is None else line.offset


def fig9(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the differences for the maps after 1 and 4 trials."""
    with np.load(folder / "histograms_after_1_and_4_trials.npz") as file:
        named = [[file[f"E{n}_{sign}"] for sign in ("positive", "negative")] for n in FIG9_TRIALS]
    theirs = np.array(named).astype(np.int64).transpose(0, *range(2, np.ndim(named)), 1)
    trials = load_trials(folder / "trials_forearm_internal.npz")
    paths = [(trial.d_m, trial.v_m_s, trial.touched) for trial in trials]
    points = {"the last sample": _from_last, "the taxel": _from_taxel}
    return {
        point: _compare(np.stack([_counts((of(*paths[t]) for t in ts), 4, 1.2) for ts in FIG9_TRIALS.values()]), theirs)
        for point, of in points.items()
    }


def _compare(ours: Counts, theirs: Counts) -> dict[str, Any]:
    more, fewer = int(np.maximum(ours - theirs, 0).sum()), int(np.maximum(theirs - ours, 0).sum())
    percent = round(100 * (more + fewer) / float(theirs.sum()), 3)
    return {"l1_percent": percent, "only_ours": more, "only_theirs": fewer, "samples": int(theirs.sum())}


def _counts(perceived: Iterable[Path3D], n: int, ttc_max_s: float) -> Counts:
    """Counts (n, 8, 4, 2) of D and TTC (T, n) on a body part of n taxels."""
    memory = empty_map(n, MemoryParams(ttc_range_s=(0.0, ttc_max_s)))
    for D, TTC, touched in perceived:
        memory = count_samples(memory, D, TTC, touched)
    return memory.counts.astype(np.int64)


def _from_last(d: Array, v: Array, touched: Mask) -> Path3D:
    return (*from_landing(d, v), touched)


def _from_taxel(d: Array, v: Array, touched: Mask) -> Path3D:
    return (*distance_and_ttc(_NO_CONE, d, _UP, v), touched)
