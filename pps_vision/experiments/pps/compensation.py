"""What a robot's errors cost its predictions, and what learning with them recovers, for each of R's error sources.

D and TTC do not contain an error across the approach. The remedy beside R's map is to estimate the encoder offsets from
the same touches (`learning/pps/joint_offsets.py`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.pps.trials import TouchTrial
from pps_vision.experiments.charts import bars, panels
from pps_vision.experiments.pps.movements import TRIALS
from pps_vision.experiments.pps.perceived import in_taxel_frames
from pps_vision.experiments.pps.predictors import Trials, by_map, scored
from pps_vision.experiments.pps.robot_errors import SOURCES, ErringRobot, ErrorSources, only
from pps_vision.experiments.pps.trials import exact_trials
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table, estimate

Sets = tuple[Trials, Trials]
"""Training and test trials."""
CASES = ("no errors", "errors, map trained without", "errors, map trained with", "encoder offsets estimated too")


@dataclass(frozen=True)
class Compensation(SampledStudy):
    """AUROC 0.15 s before the touch with R's five error sources, one by one and together, before and after learning.

    R: "the learned representations automatically compensate".
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"n_single": 1}

    n: int = 20
    """Robots with all sources together."""
    n_single: int = 3
    """Robots for each source alone."""

    def run(self) -> dict[str, Any]:
        """Return scores by source and case, with 95 % over robots."""
        training, test = (in_taxel_frames(exact_trials("inner", TRIALS["inner"], self.seed + i)) for i in (0, 1))
        sources = {**{name: only(name) for name in SOURCES}, "all": ErrorSources()}
        found: dict[str, Any] = {}
        for name, of in tqdm(sources.items(), desc="errors", unit="source", disable=None):
            robots = [self._observed(of, k) for k in range(self.n if name == "all" else self.n_single)]
            found[name] = {
                case: scored(by_map, [cases((training, test), *robot)[case] for robot in robots]) for case in CASES
            }
        return {"sources": found}

    def _observed(self, sources: ErrorSources, k: int) -> tuple[Sets, Sets]:
        """Training and test trials as robot `k` perceives them, without and with its encoder offsets estimated."""
        robot = ErringRobot.draw(sources, np.random.default_rng((self.seed, k)))
        erring = self._observe(robot, k)
        sets = erring, self._observe(robot.calibrated(erring[0]), k)
        without, calibrated = (
            (in_taxel_frames(training, robot.model, robot.skin), in_taxel_frames(test, robot.model, robot.skin))
            for training, test in sets
        )
        return without, calibrated

    def _observe(self, robot: ErringRobot, k: int) -> tuple[list[TouchTrial], list[TouchTrial]]:
        """Training and test trials as a robot observes them; the same slack of robot `k` each time."""
        rng = np.random.default_rng((self.seed, k, 1))
        training, test = (exact_trials("inner", TRIALS["inner"], self.seed + i) for i in (0, 1))
        return [robot.observe(t, True, rng) for t in training], [robot.observe(t, True, rng) for t in test]

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw AUROC by source and case."""
        figure, (axis,) = panels(1, width=9.0)
        series = {case: [scores[case]["auroc"] for scores in numbers["sources"].values()] for case in CASES}
        bars(axis, list(numbers["sources"]), series, "AUROC (95 % over robots)")
        axis.set_ylim(0.5, 1)
        axis.legend(fontsize=8, ncols=2)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return both scores with all sources together, and the Brier score above that without errors."""
        scores = numbers["sources"]["all"]
        best = scores["no errors"]["brier"][0]
        rows = []
        for case in CASES:
            brier = scores[case]["brier"]
            above = "–" if case == "no errors" else estimate([value - best for value in brier], 2)
            rows.append([case, estimate(scores[case]["auroc"]), estimate(brier), above])
        return {"": Table(["all five sources", "AUROC", "Brier score", "above that without errors"], rows)}


def cases(perfect: Sets, erring: Sets, calibrated: Sets) -> dict[str, Sets]:
    """Return training and test trials of each of `CASES`."""
    return dict(zip(CASES, (perfect, (perfect[0], erring[1]), erring, calibrated), strict=True))
