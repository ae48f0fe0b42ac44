"""The reachable space of a hand: motor babbling, forward model, labels by inverse kinematics, and the map (J)."""

from typing import Literal

MeasureName = Literal["joint-limits", "manipulability", "isotropy", "approach"]
"""What can make a posture good; importing it loads nothing else."""
