"""Predicted touches of a real robot: the authors' 37 trials on four taxels 2–3 cm apart.

Part of our method was chosen on these trials. One of some 60 variants compared on simulated sessions was fixed before
looking at an outcome (AUROC 0.903–0.907, Brier score 0.113–0.114 leaving one out). Some 200 looks followed, most of
them between 0.108 and 0.118. What they gained need not hold on other trials.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from learning.pps.contact import ContactParams, ContactPrediction, learn_contact, predict_contact, predict_session
from learning.pps.scores import auroc, brier
from learning.pps.trials import Trial, load_trials
from pps_vision.experiments import charts
from pps_vision.experiments.pps.perceived import HORIZON_S
from pps_vision.experiments.pps.predictors import (
    Predictor,
    by_authors_map,
    by_base_rate,
    by_displacement,
    by_displacement_along_skin,
    in_blocks,
    outcomes,
)
from pps_vision.experiments.study import DATA, SeededStudy, interval
from pps_vision.experiments.tables import Table, estimate
from pps_vision.types import Array, Mask

HORIZONS_S = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5)
OFFSETS_M = (0.0, 0.01, 0.02)
BLOCKS = 4
OURS = "displacement (ours)"
METHODS: dict[str, Predictor] = {
    "base rate": by_base_rate,
    "R's map": by_authors_map,
    "displacement along the skin": by_displacement_along_skin,
    OURS: by_displacement,
}
Predict = Callable[[ContactParams, Any, tuple[Trial, ...]], ContactPrediction]
OTHER_SESSION: dict[str, Predict] = {
    "offset ignored": predict_contact,
    "offset learned from the paths": predict_session,
}


@dataclass(frozen=True)
class RealTrials(SeededStudy):
    """Touches predicted 0.15 s ahead on the authors' real trials, beside R's map and the base rate."""

    data: Path = DATA
    """Folder of pps_real_robot (default: PPS_VISION_DATA, else ../shared/data)."""
    splits: int = 60
    """Random splits in two thirds to train on and one third to test on."""
    permutations: int = 200
    """Times that the outcomes are dealt to other trials."""

    def run(self) -> dict[str, Any]:
        """Return the scores; only "skipped" without the data."""
        path = self.data / "pps_real_robot" / "trials_forearm_internal.npz"
        if not path.exists():
            return {"skipped": f"no {path}"}
        trials = load_trials(path)
        touched = outcomes(trials)
        rng = np.random.default_rng(self.seed)
        splits = [np.split(rng.permutation(len(trials)), [round(len(trials) * 2 / 3)]) for _ in range(self.splits)]
        return {
            "trials": len(trials),
            "touched": touched.sum(axis=0).tolist(),
            "methods": {name: self._scores(method, trials) for name, method in METHODS.items()},
            "horizons": {
                name: [brier(touched, in_blocks(method, trials, h)) for h in HORIZONS_S]
                for name, method in METHODS.items()
            },
            "other_session": {name: displaced(predict, trials, splits) for name, predict in OTHER_SESSION.items()},
            "permuted": _permuted(trials, self.permutations, rng),
        }

    def _scores(self, method: Predictor, trials: tuple[Trial, ...]) -> dict[str, Any]:
        """AUROC and Brier score leaving one out and by blocks of time, and the Brier score's gain on the base rate."""
        touched, found = outcomes(trials), {}
        for name, blocks in (("leave_one_out", len(trials)), ("blocked", BLOCKS)):
            p, base = (in_blocks(m, trials, HORIZON_S, blocks) for m in (method, METHODS["base rate"]))
            gain = (base - touched) ** 2 - (p - touched) ** 2
            found[name] = {
                "auroc": _interval_of(touched, p),
                "brier": interval(list((p - touched) ** 2)),
                "gain": interval(list(gain)),
            }
        return found

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw the gain on the base rate and Brier scores by horizon; nothing without data."""
        if "skipped" in numbers:
            return {}
        methods, (axis,) = charts.panels(1, width=6.4)
        of = numbers["methods"]
        others = [m for m in METHODS if m != "base rate"]
        series = {label: [of[m][key]["gain"] for m in others] for key, label in _SPLITS.items()}
        charts.bars(axis, others, series, "Brier score below the base rate's")
        axis.legend(fontsize=8)
        horizon, (axis,) = charts.panels(1, width=5.6)
        charts.curves(axis, HORIZONS_S, numbers["horizons"], "known until (s before the touch)", "Brier score")
        axis.legend(fontsize=8)
        return {"methods": methods, "horizon": horizon}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the scores by method, and of ours on another session."""
        if "skipped" in numbers:
            return {}
        splits = [(split, key) for split in _SPLITS for key in ("auroc", "brier")]
        rows = [[m, *(estimate(of[split][key]) for split, key in splits)] for m, of in numbers["methods"].items()]
        names = {"auroc": "AUROC", "brier": "Brier score"}
        ours = Table(["", *(f"{names[key]}, {_SPLITS[split]}" for split, key in splits)], rows)
        keys = ("auroc", "brier", "base_rate_brier")
        rows = []
        for name in OTHER_SESSION:
            for of in numbers["other_session"][name]:
                rows.append([f"displaced by {1000 * of['offset_m']:g} mm, {name}", *(f"{of[key]:.3g}" for key in keys)])
        other = Table(["test session, method", "AUROC", "Brier score", "base rate's"], rows)
        return {"": ours, "other_session": other}


_SPLITS = {"leave_one_out": "leaving one out", "blocked": "by quarters of the session"}


def _interval_of(touched: Mask, p: Array) -> list[float]:
    """AUROC with 95 % by resampling trials."""
    units = np.stack([touched, p], axis=-1)
    return interval(list(units), lambda rows: auroc(rows[:, 0], rows[:, 1]))


def displaced(
    predict: Predict, trials: tuple[Trial, ...], splits: Sequence[list[NDArray[np.intp]]]
) -> list[dict[str, float]]:
    """Return scores on test trials displaced as by another calibration, means over splits and six directions."""
    found, params = [], ContactParams(horizon_s=HORIZON_S)
    for offset_m in OFFSETS_M:
        rows = []
        for shift in offset_m * np.concatenate([np.eye(3), -np.eye(3)]):
            for train, test in splits:
                training = tuple(trials[i] for i in train)
                moved = tuple(replace(trials[i], d_m=trials[i].d_m + shift) for i in test)
                touched, p = outcomes(moved), predict(params, learn_contact(params, training), moved).probability
                base_rate = by_base_rate(training, moved, HORIZON_S)
                rows.append((auroc(touched, p), brier(touched, p), brier(touched, base_rate)))
        means = map(float, np.mean(rows, axis=0))
        found.append({"offset_m": offset_m} | dict(zip(("auroc", "brier", "base_rate_brier"), means, strict=True)))
    return found


def _permuted(trials: tuple[Trial, ...], n: int, rng: np.random.Generator) -> dict[str, float]:
    """Mean scores leaving one out with outcomes dealt to other trials: what chance gives."""
    rows = []
    for _ in range(n):
        touched = outcomes(trials)[rng.permutation(len(trials))]
        dealt = tuple(replace(trial, touched=now) for trial, now in zip(trials, touched, strict=True))
        p = in_blocks(METHODS[OURS], dealt, HORIZON_S)
        rows.append((auroc(touched, p), brier(touched, p)))
    return {"auroc": float(np.mean([a for a, _ in rows])), "brier": float(np.mean([b for _, b in rows]))}
