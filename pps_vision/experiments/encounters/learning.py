"""Ours beside controls that have learned nothing, on robots that misjudge where objects touch their skin.

Robot k has one arm, its own errors, its own memory, learned from its own perception of R's numbers of approaches and
as many passes, and its own encounters, the same with every controller. Its touches also correct its encoders, where
held-out touches clearly confirm it; the controls have neither.
"""

from collections.abc import Mapping
from dataclasses import asdict
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.encounters.encounter import HARMLESS, Condition, Encounter, draw
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import CONTROLLERS, GEOMETRY, ONE, ONE_GATED, OURS
from pps_vision.app.encounters.robots import MiscalibratedRobot
from pps_vision.app.encounters.suite import Rows, scene, track_rng
from pps_vision.app.encounters.tracks import track_of
from pps_vision.app.encounters.training import Memories, Trial, calibrate, learn_from, training_trials
from pps_vision.app.simulation import Side
from pps_vision.experiments.charts import curves, panels
from pps_vision.experiments.encounters.controllers import unfinished_folder
from pps_vision.experiments.encounters.unfinished import run_tasks
from pps_vision.experiments.study import interval
from pps_vision.experiments.tables import Table, estimate

R_MAP = "ours, R's map"
"""Our controller on the activations of R's 8 × 4 map, which does not know the path."""
COMPARED = {
    **{name: CONTROLLERS[name] for name in (OURS, ONE_GATED, ONE, GEOMETRY)},
    R_MAP: CONTROLLERS[OURS]._replace(memory="of_both"),
}
_OF_ALL_ROBOTS = 2  # of them; the others differ so much that a fifth of the robots shows it
PER_ROBOT: dict[Condition, int] = {
    "stop": 1,
    "press": 2,
    "through": 3,
    "graze": 2,
    "harmless_near": 3,
    "harmless_passing": 2,
    "harmless_static": 1,
    "harmless_receding": 1,
}
"""Encounters of one robot."""


class RobotTask(NamedTuple):
    """All encounters of one robot with every controller."""

    robot: int
    error_m: float
    seed: int
    share: float  # of R's numbers of training approaches
    controllers: tuple[str, ...] = tuple(COMPARED)


def run(study: Any) -> dict[str, Any]:
    """Return rates and paired differences by the robots' error, with 95 % over robots."""
    tasks = {
        f"robot {k}, {1000 * error_m:g} mm": RobotTask(
            k, error_m, study.seed, study.share, tuple(COMPARED)[: None if k < study.n_robots / 5 else _OF_ALL_ROBOTS]
        )
        for k in range(study.n_robots)
        for error_m in study.errors_m
    }
    rows = run_tasks(unfinished_folder(study, "learning"), robot_rows, tasks, study.workers)
    return summary(rows)


def robot_rows(task: RobotTask, folder: Path | None = None) -> Rows:
    """Return a row for each encounter and controller of a robot."""
    robot, calibrated, memories = mind(task)
    bodies = {name: calibrated if name in (OURS, R_MAP) else robot for name in task.controllers}
    return rows_of_minds(task, robot, {name: (name, body, memories) for name, body in bodies.items()})


def rows_of_minds(
    task: RobotTask, robot: MiscalibratedRobot, minds: Mapping[str, tuple[str, MiscalibratedRobot, Memories]]
) -> Rows:
    """Return a row for each encounter of a robot, by what it may be told apart by: controller, the body that it takes
    its own to be, and memories."""
    rng = np.random.default_rng((task.seed, task.robot, 2))
    rows: Rows = []
    for condition, n in PER_ROBOT.items():
        for k in range(n):
            encounter, tracks = encounter_of(task, condition, k, n)
            slack = robot.reading(rng) - robot.joint_offsets_rad
            for label, (name, body, memories) in minds.items():
                reading = body.joint_offsets_rad + slack
                seen = body.see(tracks, encounter.q_rad, reading)
                entry = COMPARED[name]
                arguments = entry.memory_of(memories), encounter, name, entry.new, seen
                result = simulate_encounter(scene(), *arguments, erring=(body.scene, reading), field=entry.field)
                rows.append({**asdict(result), "controller": label, "robot": task.robot, "error_m": task.error_m})
    return rows


