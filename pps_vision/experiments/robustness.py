"""`bench robustness`: attacks on the program; what it refuses, what breaks it, and what is lost when it is killed."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import numpy as np

from pps_vision.experiments.fuzz_readers import fuzz
from pps_vision.experiments.kills import COMMANDS, COUNTS, Writing, kill_at_random, prepare
from pps_vision.experiments.sound_inputs import READERS
from pps_vision.experiments.study import Study, run_parts
from pps_vision.experiments.tables import Table

_KINDS = "kills ", "readers "

_WORDS = {
    "kills": "killed while running",
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
    files for every reader.

    A fault of a reader is any exception but InputError and OSError, more than 10 s or 800 MB, a process that ends, or
    a file that is damaged.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"commands": ("track2d", "convert-taxels"), "mutants": 3}

    n: int = 4
    """Kills of each command that strike it while it runs."""
    n_batch: int = 50
    """The same of `batch`, which goes on where it was killed, and so has more moments to be struck in."""
    commands: tuple[str, ...] = tuple(command.name for command in COMMANDS)
    """Commands to be killed."""
    mutants: int = 500
    """Mutated files for each reader."""
    seed: int = 0
    """Seed of the moments and signals, and of the mutants."""

    def run(self) -> dict[str, Any]:
        """Return what went wrong by command and by reader, and how much went well; an interrupted run goes on."""
        tasks: dict[str, Callable[[], Any]] = {}
        with TemporaryDirectory() as name:
            folder = Path(name)
            for k, command in enumerate(COMMANDS):
                if command.name in self.commands:
                    tasks[f"kills {command.name}"] = partial(self._kill, command, folder, k)
            for reader in READERS:
                tasks[f"readers {reader}"] = partial(_fuzz, reader, self.seed, self.mutants)
            parts = run_parts(self, tasks)
        kills, readers = ({t.removeprefix(k): part for t, part in parts.items() if t.startswith(k)} for k in _KINDS)
        return {"kills": kills, "readers": readers}

    def _kill(self, command: Writing, folder: Path, number: int) -> dict[str, int]:
        if not any(folder.iterdir()):
            prepare(folder, [one for one in COMMANDS if one.name in self.commands])
        n = self.n_batch if command.resumes else self.n
        return dict(kill_at_random(command, folder, n, np.random.default_rng((self.seed, number))))

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the kills by command, and the inputs by reader and of the control."""
        rows = [[name, *(str(row[count]) for count in COUNTS)] for name, row in numbers["kills"].items()]
        total = [str(sum(row[count] for row in numbers["kills"].values())) for count in COUNTS]
        return {
            "kills": Table(["command", *(_WORDS[count] for count in COUNTS)], [*rows, ["all", *total]]),
            "inputs": Table(
                ["input of", "accepted", "refused", "faults"],
                [
                    [name, *(str(x) for x in (of["read"], of["refused"], len(of["faults"])))]
                    for name, of in numbers["readers"].items()
                ],
            ),
        }


def _fuzz(reader: str, seed: int, mutants: int) -> dict[str, Any]:
    return asdict(fuzz(reader, seed, mutants))
