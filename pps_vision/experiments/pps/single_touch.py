"""What is learned from a single touch: when the touched taxel predicts the same approach again."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.pps.memory import MemoryParams, activation, count_samples
from pps_vision.experiments.baselines.single_taxel import Simulation, empty_map, from_taxel, simulate
from pps_vision.experiments.charts import curves, panels
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table
from pps_vision.types import Array

THRESHOLD = 0.4  # activation that starts avoidance (R)
LEAD_S = 0.3  # the goal: how long before the touch the activation is above the threshold
MAPS = {
    "8×4, σ 1 bin (R, default)": MemoryParams(),
    "8×4, σ 0.5 bin": MemoryParams(sigma_bins=0.5),
    "16×8, σ 0.5 bin": MemoryParams(bins=(16, 8), sigma_bins=0.5),
    "8×4, TTC ≤ 1.2 s, σ 0.75 bin (R's code)": MemoryParams(ttc_range_s=(0.0, 1.2), sigma_bins=0.75),
}
APPROACHES = {
    "5–15 cm/s": Simulation(),
    "5 cm/s": replace(Simulation(), speed_m_s=(0.05, 0.05)),
    "30 cm/s": replace(Simulation(), speed_m_s=(0.30, 0.30)),
    "5–15 cm/s, noise 1 mm, 1 cm/s": replace(Simulation(), position_noise_m=0.001, velocity_noise_m_s=0.01),
}


@dataclass(frozen=True)
class SingleTouch(SampledStudy):
    """Activation during a repeated approach after one touch by it, for four maps (R Fig 9, first panel)."""

    n: int = 300
    """Approaches of each kind, each learned and repeated alone."""

    def run(self) -> dict[str, Any]:
        """Return, by approach and map, when the threshold is passed and the activation over time."""
        return {
            "approaches": {
                name: {label: self._measure(simulation, params) for label, params in MAPS.items()}
                for name, simulation in APPROACHES.items()
            }
        }

    def _measure(self, simulation: Simulation, params: MemoryParams) -> dict[str, Any]:
        before_s, found = repeat_approaches(simulation, params, self.n, np.random.default_rng(self.seed))
        above = found > THRESHOLD
        lead_s = np.max(np.where(above, before_s[:, None], 0.0), axis=0)
        at_lead = int(np.argmin(np.abs(before_s - LEAD_S)))
        shown = before_s <= 2.0
        return {
            "passed_at_lead_percent": round(100 * float(np.mean(lead_s >= LEAD_S - 1e-9)), 1),
            "above_at_lead_percent": round(100 * float(above[at_lead].mean()), 1),
            "before_s": before_s[shown].round(3).tolist(),
            "activation": np.percentile(found[shown], (50, 5, 95), axis=1).T.round(3).tolist(),
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw the activation over the time before the touch: median and 5–95 % of the approaches."""
        figure, (axis,) = panels(1, width=6.4)
        maps = next(iter(numbers["approaches"].values()))
        before_s = next(iter(maps.values()))["before_s"]
        curves(
            axis, before_s, {k: of["activation"] for k, of in maps.items()}, "time before the touch (s)", "activation"
        )
        axis.axhline(THRESHOLD, color="0.4", lw=0.8, ls="--")
        axis.invert_xaxis()
        axis.set_ylim(0, 1)
        axis.legend(fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the share of approaches above the threshold 0.3 s before the touch."""
        approaches = numbers["approaches"]
        rows = [
            [label, *(f"{maps[label]['above_at_lead_percent']:g}" for maps in approaches.values())] for label in MAPS
        ]
        return {"": Table([f"above {THRESHOLD} at {LEAD_S} s (%)", *approaches], rows)}


def repeat_approaches(
    simulation: Simulation, params: MemoryParams, trials: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return the time before the touch (T,) s and the activation (T, trials) of maps that know that approach alone."""
    paths = [simulate(simulation, 2000, rng) for _ in range(-(-trials // 100))]  # 8 % touch the first taxel
    perceived = [[samples[some.touched[:, 0], :, 0] for samples in from_taxel(some)] for some in paths]
    D, TTC = (np.concatenate(samples)[:trials].T for samples in zip(*perceived, strict=True))
    n = D.shape[1]  # each trial has its own taxel
    memory = count_samples(empty_map(n, params), D, TTC, np.ones(n, bool))
    return np.arange(len(D) - 1, -1, -1) * simulation.step_s, activation(memory, D, TTC)
