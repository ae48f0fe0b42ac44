"""R Figs 2 and 3: the map of a single taxel after 500 simulated objects, without noise, with noise, with an offset."""

from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from matplotlib.figure import Figure

from learning.pps.memory import MemoryParams, PPSMemory
from pps_vision.app.report.figures import landscape
from pps_vision.experiments.baselines.single_taxel import Reference, Simulation, simulate_map
from pps_vision.experiments.pps.maps import FINE, landscape_chart, ridge_width
from pps_vision.experiments.pps.taxel_offsets import offsets
from pps_vision.experiments.study import SampledStudy

_EXACT = Simulation()
_NOISY = replace(_EXACT, position_noise_m=0.001, velocity_noise_m_s=0.01)
SIMULATIONS = {"exact": _EXACT, "noisy": _NOISY, "noisy, offset −10 cm": replace(_NOISY, offset_m=-0.10)}
_OBJECTS = 500


@dataclass(frozen=True)
class MonteCarlo(SampledStudy):
    """Map of the middle of three virtual taxels after 500 objects, trained on touches only (R Figs 2, 3).

    D and TTC are measured from the landing point, as R's published maps are, and from the taxel, as R's text says.
    Only the former shows an offset: seen from a taxel assumed 10 cm too high, an object behind it recedes (TTC < 0).
    """

    n: int = 20
    """Simulations whose medians are taken."""

    def run(self) -> dict[str, Any]:
        """Return, by reference and simulation, where the ridge crosses TTC = 0, its width and the map."""
        return {
            "landscapes": {
                reference: {name: self.measure(simulation, reference) for name, simulation in SIMULATIONS.items()}
                for reference in get_args(Reference)
            }
        }

    def measure(self, simulation: Simulation, reference: Reference) -> dict[str, Any]:
        """Return medians over the simulations, and the map of the first."""
        fine = [self._map(simulation, reference, k, FINE) for k in range(self.n)]
        crossings = [100 * float(offsets(memory)[0]) for memory in fine]
        return {
            "crosses_ttc_0_at_cm": [round(float(q), 2) for q in np.percentile(crossings, (50, 25, 75))],
            "ridge_width_cm": round(100 * float(np.median([ridge_width(m.counts[0]) for m in fine])), 2),
            "activation": np.round(landscape(self._map(simulation, reference, 0, MemoryParams())), 2).tolist(),
        }

    def _map(self, simulation: Simulation, reference: Reference, k: int, params: MemoryParams) -> PPSMemory:
        return simulate_map(simulation, _OBJECTS, np.random.default_rng([self.seed, k]), params, reference)

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw the maps: one row by the landing point, one by the taxel."""
        maps = {
            f"{name}, from the {reference}\ncrosses TTC = 0 at {of['crosses_ttc_0_at_cm'][0]:.1f} cm": of["activation"]
            for reference, by_name in numbers["landscapes"].items()
            for name, of in by_name.items()
        }
        return landscape_chart(maps, columns=3)
