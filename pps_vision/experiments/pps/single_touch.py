"""What is learned from a single touch: when the touched taxel predicts the same approach again."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure

from learning.pps.memory import MemoryParams, activation, count_samples
from learning.pps.receptive_field import ReceptiveField, distance_and_ttc
from pps_vision.experiments.baselines.single_taxel import Simulation, empty_map, sample_paths
from pps_vision.experiments.charts import curves, panels
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table
from pps_vision.types import Array

THRESHOLD = 0.4  # activation that starts avoidance (R)
LEAD_S = 0.3  # the goal: how long before the touch the activation is above the threshold
RADIUS_M = 0.035  # of the ball
FIELDS = {"surface": ReceptiveField(distance_to="surface"), "centre": ReceptiveField(distance_to="centre")}
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
    """Activation during a repeated approach of a ball after one touch by it (R Fig 9, first panel): four maps, D to its
    surface and to its centre."""

    SHORT: ClassVar[Mapping[str, Any]] = {"n": 5}

    n: int = 300
    """Approaches of each kind, each learned and repeated alone."""

    def run(self) -> dict[str, Any]:
        """Return, by approach, reference of D and map, the share above the threshold and the activation over time."""
        return {
            "approaches": {
                name: {
                    reference: {label: self._measure(simulation, params, field) for label, params in MAPS.items()}
                    for reference, field in FIELDS.items()
                }
                for name, simulation in APPROACHES.items()
            }
        }

    def _measure(self, simulation: Simulation, params: MemoryParams, field: ReceptiveField) -> dict[str, Any]:
        rng = np.random.default_rng(self.seed)
        before_s, found = repeat_approaches(simulation, params, field, self.n, rng)
        above = np.mean(found > THRESHOLD, axis=1)
        shown = before_s <= 2.0
        return {
            "above_at_lead_percent": round(100 * float(above[np.argmin(np.abs(before_s - LEAD_S))]), 1),
            "above_at_touch_percent": round(100 * float(above[-1]), 1),
            "before_s": before_s[shown].round(3).tolist(),
            "activation": np.percentile(found[shown], (50, 5, 95), axis=1).T.round(3).tolist(),
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw the activation over the time before the touch: median and 5–95 % of the approaches."""
        figure, axes = panels(len(FIELDS))
        of_reference = next(iter(numbers["approaches"].values()))
        for axis, (reference, maps) in zip(axes, of_reference.items(), strict=True):
            before_s = next(iter(maps.values()))["before_s"]
            lines = {label: of["activation"] for label, of in maps.items()}
            curves(axis, before_s, lines, "time before the touch (s)", "activation")
            axis.set_title(f"D to the {reference}", fontsize=9)
            axis.axhline(THRESHOLD, color="0.4", lw=0.8, ls="--")
            axis.invert_xaxis()
            axis.set_ylim(0, 1)
        axes[0].legend(fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the share of approaches above the threshold 0.3 s before the touch, and at the last sample."""
        approaches = numbers["approaches"]
        rows = [
            [f"D to the {reference}, {label}", *(_shares(of[reference][label]) for of in approaches.values())]
            for reference in FIELDS
            for label in MAPS
        ]
        return {"": Table([f"above {THRESHOLD} at {LEAD_S} s / at the touch (%)", *approaches], rows)}


def _shares(found: dict[str, Any]) -> str:
    return f"{found['above_at_lead_percent']:g} / {found['above_at_touch_percent']:g}"


def repeat_approaches(
    simulation: Simulation, params: MemoryParams, field: ReceptiveField, trials: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return the time before the touch (T,) s and the activation (T, trials) of maps that know that approach alone.

    The simulated paths are those of the ball's lowest point.
    """
    up = np.array([0.0, 0.0, 1.0])
    paths = [sample_paths(simulation, 2000, rng) for _ in range(-(-trials // 100))]  # 8 % touch the first taxel
    d = np.concatenate([some.d_m[some.touched[:, 0], :, 0] for some in paths])[:trials] + RADIUS_M * up
    v = np.concatenate([some.v_m_s[some.touched[:, 0], :, 0] for some in paths])[:trials]
    D, TTC = (samples.T for samples in distance_and_ttc(field, d, up, v, RADIUS_M))
    n = D.shape[1]  # each trial has its own taxel
    memory = count_samples(empty_map(n, params), D, TTC, np.ones(n, bool))
    return np.arange(len(D) - 1, -1, -1) * simulation.step_s, activation(memory, D, TTC)
