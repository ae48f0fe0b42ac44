"""Run studies and write their numbers and charts: what `pps-vision bench` does."""

import json
import platform
import subprocess
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from pps_vision.app.figures import save
from pps_vision.experiments.experiment import Charted, Experiment, Series
from pps_vision.recordings.outputs import whole_file
from pps_vision.recordings.results import plain, write_summary


def bench(experiment: Experiment | Series, out: Path | None = None, figure: Path | None = None) -> None:
    """Measure and write; of a series, what this code has not yet measured with the same parameters."""
    name = type(experiment).__name__.lower()
    out = out or Path("docs") / "results" / f"{name}.json"
    png = figure or Path("docs") / "figures" / f"{name}.png"
    if not isinstance(experiment, Series):
        _measure(name, experiment, out, png)
        return
    for part, one in experiment.parts().items():
        stems = f"{out.stem}_{part}", f"{png.stem}_{part}"
        _measure(f"{name} {part}", one, out.with_stem(stems[0]), png.with_stem(stems[1]), again=False)


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
    packages = ("pps-vision", "numpy", "opencv-contrib-python-headless", "torch", "pin", "scikit-robot-pyrender")
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
