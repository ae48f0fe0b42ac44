"""What a single touch teaches: when the touched taxel expects the next identical approach (R, Fig 9)."""

from dataclasses import dataclass, replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from learning.pps.memory import MemoryParams, PPSMemory, activation, count_samples
from learning.pps.receptive_field import ReceptiveField, distance_and_ttc
from pps_vision.experiments.baselines.single_taxel import Shower, fall
from pps_vision.experiments.study import Study
from pps_vision.types import Array

THRESHOLD, LEAD_S = 0.4, 0.3  # of avoidance (FACTS §3); the goal
MAPS = {
    "8×4, σ 1 bin (R, default)": MemoryParams(),
    "8×4, σ 0.5 bin": MemoryParams(sigma_bins=0.5),
    "16×8, σ 0.5 bin": MemoryParams(bins=(16, 8), sigma_bins=0.5),
    "8×4, TTC to 1.2 s, σ 0.75 bin (the robot's)": MemoryParams(ttc_range_s=(0.0, 1.2), sigma_bins=0.75),
}
APPROACHES = {
    "5–15 cm/s": Shower(),
    "5 cm/s": replace(Shower(), speed_m_s=(0.05, 0.05)),
    "30 cm/s": replace(Shower(), speed_m_s=(0.30, 0.30)),
    "5–15 cm/s, noise 1 mm, 1 cm/s": replace(Shower(), position_noise_m=0.001, velocity_noise_m_s=0.01),
}


@dataclass(frozen=True)
class OneTrial(Study):
    """An empty memory learns one object that touches its taxel; then the same object comes again.

    R's plain smoothing passes 0.4 in time in every approach tried (the goal: 0.3 s before the touch), by 0.5 s
    at 30 cm/s and more when slower.  But it hardly stays above: the Gaussian about a point near the skin reaches over
    bins that were never visited and speak for 0; of slow approaches one in ten is below 0.4 again 0.3 s before the
    touch.  With a window of half a bin none is.
    """

    seed: int = 0
    trials: int = 300
    """Objects of each kind of approach, each learned and met alone."""

    def run(self) -> dict[str, object]:
        """By approach and map: how long before the touch 0.4 is passed, and the activation 0.3 s before."""
        return {
            "threshold": THRESHOLD,
            "approaches": {
                name: {which: self._met(shower, params) for which, params in MAPS.items()}
                for name, shower in APPROACHES.items()
            },
        }

    def _met(self, shower: Shower, params: MemoryParams) -> dict[str, Any]:
        before_s, expected = met_again(shower, params, self.trials, np.random.default_rng(self.seed))
        lead = np.max(np.where(expected > THRESHOLD, before_s[:, None], 0.0), axis=0)
        at_goal = expected[int(np.argmin(np.abs(before_s - LEAD_S)))]
        shown = before_s <= 2.0
        return {
            "passes_s_before_touch_min": round(float(lead.min()), 3),
            "passes_s_before_touch_median": round(float(np.median(lead)), 3),
            "passes_0.3_s_before_percent": round(100 * float(np.mean(lead >= LEAD_S - 1e-9)), 1),
            "above_at_0.3_s_percent": round(100 * float(np.mean(at_goal > THRESHOLD)), 1),
            "before_s": before_s[shown].round(3).tolist(),
            "activation_p5_p50": [np.percentile(expected[shown], q, axis=1).round(3).tolist() for q in (5, 50)],
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Activation over the time before the touch: median and 5th percentile of the approaches."""
        figure, axes = plt.subplots(1, len(APPROACHES), figsize=(13, 3.6), sharey=True, layout="constrained")
        for axis, (name, maps) in zip(axes, numbers["approaches"].items(), strict=True):
            for k, (which, found) in enumerate(maps.items()):
                low, middle = found["activation_p5_p50"]
                axis.plot(found["before_s"], middle, color=f"C{k}", lw=2.2 if k == 0 else 1.3, label=which)
                axis.plot(found["before_s"], low, color=f"C{k}", lw=0.9, ls=":")
            axis.axhline(THRESHOLD, color="0.4", lw=0.8, ls="--")
            axis.axvline(LEAD_S, color="0.4", lw=0.8, ls="--")
            axis.set_xlim(2, 0)
            axis.set_ylim(0, 1)
            axis.set_title(name, fontsize=9)
            axis.set_xlabel("time before the touch (s)", fontsize=9)
            axis.grid(alpha=0.25)
        axes[0].set_ylabel("activation after one trial", fontsize=9)
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=8, frameon=False)
        figure.suptitle(
            "One touch learned: 0.4 is passed in time; half the window keeps it (dotted: 5th percentile)", fontsize=10
        )
        return figure


def met_again(shower: Shower, params: MemoryParams, trials: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Seconds before the touch (T,), and the activation (T, trials) of a memory that knows only that approach."""
    some = [fall(shower, 2000, rng) for _ in range(-(-trials // 100))]  # 8 % of the objects touch the middle taxel
    d = np.concatenate([f.d_m[f.touched[:, 0], :, :1] for f in some])[:trials]
    v = np.concatenate([f.v_m_s[f.touched[:, 0]] for f in some])[:trials]
    D, TTC = (x[..., 0].T for x in distance_and_ttc(ReceptiveField(), d, np.array([0.0, 0.0, 1.0]), v))
    n = D.shape[1]  # each trial its own taxel
    blank = np.zeros((n, *params.bins, 2), np.int64)
    memory = PPSMemory(tuple(map(str, range(n))), np.zeros(n, np.intp), blank, params)
    memory = count_samples(memory, D, TTC, np.ones(n, bool))
    return np.arange(len(D) - 1, -1, -1) * shower.step_s, activation(memory, D, TTC)
