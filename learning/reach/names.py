"""The names that a user chooses from; importing them loads nothing else."""

from typing import Literal

MeasureName = Literal["joint-limits", "manipulability", "isotropy", "approach"]
