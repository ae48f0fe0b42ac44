"""Touches of a real robot predicted: how well, how far ahead, and how much of it the choices made.

The data are the authors' 37 trials on four taxels 2–3 cm apart.  How the method was fixed, since few trials forgive
few choices:

1. On simulated sessions, before any outcome was looked at, about 60 variants of base rate, kernel, logistic, geometric
   and Gaussian models: a Gaussian one, `prior_trials` 5, `toward` a quarter or a half, half a touch and half a miss.
   It took the last position along the skin, extrapolated by half.  Left out one at a time, this first look gave AUROC
   0.903–0.907, Brier 0.1133–0.1135.
2. Then some 200 more looks: 1 to 25 samples averaged, extrapolated, medians, weights that fade, raw positions (0.17 s
   fresher) or the released ones, two coordinates or three, one frame or each taxel's own, outlier bounds, classes of
   taxels touched together.  Most lie between 0.108 and 0.118.  Released positions, three coordinates and each taxel's
   own frame were kept: they are what a file holds, and they were the better ones.  What they gain (0.113 to 0.108) was
   seen on these trials and may not all be found on others.
3. `offset_m`: 5 mm would be best here; 8 to 12 mm are best on simulated sessions whose offsets differ by a centimetre
   (`choices`), and 12 stands displaced trials better (`another_offset`).

`nested` says what choosing by such few trials costs, `permuted` what chance gives.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.pps.contact import (
    ContactParams,
    ContactPrediction,
    learn_contact,
    leave_one_out,
    predict_contact,
    predict_session,
)
from learning.pps.scores import auroc, brier, expected_calibration_error, log_loss, reliability
from learning.pps.trials import Trial, load_trials, touch_rates
from pps_vision.experiments.pps.real_trials_chart import draw
from pps_vision.experiments.pps.simulated_sessions import two_sessions
from pps_vision.experiments.pps.trial_methods import METHODS, OURS, Method, Numbers, Plain, Predictor
from pps_vision.experiments.study import DATA, Study
from pps_vision.types import Array, Mask

HORIZON_S = 0.15
HORIZONS_S = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5)  # 0.15 is 0.2 on samples 0.1 s apart
FOLLOWED = ("base rate", "R's map, all samples", OURS)  # over the horizons
CHOICES: dict[str, tuple[float, ...]] = {
    "samples": (1, 2, 3, 5, 8, 12),
    "toward": (0.0, 0.25, 0.5, 0.75, 1.0),
    "prior_trials": (1.0, 2.0, 5.0, 10.0, 20.0),
    "offset_m": (0.002, 0.005, 0.008, 0.012, 0.016, 0.02),
}
NESTED: dict[str, tuple[float, ...]] = {
    "samples": (1, 3, 5, 8),
    "toward": (0.0, 0.5),
    "offset_m": (0.005, 0.008, 0.012, 0.016),
}
OFFSETS_M = (0.0, 0.005, 0.01, 0.015, 0.02)


@dataclass(frozen=True)
class RealTrials(Study):
    """Touch predicted on the authors' real trials, each left out in turn, beside other ways and choices."""

    data: Path = DATA
    """Folder that holds pps_real_robot (default: PPS_VISION_DATA, else ../shared/data)."""
    seed: int = 0
    """Seed of resampling, splits and permutations."""
    splits: int = 200
    """Times the trials are split in two thirds to learn from and one third to predict."""
    resamples: int = 1000
    """Bootstrap samples of trials behind each 95 % interval."""
    permutations: int = 200
    """Times the outcomes are dealt to other trials."""
    pairs: int = 60
    """Pairs of simulated sessions on which the choices are compared too."""

    def run(self) -> dict[str, Any]:
        """Scores by method, horizon and choice; only `skipped` where there are no data."""
        path = self.data / "pps_real_robot" / "trials_forearm_internal.npz"
        if not path.exists():
            return {"skipped": f"no {path}"}
        trials = load_trials(path)
        touched = np.array([trial.touched for trial in trials])
        rng = np.random.default_rng(self.seed)
        splits = [np.split(rng.permutation(len(trials)), [round(len(trials) * 2 / 3)]) for _ in range(self.splits)]
        resamples = rng.integers(0, len(trials), (self.resamples, len(trials)))
        base = left_out(METHODS["base rate"], trials)
        predicted = {name: left_out(method, trials) for name, method in METHODS.items()}
        ours = predicted[OURS]
        diagram = reliability(touched, ours, 5)
        return {
            "seed": self.seed,
            "horizon_s": HORIZON_S,
            "trials": len(trials),
            "touched": touched.sum(axis=0).tolist(),
            "methods": {
                name: _scores(touched, p) | _intervals(touched, p, base, resamples) for name, p in predicted.items()
            },
            "another_session": {name: _split_scores(method, trials, splits) for name, method in METHODS.items()},
            "in_quarters": {name: _in_quarters(METHODS[name], trials) for name in ("base rate", OURS)},
            "another_offset": {
                name: _another_offset(how, trials, splits[:60]) for name, how in _OF_ANOTHER_SESSION.items()
            },
            "simulated_sessions": {
                name: _simulated(changed(), _pairs(self.pairs, self.seed), how)
                for name, how in _OF_ANOTHER_SESSION.items()
            },
            "choices": _our_choices(trials, self.pairs, self.seed),
            "choices_of_the_map": _map_choices(trials),
            "nested": _nested(trials, splits[:60]),
            "permuted": _permuted(trials, self.permutations, rng),
            "horizons": {
                name: [{"horizon_s": h} | _scores(touched, left_out(METHODS[name], trials, h)) for h in HORIZONS_S]
                for name in FOLLOWED
            },
            "calibration": {
                "error": expected_calibration_error(touched, ours, 5),
                "base_rate_error": expected_calibration_error(touched, base, 5),
                "predicted": diagram.predicted.tolist(),
                "happened": diagram.happened.tolist(),
                "n": diagram.n.tolist(),
            },
        }

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Methods, horizons, choices and the reliability diagram; nothing where there were no data."""
        return {} if "skipped" in numbers else draw(numbers)


def left_out(method: Method, trials: tuple[Trial, ...], horizon_s: float = HORIZON_S) -> Array:
    """(trials, taxels) probabilities, each trial predicted from all others."""
    predict, numbers = method(trials, horizon_s), np.arange(len(trials))
    return np.concatenate([predict(numbers[numbers != i], numbers[numbers == i]) for i in numbers])


def _scores(touched: Mask, p: Array) -> dict[str, Any]:
    return {
        "auroc": auroc(touched, p),
        "brier": brier(touched, p),
        "log_loss": log_loss(touched, p),
        "auroc_within_taxel": [auroc(y, q) for y, q in zip(touched.T, p.T, strict=True)],
    }


def _intervals(touched: Mask, p: Array, base: Array, resamples: Numbers) -> dict[str, Any]:
    """95 % bootstrap intervals over trials, of the scores and of what they gain on the base rate."""
    drawn = np.array([(auroc(touched[i], p[i]), brier(touched[i], p[i])) for i in resamples])
    rival = np.array([(auroc(touched[i], base[i]), brier(touched[i], base[i])) for i in resamples])
    columns = {"auroc": drawn[:, 0], "brier": drawn[:, 1]}
    columns |= {"auroc_gain": drawn[:, 0] - rival[:, 0], "brier_gain": rival[:, 1] - drawn[:, 1]}
    return {f"{name}_95": np.percentile(values, (2.5, 97.5)).tolist() for name, values in columns.items()}


def _split_scores(method: Method, trials: tuple[Trial, ...], splits: list[list[Numbers]]) -> dict[str, float]:
    """As on a session not seen: means over splits, and how often both scores beat the base rate's."""
    return _against_base(method(trials, HORIZON_S), trials, splits)


