"""Speed against accuracy of ways to remember what came before a touch, and the cheapest that is calibrated enough."""

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from learning.calibration import calibrate
from learning.memory import MemoryParams
from learning.representations import Counts, Foresight, Kernel, Measured, Network, Representation, cheapest
from learning.scores import auroc, brier, expected_calibration_error
from pps_vision.experiments.chart import Variant, legend, speed_against_error
from pps_vision.experiments.pps.held_out import (
    Approach,
    Samples,
    approaches,
    at_horizon,
    known_trials,
    of_part,
    samples,
)
from pps_vision.robot.icub import load_icub
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array, Mask

TRIALS = 53
PART = "left_forearm"
DEFAULT = "2-D, 8 × 4 (R)"
REPRESENTATIONS: dict[str, Representation] = {
    "1-D, 8": Counts(MemoryParams(ttc_range_s=(-np.inf, np.inf), bins=(8, 1))),
    DEFAULT: Counts(MemoryParams()),
    "2-D, 16 × 8": Counts(MemoryParams(bins=(16, 8))),
    "2-D, 32 × 16": Counts(MemoryParams(bins=(32, 16))),
    "32 × 16, normalised": Counts(MemoryParams(bins=(32, 16)), normalised=True),
    "32 × 16, normalised, pooled": Counts(MemoryParams(bins=(32, 16)), normalised=True, pooled=0.2),
    "kernel": Kernel(),
    "network": Network(),
}
ASKED = ((0.10, 1.0), (0.05, 1.0), (0.05, 0.085), (0.05, 0.06), (0.02, 1.0))
"""Calibration errors and Brier scores to ask for."""
_FOLDS, _RUNS = 5, 60


@dataclass(frozen=True)
class Representations:
    """Each learns from 53 trials of which the robot knows all, is corrected by isotonic regression of trials left
    out, and foretells 53 others 0.15 s before their end."""

    seed: int = 0
    """Seed of the trials; those held out have the next, those the choice is tested on the one after."""

    def run(self) -> dict[str, Any]:
        """By representation its time a stimulus and errors; what is chosen for each goal, and what comes of it on
        trials neither learned from nor chosen by."""
        skin = icub_skin()
        lessons, tests, others = (
            approaches(known_trials("inner", TRIALS, self.seed + k), load_icub(), of_part(skin, PART), skin)
            for k in range(3)
        )
        rng = np.random.default_rng(self.seed)
        foresights = {name: _corrected(what, lessons, rng) for name, what in REPRESENTATIONS.items()}
        ms = _timed(foresights, at_horizon(tests))
        table = {name: _measured(foresee, at_horizon(tests)) for name, foresee in foresights.items()}
        for name, of in table.items():
            of["time"] = Variant(name, ms[name], of["ece"]).summary()
        fresh = {name: _measured(foresee, at_horizon(others)) for name, foresee in foresights.items()}
        return {"seed": self.seed, "table": table, "choices": [_choice(table, fresh, *goal) for goal in ASKED]}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time against Brier score and against calibration error."""
        figure, axes = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
        for axis, key, label in zip(axes, ("brier", "ece"), ("Brier score", "expected calibration error"), strict=True):
            variants = [
                Variant.of(name, {**of["time"], "error": of[key]}, ours=True, default=name == DEFAULT)
                for name, of in numbers["table"].items()
            ]
            speed_against_error(axis, variants, "stimulus, 12 taxels", label)
        legend(axes[1])
        return figure


def _corrected(what: Representation, lessons: tuple[Approach, ...], rng: np.random.Generator) -> Foresight:
    """Calibrated on folds left out in turn."""
    said, touched = [], []
    for k in range(_FOLDS):
        D, TTC, y = at_horizon(lessons[k::_FOLDS])
        rest = [trial for i, trial in enumerate(lessons) if i % _FOLDS != k]
        said.append(what.fit(*samples(rest), rng)(D, TTC))
        touched.append(y)
    correct = calibrate(np.concatenate(touched), np.concatenate(said))
    foresee = what.fit(*samples(lessons), rng)
    return lambda distance, ttc: correct(foresee(distance, ttc))


def _timed(foresights: dict[str, Foresight], shown: Samples) -> dict[str, Array]:
    """Milliseconds for one stimulus, in turn."""
    ms: dict[str, list[float]] = {name: [] for name in foresights}
    D, TTC, _ = shown
    for k in range(_RUNS):
        for name, foresee in foresights.items():
            begun = perf_counter()
            foresee(D[k % len(D)], TTC[k % len(D)])
            ms[name].append(1000 * (perf_counter() - begun))
    return {name: np.array(times) for name, times in ms.items()}


def _measured(foresee: Foresight, shown: tuple[Array, Array, Mask]) -> dict[str, Any]:
    D, TTC, touched = shown
    p = foresee(D, TTC)
    return {
        "ece": expected_calibration_error(touched, p),
        "brier": brier(touched, p),
        "auroc": auroc(touched, p),
    }


def _choice(table: dict[str, Any], fresh: dict[str, Any], max_ece: float, max_brier: float) -> dict[str, Any]:
    """What is chosen by the table, and how it does on other trials."""
    measured = [Measured(name, 1000 * of["time"]["median_ms"], of["ece"], of["brier"]) for name, of in table.items()]
    found = cheapest(measured, max_ece, max_brier)
    goal = {"max_ece": max_ece, "max_brier": max_brier}
    if found is None:
        return {**goal, "chosen": None}
    of = fresh[found.name]
    return {**goal, "chosen": found.name, "us": found.us, "ece_on_others": of["ece"], "brier_on_others": of["brier"]}
