"""Do activations mean what they say?  Reliability on held-out trials after 53 rendered and tracked ones."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import expit, logit
from sklearn.isotonic import IsotonicRegression

from learning.pps.contact import ContactParams, landing_gap, learn_contact, predict_contact
from learning.pps.memory import MemoryParams
from learning.pps.receptive_field import ReceptiveField
from learning.pps.scores import auroc, brier, expected_calibration_error, reliability
from learning.pps.touch_trial import TouchTrial
from learning.pps.trials import Trial
from pps_vision.experiments.pps.count_table import CountTable
from pps_vision.experiments.pps.held_out import LEAD_S, Approach, approaches, at_horizon, displaced, of_part, samples
from pps_vision.experiments.pps.touch_trials import touch_trials
from pps_vision.experiments.study import Study
from pps_vision.robot.icub import load_icub
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array, Mask

TRIALS, HELD_OUT, FOLDS = 53, 40, 8
PART = "left_forearm"
_FAR_M = 0.2  # beyond, how far a landing point is does not matter
GOALS = {"auroc": 0.95, "expected_calibration_error": 0.05}
COARSE = CountTable(MemoryParams())
FINE = CountTable(MemoryParams(bins=(32, 16)), normalised=True, pooled=0.2)
CENTER = ReceptiveField()
SURFACE = ReceptiveField(subtract_radius=True, min_closing_sigmas=0.0)  # the regression judges doubtful samples


@dataclass(frozen=True)
class Lived:
    """Trials as the forearm perceived them: D and TTC to the object's centre and surface, displacements, and how near
    to each taxel (trials, taxels) the object's surface would land, m."""

    center: tuple[Approach, ...]
    surface: tuple[Approach, ...]
    moved: tuple[Trial, ...]
    landed: Array

    @classmethod
    def of(cls, trials: tuple[TouchTrial, ...]) -> "Lived":
        """By every measure that some way asks for."""
        whole, robot = icub_skin(), load_icub()
        skin = of_part(whole, PART)
        center, surface = (approaches(trials, robot, skin, whole, field) for field in (CENTER, SURFACE))
        moved = displaced(trials, robot, skin, whole)
        gaps = [landing_gap(path, _radius(trial), LEAD_S) for path, trial in zip(moved, trials, strict=True)]
        return cls(center, surface, moved, np.minimum(gaps, _FAR_M))

    def some(self, which: Iterable[int]) -> "Lived":
        """Those of the trials."""
        at = tuple(which)
        return Lived(
            tuple(self.center[i] for i in at),
            tuple(self.surface[i] for i in at),
            tuple(self.moved[i] for i in at),
            self.landed[list(at)],
        )

    @property
    def touched(self) -> Mask:
        """(trials, taxels) what was touched."""
        return np.array([trial.touched for trial in self.center])


def _radius(trial: TouchTrial) -> float:
    """What was known of the object's radius in time, m."""
    known = trial.radius_m[trial.stamps_s <= trial.stamps_s[-1] - LEAD_S]
    return float(np.median(known[np.isfinite(known)])) if np.isfinite(known).any() else 0.0


Way = Callable[[Lived, Lived], Array]
"""Lessons and tests → expected probabilities (tests, taxels)."""


