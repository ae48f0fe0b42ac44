"""Parameters of the controllers: random search, the same number of draws on the same encounters for each."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pps_vision.app.encounters.controllers import Numbers
from pps_vision.app.encounters.encounter import HARMLESS, HAZARDS
from pps_vision.app.encounters.registry import OURS, TUNABLE, Baseline
from pps_vision.app.encounters.suite import Rows, run_suite
from pps_vision.experiments.encounters import counts
from pps_vision.experiments.study import Study, kept_folder
from pps_vision.experiments.tables import Table

_LOGARITHMIC = "gain"


@dataclass(frozen=True)
class EncountersTuning(Study):
    """Random search for the parameters of every baseline controller of `encounters`, and of ours beside its defaults:
    the fewest approaching objects that touch and harmless ones that move the arm, both in percent."""

    SHORT: ClassVar[Mapping[str, Any]] = {"draws": 1}

    tuning_seed: int = 9783
    """Seed of the encounters and the draws; not `seed`, because `bench --seed` is that of the encounters that count."""
    n: int = 12
    """Encounters of each of stop, press and through; six tenths as many of each harmless kind."""
    draws: int = 30
    """Parameters tried for each controller."""
    share: float = 1.0
    """Share of R's numbers of approaches that the memories are learned from."""
    workers: int = 2
    """Parallel processes."""

    def run(self) -> dict[str, Any]:
        """Return the score of every draw, of our defaults, and each controller's best."""
        numbers = {
            f"{name}#{k}": draw_numbers(baseline, np.random.default_rng((self.tuning_seed, j, k)))
            for j, (name, baseline) in enumerate(TUNABLE.items())
            for k in range(self.draws)
        }
        folder = kept_folder(self)
        names = (OURS, *numbers)
        rows = run_suite(folder, counts(self.n), self.tuning_seed, names, self.workers, self.share, numbers)
        scores = {name: score([row for row in rows if row["controller"] == name]) for name in (OURS, *numbers)}
        best = {
            name: min((k for k in numbers if k.startswith(f"{name}#")), key=lambda k: scores[k]) for name in TUNABLE
        }
        return {
            "ours": scores[OURS],
            "best": {name: {"score": scores[k], **numbers[k]} for name, k in best.items()},
            "scores": scores,
        }

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return our defaults and the best of each search."""
        rows = [[f"{OURS}, defaults", f"{numbers['ours']:.3g}", "as everywhere"]]
        for name, best in numbers["best"].items():
            values = ", ".join(f"{key} {value:.3g}" for key, value in best.items() if key != "score")
            rows.append([name, f"{best['score']:.3g}", values])
        return {"": Table(["controller", "score on the tuning encounters", "parameters"], rows)}


def draw_numbers(baseline: Baseline, rng: np.random.Generator) -> Numbers:
    """Draw a baseline's parameters; four digits are kept."""
    found = {}
    for name, (low, high) in baseline.ranges.items():
        value = np.exp(rng.uniform(np.log(low), np.log(high))) if name == _LOGARITHMIC else rng.uniform(low, high)
        found[name] = float(f"{value:.4g}")
    return found


def score(rows: Rows) -> float:
    """Return the percentage touched of approaching objects plus the percentage of harmless ones with a command."""
    touched = [row["touched"] for row in rows if row["condition"] in HAZARDS]
    moved = [row["commands"] > 0 for row in rows if row["condition"] in HARMLESS]
    return float(100 * np.mean(touched) + 100 * np.mean(moved))
