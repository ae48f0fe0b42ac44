"""Predicted touches of a real robot: the authors' 37 trials on four taxels 2–3 cm apart.

The trials follow each other in time, and what is tested is left out in blocks of consecutive trials.  Leaving out
single trials would lower each taxel's rate of touch exactly where it is touched, which forces the base rate's AUROC
within a taxel to 0.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from learning.pps.contact import ContactPrediction, learn_contact, predict_contact, predict_session
from learning.pps.scores import auroc, brier, brier_gain
from learning.pps.trials import Trial, load_trials
from pps_vision.experiments import charts
from pps_vision.experiments.pps.perceived import HORIZON_S
from pps_vision.experiments.pps.predictors import (
    Predictor,
    by_authors_map,
    by_base_rate,
    by_displacement,
    by_displacement_along_skin,
    by_displacement_of_session,
    in_blocks,
    outcomes,
    score_interval,
    take,
)
from pps_vision.experiments.study import DATA, SeededStudy, interval
from pps_vision.experiments.tables import Table, estimate
from pps_vision.types import Array

HORIZONS_S = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5)
OFFSETS_M = (0.0, 0.01, 0.02)
BLOCKS = 4
GROUPS = (0.05, 0.2, 0.5, 0.8)
OURS = "displacement (ours)"
METHODS: dict[str, Predictor] = {
    "base rate": by_base_rate,
    "R's map, authors' code, averaged": by_authors_map,
    "displacement along the skin": by_displacement_along_skin,
    OURS: by_displacement,
    "displacement, as another session": by_displacement_of_session,
}
Predict = Callable[[float, Any, tuple[Trial, ...]], ContactPrediction]
OTHER_SESSION: dict[str, Predict] = {
    "offset ignored": predict_contact,
    "offset learned from the paths": predict_session,
}


@dataclass(frozen=True)
class RealTrials(SeededStudy):
    """Touches predicted 0.15 s ahead on the authors' real trials, beside R's map and the base rate."""

    SHORT: ClassVar[Mapping[str, Any]] = {"permutations": 1}

    data: Path = DATA
    """Folder of pps_real_robot (default: PPS_VISION_DATA, else ../shared/data)."""
    permutations: int = 100
    """Times that the outcomes are dealt to other trials."""

    def run(self) -> dict[str, Any]:
        """Return the scores; only "skipped" without the data."""
        path = self.data / "pps_real_robot" / "trials_forearm_internal.npz"
        if not path.exists():
            return {"skipped": f"no {path}"}
        trials = load_trials(path)
        rng = np.random.default_rng(self.seed)
        every = np.arange(len(trials))
        third = [(np.setdiff1d(every, test), test) for test in np.array_split(every, 3)]
        return {
            "n": len(trials),
            "touched": outcomes(trials).sum(axis=0).tolist(),
            "evidence": 1 - float(learn_contact(HORIZON_S, trials).weights[0]),
            "methods": {name: _scores(method, trials) for name, method in METHODS.items()},
            "horizons": {
                name: [brier(outcomes(trials), in_blocks(method, trials, h, BLOCKS)) for h in HORIZONS_S]
                for name, method in METHODS.items()
            },
            "grouped": _grouped(trials),
            "other_session": {name: displaced(predict, trials, third) for name, predict in OTHER_SESSION.items()},
            "permuted": _permuted(trials, self.permutations, rng),
        }

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw the gain on the base rate, Brier scores by horizon, and intervals beside frequencies; nothing without
        data."""
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
        grouped, (axis,) = charts.panels(1, width=5.2)
        stated = [100 * group["stated"] for group in numbers["grouped"]]
        charts.calibration(axis, stated, {"touched": [group["touched_percent"] for group in numbers["grouped"]]}, "")
        for at, group in zip(stated, numbers["grouped"], strict=True):
            axis.plot([at, at], [100 * x for x in group["interval"]], lw=8, alpha=0.2, color="C1", zorder=0)
        axis.set_ylabel("touched (%), 95 %; band: mean 90 % interval")
        return {"methods": methods, "horizon": horizon, "grouped": grouped}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the scores by method, and of ours on another session."""
        if "skipped" in numbers:
            return {}
        splits = [(split, key) for split in _SPLITS for key in ("auroc", "brier", "gain")]
        rows = [[m, *(estimate(of[split][key]) for split, key in splits)] for m, of in numbers["methods"].items()]
        names = {"auroc": "AUROC", "brier": "Brier score", "gain": "below the base rate's"}
        ours = Table(["", *(f"{names[key]}, {_SPLITS[split]}" for split, key in splits)], rows)
        keys = ("auroc", "brier", "base_rate_brier")
        rows = []
        for name in OTHER_SESSION:
            for of in numbers["other_session"][name]:
                rows.append([f"displaced by {1000 * of['offset_m']:g} mm, {name}", *(f"{of[key]:.3g}" for key in keys)])
        other = Table(["test session, method", "AUROC", "Brier score", "base rate's"], rows)
        return {"": ours, "other_session": other}


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


def _grouped(trials: tuple[Trial, ...]) -> list[dict[str, Any]]:
    """Predictions by quarters of the session in groups of like probability: the mean stated, the mean interval, and the
    share touched with its 95 % interval by resampling trials."""
    parts, every = np.array_split(np.arange(len(trials)), BLOCKS), np.arange(len(trials))
    models = [learn_contact(HORIZON_S, take(trials, np.setdiff1d(every, part))) for part in parts]
    blocks = [predict_contact(HORIZON_S, of, take(trials, part)) for of, part in zip(models, parts, strict=True)]
    p, low, high = (np.concatenate([getattr(b, name) for b in blocks]) for name in ("probability", "lower", "upper"))
    group, touched, found = np.digitize(p, GROUPS), outcomes(trials), []
    for g in range(len(GROUPS) + 1):
        held = group == g
        if held.any():
            share = interval([100.0 * now[inside] for now, inside in zip(touched, held, strict=True)])
            ends = [float(low[held].mean()), float(high[held].mean())]
            n = int(held.sum())
            found.append({"n": n, "stated": float(p[held].mean()), "interval": ends, "touched_percent": share})
    return found


def displaced(
    predict: Predict, trials: tuple[Trial, ...], splits: Sequence[tuple[NDArray[np.intp], NDArray[np.intp]]]
) -> list[dict[str, float]]:
    """Return scores on test trials displaced as by another calibration, means over splits and six directions."""
    found = []
    models = [learn_contact(HORIZON_S, take(trials, train)) for train, _ in splits]
    for offset_m in OFFSETS_M:
        rows = []
        for shift in offset_m * np.concatenate([np.eye(3), -np.eye(3)]):
            for (train, test), learned in zip(splits, models, strict=True):
                moved = tuple(replace(trial, d_m=trial.d_m + shift) for trial in take(trials, test))
                touched, p = outcomes(moved), predict(HORIZON_S, learned, moved).probability
                base_rate = by_base_rate(take(trials, train), moved, HORIZON_S)
                rows.append((auroc(touched, p), brier(touched, p), brier(touched, base_rate)))
        means = map(float, np.mean(rows, axis=0))
        found.append({"offset_m": offset_m} | dict(zip(("auroc", "brier", "base_rate_brier"), means, strict=True)))
    return found


def _permuted(trials: tuple[Trial, ...], n: int, rng: np.random.Generator) -> dict[str, float]:
    """Mean scores by quarters with outcomes dealt to other trials: what chance gives, beside the base rate's."""
    rows = []
    for _ in range(n):
        touched = outcomes(trials)[rng.permutation(len(trials))]
        dealt = tuple(replace(trial, touched=now) for trial, now in zip(trials, touched, strict=True))
        p, base = (in_blocks(METHODS[m], dealt, HORIZON_S, BLOCKS) for m in (OURS, "base rate"))
        rows.append((auroc(touched, p), brier(touched, p), brier(touched, base)))
    return dict(zip(("auroc", "brier", "base_rate_brier"), map(float, np.mean(rows, axis=0)), strict=True))
