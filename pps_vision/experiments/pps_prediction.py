"""Touches predicted 0.15 s ahead: rendered approaches, the authors' real trials, and robots with R's errors.

A `Predictor` learns from training trials and returns the probability (trials, taxels) that each test trial touches each
taxel, from the samples known at the horizon.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from scipy.stats import rankdata
from sklearn.isotonic import IsotonicRegression
from tqdm import tqdm

from learning.pps.joint_offsets import TouchTrial
from learning.pps.memory import MemoryParams, activation, smoothed
from pps_vision.app.encounters.encounter import TRIALS, SessionName
from pps_vision.app.encounters.robots import ErrorSources, MiscalibratedRobot
from pps_vision.app.intervals import percent_of
from pps_vision.experiments import charts
from pps_vision.experiments.pps.erring import SOURCES, calibrated, errors_from, observe
from pps_vision.experiments.pps.session_trials import SessionStudy, exact_trials
from pps_vision.experiments.pps.taxel_trials import (
    Trial,
    at_horizon,
    in_taxel_frames,
    known_at_horizon,
    load_trials,
    perceive,
    train_memory,
)
from pps_vision.experiments.study import DATA, Part, interval
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.types import Array, Mask

Trials = Sequence[Trial]
Predictor = Callable[[Trials, Trials], Array]  # training trials, test trials → probabilities (test trials, taxels)

PRIORS = (1.0, 10.0, 100.0, 1000.0, 1e9)
_FOLDS = 8
_BINS = 10  # reliability diagram
_AUTHORS = MemoryParams(ttc_range_s=(0.0, 1.2), sigma_bins=0.75)  # parameters of the authors' code
HELD_OUT = 40  # rendered approaches that test the calibration
AUROC_GOAL = 0.95
ERROR_GOAL = 0.05
_EARLY_SHARE = 24 / 37


def outcomes(trials: Trials) -> Mask:
    """Return the touches (trials, taxels)."""
    return np.array([trial.touched for trial in trials])


def by_base_rate(training: Trials, test: Trials) -> Array:
    """Predict the share of trials that touched each taxel, independent of the path."""
    return np.tile(outcomes(training).mean(axis=0), (len(test), 1))


def by_map(training: Trials, test: Trials) -> Array:
    """Predict the activation of R's map at the last known sample."""
    return activation(train_memory(training), *at_horizon(test))


def by_authors_map(training: Trials, test: Trials) -> Array:
    """Predict the activation of a map with the parameters of the authors' code, averaged over the known samples.

    Where the map covers no sample, predict the base rate.
    """
    memory = train_memory(training, _AUTHORS)
    p = by_base_rate(training, test)
    for k, trial in enumerate(test):
        D, TTC = (samples[known_at_horizon(trial.stamps_s)] for samples in perceive(trial))
        covered = _AUTHORS.covers(D, TTC)
        n = covered.sum(axis=0)
        total = (activation(memory, D, TTC) * covered).sum(axis=0)
        p[k] = np.where(n > 0, total / np.maximum(n, 1), p[k])
    return p


def by_shrunk_map(training: Trials, test: Trials) -> Array:
    """Predict from R's counts with n prior samples at the taxel's rate r of touch: (n⁺ + n r) / (n⁺ + n⁻ + n).

    n⁺ and n⁻ are smoothed by R's window; n is the prior that best predicts blocks of the training trials.
    """
    touched = outcomes(training)
    errors = [brier(touched, in_blocks(partial(_by_shrunk_map, prior), training)) for prior in PRIORS]
    return _by_shrunk_map(PRIORS[int(np.argmin(errors))], training, test)


def _by_shrunk_map(prior: float, training: Trials, test: Trials) -> Array:
    memory = train_memory(training)
    p = by_base_rate(training, test)
    D, TTC = at_horizon(test)
    inside = memory.params.covers(D, TTC)
    taxel = np.nonzero(inside)[-1]
    n_touched, n_not = (
        smoothed(memory.params, memory.counts[..., k].astype(float), taxel, D[inside], TTC[inside]) for k in range(2)
    )
    p[inside] = (n_touched + prior * p[inside]) / (n_touched + n_not + prior)
    return p


