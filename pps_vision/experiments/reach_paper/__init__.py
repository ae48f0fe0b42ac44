"""Jamone et al. reproduced: maps from babbling alone, maps of each arm and of both, and stated error bounds."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pps_vision.experiments.reach_paper import error_bound, repeated_maps, whole_paper
from pps_vision.experiments.study import Part, PartsStudy, SampledStudy


@dataclass(frozen=True)
class ReachPaper(SampledStudy, PartsStudy):
    """Reachable-space maps of Jamone et al."""

    PARTS: ClassVar[Mapping[str, Part]] = {
        "whole_paper": Part(
            lambda s: whole_paper.run(s.seeds, s.n_tried, s.n_labels, s.n_labels_of_j, s.n_test),
            whole_paper.chart,
            whole_paper.table,
        ),
        "repeated_maps": Part(
            lambda s: repeated_maps.run(s.seeds, s.n_labels, s.n_test),
            table=repeated_maps.table,
        ),
        "error_bound": Part(
            lambda s: error_bound.run(s.seed, s.n_bounds, s.requested, s.n_labels, s.n_bound_test),
            table=error_bound.table,
        ),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {
        "n_bounds": 1,
        "n_tried": 500,
        "n_labels_of_j": 600,
        "n_bound_test": 500,
        "requested": (0.05,),
    }

    n: int = 5  # repetitions of training, in the whole paper and for the maps of each arm
    n_tried: int = 20_000  # arm postures babbled
    n_labels: int = 24_000  # inverse-kinematics solutions per map; of maps with a requested error, at most
    n_labels_of_j: int = 52_000  # inverse-kinematics solutions of J's map
    n_test: int = 20_000  # gaze postures at which maps are judged
    n_bounds: int = 10  # maps of each arm per requested error bound
    requested: tuple[float, ...] = (0.01, 0.003, 0.001)  # requested error bounds
    n_bound_test: int = 100_000  # gaze postures at which a stated bound is judged
