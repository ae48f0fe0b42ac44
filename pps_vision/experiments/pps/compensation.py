"""What the robot's errors cost a prediction, and what learning with them gives back (R: "the learned representations
automatically compensate"), for every source of error.

R's D and TTC know how far a stimulus is, not where: an error across the approach is not in them, nor in what a taxel's
cone lets through.  Two ways to mend that are held against R's map: the displacement itself (`learning.pps.contact`), in
which a constant error cancels, and encoders whose offsets touches tell (`learning/pps/joint_offsets.py`), for any map.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.pps.contact import ContactParams, learn_contact, predict_contact
from learning.pps.memory import MemoryParams
from learning.pps.scores import auroc, brier
from pps_vision.experiments.pps.count_table import CountTable
from pps_vision.experiments.pps.errors import SOURCES, Belief, ErrorSources, only
from pps_vision.experiments.pps.held_out import at_horizon, known_trials, samples
from pps_vision.experiments.pps.lives import CASES, COLORS, TRIALS, Case, Life, calibrated, error_mm, live
from pps_vision.experiments.study import Study
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array, Mask

Lives = tuple[Life, Life]
"""What a robot has of the trials to learn from and of those held out."""


@dataclass(frozen=True)
class Compensation(Study):
    """Prediction by robots without errors, and by robots that err in one way or in all, before and after learning."""

    robots: int = 3
    """Robots that err, each in its own way, for each source of errors."""
    seed: int = 0
    """Seed of trials and errors."""

    def run(self) -> dict[str, Any]:
        """Per source and for all: how far off things are seen, AUROC and Brier score by way and case."""
        if self.robots < 1:
            raise ValueError(f"--robots {self.robots}; expected at least 1")
        sources = {**{name: only(name) for name in SOURCES}, "all": ErrorSources()}
        perfect = self._lives(Belief.draw(only(), icub_skin(), np.random.default_rng(self.seed)), 0)
        prediction = {
            name: _prediction(perfect, [self._erring(of, k) for k in range(self.robots)])
            for name, of in tqdm(sources.items(), desc="errors", unit="source", disable=None)
        }
        return {"seed": self.seed, "robots": self.robots, "prediction": prediction}

    def _erring(self, of: ErrorSources, k: int) -> tuple[Lives, Lives]:
        """What a robot lives through, and the same with its encoders' offsets learned."""
        lives = self._lives(Belief.draw(of, icub_skin(), np.random.default_rng((self.seed, k))), k)
        return lives, self._lives(calibrated(lives[0]), k)

    def _lives(self, belief: Belief, k: int) -> Lives:
        rng = np.random.default_rng((self.seed, k, 1))
        first, second = (live(belief, known_trials("inner", TRIALS, self.seed + i), rng) for i in (0, 1))
        return first, second

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Prediction by source, R's map and displacements."""
        figure, axes = plt.subplots(1, 2, figsize=(11.5, 4.6), sharex=True, sharey=True, layout="constrained")
        for axis, way in zip(axes, WAYS, strict=True):
            _sources(axis, numbers["prediction"], way)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=len(CASES), fontsize=9)
        return figure


def _by_case(perfect: Lives, erring: Lives, better: Lives) -> dict[Case, Lives]:
    """What is learned from and what is tested on."""
    of: tuple[Lives, ...] = (perfect, (perfect[0], erring[1]), erring, better)
    return dict(zip(CASES, of, strict=True))


def _by_distance_and_ttc(lessons: Life, tests: Life) -> tuple[Mask, Array]:
    """R's map: outcomes and expectations (trials, taxels) 0.15 s before the end."""
    D, TTC, touched = at_horizon(tests.approaches)
    return touched, CountTable(MemoryParams()).fit(*samples(lessons.approaches))(D, TTC)


def _by_displacement(lessons: Life, tests: Life) -> tuple[Mask, Array]:
    """The same by where paths pass."""
    params = ContactParams()
    found = predict_contact(params, learn_contact(params, lessons.displaced), tests.displaced)
    return np.array([trial.touched for trial in tests.displaced]), found.probability


WAYS: dict[str, Callable[[Life, Life], tuple[Mask, Array]]] = {
    "D and TTC (R)": _by_distance_and_ttc,
    "displacement": _by_displacement,
}


def _prediction(perfect: Lives, robots: list[tuple[Lives, Lives]]) -> dict[str, Any]:
    """How far off things are seen before and after their encoders are known; by way and case the scores; means over
    robots, on the taxels of the part that is approached."""
    off = [[error_mm(perfect[1], lives[1]) for lives in robot] for robot in robots]
    found: dict[str, Any] = dict(zip(("error_mm", "error_left_mm"), np.mean(off, axis=0).tolist(), strict=True))
    for way, expects in WAYS.items():
        scores = [
            [(auroc(y, p), brier(y, p)) for y, p in (expects(*of) for of in _by_case(perfect, *robot).values())]
            for robot in robots
        ]
        means = dict(zip(CASES, np.mean(scores, axis=0).tolist(), strict=True))
        found[way] = {case: {"auroc": mean[0], "brier": mean[1]} for case, mean in means.items()}
    return found


def _sources(axis: Axes, prediction: dict[str, Any], way: str) -> None:
    names = list(prediction)[::-1]
    for y, name in enumerate(names):
        scores = {case: prediction[name][way][case]["auroc"] for case in CASES}
        axis.plot(list(scores.values()), [y] * len(CASES), color="0.85", lw=2, zorder=1)
        for case, score in scores.items():
            axis.plot(score, y, "o", color=COLORS[case], ms=7, label=case if y == 0 else None)
    labels = (f"{n}\n({prediction[n]['error_mm']:.0f} → {prediction[n]['error_left_mm']:.0f} mm off)" for n in names)
    axis.set_yticks(range(len(names)), list(labels))
    every = [prediction[name][w][case]["auroc"] for name in names for w in WAYS for case in CASES]
    axis.set_xlim(min(every) - 0.01, max(every) + 0.01)
    axis.set_title(way, fontsize=10)
    axis.set_xlabel("AUROC on trials held out, 0.15 s before the end")
    axis.grid(alpha=0.25, axis="x")
