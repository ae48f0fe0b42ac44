"""Break points: one disturbance grows until a method fails."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pps_vision.experiments.severity import pps, reach
from pps_vision.experiments.study import Part, PartsStudy, SampledStudy


@dataclass(frozen=True)
class Severity(PartsStudy, SampledStudy):
    """pps: prediction of touch 0.5 s ahead by maps of D and TTC.

    reach: forward model and reachable-space map from disturbed babbling and labels.
    """

    PARTS: ClassVar[Mapping[str, Part]] = {
        "pps": Part(lambda study: pps.run(study.seeds), pps.chart, pps.table),
        "reach": Part(
            lambda study: reach.run(study.seeds, study.n_labels, study.n_test, study.reach_disturbances),
            reach.chart,
        ),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {"n_labels": 200, "reach_disturbances": ("labels flipped",)}

    n_labels: int = 1000
    """Of reach: inverse-kinematics solutions per map."""
    n_test: int = 4000
    """Of reach: gaze postures at which maps are judged."""
    reach_disturbances: tuple[str, ...] = ()
    """Of reach: disturbances (default: all)."""