@dataclass(frozen=True)
class Calibration(Study):
    """Of trials held out, 0.15 s before their end: what was expected of each taxel of the forearm, what happened.

    R's map as it is; the same corrected by an isotonic regression of its own trials, left out in turn; a
    finer one of the distance to the object's surface, normalised, neighbours counting a fifth, corrected too;
    displacements and landing points (`learning/pps/contact.py`); these together; and each taxel's rate of touch.
    """

    seed: int = 0
    """Seed of the trials; those held out have the next."""
    trials: Path = Path("build") / "pps"
    """Folder that keeps rendered trials."""

    def run(self) -> dict[str, Any]:
        """By way: AUROC, Brier score, expected calibration error, and the reliability diagram."""
        lessons, tests = (
            touch_trials("inner", n, self.seed + k, True, self.trials) for k, n in enumerate((TRIALS, HELD_OUT))
        )
        return {"seed": self.seed, "goals": GOALS, "ways": scores(Lived.of(lessons), Lived.of(tests))}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Left: reliability; right: how well told apart, how well calibrated, and the goal."""
        figure, (left, right) = plt.subplots(1, 2, figsize=(13, 4.8), layout="constrained")
        _reliability(left, numbers["ways"])
        _goal(right, numbers["ways"])
        return figure


def scores(lessons: Lived, tests: Lived) -> dict[str, dict[str, Any]]:
    """What each way makes of `tests` after `lessons`."""
    touched = tests.touched
    found = {}
    for name, expects in WAYS.items():
        p = expects(lessons, tests)
        r = reliability(touched, p)
        found[name] = {
            "auroc": auroc(touched, p),
            "brier": brier(touched, p),
            "expected_calibration_error": expected_calibration_error(touched, p),
            "predicted": r.predicted.tolist(),
            "happened": r.happened.tolist(),
            "n": r.n.tolist(),
        }
    return found


def _by_center(what: CountTable) -> Way:
    return lambda lessons, tests: _fit(what, lessons.center, tests.center)


def _by_surface(what: CountTable) -> Way:
    return lambda lessons, tests: _fit(what, lessons.surface, tests.surface)


def _fit(what: CountTable, taught: tuple[Approach, ...], tested: tuple[Approach, ...]) -> Array:
    D, TTC, _ = at_horizon(tested)
    return what.fit(*samples(taught))(D, TTC)


def _by_displacement(lessons: Lived, tests: Lived) -> Array:
    params = ContactParams()
    return predict_contact(params, learn_contact(params, lessons.moved), tests.moved).probability


def _by_rate(lessons: Lived, tests: Lived) -> Array:
    return np.tile(lessons.touched.mean(axis=0), (len(tests.center), 1))


def _by_landing(lessons: Lived, tests: Lived) -> Array:
    return _isotonic(lessons.touched, -lessons.landed)(-tests.landed)


def _isotonic(outcome: Mask, score: Array) -> Callable[[Array], Array]:
    """Isotonic regression of outcomes on scores, any shape: scores → corrected probabilities."""
    fitted = IsotonicRegression(out_of_bounds="clip").fit(score.ravel(), outcome.ravel())
    return lambda new: np.asarray(fitted.predict(new.ravel())).reshape(new.shape)


def _together(*ways: Way) -> Way:
    """The mean of their log-odds, of which none is more certain than one in fifty."""

    def expects(lessons: Lived, tests: Lived) -> Array:
        odds = [logit(np.clip(way(lessons, tests), 0.02, 0.98)) for way in ways]
        return np.asarray(expit(np.mean(odds, axis=0)))

    return expects


def _corrected(way: Way) -> Way:
    """Calibrated on what each fold of lessons would have been expected to bring by the others."""

    def expects(lessons: Lived, tests: Lived) -> Array:
        left_out = [np.arange(k, len(lessons.center), FOLDS) for k in range(FOLDS)]
        rest = [np.setdiff1d(np.arange(len(lessons.center)), fold) for fold in left_out]
        said = [way(lessons.some(r), lessons.some(fold)) for r, fold in zip(rest, left_out, strict=True)]
        return _isotonic(lessons.touched[np.concatenate(left_out)], np.concatenate(said))(way(lessons, tests))

    return expects


_FINE = _by_surface(FINE)
WAYS: dict[str, Way] = {
    "R's map": _by_center(COARSE),
    "R's map, corrected": _corrected(_by_center(COARSE)),
    "finer, to the surface, corrected": _corrected(_FINE),
    "displacement": _by_displacement,
    "finer and displacement, corrected": _corrected(_together(_FINE, _by_displacement)),
    "where it lands": _by_landing,
    "finer, displacement, landing, corrected": _corrected(_together(_FINE, _by_displacement, _by_landing)),
    "rate of touch": _by_rate,
}
_COLORS = dict(
    zip(
        WAYS,
        ("tab:orange", "tab:green", "tab:cyan", "tab:purple", "tab:blue", "tab:brown", "tab:red", "0.6"),
        strict=True,
    )
)

_SHOWN = ("R's map", "finer, displacement, landing, corrected")


def _reliability(axis: Axes, ways: dict[str, Any]) -> None:
    """Of R's map and the best way, with what chance allows (1 sigma, were taxels independent); the others thinly."""
    axis.plot([0, 1], [0, 1], color="0.3", lw=1, ls="--")
    for name, of in ways.items():
        predicted, happened, n = (np.array(of[key]) for key in ("predicted", "happened", "n"))
        if name not in _SHOWN:
            axis.plot(predicted, happened, color=_COLORS[name], lw=0.8, alpha=0.35)
            continue
        share = (happened * n + 1) / (n + 2)
        chance = np.sqrt(share * (1 - share) / (n + 2))
        axis.errorbar(predicted, happened, chance, color=_COLORS[name], lw=1.6, elinewidth=1, zorder=3)
        axis.scatter(predicted, happened, 8 + 0.6 * n, color=_COLORS[name], zorder=4)
    axis.set_xlabel("expected probability of touch, 0.15 s before the end")
    axis.set_ylabel("share touched (size: how many taxels)")
    axis.set_ylim(-0.05, 1.05)
    axis.set_title("Thick: R's map, and all three together")
    axis.grid(alpha=0.25)


def _goal(axis: Axes, ways: dict[str, Any]) -> None:
    edge = GOALS["expected_calibration_error"]
    axis.fill_between([GOALS["auroc"], 1], edge, color="tab:green", alpha=0.12, lw=0)
    axis.annotate("goal", (GOALS["auroc"] + 0.002, 0.002), fontsize=8)
    for name, of in ways.items():
        at = of["auroc"], of["expected_calibration_error"]
        axis.plot(*at, "o", ms=11 if name in _SHOWN else 7, color=_COLORS[name], label=name)
    axis.set_ylim(bottom=0)
    axis.set_xlabel("AUROC")
    axis.set_ylabel("expected calibration error")
    axis.set_title("Right and sure: lower right is better")
    axis.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, labelspacing=1.2)
    axis.grid(alpha=0.25)
