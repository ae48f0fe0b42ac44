"""Parameters that the parts of the study share."""

from dataclasses import dataclass
from pathlib import Path

from pps_vision.experiments.study import DATA, TrackingStudy


@dataclass(frozen=True)
class StageParameters(TrackingStudy):
    """Sizes of the parts; `n` is the number of recordings of each kind."""

    seconds: float = 2.5  # length of the recordings of tracked objects, unless the motion determines it
    n_calm: int = 30  # recordings in which nothing moves, for the false alarms of our trigger
    n_movements: int = 100  # movements of the arm
    n_problems: int = 52_000  # inverse-kinematics problems for the batched solver, as many as J solved
    n_ipopt: int = 1500  # problems for IPOPT, which solves one at a time
    data: Path = DATA  # folder of the real films and photographs (default: PPS_VISION_DATA, else ../shared/data)
