"""The authors' published counts, counted again from their released paths."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learning.pps.memory import MemoryParams, count_samples
from learning.pps.receptive_field import ReceptiveField, distance_and_ttc
from learning.pps.trials import load_trials
from pps_vision.experiments.baselines.single_taxel import empty_map, from_landing
from pps_vision.experiments.study import DATA, Study
from pps_vision.experiments.tables import Table
from pps_vision.types import Array, Mask

Counts = NDArray[np.int64]
Path3D = tuple[Array, Array, Mask]
"""Displacements and velocities (T, n, 3) in the taxels' frames, and what was touched (n,)."""

FIG9_TRIALS = {1: (17,), 4: (14, 15, 16, 17)}
"""Trials behind Fig 9, found by comparing every trial and every four in a row with the published counts."""
_UP = np.array([0.0, 0.0, 1.0])
_NO_CONE = ReceptiveField(base_radius_m=10.0, length_m=10.0)  # the authors' counts know no cone


@dataclass(frozen=True)
class AuthorsCounts(Study):
    """Counts of R's Monte Carlo and of its Fig 9, from the released paths, against the published counts.

    D and TTC are measured from the path's last sample or from the taxel. The difference is L1, in percent.
    """

    data: Path = DATA
    """Folder of pps_real_robot (default: PPS_VISION_DATA, else ../shared/data)."""

    def run(self) -> dict[str, Any]:
        """Return the differences; only "skipped" without the data."""
        folder = self.data / "pps_real_robot"
        if not folder.exists():
            return {"skipped": f"no {folder}"}
        return {"monte_carlo": monte_carlo(folder), "fig9": fig9(folder)}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the differences."""
        keys = ("l1_percent", "only_ours", "only_theirs", "samples")
        measured = {name: numbers[name] for name in ("monte_carlo", "fig9") if name in numbers}
        rows = [
            [f"{name}, from {point}", *(f"{of[key]:g}" for key in keys)]
            for name, points in measured.items()
            for point, of in points.items()
        ]
        return {"": Table(["counts", "L1 difference (%)", "only ours", "only the authors'", "samples"], rows)}


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
