"""R Fig 9: two neighbouring taxels after 1, 4 and 53 trials; and how well others are predicted by then."""

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learning.pps.memory import MemoryParams, activation
from learning.pps.scores import auroc, brier, expected_calibration_error
from pps_vision.app.figures import draw_landscape, landscape
from pps_vision.experiments.pps.held_out import Samples, at_horizon
from pps_vision.experiments.pps.sessions import Session, session, session_of
from pps_vision.experiments.pps.touch_trials import touch_trials
from pps_vision.experiments.study import Study
from pps_vision.types import Array, Mask

SHOWN = (1, 4, 53)
MAPS = {"8 × 4 bins (R)": MemoryParams(), "16 × 8 bins": MemoryParams(bins=(16, 8))}
LEAD_S = 0.3
_COUNTS = (1, 2, 4, 8, 16, 32, 53)


@dataclass(frozen=True)
class Progress(Study):
    """What the inner forearm has learned from ever more objects.

    Predicted is, 0.3 s before the end of trials of another seed, for each of the forearm's twelve taxels, whether
    it will be touched: in approaches that end on the forearm like those learned from, and with near misses too.
    """

    seed: int = 0
    """Seed of the trials; those held out are of the next."""
    trials: Path = Path("build") / "pps"
    """Folder that keeps rendered trials."""
    seen: bool = True
    """Rendered and tracked; off: the objects known exactly, in a tenth of the time."""
    held_out: int = 40
    """Approaches held out; half as many near misses."""

    def run(self) -> dict[str, Any]:
        """The landscapes of the two taxels by trials; and scores by map, by what is held out, by trials."""
        made = session("inner", self.seed, self.seen, self.trials)
        pair = neighbours(made)
        other = {"approaches": self._other(True)}
        other["with near misses"] = _both(other["approaches"], self._other(False))
        return {
            "taxels": [made.skin.taxel_ids[i] for i in pair],
            "landscapes": {n: [np.round(landscape(made.memory(first=n), i), 3).tolist() for i in pair] for n in SHOWN},
            "base_rate": {
                name: _scores(of[2], np.mean([one.touched for one in made.approaches], axis=0))
                for name, of in other.items()
            },
            "predicted": {
                name: {kind: {n: _foretold(made, params, n, of) for n in _COUNTS} for kind, of in other.items()}
                for name, params in MAPS.items()
            },
        }

    def _other(self, touching: bool) -> Samples:
        n = self.held_out if touching else self.held_out // 2
        trials = touch_trials("inner", n, self.seed + 1, self.seen, self.trials, touching)
        return at_horizon(session_of("inner", trials).approaches, LEAD_S)

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Rows: the two taxels; columns: after 1, 4 and 53 trials; then the scores."""
        figure, axes = plt.subplots(2, 4, figsize=(12.5, 5.6), layout="constrained")
        for column, (n, after) in enumerate(numbers["landscapes"].items()):
            for row, (name, of) in enumerate(zip(numbers["taxels"], after, strict=True)):
                axis = axes[row][column]
                image = draw_landscape(axis, of)
                axis.set_title(f"{name} after {n} trial{'' if int(n) == 1 else 's'}", fontsize=9)
                axis.set_xlabel("distance D (cm)", fontsize=8)
                axis.set_ylabel("time to contact TTC (s)", fontsize=8)
        figure.colorbar(image, ax=axes[:, :3], label="expected probability of touch", shrink=0.7, location="left")
        _score(axes[0][3], numbers, "auroc", "AUROC, 0.3 s ahead", 0.95)
        _score(axes[1][3], numbers, "calibration_error", "expected calibration error", 0.05)
        axes[1][3].legend(fontsize=6, loc="upper right")
        axes[1][3].set_ylim(0, 0.5)
        figure.suptitle(
            "One trial already tells near from far; more tell how surely, but not which of two neighbours", fontsize=11
        )
        return figure


def neighbours(made: Session) -> tuple[int, int]:
    """The two nearest of the taxels aimed at that the first trial touched both."""
    positions = made.skin.parts[0].positions_m
    touched = [i for i in made.aimed if made.approaches[0].touched[i]]
    pairs = list(combinations(touched if len(touched) > 1 else made.aimed, 2))
    return min(pairs, key=lambda pair: float(np.linalg.norm(positions[pair[0]] - positions[pair[1]])))


def _both(one: Samples, other: Samples) -> Samples:
    D, ttc, touched = (np.concatenate(arrays) for arrays in zip(one, other, strict=True))
    return D, ttc, touched


def _foretold(made: Session, params: MemoryParams, n: int, of: Samples) -> dict[str, float]:
    D, ttc, touched = of
    return _scores(touched, activation(made.memory(params, n), D, ttc))


def _scores(touched: Mask, expected: Array) -> dict[str, float]:
    p = np.broadcast_to(expected, touched.shape)
    return {
        "auroc": round(auroc(touched, p), 4),
        "brier": round(brier(touched, p), 4),
        "calibration_error": round(expected_calibration_error(touched, p), 4),
    }


def _score(axis: Axes, numbers: dict[str, Any], key: str, label: str, goal: float) -> None:
    for color, (name, kinds) in zip(("tab:blue", "tab:orange"), numbers["predicted"].items(), strict=False):
        for style, (kind, by_n) in zip(("-", ":"), kinds.items(), strict=False):
            axis.plot(
                [int(n) for n in by_n], [of[key] for of in by_n.values()], style, color=color, label=f"{name}, {kind}"
            )
    for style, (kind, of) in zip(("-", ":"), numbers["base_rate"].items(), strict=False):
        axis.axhline(of[key], color="0.6", ls=style, lw=1, label=f"base rates, {kind}")
    axis.axhline(goal, color="tab:green", lw=1, label="goal")
    axis.set_xscale("log", base=2)
    axis.set_xticks(_COUNTS, [str(n) for n in _COUNTS], fontsize=8)
    axis.set_xlabel("trials learned from", fontsize=8)
    axis.set_ylabel(label, fontsize=9)
    axis.grid(alpha=0.25)
