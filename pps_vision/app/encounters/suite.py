"""Run encounters in parallel processes, and go on where an interrupted run stopped."""

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, get_args

import numpy as np
from tqdm import tqdm

from learning.pps.memory import load_memory, save_memory
from learning.reach.map import ReachableMap, TrackReachability
from learning.reach.params import ArmLimits, MapParams
from learning.reach.training import train_part_map
from pps_vision.app.encounters.controllers import ControllerParams
from pps_vision.app.encounters.encounter import Condition, EncounterScene, Part, draw
from pps_vision.app.encounters.kinematic import can_touch, simulate_encounter
from pps_vision.app.encounters.registry import NONE, REACHING, TRUE, field_of, memory_of, new_controller
from pps_vision.app.encounters.tracks import Perception, perceived_track
from pps_vision.app.encounters.training import Memories, learn
from pps_vision.app.simulation import Side
from pps_vision.recordings.atomic_write import plain, whole_file
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.skin import TOUCH_RADIUS_M
from pps_vision.worker_pool import worker_pool

Rows = list[dict[str, Any]]
AnyTask = TypeVar("AnyTask")
_PART = 6  # encounters per file of an interrupted run
_LABELS = 1500  # labels of a body part's map of reachable space, times the share of the training
_FEWEST_LABELS = 200
_EXACT_M = 0.1  # more than an object's radius and the distance of a touch
_DEG = np.pi / 180
_GAZE = GazeLimits((-65 * _DEG, 65 * _DEG), (-110 * _DEG, 0.0), (7 * _DEG, 40 * _DEG))
"""Of all objects near the arms: down to their elbows."""


class Task(NamedTuple):
    """Encounters of one condition, simulated with every controller."""

    condition: Condition
    first: int
    n: int
    seed: int
    controllers: tuple[str, ...]
    """Names, of a baseline perhaps with `#` and the number of its parameters among `numbers`."""
    numbers: Mapping[str, ControllerParams] = {}  # other parameters than the tuned ones
    perceptions: tuple[Perception, ...] = ("track",)


def run_suite(
    folder: Path,
    counts: Mapping[Condition, int],
    seed: int,
    controllers: Sequence[str],
    workers: int,
    share: float,
    numbers: Mapping[str, ControllerParams] | None = None,
    perceptions: tuple[Perception, ...] = ("track",),
) -> Rows:
    """Return a row for each encounter, perception and controller; they do not depend on the number of `workers`.

    Args:
        folder: Finished parts are kept there until all are; an interrupted run with the same arguments goes on there.
        counts: Number of encounters of each condition.
        seed: Seed of the encounters and of the memories' training.
        controllers: Names in the registry, "MODULE:FUNCTION", or names of `numbers`.
        workers: Processes; with 1 everything runs in this one.
        share: Share of the training approaches and of the maps' labels.
        numbers: Parameters by a name "CONTROLLER#k".
        perceptions: The controllers' knowledge of the object.
    """
    for name in controllers:
        new_controller(name.partition("#")[0])  # refuse an unknown one at once
    _train(folder, seed, share, needs_maps=counts.get("reach", 0) > 0)
    tasks = [
        Task(condition, first, min(_PART, n - first), seed, tuple(controllers), numbers or {}, perceptions)
        for condition, n in counts.items()
        for first in range(0, n, _PART)
    ]
    rows = run_tasks(folder, _rows_of_task, {f"{task.condition} {task.first}": task for task in tasks}, workers)
    _memories.cache_clear()
    _maps.cache_clear()
    return rows


