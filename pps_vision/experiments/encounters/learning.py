"""Ours beside controls that have learned nothing, on robots that misjudge where objects touch their skin.

Robot k has one arm, its own errors, its own memory, learned from its own perception of R's numbers of approaches, and
its own encounters, the same with every controller.
"""

from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.encounters.encounter import HARMLESS, Condition, Encounter, EncounterScene, draw
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import OURS, UNLEARNED, memory_of, new_controller
from pps_vision.app.encounters.robots import MiscalibratedRobot
from pps_vision.app.encounters.suite import Rows, run_tasks, track_rng
from pps_vision.app.encounters.tracks import track_of
from pps_vision.app.encounters.training import Trial, learn_from, training_trials
from pps_vision.app.simulation import Side
from pps_vision.experiments.charts import curves, panels
from pps_vision.experiments.study import interval
from pps_vision.experiments.tables import Table, estimate
from pps_vision.types import Array

CONTROLLERS = (OURS, *UNLEARNED)
PER_ROBOT: dict[Condition, int] = {
    "stop": 2,
    "press": 4,
    "through": 4,
    "graze": 4,
    "harmless_near": 4,
    "harmless_passing": 4,
    "harmless_static": 2,
    "harmless_receding": 2,
}
"""Encounters of one robot."""


class RobotTask(NamedTuple):
    """All encounters of one robot with every controller."""

    robot: int
    error_m: float
    seed: int
    share: float  # of R's numbers of training approaches


def run(study: Any) -> dict[str, Any]:
    """Return rates and paired differences by the robots' error, with 95 % over robots."""
    from pps_vision.experiments.encounters.controllers import unfinished_folder

    tasks = {
        f"robot {k}, {1000 * error_m:g} mm": RobotTask(k, error_m, study.seed, study.share)
        for k in range(study.n_robots)
        for error_m in study.errors_m
    }
    rows = run_tasks(unfinished_folder(study, "learning"), robot_rows, tasks, study.workers)
    return summary(rows)


def robot_rows(task: RobotTask, folder: Path | None = None) -> Rows:
    """Return a row for each encounter and controller of a robot."""
    side = get_args(Side)[task.robot % 2]
    trials = _training(side, task.seed, task.share)
    robot = None
    if task.error_m:
        touches = [trial.encounter for trial in trials]
        robot = MiscalibratedRobot.with_error(task.error_m, touches, (task.seed, task.robot))
    rng = np.random.default_rng((task.seed, task.robot, 1))
    memories = learn_from(_scene(), side, trials, robot, rng)
    rows: Rows = []
    for condition, n in PER_ROBOT.items():
        for k in range(n):
            encounter, tracks = _encounter(condition, encounter_number(task.robot, k, n), task.seed)
            erring = None
            if robot is not None:
                reading = robot.reading(rng)
                tracks = robot.see(tracks, encounter.q_rad, reading)
                erring = robot.scene, reading
            for name in CONTROLLERS:
                memory = memory_of(name, memories)
                new = new_controller(name)
                result = simulate_encounter(_scene(), memory, encounter, name, new, tracks, erring=erring)
                rows.append({**asdict(result), "robot": task.robot, "error_m": task.error_m})
    return rows


def encounter_number(robot: int, k: int, n: int) -> int:
    """Return the number of a robot's encounter k of n of a condition: the arm is the robot's, the parts alternate."""
    index = robot // 2 * n + k
    return 6 * (index // 3) + 3 * (robot % 2) + index % 3


@cache
def _scene() -> EncounterScene:
    return EncounterScene()


@cache
def _training(side: Side, seed: int, share: float) -> tuple[Trial, ...]:
    return tuple(training_trials(_scene(), side, seed, share))


@cache
def _encounter(condition: Condition, number: int, seed: int) -> Trial:
    encounter: Encounter = draw(_scene(), condition, number, seed)
    return Trial(encounter, track_of(_scene(), encounter, track_rng(seed, condition, number)))


def summary(rows: Rows) -> dict[str, Any]:
    """Return by error and controller the percentages of hazards untouched and of harmless objects without a command,
    their mean, and ours minus the control's mean."""
    cells: dict[str, dict[str, Any]] = {}
    for error_m in sorted({row["error_m"] for row in rows}):
        names = [name for name in CONTROLLERS if any(row["controller"] == name for row in rows)]
        scores = {name: _scores(rows, error_m, name) for name in names}
        cells[f"{100 * error_m:g}"] = {
            name: {
                **{key: interval(values[:, [k]].tolist()) for k, key in enumerate(("untouched", "still", "mean"))},
                "ours above": interval((scores[OURS] - values)[:, [2]].tolist()),
                "by condition": _by_condition(rows, error_m, name),
            }
            for name, values in scores.items()
        }
    return {"robots": len({row["robot"] for row in rows}), "per_robot": PER_ROBOT, "by_error_cm": cells}


def _scores(rows: Rows, error_m: float, name: str) -> Array:
    """Percentages (robots, 3): hazards untouched, harmless without a command, and the mean of both."""
    scores = []
    chosen = [row for row in rows if row["error_m"] == error_m and row["controller"] == name]
    for robot in sorted({row["robot"] for row in chosen}):
        own = [row for row in chosen if row["robot"] == robot]
        untouched = np.mean([not row["touched"] for row in own if row["condition"] not in HARMLESS])
        still = np.mean([not row["commands"] for row in own if row["condition"] in HARMLESS])
        scores.append(100 * np.array([untouched, still, (untouched + still) / 2]))
    return np.array(scores)


def _by_condition(rows: Rows, error_m: float, name: str) -> dict[str, float]:
    chosen = [row for row in rows if row["error_m"] == error_m and row["controller"] == name]
    failures = {c: "commands" if c in HARMLESS else "touched" for c in PER_ROBOT}
    return {
        c: 100 * float(np.mean([not row[key] for row in chosen if row["condition"] == c]))
        for c, key in failures.items()
        if any(row["condition"] == c for row in chosen)
    }


def chart(numbers: dict[str, Any]) -> Figure:
    """Draw the mean of hazards untouched and harmless at rest against the robots' error."""
    figure, (axis,) = panels(1, width=5.2)
    cells = numbers["by_error_cm"]
    series = {name: [cell[name]["mean"] for cell in cells.values()] for name in next(iter(cells.values()))}
    curves(axis, [float(error) for error in cells], series, "error of the robot (cm)", "untouched, at rest: mean (%)")
    axis.legend(fontsize=7)
    return figure


def table(numbers: dict[str, Any]) -> Table:
    """Return a row for each error and controller."""
    rows = []
    for error, cell in numbers["by_error_cm"].items():
        for name, values in cell.items():
            above = "–" if name == OURS else estimate(values["ours above"])
            rows.append([error, name, *(estimate(values[key]) for key in ("untouched", "still", "mean")), above])
    header = ["error (cm)", "controller", "hazards untouched (%)", "harmless at rest (%)", "mean", "ours above"]
    return Table(header, rows)