def corrected(predictor: Predictor) -> Predictor:
    """Return the prediction corrected by isotonic regression on held-out folds of the training trials."""

    def predict(training: Trials, test: Trials) -> Array:
        folds = [np.arange(k, len(training), _FOLDS) for k in range(_FOLDS)]
        regression = IsotonicRegression(out_of_bounds="clip")
        regression.fit(_held_out(predictor, training, folds).ravel(), outcomes(training).ravel())
        raw = predictor(training, test)
        return np.asarray(regression.predict(raw.ravel())).reshape(raw.shape)

    return predict


def in_blocks(predictor: Predictor, trials: Trials, n_blocks: int = 4) -> Array:
    """Return probabilities (trials, taxels), each block of consecutive trials predicted from the others."""
    return _held_out(predictor, trials, np.array_split(np.arange(len(trials)), n_blocks))


def _held_out(predictor: Predictor, trials: Trials, folds: Sequence[NDArray[np.intp]]) -> Array:
    """Probabilities (trials, taxels), each fold of indices predicted from the others."""
    p = np.zeros(outcomes(trials).shape)
    for fold in folds:
        others = [trial for k, trial in enumerate(trials) if k not in fold]
        p[fold] = predictor(others, [trials[k] for k in fold])
    return p


def auroc(outcome: ArrayLike, score: ArrayLike) -> float:
    """Return the area under the receiver operating characteristic; NaN where all outcomes are equal.

    It is the share of pairs of a positive and a negative outcome in which the positive scores higher; ties count half.
    """
    is_positive = np.asarray(outcome, dtype=bool).ravel()
    n = np.count_nonzero(is_positive)
    if n in (0, len(is_positive)):
        return np.nan
    return float((rankdata(score)[is_positive].mean() - (n + 1) / 2) / (len(is_positive) - n))


def brier(outcome: ArrayLike, probability: ArrayLike) -> float:
    """Return the mean squared difference between predicted probability and outcome (0 or 1)."""
    return float(np.mean((np.asarray(probability, dtype=float) - np.asarray(outcome, dtype=float)) ** 2))


def brier_gain(outcome: Array | Mask, probability: Array, reference: Array) -> list[float]:
    """Return the Brier score of the reference less that of the prediction, with 95 % over rows (trials)."""
    return interval(list((reference - outcome) ** 2 - (probability - outcome) ** 2))


def expected_calibration_error(outcome: ArrayLike, probability: ArrayLike) -> float:
    """Return the mean distance between predicted probability and share of positives in its bin (ten equal bins)."""
    p = np.asarray(probability, dtype=float).ravel()
    index = np.minimum((p * _BINS).astype(np.intp), _BINS - 1)
    return float(np.abs(np.bincount(index, weights=p - np.ravel(outcome))).sum() / len(p))


CALIBRATED: dict[str, Predictor] = {
    "base rate": by_base_rate,
    "R's map": by_map,
    "R's map, corrected": corrected(by_map),
}
REAL_TRIALS: dict[str, Predictor] = {
    "base rate": by_base_rate,
    "R's map": by_map,
    "R's map, authors' code, averaged": by_authors_map,
    "R's map, shrunk to the base rate": by_shrunk_map,
}


def calibration(study: "PpsPrediction") -> dict[str, Any]:
    """Return scores by predictor, and the percentage touched by tenths of the probability; None of an empty tenth."""
    training = in_taxel_frames(study.measured_trials("inner"))
    test = in_taxel_frames(study.measured_trials("inner", HELD_OUT, seed_offset=1))
    touched = outcomes(test)
    errors = {"auroc": auroc, "brier": brier, "calibration_error": expected_calibration_error}
    numbers = {}
    for name, predict in CALIBRATED.items():
        p = predict(training, test)
        tenth = np.minimum((_BINS * p).astype(int), _BINS - 1)
        bins = [touched[tenth == k] for k in range(_BINS)]
        numbers[name] = {
            "scores": {key: score_interval(score, touched, p) for key, score in errors.items()},
            "touched_percent": [percent_of(int(b.sum()), b.size) if b.size else None for b in bins],
        }
    return {"n": len(test), "methods": numbers}


