"""`bench robustness`: attacks on the program; what it refuses, what breaks it, and what is lost when it is killed."""

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any

import numpy as np
from tqdm import tqdm

from pps_vision.experiments.adversarial_control import Outcome, attack
from pps_vision.experiments.fuzz_readers import READERS, fuzz
from pps_vision.experiments.kills import COMMANDS, COUNTS, Writing, kill_at_random, prepare
from pps_vision.experiments.study import Study
from pps_vision.experiments.tables import Table
from pps_vision.recordings.outputs import whole_file, write_json

_KINDS = "kills ", "readers "
_EPISODE = 400  # frames of the control
_PART = 50 * _EPISODE  # frames that are kept when a run is interrupted; every kind of start and path is in it

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
    files for every reader; impossible tracks, stamps and postures for the control.

    A fault of a reader is any exception but InputError and OSError, more than 10 s or 800 MB, a process that ends, or
    a file that is damaged; one of the control is such an exception, or a limit of the robot that is left.
    """

    n: int = 4
    """Kills of each command that strike it while it runs."""
    commands: tuple[str, ...] = tuple(command.name for command in COMMANDS)
    """Commands to be killed."""
    mutants: int = 500
    """Mutated files for each reader."""
    steps: int = 1_000_000
    """Frames of the control."""
    seed: int = 0
    """Seed of the moments and signals, of the mutants and of the control's episodes."""

    def run(self) -> dict[str, Any]:
        """Return what went wrong by command, by reader and in control, and how much went well.

        Finished parts are kept in the system's folder for temporary files until all are, so that an interrupted run of
        the same code goes on there.
        """
        kept = Path(gettempdir()) / f"pps-vision-robustness-{_fingerprint(self)}"
        tasks: dict[str, Callable[[], Any]] = {}
        with TemporaryDirectory() as name:
            folder = Path(name)
            for k, command in enumerate(COMMANDS):
                if command.name in self.commands:
                    tasks[f"kills {command.name}"] = partial(self._kill, command, folder, k)
            for reader in READERS:
                tasks[f"readers {reader}"] = partial(_fuzz, reader, self.seed, self.mutants)
            for begun in range(0, self.steps, _PART):
                part = min(_PART, self.steps - begun), self.seed, _EPISODE, begun // _EPISODE
                tasks[f"control {begun}"] = partial(attack, *part)
            parts = {task: _part(kept / f"{task}.json", do) for task, do in tqdm(tasks.items(), disable=None)}
        shutil.rmtree(kept)
        control = Outcome()
        for task, found in parts.items():
            if task.startswith("control "):
                control.add(Outcome.of_json(found))
        kills, readers = ({t.removeprefix(k): part for t, part in parts.items() if t.startswith(k)} for k in _KINDS)
        return {"kills": kills, "readers": readers, "control": control.to_json()}

    def _kill(self, command: Writing, folder: Path, number: int) -> dict[str, int]:
        if not any(folder.iterdir()):
            prepare(folder, [one for one in COMMANDS if one.name in self.commands])
        return dict(kill_at_random(command, folder, self.n, np.random.default_rng((self.seed, number))))

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


def _fuzz(reader: str, seed: int, mutants: int) -> dict[str, Any]:
    return asdict(fuzz(reader, seed, mutants))


def _part(file: Path, do: Callable[[], Any]) -> Any:
    """What the file holds; first do it and write it down where there is none."""
    if not file.exists():
        found = do()
        with whole_file(file) as partial_file:
            write_json(partial_file, found.to_json() if isinstance(found, Outcome) else found)
    return json.loads(file.read_text())


def _fingerprint(study: Study) -> str:
    """A name of the study's parameters and of all code."""
    root, digest = Path(__file__).parents[2], hashlib.sha256(repr(study).encode())
    for package in ("pps_vision", "rendering", "tracking", "learning", "control"):
        for file in sorted((root / package).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
