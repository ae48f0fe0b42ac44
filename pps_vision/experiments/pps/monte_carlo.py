"""R Figs 2 and 3: what a single taxel learns from a shower of 500 objects, clean, noisy, and with an offset."""

import resource
import sys
from dataclasses import dataclass, replace
from time import process_time
from typing import Any, get_args

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learning.pps.memory import MemoryParams, PPSMemory
from learning.pps.offsets import offsets, orthogonal_line
from pps_vision.app.figures import draw_landscape, landscape
from pps_vision.experiments.baselines.single_taxel import Reference, Shower, rain
from pps_vision.experiments.study import Study

CLEAN = Shower()
NOISY = replace(CLEAN, position_noise_m=0.001, velocity_noise_m_s=0.01)
SHOWERS = {"clean": CLEAN, "noisy": NOISY, "noisy, offset −10 cm": replace(NOISY, offset_m=-0.10)}
_FINE = MemoryParams(bins=(120, 60))
_FROM: dict[Reference, str] = {"landing": "from the landing point", "taxel": "from the taxel (R eqs 1–2)"}


@dataclass(frozen=True)
class MonteCarlo(Study):
    """Landscapes of the middle one of three virtual taxels after 500 objects, learned from touches as R does.

    D and TTC are measured in both ways: from the landing point, as R's published maps are, and from the taxel, as its
    text says.  The offset shows only in the former: seen from a taxel believed 10 cm too high, what has passed it
    recedes (TTC < 0), so that its ridge still ends at D = 0 and the last 10 cm are blind.
    """

    seed: int = 0
    """Seed of the first shower; the numbers are medians over `repeats`, counted up."""
    objects: int = 500
    repeats: int = 20

    def run(self) -> dict[str, object]:
        """By reference and shower: where the ridge crosses TTC = 0, its width, and the landscape; and what it costs."""
        landscapes = {
            reference: {name: self.measured(shower, reference) for name, shower in SHOWERS.items()}
            for reference in get_args(Reference)
        }
        return {"landscapes": landscapes, "cost": self._cost()}

    def measured(self, shower: Shower, reference: Reference) -> dict[str, Any]:
        """The ridge of one shower in one reference, medians over the repeats, and the first landscape."""
        fine = [self._learned(shower, reference, k, _FINE) for k in range(self.repeats)]
        crossing = 100 * np.array([offsets(memory)[0] for memory in fine])
        shown = self._learned(shower, reference, 0, MemoryParams())
        return {
            "crosses_ttc_0_at_cm": round(float(np.median(crossing)), 2),
            "crossing_quartiles_cm": [round(float(value), 2) for value in np.percentile(crossing, (25, 75))],
            "ridge_width_cm": round(100 * float(np.median([ridge_width(memory) for memory in fine])), 2),
            "positive_samples_behind_the_taxel_percent": round(100 * float(np.mean([_behind(m) for m in fine])), 1),
            "samples": [int(n) for n in shown.counts[0].sum(axis=(0, 1))],
            "activation": np.round(landscape(shown), 2).tolist(),
        }

    def _learned(self, shower: Shower, reference: Reference, k: int, params: MemoryParams) -> PPSMemory:
        return rain(shower, self.objects, np.random.default_rng([self.seed, k]), params, reference)

    def _cost(self) -> dict[str, float]:
        """CPU time of 500 objects (least of several) and of 100 000, which must not need more memory."""
        times = []
        for k in range(self.repeats):
            begun = process_time()
            self._learned(CLEAN, "taxel", k, MemoryParams())
            times.append(process_time() - begun)
        rain(CLEAN, 5000, np.random.default_rng(self.seed), MemoryParams())
        before, begun = _peak_mb(), process_time()
        rain(CLEAN, 100_000, np.random.default_rng(self.seed), MemoryParams())
        return {
            f"cpu_s_{self.objects}_objects": round(min(times), 4),
            "cpu_s_100000_objects": round(process_time() - begun, 2),
            "peak_memory_mb_more_than_with_5000_objects": round(_peak_mb() - before, 1),
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Rows: reference; columns: shower."""
        figure, axes = plt.subplots(2, 3, figsize=(10.5, 6.4), sharex=True, sharey=True, layout="constrained")
        for row, (reference, way) in enumerate(_FROM.items()):
            for column, name in enumerate(SHOWERS):
                _panel(axes[row][column], numbers["landscapes"][reference][name])
                axes[row][column].set_title(f"{name}\n{way}", fontsize=9)
        figure.colorbar(axes[0][0].images[0], ax=axes, label="expected probability of touch", shrink=0.7)
        figure.supxlabel("distance D (cm)", fontsize=9)
        figure.supylabel("time to contact TTC (s)", fontsize=9)
        figure.suptitle(
            f"What a taxel learns from {self.objects} objects: an offset shows when measured from the landing point",
            fontsize=10,
        )
        return figure


def ridge_width(memory: PPSMemory, taxel: int = 0) -> float:
    """Standard deviation in m of the positive samples' D about their line; NaN without one."""
    (d0, d1), (t0, t1) = memory.params.distance_range_m, memory.params.ttc_range_s
    n_d, n_t = memory.params.bins
    D = d0 + (d1 - d0) * (np.arange(n_d) + 0.5)[:, None] / n_d
    TTC = t0 + (t1 - t0) * (np.arange(n_t) + 0.5)[None, :] / n_t
    weight = memory.counts[taxel, ..., 0]
    x, y = np.broadcast_arrays(D, TTC)
    line = orthogonal_line(x, y, weight)
    if line is None:
        return float("nan")
    return float(np.sqrt((weight * (D - line.offset - line.slope * TTC) ** 2).sum() / weight.sum()))


def _behind(memory: PPSMemory) -> float:
    """Share of the middle taxel's positive samples that have D < 0."""
    (d0, d1), n = memory.params.distance_range_m, memory.params.bins[0]
    positive = memory.counts[0, ..., 0]
    return float(positive[: round(-d0 / (d1 - d0) * n)].sum() / max(positive.sum(), 1))


def _peak_mb() -> float:
    """The most memory this process has ever held."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def _panel(axis: Axes, numbers: dict[str, Any]) -> None:
    draw_landscape(axis, numbers["activation"], smooth=True)
    at = numbers["crosses_ttc_0_at_cm"]
    axis.plot(at, 0.06, "v", color="tab:cyan", ms=8, clip_on=False)
    axis.annotate(
        f"ridge crosses TTC = 0 at {at:.1f} cm\nwidth ±{numbers['ridge_width_cm']:.1f} cm".replace("-", "−"),
        (-9.5, 2.9),
        va="top",
        color="w",
        fontsize=8,
    )
