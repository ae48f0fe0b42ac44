"""`bench robustness`: kills at random moments of every command that writes; nothing may be lost."""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from tqdm import tqdm

from pps_vision.errors import InputError
from pps_vision.experiments.kills import COMMANDS, COUNTS, kill_at_random, prepare
from pps_vision.experiments.study import Study
from pps_vision.experiments.tables import Table

_WORDS = {
    "kills": "killed",
    "finished": "finished before",
    "running_on": "ran on after the signal",
    "damaged": "inputs or earlier outputs damaged",
    "half_written": "outputs half-written",
    "failed_reruns": "re-runs that failed",
    "left_over": "hidden files left by the re-run",
}


@dataclass(frozen=True)
class Robustness(Study):
    """Every command that writes, killed by SIGKILL, SIGTERM or SIGINT at random moments, and run once more."""

    n: int = 5
    """Kills of each command."""
    seed: int = 0
    """Seed of the moments and signals."""

    def run(self) -> dict[str, Any]:
        """Return by command how many runs were killed, and what went wrong."""
        if self.n < 1:
            raise InputError("bench robustness", f"--n {self.n}; expected at least one")
        rng = np.random.default_rng(self.seed)
        with TemporaryDirectory() as name:
            folder = Path(name)
            prepare(folder)
            found = {
                command.name: dict(kill_at_random(command, folder, self.n, rng))
                for command in tqdm(COMMANDS, desc="kills", unit="command", disable=None)
            }
        return {"kills": found}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the kills, one row a command and one for all."""
        rows = [[name, *(str(row[count]) for count in COUNTS)] for name, row in numbers["kills"].items()]
        total = [str(sum(row[count] for row in numbers["kills"].values())) for count in COUNTS]
        return {"kills": Table(["command", *(_WORDS[count] for count in COUNTS)], [*rows, ["all", *total]])}
