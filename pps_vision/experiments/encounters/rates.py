"""Rates of encounters that the parts share."""

import hashlib
from collections.abc import Callable
from math import ceil
from pathlib import Path
from tempfile import gettempdir
from typing import Any

from pps_vision.app.encounters.encounter import HARMLESS, HAZARDS, Condition
from pps_vision.app.encounters.suite import Rows
from pps_vision.experiments.encounters.parameters import EncountersParameters
from pps_vision.experiments.study import code_digest, percent_of

SLOW_M_S = 0.15
"""Largest speed of the objects that approached R's robot."""
MIN_SELF_DISTANCE_MM = 20.0
"""Self-collision distance that no encounter may come below."""
_HARMLESS = 0.6  # encounters of each harmless condition for one of each approaching condition


def counts(n: int) -> dict[Condition, int]:
    """Return the number of encounters of each condition but `reach` in a tuning or rendered run."""
    return dict.fromkeys(HAZARDS, n) | dict.fromkeys(HARMLESS, ceil(_HARMLESS * n))


def rate(rows: Rows, is_counted: Callable[[dict[str, Any]], bool]) -> list[float]:
    """Return the percentage of rows that count, with Wilson's 95 % interval; NaN of none."""
    return percent_of(sum(map(is_counted, rows)), len(rows))


def unfinished_folder(study: EncountersParameters, part: str) -> Path:
    """Return the temporary folder of a part's finished encounters, by the study's parameters and all code."""
    parameters = {name: value for name, value in vars(study).items() if name not in ("parts", "workers", "json")}
    digest = hashlib.sha256(f"{part} {parameters}".encode() + code_digest())
    return Path(gettempdir()) / f"pps-vision-{digest.hexdigest()[:16]}"
