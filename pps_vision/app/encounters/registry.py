"""The controllers of the suite by name, with the ranges that the parameters of the baselines are drawn from."""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pps_vision.app.encounters.baselines import depth_space, potential_field, taxel_constraints
from pps_vision.app.encounters.controllers import ArmScene, Controller, ControllerParams, distance_only, ours, paper
from pps_vision.errors import InputError

NewController = Callable[[ArmScene], Controller]
OURS, TRUE, NONE = "ours", "true positions", "no avoidance"
"""Ours; the upper bound, ours on tracks without error; the lower bound, which never moves."""
WRIST_AT_REST = "ours, wrist at rest"
"""The three joints of the wrist at rest, as R's robot moved."""
ASKING = "ours, asking the map"
"""As the pipeline reaches: only for what the reachable-space map of the palm calls reachable."""
REACHING = (OURS, ASKING, "R eq. 6", "distance only", TRUE)
"""Controllers that can reach; all but `ASKING` can avoid as well."""


class Baseline(NamedTuple):
    """A baseline and the ranges that its parameters are drawn from; `TUNED` has their values."""

    new: Callable[[ArmScene, ControllerParams], Controller]
    ranges: Mapping[str, tuple[float, float]]  # uniform, the logarithm of `gain`


TUNED: dict[str, dict[str, float]] = {
    "R eq. 6": {"threshold": 0.4203, "confirmation_s": 0.1306, "persist_s": 0.3889},
    "distance only": {"threshold": 0.4319, "confirmation_s": 0.1949, "persist_s": 0.5954},
    "potential field": {"range_m": 0.06314, "gain": 0.009452, "home_per_s": 1.112},
    "depth space": {"range_m": 0.08746, "aside": 0.2517},
    "taxel constraints": {"threshold": 0.5284, "gain": 13.8, "home_per_s": 0.6069},
}
"""Parameters of the baselines: the best of the part `tuning` of `bench encounters`."""
_OF_ACTIVATION = {"threshold": (0.2, 0.7), "confirmation_s": (0.0, 0.2), "persist_s": (0.0, 0.6)}
_HOME_PER_S = (0.3, 3.0)
BASELINES = {
    "R eq. 6": Baseline(paper, _OF_ACTIVATION),
    "distance only": Baseline(distance_only, _OF_ACTIVATION),
    "potential field": Baseline(
        potential_field, {"range_m": (0.05, 0.3), "gain": (1e-4, 1e-1), "home_per_s": _HOME_PER_S}
    ),
    "depth space": Baseline(depth_space, {"range_m": (0.05, 0.3), "aside": (0.0, 1.0)}),
    "taxel constraints": Baseline(
        taxel_constraints, {"threshold": (0.2, 0.7), "gain": (0.5, 20.0), "home_per_s": _HOME_PER_S}
    ),
}
_OURS_RANGES = {
    "threshold": (0.2, 0.7),
    "miss_distance_m": (0.02, 0.1),
    "min_approach_m": (0.003, 0.03),
    "confirmation_s": (0.0, 0.3),
    "escape_clearance_m": (0.0, 0.1),
    "persist_s": (0.0, 0.6),
}
TUNABLE = {**BASELINES, OURS: Baseline(lambda scene, numbers: ours(scene, numbers=numbers), _OURS_RANGES)}
"""Controllers of the random search; ours is measured with its defaults."""
NAMES = (OURS, *BASELINES, TRUE, NONE)


def new_controller(name: str, numbers: ControllerParams | None = None) -> NewController:
    """Return the maker of a controller: one of `NAMES`, of a baseline with other `numbers`, or "MODULE:FUNCTION";
    InputError if there is none."""
    if name in (OURS, ASKING, TRUE):
        return lambda scene: ours(scene, numbers=numbers)
    if name == WRIST_AT_REST:
        return lambda scene: ours(scene, resting=3)
    if name == NONE:
        return lambda scene: lambda activations, track, posture: np.zeros(scene.robot.n_joints)
    if name in BASELINES:
        baseline = BASELINES[name]
        params = numbers or TUNED[name]
        return lambda scene: baseline.new(scene, params)
    module, _, function = name.partition(":")
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        imported: NewController = getattr(import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        expected = f"expected MODULE:FUNCTION that can be imported, or one of {', '.join(NAMES)}"
        raise InputError("controller", f"{name!r}: {error}; {expected}") from error
    return imported