def side_of(robot: int) -> Side:
    """Return the arm of a robot."""
    return get_args(Side)[robot % 2]


def mind(task: RobotTask) -> tuple[MiscalibratedRobot, MiscalibratedRobot, Memories]:
    """Return a robot, the same with its encoders corrected, and its memory."""
    number = task.robot if task.error_m else task.robot % 2  # robots of one arm without error are one robot
    return _mind(number, task.error_m, task.seed, task.share, R_MAP in task.controllers)


@lru_cache(maxsize=4)
def _mind(
    number: int, error_m: float, seed: int, share: float, with_others: bool
) -> tuple[MiscalibratedRobot, MiscalibratedRobot, Memories]:
    side = side_of(number)
    trials = training(side, seed, share)
    robot = MiscalibratedRobot.with_error(error_m, [trial.encounter for trial in trials], (seed, number))
    rng = np.random.default_rng((seed, number, 1))
    calibrated = calibrate(trials, robot, rng)
    return robot, calibrated, learn_from(scene(), side, trials, calibrated, rng, with_others)


def encounter_of(task: RobotTask, condition: Condition, k: int, n: int) -> Trial:
    """Return a robot's encounter k of n of a condition."""
    return _encounter(condition, encounter_number(task.robot, k, n), task.seed)


def encounter_number(robot: int, k: int, n: int) -> int:
    """Return the number of a robot's encounter k of n of a condition: the arm is the robot's, the parts alternate."""
    index = robot // 2 * n + k
    return 6 * (index // 3) + 3 * (robot % 2) + index % 3


@cache
def training(side: Side, seed: int, share: float) -> tuple[Trial, ...]:
    return tuple(training_trials(scene(), side, seed, share))


@cache
def _encounter(condition: Condition, number: int, seed: int) -> Trial:
    encounter: Encounter = draw(scene(), condition, number, seed)
    return Trial(encounter, track_of(scene(), encounter, track_rng(seed, condition, number)))


def summary(rows: Rows) -> dict[str, Any]:
    """Return by error and controller the percentages of hazards untouched and of harmless objects without a command,
    their mean, and ours minus the control's mean."""
    cells: dict[str, dict[str, Any]] = {}
    for error_m in sorted({row["error_m"] for row in rows}):
        names = [name for name in COMPARED if any(row["controller"] == name for row in rows)]
        scores = {name: scores_of(rows, error_m, name) for name in names}
        cells[f"{100 * error_m:g}"] = {
            name: {
                "robots": len(by_robot),
                **{
                    key: interval([[of_robot[k]] for of_robot in by_robot.values()])
                    for k, key in enumerate(("untouched", "still", "mean"))
                },
                "ours above": interval([[scores[OURS][robot][2] - own[2]] for robot, own in by_robot.items()]),
                "by condition": _by_condition(rows, error_m, name),
            }
            for name, by_robot in scores.items()
        }
    return {"per_robot": PER_ROBOT, "by_error_cm": cells}


def scores_of(rows: Rows, error_m: float, name: str) -> dict[int, tuple[float, float, float]]:
    """Percentages by robot: hazards untouched, harmless without a command, and the mean of both."""
    scores = {}
    chosen = [row for row in rows if row["error_m"] == error_m and row["controller"] == name]
    for robot in sorted({row["robot"] for row in chosen}):
        own = [row for row in chosen if row["robot"] == robot]
        untouched = 100 * float(np.mean([not row["touched"] for row in own if row["condition"] not in HARMLESS]))
        still = 100 * float(np.mean([not row["commands"] for row in own if row["condition"] in HARMLESS]))
        scores[robot] = untouched, still, (untouched + still) / 2
    return scores


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
            rates = (estimate(values[key]) for key in ("untouched", "still", "mean"))
            rows.append([error, name, str(values["robots"]), *rates, above])
    quantities = "hazards untouched (%)", "harmless at rest (%)", "mean", "ours above"
    return Table(["error (cm)", "controller", "robots", *quantities], rows)
