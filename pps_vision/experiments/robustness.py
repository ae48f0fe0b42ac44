"""`bench robustness`: attacks on the program; what it refuses, what breaks it, and what is lost when it is killed."""

from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from tqdm import tqdm

from pps_vision.experiments.adversarial_control import attack
from pps_vision.experiments.fuzz_readers import READERS, fuzz
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
    """Every command that writes, killed by SIGKILL, SIGTERM or SIGINT at random moments, and run once more; mutated
    files for every reader; impossible tracks, stamps and postures for the control.

    A fault of a reader is any exception but InputError and OSError, more than 10 s or 800 MB, a process that ends, or
    a file that is damaged; one of the control is such an exception, or a limit of the robot that is left.
    """

    n: int = 5
    """Kills of each command."""
    mutants: int = 1000
    """Mutated files for each reader."""
    steps: int = 1_000_000
    """Frames of the control."""
    seed: int = 0
    """Seed of the moments and signals, of the mutants and of the control's episodes."""

    def run(self) -> dict[str, Any]:
        """Return what went wrong by command, by reader and in control, and how much went well."""
        rng = np.random.default_rng(self.seed)
        with TemporaryDirectory() as name:
            folder = Path(name)
            prepare(folder)
            kills = {
                command.name: dict(kill_at_random(command, folder, self.n, rng))
                for command in tqdm(COMMANDS, desc="kills", unit="command", disable=None)
            }
        readers = {
            name: asdict(fuzz(name, self.seed, self.mutants))
            for name in tqdm(READERS, desc="mutants", unit="reader", disable=None)
        }
        return {"kills": kills, "readers": readers, "control": attack(self.steps, self.seed).to_json()}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the kills by command, and the inputs by reader and of the control."""
        rows = [[name, *(str(row[count]) for count in COUNTS)] for name, row in numbers["kills"].items()]
        total = [str(sum(row[count] for row in numbers["kills"].values())) for count in COUNTS]
        control = numbers["control"]
        refused = sum(control["refused"].values())
        inputs = {
            **numbers["readers"],
            "control (frames)": {**control, "read": control["steps"] - refused, "refused": refused},
        }
        return {
            "kills": Table(["command", *(_WORDS[count] for count in COUNTS)], [*rows, ["all", *total]]),
            "inputs": Table(
                ["input of", "accepted", "refused", "faults"],
                [
                    [name, *(str(x) for x in (of["read"], of["refused"], len(of["faults"])))]
                    for name, of in inputs.items()
                ],
            ),
        }
