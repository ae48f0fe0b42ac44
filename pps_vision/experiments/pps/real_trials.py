"""Predicted touches of a real robot: the authors' 37 trials on four taxels 2–3 cm apart.

The trials follow each other in time, and what is tested is left out in blocks of consecutive trials.  Leaving out
single trials would lower each taxel's rate of touch exactly where it is touched, which forces the base rate's AUROC
within a taxel to 0.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from pps_vision.experiments import charts
from pps_vision.experiments.pps.perceived import HORIZON_S
from pps_vision.experiments.pps.predictors import (
    Predictor,
    by_authors_map,
    by_base_rate,
    by_shrunk_map,
    in_blocks,
    outcomes,
    score_interval,
)
from pps_vision.experiments.pps.scores import auroc, brier, brier_gain
from pps_vision.experiments.pps.taxel_trials import Trial, load_trials
from pps_vision.experiments.study import DATA, SeededStudy, interval
from pps_vision.experiments.tables import Table, estimate
from pps_vision.types import Array

HORIZONS_S = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5)
BLOCKS = 4
METHODS: dict[str, Predictor] = {
    "base rate": by_base_rate,
    "R's map, authors' code, averaged": by_authors_map,
    "R's map, shrunk to the base rate": by_shrunk_map,
}


@dataclass(frozen=True)
class RealTrials(SeededStudy):
    """Touches predicted 0.15 s ahead on the authors' real trials, beside R's map and the base rate."""

    data: Path = DATA
    """Folder of pps_real_robot (default: PPS_VISION_DATA, else ../shared/data)."""

    def run(self) -> dict[str, Any]:
        """Return the scores; only "skipped" without the data."""
        path = self.data / "pps_real_robot" / "trials_forearm_internal.npz"
        if not path.exists():
            return {"skipped": f"no {path}"}
        trials = load_trials(path)
        return {
            "n": len(trials),
            "touched": outcomes(trials).sum(axis=0).tolist(),
            "methods": {name: _scores(method, trials) for name, method in METHODS.items()},
            "horizons": {
                name: [brier(outcomes(trials), in_blocks(method, trials, h, BLOCKS)) for h in HORIZONS_S]
                for name, method in METHODS.items()
            },
        }

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw the gain on the base rate and Brier scores by horizon; nothing without data."""
        if "skipped" in numbers:
            return {}
        methods, (axis,) = charts.panels(1, width=6.4)
        of = numbers["methods"]
        others = [m for m in of if m != "base rate"]
        series = {label: [of[m][key]["gain"] for m in others] for key, label in _SPLITS.items()}
        charts.bars(axis, others, series, "Brier score below the base rate's")
        axis.legend(fontsize=8)
        horizon, (axis,) = charts.panels(1, width=5.6)
        charts.curves(axis, HORIZONS_S, numbers["horizons"], "known until (s before the touch)", "Brier score")
        axis.legend(fontsize=8)
        return {"methods": methods, "horizon": horizon}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the scores by method."""
        if "skipped" in numbers:
            return {}
        splits = [(split, key) for split in _SPLITS for key in ("auroc", "brier", "gain")]
        rows = [[m, *(estimate(of[split][key]) for split, key in splits)] for m, of in numbers["methods"].items()]
        names = {"auroc": "AUROC", "brier": "Brier score", "gain": "below the base rate's"}
        return {"": Table(["", *(f"{names[key]}, {_SPLITS[split]}" for split, key in splits)], rows)}


_SPLITS = {"blocked": "quarters", "early_late": "first 24 → last 13"}


def _scores(method: Predictor, trials: tuple[Trial, ...]) -> dict[str, Any]:
    """AUROC, Brier score and its gain on the base rate, by quarters of the session and from its first two thirds."""
    early = round(len(trials) * 24 / 37)
    first, last = trials[:early], trials[early:]
    splits: dict[str, tuple[tuple[Trial, ...], Callable[[Predictor], Array]]] = {
        "blocked": (trials, lambda m: in_blocks(m, trials, HORIZON_S, BLOCKS)),
        "early_late": (last, lambda m: m(first, last, HORIZON_S)),
    }
    found = {}
    for name, (test, predict) in splits.items():
        touched, p, base = outcomes(test), predict(method), predict(by_base_rate)
        found[name] = {
            "auroc": score_interval(auroc, touched, p),
            "brier": interval(list((p - touched) ** 2)),
            "gain": list(brier_gain(touched, p, base)),
        }
    return found
