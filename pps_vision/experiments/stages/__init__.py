"""Each stage of the pipeline alone, time against error: our variants beside baselines on the same input."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from pps_vision.experiments.stages import (
    arm,
    batches,
    clock,
    filter,
    image_tracker,
    orders,
    points,
    rendering,
    solvers,
    stereo,
    trigger,
)
from pps_vision.experiments.study import DATA, Part, PartsStudy, TrackingStudy


@dataclass(frozen=True)
class Stages(PartsStudy, TrackingStudy):
    """One speed–accuracy chart per stage; a panel shows one scenario, the 95 % intervals resample its recordings."""

    MINUTES: ClassVar[int] = 25
    PARTS: ClassVar[Mapping[str, Part]] = {
        "trigger": Part(trigger.run, trigger.chart),
        "image_tracker": Part(image_tracker.run, image_tracker.chart, image_tracker.table),
        "stereo": Part(stereo.run, stereo.chart),
        "filter": Part(filter.run, filter.chart),
        "orders": Part(orders.run, orders.chart, orders.table),
        "points": Part(points.run, points.chart, points.table),
        "clock": Part(clock.run, clock.chart, clock.table),
        "arm": Part(arm.run, arm.chart),
        "solvers": Part(solvers.run, solvers.chart),
        "rendering": Part(rendering.run, rendering.chart),
        "batches": Part(batches.run, batches.chart),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {"n_calm": 1, "n_movements": 2, "n_problems": 100, "n_ipopt": 10}

    n: int = 3  # recordings of each kind
    seconds: float = 2.5  # length of the recordings of tracked objects, unless the motion determines it
    n_calm: int = 30  # recordings in which nothing moves, for the false alarms of our trigger
    n_movements: int = 100  # movements of the arm
    n_problems: int = 52_000  # inverse-kinematics problems for the batched solver, as many as J solved
    n_ipopt: int = 1500  # problems for IPOPT, which solves one at a time
    data: Path = DATA  # folder of the real films and photographs (default: PPS_VISION_DATA, else ../shared/data)
