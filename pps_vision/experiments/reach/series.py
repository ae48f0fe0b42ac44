"""The figures and tables of reachable space (Jamone et al. 2013), each also alone."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from tyro.conf import Positional

from pps_vision.experiments.experiment import Experiment

FigureName = Literal[
    "lwpr",
    "forward_model",
    "regressors",
    "babbling_failures",
    "map_failures",
    "maps",
    "solvers",
    "planning",
    "whole_paper",
    "measures",
    "in_loop",
]


@dataclass(frozen=True)
class Reach:
    """All of reachable space: figures and tables of the paper and what goes past it.

    Without a name all are made, one after another; what this very code has already measured with the
    same parameters is not measured again, so that an interrupted run goes on where it stopped.
    """

    figure: Annotated[FigureName | None, Positional] = None
    """Only this one."""
    seed: int = 0
    """Seed of whatever is random."""

    def parts(self) -> dict[str, Experiment]:
        """The experiments asked for, by name."""
        from pps_vision.experiments.reach.failures import BabblingFailures
        from pps_vision.experiments.reach.forward_model import ForwardModelError
        from pps_vision.experiments.reach.in_loop import InLoop
        from pps_vision.experiments.reach.lwpr import CrossFunction
        from pps_vision.experiments.reach.map_failures import MapFailures
        from pps_vision.experiments.reach.maps import Maps
        from pps_vision.experiments.reach.measures import Measures
        from pps_vision.experiments.reach.planning import Planning
        from pps_vision.experiments.reach.regressors import Regressors
        from pps_vision.experiments.reach.solvers import Solvers
        from pps_vision.experiments.reach.whole_paper import WholePaper

        makers: Mapping[str, Callable[[], Experiment]] = {
            "lwpr": lambda: CrossFunction(self.seed),
            "forward_model": lambda: ForwardModelError(self.seed),
            "regressors": lambda: Regressors(self.seed),
            "babbling_failures": lambda: BabblingFailures(self.seed),
            "map_failures": lambda: MapFailures(self.seed),
            "maps": lambda: Maps(self.seed),
            "solvers": lambda: Solvers(self.seed),
            "planning": lambda: Planning(self.seed),
            "whole_paper": lambda: WholePaper(self.seed),
            "measures": lambda: Measures(self.seed),
            "in_loop": lambda: InLoop(self.seed),
        }
        return {name: makers[name]() for name in get_args(FigureName) if self.figure in (None, name)}
