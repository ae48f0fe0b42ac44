"""`pps-vision bench`: the experiments, each measured afresh on the seed that is asked for."""

import json
import platform
import subprocess
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

from matplotlib.figure import Figure
from tyro.conf import subcommand

from pps_vision.app.figures import save
from pps_vision.experiments.batches import Batches
from pps_vision.experiments.budget import Budget
from pps_vision.experiments.consistency import Consistency
from pps_vision.experiments.experiment import Charted, Experiment, Series
from pps_vision.experiments.failures import Failures
from pps_vision.experiments.fidelity import Fidelity
from pps_vision.experiments.filter import Filter
from pps_vision.experiments.fixation import Fixation
from pps_vision.experiments.image_tracker import ImageTracker
from pps_vision.experiments.independent import Independent
from pps_vision.experiments.loop import Loop
from pps_vision.experiments.pipeline import Pipeline
from pps_vision.experiments.pps.series import Pps
from pps_vision.experiments.reach.series import Reach
from pps_vision.experiments.real import Real
from pps_vision.experiments.soak import Soak
from pps_vision.experiments.stereo import Stereo
from pps_vision.experiments.tracking import Tracking
from pps_vision.experiments.triangulation import Triangulation
from pps_vision.experiments.trigger import Trigger
from pps_vision.recordings.outputs import whole_file
from pps_vision.recordings.results import plain, write_summary


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
        | Annotated[Independent, subcommand("independent")]
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
        name = type(self.experiment).__name__.lower()
        out = self.out or Path("docs") / "results" / f"{name}.json"
        png = self.figure or Path("docs") / "figures" / f"{name}.png"
        if not isinstance(self.experiment, Series):
            _measure(name, self.experiment, out, png)
            return
        for part, experiment in self.experiment.parts().items():
            stems = f"{out.stem}_{part}", f"{png.stem}_{part}"
            _measure(f"{name} {part}", experiment, out.with_stem(stems[0]), png.with_stem(stems[1]), again=False)


def _measure(name: str, experiment: Experiment, out: Path, png: Path, again: bool = True) -> None:
    """Run, print, write the numbers and the charts; nothing where they are there and not wanted `again`."""
    setting = {"experiment": name, "parameters": asdict(experiment), "machine": _machine()}  # type: ignore[call-overload]
    if not again and _is_measured(out, setting):
        print(f"= {out} (measured before, by the same code with the same parameters)")
        return
    with whole_file(out) as partial:
        numbers = experiment.run()
        charts = experiment.chart(numbers) if isinstance(experiment, Charted) else {}
        for part, figure in {"": charts}.items() if isinstance(charts, Figure) else charts.items():
            file = png.with_stem(f"{png.stem}_{part}" if part else png.stem)
            with whole_file(file) as drawing:
                save(figure, drawing)
            print(f"→ {file}")
        write_summary(partial, {**setting, **numbers})
        print(partial.read_text(), end="")
    print(f"→ {out}")


def _is_measured(out: Path, setting: dict[str, Any]) -> bool:
    """Whether a file holds the numbers of this setting; never where the code is not the commit's."""
    if setting["machine"]["commit"].endswith(("dirty", "unknown")) or not out.exists():
        return False
    before = json.loads(out.read_text())
    return all(before.get(key) == plain(value) for key, value in setting.items())


def _machine() -> dict[str, str]:
    """What the numbers were measured with and on."""
    packages = ("pps-vision", "numpy", "opencv-contrib-python-headless", "torch", "pin", "PyOpenGL")
    return {
        "processor": platform.processor() or platform.machine(),
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
        "commit": _commit(),
    }


def _commit() -> str:
    """The last commit that changed code, "-dirty" where code differs from it; unknown where this is no checkout."""
    root = Path(__file__).parents[2]
    try:
        git = ["git", "-C", str(root)]
        log = [*git, "log", "-1", "--format=%h", "--", "*.py"]
        commit = subprocess.check_output(log, text=True, stderr=subprocess.DEVNULL)
        changed = subprocess.check_output([*git, "status", "--porcelain", "--", "*.py"], text=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return commit.strip() + ("-dirty" if changed else "")
