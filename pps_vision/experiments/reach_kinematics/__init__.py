"""Forward models arm → gaze, LWPR beside its authors' library, robots with deviations, official iCub models."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pps_vision.experiments.reach_kinematics import cross_function, deviations, forward_model, official_icub
from pps_vision.experiments.study import Part, PartsStudy, SampledStudy


@dataclass(frozen=True)
class ReachKinematics(SampledStudy, PartsStudy):
    """Kinematics behind the reachable-space map."""

    PARTS: ClassVar[Mapping[str, Part]] = {
        "forward_model": Part(
            lambda s: forward_model.run(s.seeds, s.sizes),
            forward_model.chart,
        ),
        "deviations": Part(lambda s: deviations.run(s.seeds, s.sizes[-1]), table=deviations.table),
        "lwpr": Part(lambda s: cross_function.run(s.seed, s.n_lwpr, s.lwpr_share), table=cross_function.table),
        "official_icub": Part(lambda s: official_icub.run(s.official_models), table=official_icub.table),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {"sizes": (100, 200), "n_lwpr": 1, "lwpr_share": 0.05}

    n: int = 3  # sets of babbled postures, each with its own test set
    sizes: tuple[int, ...] = (100, 200, 400, 800, 1600, 3000, 4400)
    """Fixated postures after which each forward model is judged; of robots with deviations, the last one only."""
    n_lwpr: int = 5  # LWPR models of the cross function per setting
    lwpr_share: float = 1.0  # share of their training samples
    official_models: tuple[str, ...] = ("iCubLisboa01", "iCubGazeboV2_5")
    """Official iCub models: of version 1, as ours, and of version 2.5."""
