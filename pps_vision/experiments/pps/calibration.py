"""Do predicted probabilities come true? Held-out rendered approaches, 0.15 s before their end."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments import charts
from pps_vision.experiments.pps.perceived import HORIZON_S, in_taxel_frames
from pps_vision.experiments.pps.predictors import (
    Predictor,
    Score,
    Trials,
    by_base_rate,
    by_fine_map,
    by_landing,
    by_map,
    corrected,
    outcomes,
    score_interval,
)
from pps_vision.experiments.pps.scores import auroc, brier, expected_calibration_error
from pps_vision.experiments.pps.trials import SessionStudy
from pps_vision.experiments.study import percent_of
from pps_vision.experiments.tables import Table, estimate
from pps_vision.types import Array, Mask

HELD_OUT, BINS = 40, 10
AUROC_GOAL, ERROR_GOAL = 0.95, 0.05
METHODS: dict[str, Predictor] = {
    "base rate": by_base_rate,
    "R's map": by_map,
    "R's map, corrected": corrected(by_map),
    "fine map, corrected": corrected(by_fine_map),
    "landing point": by_landing,
}
SHOWN = ("R's map", "fine map, corrected")


@dataclass(frozen=True)
class Calibration(SessionStudy):
    """Calibration of predicted touches of 12 forearm taxels on 40 held-out approaches after training on 53.

    The approaches are rendered and tracked; those held out have the next seed. Goals: AUROC 0.95, expected calibration
    error 0.05. Intervals are over the held-out approaches.
    """

    def run(self) -> dict[str, Any]:
        """Return scores and the reliability diagram by method."""
        training, test = self.seen("inner"), self.seen("inner", HELD_OUT, further=1)
        return {"n": len(test), "methods": evaluate(in_taxel_frames(training), in_taxel_frames(test))}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw the reliability of R's map and of the corrected fine map."""
        figure, (axis,) = charts.panels(1, width=5.2)
        stated = 100 * (np.arange(BINS) + 0.5) / BINS
        charts.calibration(
            axis, stated.tolist(), {m: numbers["methods"][m]["touched_percent"] for m in SHOWN}, "touched (%)"
        )
        axis.legend(fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the scores by method."""
        keys, rows = ("auroc", "brier", "calibration_error"), []
        for method, of in numbers["methods"].items():
            scores = of["scores"]
            meets = scores["auroc"][0] >= AUROC_GOAL and scores["calibration_error"][0] <= ERROR_GOAL
            rows.append([method, *(estimate(scores[key]) for key in keys), "yes" if meets else "no"])
        return {"": Table(["", "AUROC", "Brier score", "calibration error", "meets both goals"], rows)}


def evaluate(training: Trials, test: Trials) -> dict[str, dict[str, Any]]:
    """Return the scores of every method, and the share touched by tenths of the probability."""
    touched, p = outcomes(test), {name: predict(training, test, HORIZON_S) for name, predict in METHODS.items()}
    return {name: {"scores": scores(touched, of), "touched_percent": shares(touched, of)} for name, of in p.items()}


def scores(touched: Mask, p: Array) -> dict[str, list[float]]:
    """Return AUROC, Brier score and expected calibration error of probabilities (trials, taxels), each with its 95 %
    interval over the trials."""
    functions: dict[str, Score] = {"auroc": auroc, "brier": brier, "calibration_error": expected_calibration_error}
    return {name: score_interval(score, touched, p) for name, score in functions.items()}


def shares(touched: Mask, p: Array) -> list[list[float] | None]:
    """Return the share touched (percent, with Wilson's interval, which takes taxels as independent) by tenths of the
    probability; None of a tenth without any."""
    tenth = np.minimum((BINS * p).astype(int), BINS - 1)
    of_tenths = [touched[tenth == k] for k in range(BINS)]
    return [percent_of(int(some.sum()), some.size) if some.size else None for some in of_tenths]
