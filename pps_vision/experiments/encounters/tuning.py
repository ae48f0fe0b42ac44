"""Random search for the parameters of the controllers, on the same encounters for each."""

from typing import Any

import numpy as np

from pps_vision.app.encounters.controllers import ControllerParams
from pps_vision.app.encounters.encounter import HARMLESS, HAZARDS
from pps_vision.app.encounters.registry import OURS, TUNABLE, Baseline
from pps_vision.app.encounters.suite import Rows, run_suite
from pps_vision.experiments.encounters.parameters import EncountersParameters, counts, unfinished_folder

_LOGARITHMIC = "gain"


def run(study: EncountersParameters) -> dict[str, Any]:
    """Return the score of our defaults, and each controller's best draw."""
    params = {
        f"{name}#{k}": draw_params(baseline, np.random.default_rng((study.tuning_seed, j, k)))
        for j, (name, baseline) in enumerate(TUNABLE.items())
        for k in range(study.draws)
    }
    names = (OURS, *params)
    folder = unfinished_folder(study, "tuning")
    rows = run_suite(folder, counts(study.n_tuning), study.tuning_seed, names, study.workers, study.share, params)
    scores = {name: score([row for row in rows if row["controller"] == name]) for name in names}
    best = {name: min((k for k in params if k.startswith(f"{name}#")), key=lambda k: scores[k]) for name in TUNABLE}
    return {"ours": scores[OURS], "best": {name: {"score": scores[k], **params[k]} for name, k in best.items()}}


def draw_params(baseline: Baseline, rng: np.random.Generator) -> ControllerParams:
    """Draw a baseline's parameters with four digits."""
    params = {}
    for name, (low, high) in baseline.ranges.items():
        value = np.exp(rng.uniform(np.log(low), np.log(high))) if name == _LOGARITHMIC else rng.uniform(low, high)
        params[name] = float(f"{value:.4g}")
    return params


def score(rows: Rows) -> float:
    """Return the percentage of approaching objects that touch plus that of harmless ones with a command."""
    touched = [row["touched"] for row in rows if row["condition"] in HAZARDS]
    moved = [row["commands"] > 0 for row in rows if row["condition"] in HARMLESS]
    return float(100 * np.mean(touched) + 100 * np.mean(moved))