def _against_base(predict: Predictor, trials: tuple[Trial, ...], splits: list[list[Numbers]]) -> dict[str, float]:
    touched, base = np.array([trial.touched for trial in trials]), METHODS["base rate"](trials, HORIZON_S)
    rows = []
    for train, test in splits:
        now, p, rate = touched[test], predict(train, test), base(train, test)
        rows.append((auroc(now, p), brier(now, p), auroc(now, rate), brier(now, rate)))
    return _means(np.array(rows))


def _in_quarters(method: Method, trials: tuple[Trial, ...]) -> dict[str, float]:
    """Each quarter of the session, in order of time, predicted from the other three: what drifts costs."""
    predict, numbers = method(trials, HORIZON_S), np.arange(len(trials))
    p = np.concatenate([predict(np.setdiff1d(numbers, part), part) for part in np.array_split(numbers, 4)])
    touched = np.array([trial.touched for trial in trials])
    return {"auroc": auroc(touched, p), "brier": brier(touched, p)}


_OF_ANOTHER_SESSION = {"as it is": predict_contact, "its offset learned": predict_session}


def _another_offset(
    how: Callable[..., ContactPrediction], trials: tuple[Trial, ...], splits: list[list[Numbers]]
) -> list[dict[str, float]]:
    """The trials to predict displaced all alike, as by another calibration; mean over six directions."""
    rows = []
    for size in OFFSETS_M:
        scores = []
        for shift in size * np.concatenate([np.eye(3), -np.eye(3)]):
            moved = tuple(replace(trial, d_m=trial.d_m + shift) for trial in trials)
            scores.append(_against_base(_shifted(how, trials, moved), trials, splits))
        rows.append({"offset_m": size} | {key: float(np.mean([s[key] for s in scores])) for key in scores[0]})
    return rows


def _shifted(how: Callable[..., ContactPrediction], trials: tuple[Trial, ...], moved: tuple[Trial, ...]) -> Predictor:
    params = changed()

    def predict(train: Numbers, test: Numbers) -> Array:
        learned = learn_contact(params, tuple(trials[i] for i in train))
        return how(params, learned, tuple(moved[i] for i in test)).probability

    return predict


