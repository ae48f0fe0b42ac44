"""What a robot's errors cost its predictions, and what learning with them recovers, for each of R's error sources.

D and TTC do not contain an error across the approach. Two remedies stand beside R's map: the displacement from each
taxel, in which a constant error cancels (`learning/pps/contact.py`), and encoder offsets estimated from the same
touches (`learning/pps/joint_offsets.py`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.pps.contact import ContactParams, learn_contact, predict_contact
from learning.pps.scores import auroc, brier
from pps_vision.experiments.charts import bars, panels
from pps_vision.experiments.pps.movements import TRIALS
from pps_vision.experiments.pps.predictors import predict_by_map
from pps_vision.experiments.pps.robot_errors import (
    SOURCES,
    ErringRobot,
    ErrorSources,
    ObservedTrials,
    displacement_error_mm,
    only,
)
from pps_vision.experiments.pps.trials import exact_trials
from pps_vision.experiments.study import Study, interval
from pps_vision.experiments.tables import Table, estimate
from pps_vision.types import Array

CASES = ("no errors", "errors, map trained without", "errors, map trained with", "encoder offsets estimated too")
Sets = tuple[ObservedTrials, ObservedTrials]
"""Training and test trials of one robot."""


def _by_map(training: ObservedTrials, test: ObservedTrials) -> Array:
    return predict_by_map(training.perceived, test.perceived)


def _by_displacement(training: ObservedTrials, test: ObservedTrials) -> Array:
    params = ContactParams()
    return predict_contact(params, learn_contact(params, training.displacements), test.displacements).probability


METHODS: dict[str, Callable[[ObservedTrials, ObservedTrials], Array]] = {
    "map": _by_map,
    "displacement": _by_displacement,
}


@dataclass(frozen=True)
class Compensation(Study):
    """AUROC 0.15 s before the touch with R's five error sources, one by one and together, before and after learning.

    R: "the learned representations automatically compensate".
    """

    seed: int = 0
    """Seed of trials and errors."""
    n: int = 3
    """Robots for each source."""

    def run(self) -> dict[str, Any]:
        """Return, by source, the position error in mm before and after calibration, and scores by method and case."""
        perfect = self._observe(ErringRobot.draw(only(), np.random.default_rng(self.seed)), 0)
        sources = {**{name: only(name) for name in SOURCES}, "all": ErrorSources()}
        found = {
            name: compare_cases(perfect, [self._robot(of, k) for k in range(self.n)])
            for name, of in tqdm(sources.items(), desc="errors", unit="source", disable=None)
        }
        return {"sources": found}

    def _robot(self, sources: ErrorSources, k: int) -> tuple[Sets, Sets]:
        """Trials of robot `k`, and the same with its encoder offsets estimated."""
        erring = self._observe(ErringRobot.draw(sources, np.random.default_rng((self.seed, k))), k)
        return erring, self._observe(erring[0].corrected_robot(), k)

    def _observe(self, robot: ErringRobot, k: int) -> Sets:
        rng = np.random.default_rng((self.seed, k, 1))
        trials = (exact_trials("inner", TRIALS["inner"], self.seed + i) for i in (0, 1))
        training, test = (ObservedTrials.of(robot, some, rng) for some in trials)
        return training, test

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw AUROC by source and case, for each method."""
        figures = {}
        for method in METHODS:
            figures[method], (axis,) = panels(1, width=9.0)
            series = {case: [of[method][case]["auroc"] for of in numbers["sources"].values()] for case in CASES}
            bars(axis, list(numbers["sources"]), series, "AUROC (95 % over robots)")
            axis.set_ylim(0.5, 1)
            axis.legend(fontsize=8, ncols=2)
        return figures

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return both scores with all sources together."""
        rows = [
            [
                f"{method}: {case}",
                *(estimate(numbers["sources"]["all"][method][case][key]) for key in ("auroc", "brier")),
            ]
            for method in METHODS
            for case in CASES
        ]
        return {"": Table(["all five sources", "AUROC", "Brier score"], rows)}


def compare_cases(perfect: Sets, robots: list[tuple[Sets, Sets]]) -> dict[str, Any]:
    """Return position errors and scores by method and case, with 95 % over robots."""
    errors = [[displacement_error_mm(perfect[1], sets[1]) for sets in robot] for robot in robots]
    found: dict[str, Any] = {
        name: interval([[row[k]] for row in errors]) for k, name in enumerate(("error_mm", "error_after_mm"))
    }
    for method, predict in METHODS.items():
        by_robot = [[_scores(predict, *of) for of in cases(perfect, *robot)] for robot in robots]
        found[method] = {
            case: {key: interval([[row[k][key]] for row in by_robot]) for key in ("auroc", "brier")}
            for k, case in enumerate(CASES)
        }
    return found


def cases(perfect: Sets, erring: Sets, corrected: Sets) -> tuple[Sets, ...]:
    """Return training and test trials of each of `CASES`."""
    return perfect, (perfect[0], erring[1]), erring, corrected


def _scores(predict: Callable[..., Array], training: ObservedTrials, test: ObservedTrials) -> dict[str, float]:
    p, touched = predict(training, test), np.array([trial.touched for trial in test.perceived])
    return {"auroc": auroc(touched, p), "brier": brier(touched, p)}
