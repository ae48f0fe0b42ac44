"""`pps-vision bench`: run studies and write their numbers, charts and tables."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional


@dataclass(frozen=True)
class Bench:
    """Run studies; write OUT/results/NAME.json, OUT/figures/NAME*.png and the tables in OUT/*.md and README.md.

    A study that this commit has already measured with the same parameters is skipped, so that an interrupted run goes
    on where it stopped. Measurements for the documents need a clean commit: with uncommitted code give --out.
    """

    names: Positional[tuple[str, ...]] = ()
    """Names of studies, or `all`. Without a name: list them with their parameters."""
    n: int | None = None
    """Number of recordings, where a study has this parameter (as have the next ones)."""
    seed: int | None = None
    """Seed of the random numbers."""
    seconds: float | None = None
    """Length of a recording."""
    scenes: Literal["rendered", "independent", "both"] | None = None
    """Scenes of the project's renderer, of the independent ray caster, or both."""
    parts: tuple[str, ...] | None = None
    """Parts of a study that has several (default: all but those on request)."""
    robot: Path | None = None
    """robot.toml of another robot for `loop`; give --out."""
    data: Path | None = None
    """Folder of the real data (default: PPS_VISION_DATA, else ../shared/data)."""
    workers: int | None = None
    """Processes: several studies run side by side; `encounters` or `independent` alone divides its work among them."""
    out: Path = Path("docs")
    """Folder of results and figures; with another than docs, the documents with their tables go there too."""
    short: bool = False
    """Run each study with its smallest parameters, to see that all work; asks for --out."""
    again: bool = False
    """Measure again what was already measured."""
    redraw: bool = False
    """Measure nothing; draw charts and fill tables from the results that are there."""

    def run(self) -> None:
        from pps_vision.experiments.bench import bench, listing

        if not self.names:
            print(listing())
            return
        parameters = ("n", "seed", "seconds", "scenes", "parts", "robot", "data", "workers")
        overrides = {name: getattr(self, name) for name in parameters if getattr(self, name) is not None}
        bench(self.names, overrides, self.out, again=self.again, redraw=self.redraw, short=self.short)
