"""R Figs 4, 5 and 7: what a taxel learned from its own body felt, from its own body seen, and from objects."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learning.memory import MemoryParams, PPSMemory
from pps_vision.app.figures import draw_landscape, landscape
from pps_vision.experiments.pps.held_out import learned
from pps_vision.experiments.pps.monte_carlo import ridge_width
from pps_vision.experiments.pps.sessions import Session, session
from pps_vision.experiments.pps.touch_movements import Condition
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
class Landscapes:
    """One taxel's landscape after each of R's five sessions, and how wide its ridge is.

    The taxel is the one with the most samples, as R's.  The ridge's width is the standard deviation of the positive
    samples' D about their line in (D, TTC), all taxels of the session together; its spread is that over
    sessions drawn from the trials with replacement.
    """

    seed: int = 0
    """Seed of the trials."""
    trials: Path = Path("build") / "pps"
    """Folder that keeps rendered trials."""
    seen: bool = True
    """Rendered and tracked; off: the objects known exactly, in a tenth of the time."""
    resampled: int = 200
    """Sessions drawn for the spread."""

    def run(self) -> dict[str, Any]:
        """By condition: the taxel shown, its samples and landscape; the ridge's width with its 95 % range."""
        return {name: self._measured(session(name, self.seed, self.seen, self.trials)) for name in NAMES}

    def _measured(self, made: Session) -> dict[str, Any]:
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
        }

    def _width(self, made: Session) -> Array:
        """(1 + resampled,) m: the width of the session, and of sessions drawn from its trials."""
        one_each = [learned(made.skin, _FINE, [one]) for one in made.approaches]
        counts = np.array([memory.counts[list(made.aimed)].sum(axis=0) for memory in one_each])
        rng = np.random.default_rng(self.seed)
        times = rng.multinomial(len(counts), np.full(len(counts), 1 / len(counts)), self.resampled)
        memories = (
            PPSMemory(("all",), np.zeros(1, np.intp), np.tensordot(drawn, counts, 1)[None], _FINE)
            for drawn in np.vstack([np.ones_like(times[:1]), times])
        )
        return np.array([ridge_width(memory) for memory in memories])

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
            axis.plot(of["ridge_width_cm"], row, "o", color="tab:blue")
        axis.set_yticks(range(len(NAMES)), NAMES, fontsize=8)
        axis.invert_yaxis()
        axis.set_xlim(left=0)
        axis.set_xlabel("ridge's width: SD of D about its line (cm)\nbar: 95 % of resampled sessions", fontsize=8)
        axis.grid(alpha=0.25)
