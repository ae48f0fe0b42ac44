"""R Fig 8: systematic offsets of the taxels, read from their maps, on robots whose errors are known.

The offset is where the regression line through the positive samples crosses TTC = 0. Here TTC is the time that was left
to the touch, known once the touch has happened. TTC as perceived beforehand (R eq. 2) cannot show an error along the
approach, which shifts D and TTC alike; R's weights and that TTC are measured beside.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.pps.memory import MemoryParams, PPSMemory, count_samples
from learning.pps.trials import TouchTrial
from pps_vision.experiments.baselines.single_taxel import empty_map
from pps_vision.experiments.charts import bars, panels
from pps_vision.experiments.pps.movements import TRIALS, SessionName
from pps_vision.experiments.pps.perceived import Session, perceive, train_memory
from pps_vision.experiments.pps.robot_errors import ErringRobot, ErrorSources
from pps_vision.experiments.pps.taxel_offsets import offsets
from pps_vision.experiments.pps.taxel_trials import Trial
from pps_vision.experiments.pps.trials import exact_trials
from pps_vision.experiments.study import SampledStudy, interval, mean, median, percent
from pps_vision.experiments.tables import Table, estimate

PAPER_MM: dict[SessionName, float] = {"inner": 21.1, "outer": 17.3, "palm": 11.6}
METHODS = {
    "found": "positive samples, time left",
    "weighted_by_f": "weights f (R)",
    "perceived_ttc": "TTC as perceived",
}
MIN_TOUCHES = 5
LAST = MemoryParams(distance_range_m=(-0.15, 0.20), ttc_range_s=(-0.025, 0.225), bins=(140, 5))
"""The last 0.2 s, before which hands slow down; samples come every 50 ms and lie in the middle of a TTC bin."""
_SAMPLED = ("stamps_s", "joints_rad", "positions", "velocities", "velocity_covs", "radius_m")


@dataclass(frozen=True)
class Offsets(SampledStudy):
    """Offset of each taxel estimated from its map, against the true distance perceived at the touch (R Fig 8)."""

    def run(self) -> dict[str, Any]:
        """Return, by part, the mean offsets, and the error of each method; 95 % intervals over robots."""
        robots = [[row for part in PAPER_MM for row in self._taxels(part, k)] for k in range(self.n)]
        errors = {m: [[abs(row[m] - row["true"]) for row in rows] for rows in robots] for m in METHODS}
        return {
            "taxels": sum(map(len, robots)),
            "parts": {
                part: {
                    "found_mm": interval([[row["found"] for row in rows if row["part"] == part] for rows in robots]),
                    "true_mm": mean(np.array([row["true"] for rows in robots for row in rows if row["part"] == part])),
                    "paper_mm": paper_mm,
                }
                for part, paper_mm in PAPER_MM.items()
            },
            "methods": {
                m: {
                    "error_median_mm": interval(of, median),
                    "within_3_mm_percent": interval([np.array(one) <= 3 for one in of], percent),
                }
                for m, of in errors.items()
            },
        }

    def _taxels(self, part: SessionName, number: int) -> list[dict[str, Any]]:
        """True and estimated offsets in mm of the taxels that one robot's session touches often enough."""
        rng = np.random.default_rng((self.seed, number))
        robot = ErringRobot.draw(ErrorSources(), rng)
        trials = [robot.observe(_end(t), True, rng) for t in exact_trials(part, TRIALS[part], self.seed)]
        session = Session.of(part, trials, robot.model, robot.skin)
        memory = by_time_left(session.trials)
        found = {
            "found": offsets(memory),
            "weighted_by_f": offsets(memory, memory.frequency),
            "perceived_ttc": offsets(train_memory(session.trials)),
        }
        at_touch = np.array([np.where(one.touched, perceive(one)[0][-1], np.nan) for one in session.trials])
        enough = (np.isfinite(at_touch).sum(axis=0) >= MIN_TOUCHES) & np.isfinite(found["found"])
        return [
            {"part": part, "true": 1000 * float(np.nanmean(at_touch[:, i]))}
            | {method: 1000 * float(values[i]) for method, values in found.items()}
            for i in np.flatnonzero(enough)
        ]

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw the mean offset of each part: estimated, true, and R's on the robot."""
        figure, (axis,) = panels(1, width=5.6)
        parts = numbers["parts"]
        series = {
            "estimated (95 % over robots)": [of["found_mm"] for of in parts.values()],
            "true": [of["true_mm"] for of in parts.values()],
            "R, on the robot": [of["paper_mm"] for of in parts.values()],
        }
        bars(axis, list(parts), series, "mean offset to the object's centre (mm)")
        axis.legend(fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the error of each method."""
        rows = [
            [METHODS[m], estimate(of["error_median_mm"]), estimate(of["within_3_mm_percent"])]
            for m, of in numbers["methods"].items()
        ]
        return {"": Table([f"{numbers['taxels']} taxels", "median error (mm)", "within 3 mm (%)"], rows)}


def _end(trial: TouchTrial) -> TouchTrial:
    """The last samples of a trial, the only ones counted here."""
    last = trial.stamps_s >= trial.stamps_s[-1] - 2 * LAST.ttc_range_s[1]
    return replace(trial, **{name: getattr(trial, name)[last] for name in _SAMPLED})


def by_time_left(trials: Sequence[Trial]) -> PPSMemory:
    """Return the map of D and the time left to the touch."""
    memory = empty_map(len(trials[0].touched), LAST)
    for trial in trials:
        D, _ = perceive(trial)
        left_s = np.broadcast_to((trial.stamps_s[-1] - trial.stamps_s)[:, None], D.shape)
        memory = count_samples(memory, D, left_s, trial.touched)
    return memory
