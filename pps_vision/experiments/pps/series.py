"""The figures and tables of peripersonal space (Roncone et al. 2016), each also alone."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

from tyro.conf import Positional

from pps_vision.experiments.experiment import DATA, Experiment

FigureName = Literal[
    "monte_carlo",
    "authors_counts",
    "one_trial",
    "real_trials",
    "whole_skin",
    "failures",
    "offsets",
    "without_ttc",
    "double_touch",
    "landscapes",
    "progress",
    "table5",
    "calibration",
    "invariance",
    "compensation",
]


@dataclass(frozen=True)
class Pps:
    """All of peripersonal space: figures and tables of the paper and what goes past it.

    Without a name all are made, one after another; what this very code has already measured with the
    same parameters is not measured again, so that an interrupted run goes on where it stopped.
    """

    figure: Annotated[FigureName | None, Positional] = None
    """Only this one."""
    seed: int = 0
    """Seed of whatever is random."""
    trials: Path = Path("build") / "pps"
    """Folder that keeps rendered trials, which several figures share."""
    data: Path = DATA
    """Folder that holds pps_real_robot (default: PPS_VISION_DATA, else ../shared/data)."""

    def parts(self) -> dict[str, Experiment]:
        """The experiments asked for, by name."""
        from pps_vision.experiments.pps.authors_counts import AuthorsCounts
        from pps_vision.experiments.pps.calibration import Calibration
        from pps_vision.experiments.pps.compensation import Compensation
        from pps_vision.experiments.pps.double_touches import DoubleTouches
        from pps_vision.experiments.pps.failures import PpsFailures
        from pps_vision.experiments.pps.invariance import Invariance
        from pps_vision.experiments.pps.landscapes import Landscapes
        from pps_vision.experiments.pps.monte_carlo import MonteCarlo
        from pps_vision.experiments.pps.offsets import Offsets
        from pps_vision.experiments.pps.one_trial import OneTrial
        from pps_vision.experiments.pps.progress import Progress
        from pps_vision.experiments.pps.real_trials import RealTrials
        from pps_vision.experiments.pps.table5 import Table5
        from pps_vision.experiments.pps.whole_skin import WholeSkin
        from pps_vision.experiments.pps.without_ttc import WithoutTtc

        makers: Mapping[str, Callable[[], Experiment]] = {
            "monte_carlo": lambda: MonteCarlo(self.seed),
            "authors_counts": lambda: AuthorsCounts(self.data),
            "one_trial": lambda: OneTrial(self.seed),
            "real_trials": lambda: RealTrials(self.data, self.seed),
            "whole_skin": lambda: WholeSkin(self.seed),
            "failures": lambda: PpsFailures(self.seed),
            "offsets": lambda: Offsets(seed=self.seed),
            "without_ttc": lambda: WithoutTtc(self.seed),
            "double_touch": lambda: DoubleTouches(self.seed),
            "landscapes": lambda: Landscapes(self.seed, self.trials),
            "progress": lambda: Progress(self.seed, self.trials),
            "table5": lambda: Table5(self.seed, self.trials),
            "calibration": lambda: Calibration(self.seed, self.trials),
            "invariance": lambda: Invariance(self.seed, trials=self.trials),
            "compensation": lambda: Compensation(seed=self.seed),
        }
        return {name: makers[name]() for name in get_args(FigureName) if self.figure in (None, name)}
