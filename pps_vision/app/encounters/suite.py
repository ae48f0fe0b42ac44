"""Run encounters with several controllers in parallel processes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
from tqdm import tqdm

from learning.pps.memory import load_memory, save_memory
from pps_vision.app.encounters.encounter import Condition, EncounterScene, draw
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import TRUE, Entry
from pps_vision.app.encounters.tracks import NOISE, Perception, track_of, true_track_of
from pps_vision.app.encounters.training import Memories, learn
from pps_vision.app.simulation import Side
from pps_vision.worker_pool import mapped

Rows = list[dict[str, Any]]
PART = 6  # encounters per task


class Task(NamedTuple):
    """Encounters of one condition, simulated with every controller."""

    condition: Condition
    first: int
    n: int
    seed: int
    controllers: Mapping[str, Entry]
    perceptions: tuple[Perception, ...] = ("track",)


def map_tasks(rows_of: Callable[..., Rows], workers: int, *arguments: Sequence[Any]) -> Rows:
    """Return the rows of all tasks, by `rows_of` of one of each of the `arguments`, in `workers` processes; with 1 all
    run in this one."""
    rows_of_tasks = mapped(rows_of, workers, *arguments)
    parts = tqdm(rows_of_tasks, desc="encounters", unit="part", total=len(arguments[0]), disable=None)
    return [row for rows in parts for row in rows]


def tasks_of(
    counts: Mapping[Condition, int],
    seed: int,
    controllers: Mapping[str, Entry],
    perceptions: tuple[Perception, ...] = ("track",),
) -> dict[str, Task]:
    """Return tasks with these numbers of encounters of each condition, every one met by every controller with every
    perception; by name.  `seed`: of the encounters and the tracks' errors."""
    return {
        f"{condition} {first}": Task(condition, first, min(PART, n - first), seed, controllers, perceptions)
        for condition, n in counts.items()
        for first in range(0, n, PART)
    }


def train(folder: Path, seed: int, share: float) -> None:
    """Learn the memories of both arms into a folder, unless they are there."""
    folder.mkdir(parents=True, exist_ok=True)
    for side in get_args(Side):
        files = _memory_files(folder, side)
        if not files[-1].exists():
            for file, memory in zip(files, learn(scene(), side, seed, share), strict=True):
                save_memory(file, memory)


def rows_of_task(task: Task, folder: Path) -> Rows:
    """Return the rows of a task, of each encounter one a controller and perception, with the same random numbers."""
    rows: Rows = []
    for number in range(task.first, task.first + task.n):
        encounter = draw(scene(), task.condition, number, task.seed)
        learned = memories(folder)[encounter.side]
        seeds = task.seed, task.condition, number
        noises = {"track": 1.0, "noisy track": NOISE}
        tracks = {
            p: track_of(scene(), encounter, track_rng(*seeds), noises[p]) for p in task.perceptions if p in noises
        }
        tracks["truth"] = true_track_of(encounter)
        for perception, (name, entry) in product(task.perceptions, task.controllers.items()):
            seen = tracks["truth" if name == TRUE else perception]
            arguments = entry.memory_of(learned), encounter, name, entry.new, seen
            result = simulate_encounter(scene(), *arguments, field=entry.field)
            rows.append({**asdict(result), "perception": perception})
    return rows


def track_rng(seed: int, condition: Condition, number: int) -> np.random.Generator:
    """Return the random numbers of an encounter's track errors."""
    return np.random.default_rng((seed, 1, get_args(Condition).index(condition), number))


@cache
def scene() -> EncounterScene:
    """Return the scene of this process."""
    return EncounterScene()


@cache
def memories(folder: Path) -> dict[Side, Memories]:
    """Return what `train` has learned, by arm."""
    return {side: Memories(*(load_memory(file) for file in _memory_files(folder, side))) for side in get_args(Side)}


def _memory_files(folder: Path, side: Side) -> list[Path]:
    return [folder / f"{side} {name}.npz" for name in Memories._fields]
