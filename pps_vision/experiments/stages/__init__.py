"""Each stage of the pipeline alone, time against error: our variants beside baselines on the same input."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pps_vision.experiments.stages import (
    arm,
    batches,
    filter,
    image_tracker,
    rendering,
    solvers,
    stereo,
    trigger,
)
from pps_vision.experiments.stages.parameters import StageParameters
from pps_vision.experiments.study import Part, PartsStudy


@dataclass(frozen=True)
class Stages(PartsStudy, StageParameters):
    """One speed–accuracy chart per stage; a panel shows one scenario, the 95 % intervals resample its recordings."""

    PARTS: ClassVar[Mapping[str, Part]] = {
        "trigger": Part(trigger.run, trigger.chart),
        "image_tracker": Part(image_tracker.run, image_tracker.chart),
        "stereo": Part(stereo.run, stereo.chart),
        "filter": Part(filter.run, filter.chart),
        "arm": Part(arm.run, arm.chart),
        "solvers": Part(solvers.run, solvers.chart),
        "rendering": Part(rendering.run, rendering.chart),
        "batches": Part(batches.run, batches.chart),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {"n_calm": 1, "n_movements": 2, "n_problems": 100, "n_ipopt": 10}
