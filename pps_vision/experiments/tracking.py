"""How accurately, how surely and how fast an object is tracked while the head moves."""

from dataclasses import dataclass
from functools import partial
from typing import Any

from pps_vision.experiments.scenarios import Recording, moving, sources
from pps_vision.experiments.score import METRICS, tracker
from pps_vision.experiments.study import Scenes, SceneSource, Study, compare
from pps_vision.experiments.tables import Table, estimate
from rendering.names import MotionName

MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk", "approach")
_METRICS = {name: METRICS[name] for name in ("mean_recording_mm", "worst_recording_mm", "near_percent")}


@dataclass(frozen=True)
class Tracking(Study):
    """Balls (generic tracker) and markers (marker tracker) at 5–15 cm/s while the head moves; judged from 0.5 s on."""

    n: int = 10
    """Recordings of each object, their motions in turn."""
    seconds: float = 5.0
    """Length of each."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the first; the others count up."""
    scenes: Scenes = "both"
    """Rendered scenes, independent ones, or both."""

    def run(self) -> dict[str, Any]:
        """Return by source and object: RMS error of a recording (mean, worst), tracked frames, time."""
        scenarios = {f"{s}, {o}": partial(self._film, o, s) for s in sources(self.scenes) for o in ("ball", "marker")}
        return {"cells": compare(scenarios, {"tracker": tracker()}, _METRICS, range(self.seed, self.seed + self.n))}

    def _film(self, stimulus: str, source: SceneSource, seed: int) -> Recording:
        motion = MOTIONS[(seed - self.seed) % len(MOTIONS)]
        return moving(stimulus, motion, seed, self.seconds, self.noise, source)

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one row a source and object."""
        rows = []
        for name, methods in numbers["cells"].items():
            cell = methods["tracker"]
            rows.append([name, *(estimate(cell[key]) for key in _METRICS), f"{cell['ms'][1]:.2f}"])
        header = ["scenes", "RMS of a recording (mm)", "worst recording (mm)", "tracked (%)", "ms per pair"]
        return {"": Table(header, rows)}
