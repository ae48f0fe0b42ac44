"""What the robot's errors cost, and what learning with them gives back (R: "the learned representations
automatically compensate"): prediction for every source of error, avoidance with all of them.

Two ways to remember are held against each other.  R's D and TTC know how far a stimulus is, not where: an error
across the approach is no longer in them, nor in what a taxel's cone lets through.  The displacement itself
(`learning/passing.py`) keeps it, so that a constant error cancels.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.memory import MemoryParams
from learning.passing import PassingParams, foretell, learn_passing
from learning.representations import Counts
from learning.scores import auroc, brier
from learning.touch_trial import TouchTrial
from pps_vision.experiments.pps.errors import SOURCES, Belief, ErrorSources, only
from pps_vision.experiments.pps.flight import Fleeing, Flight
from pps_vision.experiments.pps.held_out import (
    approaches,
    at_horizon,
    displaced,
    known_trials,
    learned,
    of_part,
    samples,
)
from pps_vision.robot.skin import INNER_FOREARM, icub_skin
from pps_vision.types import Array, Mask

Case = Literal["no errors", "before learning", "after learning"]
CASES: tuple[Case, ...] = ("no errors", "before learning", "after learning")
TRIALS = 53
PART = "left_forearm"
_SPEED_M_S = (0.05, 0.15)
_RADIUS_M = 0.035

Told = tuple[Belief, tuple[TouchTrial, ...]]
"""Trials as a robot took them."""


@dataclass(frozen=True)
class Compensation:
    """No errors; what a robot without errors learned, on one that errs; what that one has learned itself."""

    robots: int = 3
    """Robots that err, each in its own way."""
    approaches: int = 10
    """Approaches that each robot is to flee in each case."""
    seed: int = 0
    """Seed of trials, errors and approaches."""

    def run(self) -> dict[str, Any]:
        """Per source and for all: AUROC and Brier score by way and case; with all: touches by case."""
        if self.robots < 1 or self.approaches < 1:
            raise ValueError(f"--robots {self.robots}, --approaches {self.approaches}; expected at least 1 of each")
        sources = {**{name: only(name) for name in SOURCES}, "all": ErrorSources()}
        rng = np.random.default_rng(self.seed)
        perfect = self._lives(Belief.draw(only(), icub_skin(), rng), rng)
        lives: dict[str, list[tuple[Told, Told]]] = {}
        for name, source in tqdm(sources.items(), desc="errors", unit="source", disable=None):
            rngs = [np.random.default_rng((self.seed, k)) for k in range(self.robots)]
            lives[name] = [self._lives(Belief.draw(source, icub_skin(), r), r) for r in rngs]
        flights: dict[Case, list[Flight]] = {case: [] for case in CASES}
        for number, erring in enumerate(tqdm(lives["all"], desc="fleeing", unit="robot", disable=None)):
            for case in CASES:
                flights[case].extend(self._flee(number, *_of(case, perfect, erring)))
        return {
            "seed": self.seed,
            "robots": self.robots,
            "prediction": {name: _prediction(perfect, of_source) for name, of_source in lives.items()},
            "avoidance": {case: _avoidance(of_case) for case, of_case in flights.items()},
        }

    def _lives(self, belief: Belief, rng: np.random.Generator) -> tuple[Told, Told]:
        """What a robot has of the trials to learn from and of those held out."""
        first, second = (
            (belief, tuple(belief.tells(trial, True, rng) for trial in known_trials("inner", TRIALS, self.seed + k)))
            for k in (0, 1)
        )
        return first, second

    def _flee(self, number: int, lessons: Told, tests: Told) -> Iterator[Flight]:
        belief, whole = tests[0], icub_skin()
        memory = learned(
            lessons[0].skin, MemoryParams(), approaches(lessons[1], lessons[0].robot, lessons[0].skin, whole)
        )
        fleeing = Fleeing(belief, whole, memory)
        for k in range(self.approaches):
            rng = np.random.default_rng((self.seed, number, k))
            motion = fleeing.approach(f"{PART}:{INNER_FOREARM[k % 8]}", _RADIUS_M, rng.uniform(*_SPEED_M_S), rng)
            yield fleeing.meet(motion, _RADIUS_M, rng)

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Left and middle: prediction by source, R's map and displacements; right: touches in flight."""
        figure, axes = plt.subplots(1, 3, figsize=(13.5, 4.6), width_ratios=(1.4, 1.4, 1), layout="constrained")
        for axis, way in zip(axes, WAYS, strict=False):
            _sources(axis, numbers["prediction"], way)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=3, fontsize=9)
        _touches(axes[2], numbers["avoidance"])
        return figure


