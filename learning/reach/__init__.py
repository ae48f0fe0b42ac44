"""The reachable space of a hand: motor babbling, forward model, labels by inverse kinematics, and the map (J)."""

from typing import Literal

MeasureName = Literal["joint-limits", "manipulability", "isotropy", "approach"]
"""Measures of a good posture; importing them loads nothing else."""
