"""Which representation of touch to take: error and calibration against trials and milliseconds.

Every method learns from the same trials of a session and predicts later ones, or a quarter from the other three; the
base rate learns from these trials too.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.pps.movements import TRIALS
from pps_vision.experiments.pps.perceived import HORIZON_S, Session, in_taxel_frames
from pps_vision.experiments.pps.predictors import (
    Predictor,
    Trials,
    by_base_rate,
    by_half_windows,
    by_map,
    by_shrunk_map,
    by_trees,
    by_trees_of_distance_and_ttc,
    in_blocks,
    outcomes,
)
from pps_vision.experiments.pps.robot_errors import ErringRobot, ErrorSources
from pps_vision.experiments.pps.scores import auroc, brier, brier_gain, expected_calibration_error
from pps_vision.experiments.pps.taxel_trials import load_trials
from pps_vision.experiments.pps.trials import SessionStudy, exact_trials
from pps_vision.experiments.study import DATA
from pps_vision.experiments.tables import Table, estimate
from pps_vision.experiments.timing import timed
from pps_vision.types import Array

BASE_RATE = "base rate"
METHODS: dict[str, Predictor] = {
    BASE_RATE: by_base_rate,
    "R's map, 8×4": by_map,
    "16×8, half the window": by_half_windows,
    "R's map, shrunk to the base rate": by_shrunk_map,
    "gradient-boosted trees": by_trees,
    "gradient-boosted trees, D and TTC only": by_trees_of_distance_and_ttc,
}
SIZES, LATER, BLOCKS = (6, 12, 24), 13, 4
Sessions = dict[str, list[Trials]]


@dataclass(frozen=True)
class Representations(SessionStudy):
    """Touches predicted 0.15 s ahead by every representation, on simulated, rendered and real sessions.

    Simulated: robots with R's sources of error, objects known up to them. Rendered: one session, tracked. Real: the
    authors' 37 trials.
    """

    n: int = 8
    """Simulated robots, each with its own errors and movements."""
    data: Path = DATA
    """Folder of pps_real_robot (default: PPS_VISION_DATA, else ../shared/data)."""

    def run(self) -> dict[str, Any]:
        """Return the scores by source and method, and the times; real trials only where they are."""
        sessions: Sessions = {
            "simulated": [self._simulated(k) for k in range(self.n)],
            "rendered": [in_taxel_frames(self.seen("inner"))],
        }
        path = self.data / "pps_real_robot" / "trials_forearm_internal.npz"
        if path.exists():
            sessions["real"] = [load_trials(path)]
        return {
            "sources": {
                source: {
                    "trials": sum(map(len, of)),
                    "sessions": len(of),
                    "methods": _scores(of),
                }
                for source, of in sessions.items()
            },
            "ms": {name: _milliseconds(method, sessions["simulated"][0]) for name, method in METHODS.items()},
        }

    def _simulated(self, number: int) -> Trials:
        """A session of the inner forearm as a robot with errors perceives it."""
        rng = np.random.default_rng((self.seed, number))
        robot = ErringRobot.draw(ErrorSources(), rng)
        made = exact_trials("inner", self.size(TRIALS["inner"]), self.seed + number)
        return Session.of("inner", [robot.observe(t, True, rng) for t in made], robot.model, robot.skin).trials

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw, by source, the Brier score over the training trials, and gain and calibration over the time."""
        sources, methods = numbers["sources"], list(numbers["ms"])
        figure = Figure(figsize=(3.6 * len(sources), 8.4), layout="constrained")
        axes = figure.subplots(3, len(sources), squeeze=False, sharex="row")
        for column, (source, of) in enumerate(sources.items()):
            top, middle, bottom = axes[:, column]
            for k, name in enumerate(methods):
                one, color, ms = of["methods"][name], f"C{k}", numbers["ms"][name]["predict"]
                top.plot(SIZES, one["later"], "o-", color=color, label=name, ms=4)
                low, high = one["gain"][1:]
                gain = one["gain"][0]
                middle.errorbar(ms, gain, [[gain - low], [high - gain]], fmt="o", color=color, ms=5, capsize=2)
                bottom.plot(ms, one["calibration_error"], "o", color=color)
            top.set(
                title=f"{source}, {of['sessions']} × {of['trials'] // of['sessions']} trials", xlabel="trials learned"
            )
            middle.axhline(0, color="0.5", lw=0.8)
            for axis in (middle, bottom):
                axis.set(xscale="log", xlabel="ms per prediction of an approach")
        for axis, label in zip(axes[:, 0], _LABELS, strict=True):
            axis.set_ylabel(label)
        for axis in axes.ravel():
            axis.grid(alpha=0.25)
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the gain on the base rate and the calibration by source, and the times."""
        sources = numbers["sources"]
        rows = []
        for name in numbers["ms"]:
            cells = [
                cell
                for of in sources.values()
                for cell in (estimate(of["methods"][name]["gain"]), f"{of['methods'][name]['calibration_error']:.3f}")
            ]
            ms = numbers["ms"][name]
            rows.append([name, *cells, f"{ms['learn']:.3g}", f"{ms['predict']:.3g}"])
        head = [f"{source}: {what}" for source in sources for what in ("below the base rate's", "calibration error")]
        return {"": Table(["Brier score, by quarters", *head, "learn 40 trials (ms)", "predict one (ms)"], rows)}


_TIMED = 5
_LABELS = ("Brier score of the last 13 trials", "Brier score below the base rate's", "expected calibration error")


def _scores(sessions: list[Trials]) -> dict[str, dict[str, Any]]:
    """Scores of every method by quarters, and of the last trials of each session by the number of first trials learned.

    The paired differences of Brier scores are over the robots, each with its own movements, or over the trials of one.
    """
    touched = np.concatenate([outcomes(trials) for trials in sessions])
    predicted = {
        name: np.concatenate([in_blocks(method, trials, HORIZON_S, BLOCKS) for trials in sessions])
        for name, method in METHODS.items()
    }
    units = (len(sessions), -1) if len(sessions) > 1 else touched.shape

    def gain(p: Array, reference: Array) -> list[float]:
        return list(brier_gain(*(a.reshape(units) for a in (touched, p, reference))))

    return {
        name: {
            "brier": brier(touched, p),
            "auroc": auroc(touched, p),
            "gain": gain(p, predicted[BASE_RATE]),
            "calibration_error": expected_calibration_error(touched, p),
            "later": [_later(METHODS[name], sessions, size) for size in SIZES],
        }
        for name, p in predicted.items()
    }


def _later(method: Predictor, sessions: list[Trials], size: int) -> float:
    """Mean Brier score of the last trials of each session after learning from its first `size`."""
    found = []
    for trials in sessions:
        first, test = early_and_late(trials, size)
        found.append(brier(outcomes(test), method(first, test, HORIZON_S)))
    return float(np.mean(found))


def early_and_late(trials: Trials, size: int) -> tuple[Trials, Trials]:
    """Return the first `size` trials and the last 13 (of fewer than 26: the last half), which do not overlap."""
    n_late = min(LATER, len(trials) // 2)
    return trials[: min(size, len(trials) - n_late)], trials[-n_late:]


def _milliseconds(method: Predictor, trials: Trials) -> dict[str, float]:
    """Median processor time to learn from all but the last 13 trials, and to predict one more."""
    first, test = trials[:-LATER] or trials, trials[-LATER:]

    one, many = (
        float(np.median([timed(partial(method, first, some, HORIZON_S))[1] for _ in range(_TIMED)]))
        for some in (test[:1], test)
    )
    return {"learn": one, "predict": max((many - one) / max(len(test) - 1, 1), 1e-3)}
