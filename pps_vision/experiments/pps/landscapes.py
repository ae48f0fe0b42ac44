"""R Figs 4, 5 and 7: what a taxel learned from its own body felt, from its own body seen, and from objects."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learning.pps.memory import Counts, MemoryParams, PPSMemory
from pps_vision.app.figures import draw_landscape, landscape
from pps_vision.experiments.pps.errors import Belief, ErrorSources
from pps_vision.experiments.pps.held_out import known_trials, learned
from pps_vision.experiments.pps.lives import live
from pps_vision.experiments.pps.monte_carlo import ridge_width
from pps_vision.experiments.pps.sessions import Session, session, session_of
from pps_vision.experiments.pps.touch_movements import Condition
from pps_vision.experiments.study import Study
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array

NAMES: dict[Condition, str] = {
    "motor": "own finger, felt (Fig 4)",
    "visual": "own finger, seen (Fig 5)",
    "inner": "objects, inner forearm (Fig 7)",
    "outer": "objects, outer forearm (Fig 7)",
    "palm": "objects, palm (Fig 7)",
}
_FINE = MemoryParams(bins=(120, 60))


@dataclass(frozen=True)
class Landscapes(Study):
    """One taxel's landscape after each of R's five sessions, and how wide its ridge is.

    The taxel is the one with the most samples, as R's.  The ridge's width is the standard deviation of the positive
    samples' D about their line in (D, TTC), all taxels of the session together; its spread is that over
    sessions drawn from the trials with replacement.  Robots that err as R's sources say (`errors.py`) live through the
    same sessions, the objects known to their eyes but for that.
    """

    seed: int = 0
    """Seed of the trials."""
    trials: Path = Path("build") / "pps"
    """Folder that keeps rendered trials."""
    seen: bool = True
    """Rendered and tracked; off: the objects known exactly, in a tenth of the time."""
    resampled: int = 200
    """Sessions drawn for the spread."""
    robots: int = 8
    """Robots that err, each in its own way."""

    def run(self) -> dict[str, Any]:
        """By condition: the taxel shown, its samples and landscape; the ridge's width with its 95 % range, and that of
        each robot that errs."""
        beliefs = [
            Belief.draw(ErrorSources(), icub_skin(), np.random.default_rng((self.seed, k))) for k in range(self.robots)
        ]
        return {name: self._measured(session(name, self.seed, self.seen, self.trials), beliefs) for name in NAMES}

    def _measured(self, made: Session, beliefs: list[Belief]) -> dict[str, Any]:
        memory = made.memory()
        shown = made.taxel_with_most_samples(memory)
        width = self._width(made)
        return {
            "trials": len(made.trials),
            "taxel": made.skin.taxel_ids[shown],
            "samples": [int(n) for n in memory.counts[shown].sum(axis=(0, 1))],
            "activation": np.round(landscape(memory, shown), 3).tolist(),
            "ridge_width_cm": round(100 * float(width[0]), 2),
            "ridge_width_95_cm": [round(100 * float(w), 2) for w in np.percentile(width[1:], (2.5, 97.5))],
            "ridge_widths_of_erring_cm": [round(100 * self._erring(made, belief), 2) for belief in beliefs],
        }

    def _erring(self, made: Session, belief: Belief) -> float:
        """The width of a session's ridge, m, as a robot that errs takes the same trials."""
        truth = known_trials(made.condition, len(made.trials), self.seed)
        life = live(belief, truth, np.random.default_rng(self.seed), sees=made.condition != "motor")
        its = session_of(made.condition, life.trials, belief.robot, belief.skin)
        return _ridge_width(_together(its, its.memory(_FINE)))

    def _width(self, made: Session) -> Array:
        """(1 + resampled,) m: the width of the session, and of sessions drawn from its trials."""
        counts = np.array([_together(made, learned(made.skin, _FINE, [one])) for one in made.approaches])
        rng = np.random.default_rng(self.seed)
        times = rng.multinomial(len(counts), np.full(len(counts), 1 / len(counts)), self.resampled)
        drawn = np.vstack([np.ones_like(times[:1]), times])
        return np.array([_ridge_width(np.tensordot(of, counts, 1)) for of in drawn])

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """The landscapes, and the widths of their ridges."""
        figure, axes = plt.subplots(2, 3, figsize=(10.5, 6.4), layout="constrained")
        for axis, (name, title) in zip(axes.flat, NAMES.items(), strict=False):
            of = numbers[name]
            image = draw_landscape(axis, of["activation"])
            axis.set_title(f"{title}\n{of['taxel']}: {sum(of['samples'])} samples, {of['trials']} trials", fontsize=9)
            axis.set_xlabel("distance D (cm)", fontsize=8)
            axis.set_ylabel("time to contact TTC (s)", fontsize=8)
        figure.colorbar(image, ax=axes[:, :2], label="expected probability of touch", shrink=0.7, location="left")
        self._widths(axes[1][2], numbers)
        figure.suptitle("From crisper to broader: one's own finger, then objects in a hand", fontsize=11)
        return figure

    def _widths(self, axis: Axes, numbers: dict[str, Any]) -> None:
        for row, name in enumerate(NAMES):
            of = numbers[name]
            axis.plot(of["ridge_width_95_cm"], [row, row], color="tab:blue", lw=2, alpha=0.5)
            axis.plot(of["ridge_width_cm"], row, "o", color="tab:blue", label="knows itself" if row == 0 else None)
            erring = of["ridge_widths_of_erring_cm"]
            axis.plot(erring, [row + 0.25] * len(erring), "o", color="tab:orange", ms=3, alpha=0.5)
            label = "errs as R's sources\n(each robot; mean)" if row == 0 else None
            axis.plot(np.mean(erring), row + 0.25, "D", color="tab:orange", label=label)
        axis.set_yticks(range(len(NAMES)), NAMES, fontsize=8)
        axis.invert_yaxis()
        axis.set_xlim(left=0)
        axis.legend(fontsize=7, loc="lower left")
        axis.set_xlabel("ridge's width: SD of D about its line (cm)\nbar: 95 % of resampled sessions", fontsize=8)
        axis.grid(alpha=0.25)


def _together(made: Session, memory: PPSMemory) -> Counts:
    """(D bins, TTC bins, 2) what the taxels that a session aims at counted, all as one."""
    together: Counts = memory.counts[list(made.aimed)].sum(axis=0)
    return together


def _ridge_width(counts: Counts) -> float:
    """Of one taxel's fine counts (D bins, TTC bins, 2), m."""
    return ridge_width(PPSMemory(("all",), np.zeros(1, np.intp), counts[None], _FINE))
