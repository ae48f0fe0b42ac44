"""`pps-vision bench`: the experiments, each measured afresh on the seed that is asked for."""

import platform
import subprocess
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

from matplotlib.figure import Figure
from tyro.conf import subcommand

from pps_vision.app.figures import save
from pps_vision.experiments.batches import Batches
from pps_vision.experiments.budget import Budget
from pps_vision.experiments.consistency import Consistency
from pps_vision.experiments.failures import Failures
from pps_vision.experiments.fidelity import Fidelity
from pps_vision.experiments.filter import Filter
from pps_vision.experiments.fixation import Fixation
from pps_vision.experiments.image_tracker import ImageTracker
from pps_vision.experiments.loop import Loop
from pps_vision.experiments.pipeline import Pipeline
from pps_vision.experiments.real import Real
from pps_vision.experiments.soak import Soak
from pps_vision.experiments.stereo import Stereo
from pps_vision.experiments.tracking import Tracking
from pps_vision.experiments.triangulation import Triangulation
from pps_vision.experiments.trigger import Trigger
from pps_vision.recordings.outputs import whole_file
from pps_vision.recordings.results import write_summary


@runtime_checkable
class Charted(Protocol):
    """An experiment that draws the numbers it measured."""

    def chart(self, numbers: dict[str, Any]) -> Figure | dict[str, Figure]:
        """The chart of what `run` returned, or several by their names."""
        ...


@dataclass(frozen=True)
class Bench:
    """Run an experiment, print its numbers, and write them with machine, versions, seed and commit."""

    experiment: (
        Annotated[Loop, subcommand("loop")]
        | Annotated[Tracking, subcommand("tracking")]
        | Annotated[Fixation, subcommand("fixation")]
        | Annotated[Real, subcommand("real")]
        | Annotated[Trigger, subcommand("trigger")]
        | Annotated[Fidelity, subcommand("fidelity")]
        | Annotated[ImageTracker, subcommand("imagetracker")]
        | Annotated[Batches, subcommand("batches")]
        | Annotated[Pipeline, subcommand("pipeline")]
        | Annotated[Failures, subcommand("failures")]
        | Annotated[Budget, subcommand("budget")]
        | Annotated[Triangulation, subcommand("triangulation")]
        | Annotated[Stereo, subcommand("stereo")]
        | Annotated[Soak, subcommand("soak")]
        | Annotated[Filter, subcommand("filter")]
        | Annotated[Consistency, subcommand("consistency")]
    )
    out: Path | None = None
    """Where to write the JSON; default: docs/results/NAME.json under the present folder."""
    figure: Path | None = None
    """Where to write the chart, if the experiment has one; default: docs/figures/NAME.png; of several charts
    each has its own name appended."""

    def run(self) -> None:
        """Measure and write."""
        name = type(self.experiment).__name__.lower()
        out = self.out or Path("docs") / "results" / f"{name}.json"
        setting = {"experiment": name, "parameters": asdict(self.experiment), "machine": _machine()}
        with whole_file(out) as partial:
            numbers = self.experiment.run()
            write_summary(partial, {**setting, **numbers})
            print(partial.read_text(), end="")
        print(f"→ {out}")
        if isinstance(self.experiment, Charted):
            png = self.figure or Path("docs") / "figures" / f"{name}.png"
            chart = self.experiment.chart(numbers)
            charts = {"": chart} if isinstance(chart, Figure) else {f"_{part}": one for part, one in chart.items()}
            for part, figure in charts.items():
                file = png.with_stem(png.stem + part)
                with whole_file(file) as partial:
                    save(figure, partial)
                print(f"→ {file}")


def _machine() -> dict[str, str]:
    """What the numbers were measured with and on; the commit is unknown where this is no checkout."""
    packages = ("pps-vision", "numpy", "opencv-contrib-python-headless", "torch", "pin", "PyOpenGL")
    try:
        describe = ["git", "describe", "--always", "--dirty"]
        here = Path(__file__).parent
        commit = subprocess.run(describe, cwd=here, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        commit = "unknown"
    return {
        "processor": platform.processor() or platform.machine(),
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
        "commit": commit,
    }
