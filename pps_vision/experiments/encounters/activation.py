"""The meaning of an activation: on time before a touch, low where nothing threatens, and equal to the rate of touch."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from learning.pps.memory import activation
from pps_vision.app.encounters.encounter import HARMLESS, Condition
from pps_vision.app.encounters.suite import Rows, scene
from pps_vision.app.encounters.training import Trial, events_of, training_trials
from pps_vision.app.intervals import percent_of
from pps_vision.app.simulation import Side
from pps_vision.experiments.encounters.controllers import unfinished_folder
from pps_vision.experiments.encounters.learning import RobotTask, encounter_of, mind, side_of
from pps_vision.experiments.encounters.unfinished import run_tasks
from pps_vision.experiments.study import interval
from pps_vision.experiments.tables import Table, estimate, judged

THRESHOLD = 0.4  # above which the arm responds
_LEAD_S = 0.5  # before a contact, from which on the activation is to be above the threshold
_TENTHS = 10
_HELD_OUT_SHARE = 0.2  # trials that test the calibration, relative to the training trials
PER_ROBOT: dict[Condition, int] = {
    "press": 6,
    "graze": 6,
    "harmless_near": 3,
    "harmless_passing": 3,
    "harmless_static": 3,
    "harmless_receding": 3,
}
"""Encounters of one robot, whose arm stays at rest."""
_GOALS = {"press": 95.0, "graze": 80.0, "harmless": 99.0}


def run(study: Any) -> dict[str, Any]:
    """Return by error the shares of encounters and frames as the activation should be, and its calibration error."""
    tasks = {
        f"robot {k}, {1000 * error_m:g} mm": RobotTask(k, error_m, study.seed, study.share)
        for k in range(-(-study.n_robots // 2))
        for error_m in study.errors_m
    }
    rows = run_tasks(unfinished_folder(study, "activation"), robot_rows, tasks, study.workers)
    return {"by_error_cm": {f"{100 * e:g}": summary([r for r in rows if r["error_m"] == e]) for e in study.errors_m}}


def robot_rows(task: RobotTask, folder: Path | None = None) -> Rows:
    """Return a row for each encounter of a robot at rest, and for each held-out trial."""
    _, body, memories = mind(task)
    rng = np.random.default_rng((task.seed, task.robot, 3))
    rows: Rows = []
    trials = [(condition, encounter_of(task, condition, k, n)) for condition, n in PER_ROBOT.items() for k in range(n)]
    held_out = _held_out(side_of(task.robot), task.seed, task.share)
    for condition, trial in (*trials, *(("held out", trial) for trial in held_out)):
        events = list(events_of(scene(), trial, body, body.reading(rng)))
        if not events:
            continue
        places = (np.array([getattr(e, name) for e in events]) for name in ("distance_m", "ttc_s", "miss_m"))
        touched = np.array([e.touched for e in events])
        P = activation(memories.probability, *places)
        row = {"robot": task.robot, "error_m": task.error_m, "condition": condition, "part": trial.encounter.part}
        if condition == "held out":
            before = ~np.logical_or.accumulate(touched) & (P > 0)
            tenth = np.minimum((P[before] * _TENTHS).astype(int), _TENTHS - 1)
            later = np.broadcast_to(touched.any(axis=0), P.shape)[before]
            sums = (np.bincount(tenth, weights, _TENTHS) for weights in (np.ones(len(later)), P[before], later))
            rows.append({**row, "tenths": [values.tolist() for values in sums]})
            continue
        highest = np.maximum(P.max(axis=1), touched.any(axis=1))
        stamps = np.array([e.stamp_s for e in events])
        contact = np.flatnonzero(touched.any(axis=1))
        if len(contact):
            threatens = (stamps >= trial.encounter.contact_s - _LEAD_S) & (stamps <= stamps[contact[-1]])
            rows.append({**row, "held": bool((highest[threatens] >= THRESHOLD).all())})
        elif condition in HARMLESS:
            rows.append({**row, "below": int((highest < THRESHOLD).sum()), "frames": len(highest)})
    return rows


@cache
def _held_out(side: Side, seed: int, share: float) -> tuple[Trial, ...]:
    """Trials drawn as in the training."""
    return tuple(training_trials(scene(), side, seed + 1, _HELD_OUT_SHARE * share))


def summary(rows: Rows) -> dict[str, Any]:
    """Return percentages with 95 %: over encounters, over robots for frames and for the calibration error."""
    numbers: dict[str, Any] = {}
    for condition in ("press", "graze"):
        parts = {"all": rows, **{p: [r for r in rows if r["part"] == p] for p in sorted({r["part"] for r in rows})}}
        for part, of_part in parts.items():
            held = [row["held"] for row in of_part if row["condition"] == condition and "held" in row]
            numbers[f"{condition}, {part}"] = percent_of(sum(held), len(held))
    robots = sorted({row["robot"] for row in rows})
    shares = []
    tenths = []
    for robot in robots:
        own = [row for row in rows if row["robot"] == robot]
        frames = sum(row["frames"] for row in own if "frames" in row)
        shares.append([100 * sum(row["below"] for row in own if "frames" in row) / max(frames, 1)])
        tenths.append(np.sum([row["tenths"] for row in own if "tenths" in row], axis=0)[None])
    numbers["harmless"] = interval(shares)
    numbers["calibration_error"] = interval(tenths, calibration_error)
    numbers["tenths"] = np.sum(tenths, axis=(0, 1)).tolist()
    return numbers


def calibration_error(tenths: Any) -> float:
    """Return the mean distance between stated and true rate of touch, of sums (robots, 3, 10): n, stated, touched."""
    n, stated, touched = np.sum(tenths, axis=0)
    return float(np.abs(stated - touched).sum() / n.sum())


def table(numbers: dict[str, Any]) -> Table:
    """Return a row for each quantity, a column for each error of the robots; a missed goal is bold."""
    cells = numbers["by_error_cm"]
    rows = []
    for quantity in next(iter(cells.values())):
        if quantity == "tenths":
            continue
        goal = _GOALS.get(quantity.partition(",")[0])
        values = [cell[quantity] for cell in cells.values()]
        missed = [value[0] > 0.05 if goal is None else value[0] < goal for value in values]
        name = "calibration error" if goal is None else f"{quantity} (%)"
        bound = "≤ 0.05" if goal is None else f"≥ {goal:g}"
        rows.append([name, bound, *(judged(estimate(v), m) for v, m in zip(values, missed, strict=True))])
    return Table(["activation", "goal", *(f"{error} cm" for error in cells)], rows)