def score_interval(score: Callable[[ArrayLike, ArrayLike], float], touched: Mask, p: Array) -> list[float]:
    """Return a score of probabilities (trials, taxels) with its 95 % interval by resampling trials."""
    return interval(list(np.stack([touched, p], axis=-1)), lambda rows: score(rows[:, 0], rows[:, 1]))


def draw_calibration(numbers: dict[str, Any]) -> Figure:
    """Draw the reliability of R's map before and after correction."""
    figure, (axis,) = charts.panels(1, width=5.2)
    axis.plot([0, 100], [0, 100], color="0.25", lw=0.9, ls="--")
    stated = 100 * (np.arange(_BINS) + 0.5) / _BINS
    series = {name: numbers["methods"][name]["touched_percent"] for name in ("R's map", "R's map, corrected")}
    charts.curves(axis, stated, series, "stated (%)", "touched (%)")
    axis.legend(fontsize=8)
    return figure


def tabulate_calibration(numbers: dict[str, Any]) -> Table:
    """Return the scores; a missed goal is bold."""
    rows = []
    for name, method in numbers["methods"].items():
        scores = method["scores"]
        auroc_cell = judged(estimate(scores["auroc"]), scores["auroc"][0] < AUROC_GOAL)
        error_cell = judged(estimate(scores["calibration_error"]), scores["calibration_error"][0] > ERROR_GOAL)
        rows.append([name, auroc_cell, estimate(scores["brier"]), error_cell])
    return Table(["", f"AUROC (goal {AUROC_GOAL})", "Brier score", f"calibration error (goal {ERROR_GOAL})"], rows)


def real_trials(study: "PpsPrediction") -> dict[str, Any]:
    """Return the scores on the authors' trials; only "skipped" without the data.

    The trials follow each other in time, and blocks of consecutive trials are held out. Holding out single trials would
    lower each taxel's rate of touch exactly where it is touched.
    """
    path = study.data / "pps_real_robot" / "trials_forearm_internal.npz"
    if not path.exists():
        return {"skipped": f"no {path}"}
    trials = load_trials(path)
    n_early = round(_EARLY_SHARE * len(trials))
    touched = outcomes(trials)
    splits: dict[str, tuple[Mask, Callable[[Predictor], Array]]] = {
        "quarters": (touched, lambda predict: in_blocks(predict, trials)),
        "early_late": (touched[n_early:], lambda predict: predict(trials[:n_early], trials[n_early:])),
    }
    numbers: dict[str, dict[str, Any]] = {name: {} for name in REAL_TRIALS}
    for name, predict in REAL_TRIALS.items():
        for split, (outcome, probabilities) in splits.items():
            p = probabilities(predict)
            numbers[name][split] = {
                "auroc": score_interval(auroc, outcome, p),
                "brier": interval(list((p - outcome) ** 2)),
                "gain": brier_gain(outcome, p, probabilities(by_base_rate)),
            }
    return {"n": len(trials), "touched": touched.sum(axis=0).tolist(), "methods": numbers}


def tabulate_real_trials(numbers: dict[str, Any]) -> Table:
    rows = [
        [name, *map(estimate, method["quarters"].values()), estimate(method["early_late"]["gain"])]
        for name, method in numbers["methods"].items()
    ]
    gains = [f"below the base rate's, {split}" for split in ("quarters", "first 24 → last 13")]
    return Table(["", "AUROC, quarters", "Brier score, quarters", *gains], rows)


Exact = Sequence[Sequence[TouchTrial]]  # training and test trials
Sets = list[Trials]  # training and test trials as the taxels perceive them
CASES = ("no errors", "errors, map trained without", "errors, map trained with", "encoder offsets estimated too")
MODALITIES: dict[SessionName, int] = {"motor": 45, "visual": 45, "inner": 53}
"""Trials of the felt finger, the seen finger, and seen objects."""


def scores(sets: Iterable[Sets]) -> dict[str, list[float]]:
    """Return AUROC and Brier score of R's map on pairs of training and test trials, with 95 % over the pairs."""
    predictions = [(outcomes(test), by_map(training, test)) for training, test in sets]
    return {score.__name__: interval([[score(*pair)] for pair in predictions]) for score in (auroc, brier)}


