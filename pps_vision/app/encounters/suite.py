"""Run encounters in parallel processes, and go on where an interrupted run stopped."""

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
from tqdm import tqdm

from learning.pps.memory import load_memory, save_memory
from learning.reach.map import ReachableMap
from learning.reach.params import MapParams
from learning.reach.track_reachability import TrackReachability
from learning.reach.training import train_reachable_map
from pps_vision.app.encounters.controllers import ControllerParams
from pps_vision.app.encounters.encounter import Condition, EncounterScene, draw
from pps_vision.app.encounters.kinematic import can_touch, simulate_encounter
from pps_vision.app.encounters.registry import ASKING, NONE, REACHING, TRUE, new_controller
from pps_vision.app.encounters.tracks import track_of, true_track_of
from pps_vision.app.encounters.training import Memories, learn
from pps_vision.app.simulation import Side
from pps_vision.recordings.outputs import plain, whole_file
from pps_vision.robot.gaze import GazeLimits
from pps_vision.worker_pool import worker_pool

Rows = list[dict[str, Any]]
_PART = 6  # encounters that are kept when a run is interrupted
_LABELS = 6000  # of a reachable-space map, times the share of the training
_GAZE = GazeLimits(pitch_rad=(np.deg2rad(-80.0), np.deg2rad(40.0)))  # J's pitch, and as far down as the eyes' tilt


class Task(NamedTuple):
    """Encounters of one condition, met by every controller in turn."""

    condition: Condition
    first: int
    n: int
    seed: int
    controllers: tuple[str, ...]
    """Names, of a baseline perhaps with `#` and the number of its parameters among `numbers`."""
    numbers: Mapping[str, ControllerParams] = {}
    """Other parameters than the tuned ones."""


def run_suite(
    folder: Path,
    counts: Mapping[Condition, int],
    seed: int,
    controllers: Sequence[str],
    workers: int,
    share: float,
    numbers: Mapping[str, ControllerParams] | None = None,
) -> Rows:
    """Return a row for each encounter and controller; they do not depend on the number of `workers`.

    Args:
        folder: Where finished parts are kept until all are; an interrupted run with the same arguments goes on there.
        counts: How many encounters of each condition.
        seed: Of encounters and of the memories' training.
        controllers: Names in the registry, "MODULE:FUNCTION", or names of `numbers`.
        workers: Processes; with 1 everything runs in this one.
        share: Of the training approaches, and of the labels of the reachable-space maps.
        numbers: Parameters by a name "CONTROLLER#k".
    """
    for name in controllers:
        new_controller(name.partition("#")[0])  # refuse an unknown one at once
    _train(folder, seed, share, needs_map=ASKING in controllers and counts.get("reach", 0) > 0)
    tasks = [
        Task(condition, first, min(_PART, n - first), seed, tuple(controllers), numbers or {})
        for condition, n in counts.items()
        for first in range(0, n, _PART)
    ]
    files = [folder / f"{task.condition} {task.first}.json" for task in tasks]
    show = {"desc": "encounters", "unit": "part", "total": len(tasks), "disable": None}
    if workers == 1:
        parts = list(tqdm(map(_run, tasks, files), **show))
    else:
        with worker_pool(workers) as pool:
            parts = list(tqdm(pool.map(_run, tasks, files), **show))
    shutil.rmtree(folder)
    _memories.cache_clear()
    _maps.cache_clear()
    return [row for rows in parts for row in rows]


def _train(kept: Path, seed: int, share: float, needs_map: bool) -> None:
    kept.mkdir(parents=True, exist_ok=True)
    for side in get_args(Side):
        files = _files(kept, side)
        if not files[1].exists():
            for file, memory in zip(files, learn(_scene(), side, seed, share), strict=True):
                save_memory(file, memory)
        if needs_map and not _map_file(kept, side).exists():
            n = max(round(share * _LABELS), 100)
            params, rng = MapParams(_GAZE, n_labels=n, round_labels=min(1500, n // 2)), np.random.default_rng(seed)
            train_reachable_map(_scene().robot, side, rng, params).save(_map_file(kept, side))


def _run(task: Task, file: Path) -> Rows:
    """The rows of a task; those that `file` holds already are not made again."""
    if not file.exists():
        rows = [row for k in range(task.n) for row in _rows(task, task.first + k, file.parent)]
        with whole_file(file) as partial:
            partial.write_text(json.dumps(plain(rows)))
    made: Rows = json.loads(file.read_text())
    return made


def _rows(task: Task, number: int, kept: Path) -> Rows:
    """One encounter with every controller, all with the same track errors; whether one to reach for can be touched."""
    scene = _scene()
    encounter = draw(scene, task.condition, number, task.seed)
    seen = track_of(scene, encounter, track_rng(task.seed, task.condition, number))
    true, found = true_track_of(encounter), []
    reaches = encounter.condition == "reach"
    reachable = can_touch(scene, encounter, track_rng(task.seed, task.condition, number)) if reaches else None
    for name in task.controllers:
        if name not in (*REACHING, NONE) if reaches else name == ASKING:
            continue
        new = new_controller(name.partition("#")[0], task.numbers.get(name))
        track = true if name == TRUE else seen
        asked = _maps(kept)[encounter.side] if name == ASKING else None
        outcome = simulate_encounter(scene, _memories(kept)[encounter.side], encounter, name, new, track, None, asked)
        found.append({**asdict(outcome), "reachable": reachable})
    return found


def track_rng(seed: int, condition: Condition, number: int) -> np.random.Generator:
    """Return the random numbers of an encounter's track errors."""
    return np.random.default_rng((seed, 1, get_args(Condition).index(condition), number))


@cache
def _scene() -> EncounterScene:
    return EncounterScene()


@cache
def _memories(kept: Path) -> dict[Side, Memories]:
    return {side: Memories(*(load_memory(file) for file in _files(kept, side))) for side in get_args(Side)}


@cache
def _maps(kept: Path) -> dict[Side, TrackReachability]:
    return {s: TrackReachability(_scene().robot, ReachableMap.load(_map_file(kept, s))) for s in get_args(Side)}


def _map_file(kept: Path, side: str) -> Path:
    return kept / f"{side} reachable.npz"


def _files(kept: Path, side: str) -> tuple[Path, Path]:
    return kept / f"{side}.npz", kept / f"{side} distance.npz"