def _of(case: Case, perfect: tuple[Told, Told], erring: tuple[Told, Told]) -> tuple[Told, Told]:
    """What is learned from and what is tested on."""
    return (erring if case == "after learning" else perfect)[0], (perfect if case == "no errors" else erring)[1]


def _by_distance_and_ttc(lessons: Told, tests: Told) -> tuple[Mask, Array]:
    """R's map: outcomes and expectations (trials, taxels) 0.15 s before the end."""
    taught, tested = (
        approaches(trials, belief.robot, of_part(belief.skin, PART), belief.skin) for belief, trials in (lessons, tests)
    )
    D, TTC, touched = at_horizon(tested)
    return touched, Counts(MemoryParams()).fit(*samples(taught), np.random.default_rng(0))(D, TTC)


def _by_displacement(lessons: Told, tests: Told) -> tuple[Mask, Array]:
    """The same by where paths pass."""
    params = PassingParams()
    taught, tested = (
        displaced(trials, belief.robot, of_part(belief.skin, PART), belief.skin) for belief, trials in (lessons, tests)
    )
    return np.array([t.touched for t in tested]), foretell(params, learn_passing(params, taught), tested).probability


WAYS: dict[str, Callable[[Told, Told], tuple[Mask, Array]]] = {
    "D and TTC (R)": _by_distance_and_ttc,
    "displacement": _by_displacement,
}


def _prediction(perfect: tuple[Told, Told], robots: list[tuple[Told, Told]]) -> dict[str, Any]:
    """By way and case the scores, mean over robots, on the taxels of the part that is approached."""
    found: dict[str, Any] = {"error_mm": float(np.mean([_error_mm(perfect, erring) for erring in robots]))}
    for way, expects in WAYS.items():
        found[way] = {}
        for case in CASES:
            scores = [(auroc(y, p), brier(y, p)) for y, p in (expects(*_of(case, perfect, r)) for r in robots)]
            found[way][case] = dict(zip(("auroc", "brier"), np.mean(scores, axis=0).tolist(), strict=True))
    return found


def _error_mm(perfect: tuple[Told, Told], erring: tuple[Told, Told]) -> float:
    """Median distance between where the object is seen from a taxel at the end, and where it is."""
    true, taken = (
        np.array([t.d_m[-1] for t in displaced(trials, belief.robot, of_part(belief.skin, PART), belief.skin)])
        for belief, trials in (perfect[1], erring[1])
    )
    return 1000 * float(np.nanmedian(np.linalg.norm(taken - true, axis=-1)))


def _avoidance(flights: list[Flight]) -> dict[str, Any]:
    moved = np.array([flight.moved_before_s for flight in flights])
    return {
        "approaches": len(flights),
        "touched": sum(flight.touched for flight in flights),
        "never_moved": int(np.isnan(moved).sum()),
        "moved_before_s": float(np.median(np.nan_to_num(moved))),
    }


_COLORS: dict[str, str] = dict(zip(CASES, ("0.55", "tab:orange", "tab:blue"), strict=True))


def _sources(axis: Axes, prediction: dict[str, Any], way: str) -> None:
    names = list(prediction)[::-1]
    for y, name in enumerate(names):
        of = prediction[name][way]
        axis.plot([of[case]["auroc"] for case in CASES], [y] * 3, color="0.85", lw=2, zorder=1)
        for case in CASES:
            axis.plot(of[case]["auroc"], y, "o", color=_COLORS[case], ms=7, label=case if y == 0 else None)
    axis.set_yticks(range(len(names)), [f"{name}\n({prediction[name]['error_mm']:.0f} mm off)" for name in names])
    axis.set_xlim(min(of[w][case]["auroc"] for of in prediction.values() for w in WAYS for case in CASES) - 0.02, 1)
    axis.set_title(way, fontsize=10)
    axis.set_xlabel("AUROC on trials held out, 0.15 s before the end")
    axis.grid(alpha=0.25, axis="x")


def _touches(axis: Axes, avoidance: dict[str, Any]) -> None:
    for x, (case, of) in enumerate(avoidance.items()):
        share = 100 * of["touched"] / of["approaches"]
        axis.bar(x, share, color=_COLORS[case], width=0.6)
        axis.annotate(f"{of['touched']} of {of['approaches']}", (x, share), ha="center", va="bottom", fontsize=9)
    axis.set_xticks(range(len(avoidance)), [case.replace(" ", "\n") for case in avoidance])
    axis.set_ylim(0, 100)
    axis.set_title("avoidance, R's map, all sources", fontsize=10)
    axis.set_ylabel("approaches that touch the fleeing arm (%)")
    axis.grid(alpha=0.25, axis="y")
