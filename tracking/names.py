"""The names that a user chooses from; importing them loads nothing else."""

from typing import Literal

Mode = Literal["generic", "marker"]
Depth = Literal["centroid", "disparity"]
