"""Parameters of the study of encounters, which its parts read."""

from dataclasses import dataclass
from pathlib import Path

from pps_vision.experiments.study import PartsStudy


@dataclass(frozen=True)
class EncountersParameters(PartsStudy):
    """Fields of `Encounters`."""

    seed: int = 0
    """Seed of encounters and training."""
    n: int = 1500
    """Encounters of each of press and through; a fifth as many of stop, 6 % of each harmless kind, a tenth of `reach`
    and of through at 30–60 cm/s."""
    n_rendered: int = 20
    """Rendered encounters of each of stop, press and through; six tenths as many of each harmless kind."""
    n_tuning: int = 12
    """The same of the search for parameters."""
    draws: int = 30
    """Parameters tried for each controller."""
    tuning_seed: int = 9783
    """Seed of the search; not `seed`, which is that of the encounters that count."""
    avoidance_min: float = 20.0
    """Length of the sessions of avoidance."""
    reaching_min: float = 10.0
    """Length of the session of reaching."""
    share: float = 1.0
    """Share of R's numbers of training approaches (Table 5), and of the sessions' lengths."""
    controller: str = ""
    """A further controller, "MODULE:FUNCTION" (`pps_vision.app.encounters.controllers`)."""
    json: Path | None = None
    """File for a row of every encounter of the part `controllers`."""
    workers: int = 2
    """Parallel processes."""
