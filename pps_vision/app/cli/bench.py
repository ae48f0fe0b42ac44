"""`pps-vision bench`: the experiments, each measured afresh on the seed that is asked for."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated

from tyro.conf import subcommand

from pps_vision.experiments import parameters
from pps_vision.experiments.experiment import Experiment, Series
from pps_vision.experiments.pps.series import Pps
from pps_vision.experiments.reach.series import Reach


@dataclass(frozen=True)
class Bench:
    """Run an experiment, print its numbers, and write them with machine, versions, seed and commit."""

    experiment: (
        Annotated[parameters.Loop, subcommand("loop")]
        | Annotated[parameters.Tracking, subcommand("tracking")]
        | Annotated[parameters.Fixation, subcommand("fixation")]
        | Annotated[parameters.Real, subcommand("real")]
        | Annotated[parameters.Trigger, subcommand("trigger")]
        | Annotated[parameters.Fidelity, subcommand("fidelity")]
        | Annotated[parameters.ImageTracker, subcommand("imagetracker")]
        | Annotated[parameters.Batches, subcommand("batches")]
        | Annotated[parameters.Pipeline, subcommand("pipeline")]
        | Annotated[parameters.Failures, subcommand("failures")]
        | Annotated[parameters.Budget, subcommand("budget")]
        | Annotated[parameters.Triangulation, subcommand("triangulation")]
        | Annotated[parameters.Stereo, subcommand("stereo")]
        | Annotated[parameters.Soak, subcommand("soak")]
        | Annotated[parameters.Filter, subcommand("filter")]
        | Annotated[parameters.Consistency, subcommand("consistency")]
        | Annotated[parameters.Independent, subcommand("independent")]
        | Annotated[Pps, subcommand("pps")]
        | Annotated[Reach, subcommand("reach")]
    )
    out: Path | None = None
    """Where to write the JSON; default: docs/results/NAME.json under the present folder.  Each part of a series
    has its own name appended."""
    figure: Path | None = None
    """Where to write the chart, if the experiment has one; default: docs/figures/NAME.png; of several charts
    each has its own name appended."""

    def run(self) -> None:
        """Measure and write; of a series, what this code has not yet measured with the same parameters."""
        from pps_vision.app.bench import bench

        asked = self.experiment
        bench(asked if isinstance(asked, Series) else study(asked), self.out, self.figure)


def study(asked: object) -> Experiment:
    """Return the study of these parameters, the class of the same name in `pps_vision.experiments`."""
    name = type(asked).__name__
    module = {"ImageTracker": "image_tracker"}.get(name, name.lower())
    made: Experiment = getattr(import_module(f"pps_vision.experiments.{module}"), name)(**vars(asked))
    return made