def _our_choices(trials: tuple[Trial, ...], n_pairs: int, seed: int) -> list[dict[str, Any]]:
    """One parameter changed at a time: on the real trials, and on simulated sessions predicted from another."""
    touched, default = np.array([trial.touched for trial in trials]), changed()
    pairs = _pairs(n_pairs, seed)
    rows = []
    for name, values in CHOICES.items():
        for value in values:
            params = changed(**{name: value})
            p = leave_one_out(params, trials).probability
            row = {"choice": name, "value": value, "default": getattr(default, name) == value}
            row |= {"auroc": auroc(touched, p), "brier": brier(touched, p)}
            rows.append(row | {"simulated": _simulated(params, pairs)})
    return rows


def _pairs(n: int, seed: int) -> list[tuple[tuple[Trial, ...], tuple[Trial, ...]]]:
    return [two_sessions(np.random.default_rng((seed, k))) for k in range(n)]


def _simulated(
    params: ContactParams,
    pairs: list[tuple[tuple[Trial, ...], tuple[Trial, ...]]],
    how: Callable[..., ContactPrediction] = predict_contact,
) -> dict[str, float]:
    rows = []
    for train, test in pairs:
        p, now = how(params, learn_contact(params, train), test).probability, np.array([t.touched for t in test])
        rate = np.tile(touch_rates(train), (len(test), 1))
        rows.append((auroc(now, p), brier(now, p), auroc(now, rate), brier(now, rate)))
    return _means(np.array(rows))


def _means(rows: Array) -> dict[str, float]:
    """Of AUROC and Brier score, and of the base rate's (k, 4), and how often both are better."""
    a, b, base_a, base_b = rows.T
    better = float(np.mean((a > base_a) & (b < base_b)))
    return {"auroc": a.mean(), "brier": b.mean(), "base_rate_brier": base_b.mean(), "beats_base_rate": better}


def _map_choices(trials: tuple[Trial, ...]) -> list[dict[str, Any]]:
    """R's map: where D is measured from, how far TTC reaches, how much it is smoothed, how it is read."""
    touched, rows = np.array([trial.touched for trial in trials]), []
    for reference, ttc_s, sigma, average in product(
        ("taxel", "surface", "landing"), (1.2, 3.0), (0.75, 1.0), (False, True)
    ):
        p = left_out(Plain(ttc_s, sigma, reference, average), trials)  # type: ignore[arg-type]
        read = "all samples" if average else "last sample"
        row = {"reference": reference, "ttc_s": ttc_s, "sigma_bins": sigma, "read": read}
        rows.append(row | {"auroc": auroc(touched, p), "brier": brier(touched, p)})
    return rows


def _nested(trials: tuple[Trial, ...], splits: list[list[Numbers]]) -> dict[str, Any]:
    """Parameters chosen on the trials to learn from alone, leaving out one of those at a time."""
    grid = [changed(**dict(zip(NESTED, values, strict=True))) for values in product(*NESTED.values())]
    chosen: Counter[str] = Counter()

    def predict(train: Numbers, test: Numbers) -> Array:
        known = tuple(trials[i] for i in train)
        outcome = np.array([trial.touched for trial in known])
        best = min(grid, key=lambda params: brier(outcome, leave_one_out(params, known).probability))
        chosen[" ".join(f"{name}={getattr(best, name):g}" for name in NESTED)] += 1
        return predict_contact(best, learn_contact(best, known), tuple(trials[i] for i in test)).probability

    fixed = _split_scores(METHODS[OURS], trials, splits)
    return {"chosen": _against_base(predict, trials, splits), "fixed": fixed, "grid": NESTED, "choices": dict(chosen)}


def changed(**parameters: Any) -> ContactParams:
    """Ours with other parameters."""
    return replace(ContactParams(horizon_s=HORIZON_S), **parameters)


def _permuted(trials: tuple[Trial, ...], n: int, rng: np.random.Generator) -> dict[str, Any]:
    """Outcomes dealt to other trials, so that paths say nothing: what leaving one out alone does to the scores,
    and how often chance does as well as the truth."""
    touched, params = np.array([trial.touched for trial in trials]), changed()
    p = leave_one_out(params, trials).probability
    truth, dealt = (auroc(touched, p), brier(touched, p)), []
    for _ in range(n):
        outcome = touched[rng.permutation(len(trials))]
        others = tuple(replace(trial, touched=now) for trial, now in zip(trials, outcome, strict=True))
        p = leave_one_out(params, others).probability
        dealt.append((auroc(outcome, p), brier(outcome, p)))
    a, b = np.array(dealt).T
    return {
        "n": n,
        "auroc": float(a.mean()),
        "brier": float(b.mean()),
        "as_good_auroc": float(np.mean(a >= truth[0])),
        "as_good_brier": float(np.mean(b <= truth[1])),
    }
