"""Parameters that the parts of the study share."""

from dataclasses import dataclass
from pathlib import Path

from pps_vision.experiments.study import DATA, TrackingStudy


@dataclass(frozen=True)
class StageParameters(TrackingStudy):
    """Sizes of the parts; `n` is the number of recordings of each kind."""

    seconds: float = 2.5
    """Length of the recordings of tracked objects, unless the motion determines it."""
    n_calm: int = 30
    """Recordings in which nothing moves, for the false alarms of our trigger."""
    n_movements: int = 100
    """Movements of the arm."""
    n_problems: int = 52_000
    """Inverse-kinematics problems for the batched solver, as many as J solved."""
    n_ipopt: int = 1500
    """Problems for IPOPT, which solves one at a time."""
    data: Path = DATA
    """Folder of the real films and photographs (default: PPS_VISION_DATA, else ../shared/data)."""
