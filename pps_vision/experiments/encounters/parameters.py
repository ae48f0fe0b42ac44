"""Parameters of the study of encounters, and the numbers and rates of encounters that its parts share."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from tempfile import gettempdir
from typing import Any

from pps_vision.app.encounters.encounter import HARMLESS, HAZARDS, Condition
from pps_vision.app.encounters.suite import Rows
from pps_vision.experiments.study import PartsStudy, code_digest, percent_of

SLOW_M_S = 0.15  # largest speed of the objects that approached R's robot
MIN_SELF_DISTANCE_MM = 20.0  # self-collision distance that no encounter may come below
_HARMLESS = 0.6  # encounters of each harmless condition for one of each approaching condition


@dataclass(frozen=True)
class EncountersParameters(PartsStudy):
    """Fields of `Encounters`."""

    seed: int = 0  # seed of encounters and training
    n: int = 1500
    """Encounters of each of press and through; a fifth as many of stop, 6 % of each harmless kind, a tenth of `reach`
    and of through at 30–60 cm/s."""
    n_rendered: int = 20
    """Rendered encounters of each of stop, press and through; six tenths as many of each harmless kind."""
    n_tuning: int = 12  # the same of the search for parameters
    draws: int = 30  # parameters tried for each controller
    tuning_seed: int = 9783  # seed of the search; not `seed`, which is that of the encounters that count
    avoidance_min: float = 20.0  # length of the sessions of avoidance
    reaching_min: float = 10.0  # length of the session of reaching
    share: float = 1.0  # share of R's numbers of training approaches (Table 5), and of the sessions' lengths
    controller: str = ""
    """A further controller, "MODULE:FUNCTION" (`pps_vision.app.encounters.controllers`)."""
    json: Path | None = None  # file for a row of every encounter of the part `controllers`
    workers: int = 2  # parallel processes


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
