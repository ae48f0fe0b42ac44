"""R Table 5: how much was collected in each session, beside the paper."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.pps.sessions import Session, samples_per_trial, session
from pps_vision.experiments.pps.touch_movements import Condition
from pps_vision.experiments.study import Study

PAPER: dict[Condition, dict[str, float]] = {
    "motor": {"minutes": 31, "trials": 82, "samples": 3512, "samples_of_shown_taxel": 1625},
    "visual": {"minutes": 30, "trials": 45, "samples": 1166, "samples_of_shown_taxel": 376},
    "inner": {"minutes": 23, "trials": 53, "samples": 1886, "samples_of_shown_taxel": 627},
    "outer": {"minutes": 17, "trials": 34, "samples": 1348, "samples_of_shown_taxel": 451},
    "palm": {"minutes": 44, "trials": 77, "samples": 2833, "samples_of_shown_taxel": 944},
}


@dataclass(frozen=True)
class Table5(Study):
    """Minutes, trials and samples of R's five sessions and of ours.

    A sample is a step of 50 ms in which some taxel of the part perceives the object.  Our minutes are those of
    the movements alone; R's include the robot's way back and the experimenter's.
    """

    seed: int = 0
    """Seed of the trials."""
    trials: Path = Path("build") / "pps"
    """Folder that keeps rendered trials."""
    seen: bool = True
    """Rendered and tracked; off: the objects known exactly, in a tenth of the time."""

    def run(self) -> dict[str, Any]:
        """By condition, ours and the paper's."""
        return {
            name: {"ours": _counted(session(name, self.seed, self.seen, self.trials)), "paper": paper}
            for name, paper in PAPER.items()
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Bars side by side, one panel a column of the table."""
        figure, axes = plt.subplots(1, 3, figsize=(10.5, 3.2), layout="constrained")
        columns = {
            "trials": "trials",
            "samples_per_trial": "samples per trial (50 ms each)",
            "minutes": "minutes (ours: movements alone)",
        }
        at = np.arange(len(numbers))
        for axis, (key, label) in zip(axes, columns.items(), strict=True):
            for shift, who, color in ((-0.2, "ours", "tab:blue"), (0.2, "paper", "tab:orange")):
                values = [_value(of[who], key) for of in numbers.values()]
                bars = axis.bar(at + shift, values, 0.4, color=color, label="Roncone et al. 2016" if shift > 0 else who)
                axis.bar_label(bars, fmt="%.3g", fontsize=7)
            axis.set_xticks(at, numbers, fontsize=8)
            axis.set_ylabel(label, fontsize=9)
            axis.margins(y=0.15)
        axes[0].legend(fontsize=8)
        figure.suptitle(
            "As many trials as the paper's; shorter approaches, so mostly fewer samples of each", fontsize=11
        )
        return figure


def _counted(made: Session) -> dict[str, Any]:
    memory = made.memory()
    return {
        "minutes": round(sum(float(np.ptp(trial.stamps_s)) for trial in made.trials) / 60, 2),
        "trials": len(made.trials),
        "samples": sum(samples_per_trial(made)),
        "samples_of_shown_taxel": int(memory.counts[made.taxel_with_most_samples(memory)].sum()),
        "taxels_aimed_at": len(made.aimed),
        "taxels_ever_touched": int(np.any([one.touched for one in made.approaches], axis=0)[list(made.aimed)].sum()),
    }


def _value(of: dict[str, float], key: str) -> float:
    return of["samples"] / of["trials"] if key == "samples_per_trial" else of[key]