def compensation(study: "PpsPrediction") -> dict[str, Any]:
    """Return the scores by source of error and case, with 95 % over robots."""
    exact = [exact_trials("inner", study.size(TRIALS["inner"]), study.seed + i) for i in (0, 1)]
    without: Sets = [in_taxel_frames(trials) for trials in exact]
    sources = {**{name: errors_from(name) for name in SOURCES}, "all": ErrorSources()}
    numbers: dict[str, Any] = {}
    for name, source in tqdm(sources.items(), desc="errors", unit="source", disable=None):
        sets: dict[str, list[Sets]] = {case: [] for case in CASES}
        for k in range(study.n if name == "all" else study.n_single):
            robot = MiscalibratedRobot.draw(source, np.random.default_rng((study.seed, k)))
            observed, erring = _observe(robot, exact, (study.seed, k, 1))
            _, estimated = _observe(calibrated(robot, observed[0]), exact, (study.seed, k, 1))
            of_cases: tuple[Sets, ...] = (without, [without[0], erring[1]], erring, estimated)
            for case, of_case in zip(CASES, of_cases, strict=True):
                sets[case].append(of_case)
        numbers[name] = {case: scores(sets[case]) for case in CASES}
    return {"sources": numbers}


def _observe(robot: MiscalibratedRobot, exact: Exact, seed: tuple[int, ...]) -> tuple[Exact, Sets]:
    """Training and test trials as a robot measures and perceives them, with the slack drawn from `seed`."""
    rng = np.random.default_rng(seed)
    observed = [[observe(robot, trial, True, rng) for trial in trials] for trials in exact]
    return observed, [in_taxel_frames(trials, robot.model, robot.skin) for trials in observed]


def draw_compensation(numbers: dict[str, Any]) -> Figure:
    sources = numbers["sources"]
    series = {case: [source[case]["auroc"] for source in sources.values()] for case in CASES}
    figure = charts.bar_chart(list(sources), series, "AUROC (95 % over robots)", 9.0)
    figure.axes[0].set_ylim(0.5, 1)
    return figure


def tabulate_compensation(numbers: dict[str, Any]) -> Table:
    """Return both scores with all sources together, and the Brier score above that without errors."""
    cases = numbers["sources"]["all"]
    best = cases["no errors"]["brier"][0]
    rows = []
    for case in CASES:
        above = "–" if case == "no errors" else estimate([value - best for value in cases[case]["brier"]], 2)
        rows.append([case, estimate(cases[case]["auroc"]), estimate(cases[case]["brier"]), above])
    return Table(["all five sources", "AUROC", "Brier score", "above that without errors"], rows)


def invariance(study: "PpsPrediction") -> dict[str, Any]:
    """Return the scores by modality of training and of test: two thirds of the trials train, the last third tests."""
    sets = {}
    for name, n in MODALITIES.items():
        trials = in_taxel_frames(study.measured_trials(name, n))
        n_training = 2 * len(trials) // 3
        sets[name] = [trials[:n_training], trials[n_training:]]
    return {"modalities": {a: {b: scores([[sets[a][0], sets[b][1]]]) for b in sets} for a in sets}}


@dataclass(frozen=True)
class PpsPrediction(SessionStudy):
    """Calibration: 53 rendered approaches train, 40 others test. Real trials: the authors' 37 trials on four taxels.

    Compensation: scores of R's map with R's five error sources, one by one and together. R: "the learned
    representations automatically compensate". Invariance: the map is trained on felt fingers, seen fingers or objects
    and tested on each.
    """

    MINUTES: ClassVar[int] = 6
    SHORT: ClassVar[Mapping[str, Any]] = {"n_single": 1}
    PARTS: ClassVar[Mapping[str, Part]] = {
        "calibration": Part(calibration, draw_calibration, tabulate_calibration),
        "real_trials": Part(real_trials, table=tabulate_real_trials),
        "compensation": Part(compensation, draw_compensation, tabulate_compensation),
        "invariance": Part(invariance),
    }

    n: int = 20  # robots with all sources of error together
    n_single: int = 3  # robots with each source alone
    data: Path = DATA  # folder of pps_real_robot (default: PPS_VISION_DATA, else ../shared/data)
