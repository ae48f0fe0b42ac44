"""How accurately, how surely and how fast an object is tracked while the head moves."""

from dataclasses import dataclass
from typing import Any

from pps_vision.experiments.scenarios import Footage, moving
from pps_vision.experiments.score import METRICS, tracker
from pps_vision.experiments.study import TURNS, SceneSource, TrackingStudy, compare
from pps_vision.experiments.tables import Table, estimate, median_first
from rendering.names import MotionName

MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk", "approach")
_METRICS = {name: METRICS[name] for name in ("mean_recording_mm", "worst_recording_mm", "near_percent")}


@dataclass(frozen=True)
class Tracking(TrackingStudy):
    """Balls (generic tracker) and markers (marker tracker) at 5–15 cm/s while the head moves; judged from 0.5 s on."""

    n: int = 20
    """Recordings of each object, their motions in turn."""
    seconds: float = 5.0
    """Length of each."""

    def run(self) -> dict[str, Any]:
        """Return by source and object: RMS error of a recording (mean, worst), tracked frames, time."""
        scenarios = self.scenarios(self._film, ("ball", "marker"))
        return {"cells": compare(scenarios, {"tracker": tracker()}, _METRICS, self.seeds, repeated=TURNS)}

    def _film(self, stimulus: str, source: SceneSource, seed: int) -> Footage:
        motion = MOTIONS[(seed - self.seed) % len(MOTIONS)]
        return moving(stimulus, motion, seed, self.seconds, source)

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one row a source and object."""
        rows = []
        for name, methods in numbers["cells"].items():
            cell = methods["tracker"]
            rows.append([name, *(estimate(cell[key]) for key in _METRICS), median_first(cell["ms"])])
        header = ["scenes", "RMS of a recording (mm)", "worst recording (mm)", "tracked (%)", "ms per pair, quartiles"]
        return {"": Table(header, rows)}
