"""Break points: one disturbance grows until a method fails."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pps_vision.experiments.severity import inputs, pps, reach, tracking
from pps_vision.experiments.study import Part, PartsStudy, TrackingStudy


@dataclass(frozen=True)
class Severity(PartsStudy, TrackingStudy):
    """tracking: a ball in view, recorded under each disturbance.

    pps: prediction of touch 0.5 s ahead by maps of D and TTC.

    reach: forward model and reachable-space map from disturbed babbling and labels.

    inputs: recordings with a plausible fault, and sound ones: which are warned of.
    """

    MINUTES: ClassVar[int] = 35
    PARTS: ClassVar[Mapping[str, Part]] = {
        "tracking": Part(tracking.run, tracking.chart),
        "pps": Part(pps.run, pps.chart),
        "reach": Part(reach.run, reach.chart),
        "inputs": Part(inputs.run, inputs.chart, inputs.table),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {
        "n_labels": 200,
        "n_sound": 1,
        "n_faulty": 1,
        "disturbances": ("distance", "few trials", "labels flipped"),
    }

    disturbances: tuple[str, ...] = ()  # names of disturbances of the parts (default: all)
    n_labels: int = 1000  # of reach: inverse-kinematics solutions per map
    n_sound: int = 100  # of inputs: sound recordings
    n_faulty: int = 5  # of inputs: recordings of each fault
    n_test: int = 4000  # of reach: gaze postures at which maps are judged