def run_tasks(
    folder: Path, rows_of: Callable[[AnyTask, Path], Rows], tasks: Mapping[str, AnyTask], workers: int
) -> Rows:
    """Return the rows of all tasks, by `rows_of(task, folder)` in `workers` processes; with 1 all run in this one.

    Finished tasks' rows are kept in `folder` until all are finished.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{name}.json" for name in tasks]
    with worker_pool(workers) if workers > 1 else nullcontext() as pool:
        rows_of_tasks = (pool.map if pool else map)(partial(_stored, rows_of), tasks.values(), files)
        parts = list(tqdm(rows_of_tasks, desc="encounters", unit="part", total=len(tasks), disable=None))
    shutil.rmtree(folder)
    return [row for rows in parts for row in rows]


def _stored(rows_of: Callable[[AnyTask, Path], Rows], task: AnyTask, file: Path) -> Rows:
    """Rows of a task, read from `file` if it exists."""
    if not file.exists():
        rows = rows_of(task, file.parent)
        with whole_file(file) as partial_file:
            partial_file.write_text(json.dumps(plain(rows)))
    stored: Rows = json.loads(file.read_text())
    return stored


def _train(folder: Path, seed: int, share: float, needs_maps: bool) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for side in get_args(Side):
        memory_files = _memory_files(folder, side)
        if not memory_files[-1].exists():
            for file, memory in zip(memory_files, learn(_scene(), side, seed, share), strict=True):
                save_memory(file, memory)
        for part in _parts(side) if needs_maps else ():
            if not (file := _map_file(folder, side, part)).exists():
                reachable_part(_scene(), side, part, np.random.default_rng(seed), share).save(file)


def reachable_part(
    scene: EncounterScene, side: Side, part: Part, rng: np.random.Generator, share: float = 1.0
) -> ReachableMap:
    """Return the map of the points that any taxel of a body part can be brought to, with a share of the labels."""
    n = max(round(share * _LABELS), _FEWEST_LABELS)
    arm_limits = ArmLimits.of(scene.robot, side)
    params = MapParams(_GAZE, arm_limits, n, n // 2, n_babble=20_000, lattice=0.05, exact_m=_EXACT_M)
    taxels = [taxel for taxel in scene.skins[side].taxel_ids if scene.body_part(taxel) == part]
    return train_part_map(scene.robot, side, taxels, rng, params)


def _rows_of_task(task: Task, folder: Path) -> Rows:
    return [row for k in range(task.n) for row in _rows(task, task.first + k, folder)]


def _rows(task: Task, number: int, folder: Path) -> Rows:
    """Rows of one encounter, one a controller and perception, all with the same random numbers."""
    scene = _scene()
    encounter = draw(scene, task.condition, number, task.seed)
    seeds = task.seed, task.condition, number
    tracks = {p: perceived_track(scene, encounter, p, track_rng(*seeds)) for p in ("truth", *task.perceptions)}
    is_reach = encounter.condition == "reach"
    reachable = can_touch(scene, encounter, track_rng(*seeds)) if is_reach else None
    rows: Rows = []
    for perception, name in product(task.perceptions, task.controllers):
        if is_reach and name not in (*REACHING, NONE):
            continue
        result = simulate_encounter(
            scene,
            memory_of(name, _memories(folder)[encounter.side]),
            encounter,
            name,
            new_controller(name.partition("#")[0], task.numbers.get(name)),
            tracks["truth" if name == TRUE else perception],
            field=field_of(name),
            reachability=_maps(folder)[encounter.side] if is_reach else None,
        )
        rows.append({**asdict(result), "reachable": reachable, "perception": perception})
    return rows


def track_rng(seed: int, condition: Condition, number: int) -> np.random.Generator:
    """Return the random numbers of an encounter's track errors."""
    return np.random.default_rng((seed, 1, get_args(Condition).index(condition), number))


@cache
def _scene() -> EncounterScene:
    return EncounterScene()


@cache
def _memories(folder: Path) -> dict[Side, Memories]:
    return {side: Memories(*(load_memory(file) for file in _memory_files(folder, side))) for side in get_args(Side)}


@cache
def _maps(folder: Path) -> dict[Side, dict[str, TrackReachability]]:
    """By arm and taxel, the map of the taxel's body part."""
    robot = _scene().robot

    def of_arm(side: Side) -> dict[str, TrackReachability]:
        learned = {part: ReachableMap.load(_map_file(folder, side, part)) for part in _parts(side)}
        asked = {part: TrackReachability(robot, learned[part], 1e-3, TOUCH_RADIUS_M) for part in learned}
        return {taxel: asked[_scene().body_part(taxel)] for taxel in _scene().skins[side].taxel_ids}

    return {side: of_arm(side) for side in get_args(Side)}


def _parts(side: Side) -> list[Part]:
    """Body parts of an arm that objects come to."""
    return [part for of, part in _scene().targets if of == side]


def _memory_files(folder: Path, side: Side) -> list[Path]:
    return [folder / f"{side} {name}.npz" for name in Memories._fields]


def _map_file(folder: Path, side: Side, part: Part) -> Path:
    return folder / f"{side} {part}.npz"
