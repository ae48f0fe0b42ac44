"""Break points: one disturbance grows until a method fails."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pps_vision.experiments.severity import pps, reach, tracking
from pps_vision.experiments.study import Part, PartsStudy, TrackingStudy


@dataclass(frozen=True)
class Severity(PartsStudy, TrackingStudy):
    """tracking: a ball in view, recorded under each disturbance.

    pps: prediction of touch 0.5 s ahead by maps of D and TTC.

    reach: forward model and reachable-space map from disturbed babbling and labels.
    """

    PARTS: ClassVar[Mapping[str, Part]] = {
        "tracking": Part(tracking.run, tracking.chart),
        "pps": Part(pps.run, pps.chart),
        "reach": Part(reach.run, reach.chart),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {
        "n_labels": 200,
        "disturbances": ("distance", "few trials", "labels flipped"),
    }

    disturbances: tuple[str, ...] = ()  # names of disturbances of the parts (default: all)
    n_labels: int = 1000  # of reach: inverse-kinematics solutions per map
    n_test: int = 4000  # of reach: gaze postures at which maps are judged
