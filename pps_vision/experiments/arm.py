"""Velocities of points of the arm: the quadratic programme beside damped least squares."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from tqdm import tqdm

from control import limits
from control.arm import ArmParams, MovingPoint, arm_constraints, arm_velocity
from control.limits import LimitParams
from pps_vision.experiments import charts
from pps_vision.experiments.baselines.damped_least_squares import damped_least_squares
from pps_vision.experiments.study import TURNS, SampledStudy, interval, mean, rms
from pps_vision.experiments.tables import Table, estimate, median_first
from pps_vision.experiments.timing import timed
from pps_vision.robot.icub import HOME_ARM_RAD, home, load_icub
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import Array, JointVelocity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DT_S, _DEG, _SPEED_M_S, _SPREAD_RAD = 0.05, np.pi / 180, 0.1, 25 * np.pi / 180
_TOUCHING_M = LimitParams().clearance_m
_REST, _PARAMS = np.array(HOME_ARM_RAD), ArmParams()
_OURS = "quadratic programme"


class Solver(Protocol):
    """A controller of one point of one arm."""

    def __call__(self, posture: Posture, task: "Task", bodies: SelfCollision) -> Array:
        """Return joint rates (n_joints,)."""


@dataclass(frozen=True)
class Task:
    """A point of an arm that is to move out and back at 10 cm/s, and where the robot starts."""

    side: str
    frame: str
    point: Array
    """(3,) in `frame`, m."""
    direction: Array
    """(3,) unit vector."""
    start_rad: Array
    """(n_joints,)."""
    velocity: Array
    """(3,) m/s now."""


def _quadratic(posture: Posture, task: Task, bodies: SelfCollision) -> Array:
    points = [MovingPoint(task.frame, task.point, task.velocity)]
    constraints = arm_constraints(_PARAMS, posture, task.side, _REST, hold_s=_DT_S, self_collision=bodies)
    return arm_velocity(_PARAMS, posture, constraints, points)


def _damped(posture: Posture, task: Task, bodies: SelfCollision) -> Array:
    return damped_least_squares(_PARAMS, posture, task.side, task.frame, task.point, task.velocity, _REST)


def _clipped(posture: Posture, task: Task, bodies: SelfCollision) -> Array:
    return damped_least_squares(_PARAMS, posture, task.side, task.frame, task.point, task.velocity, _REST, _DT_S)


SOLVERS: Mapping[str, Solver] = {_OURS: _quadratic, "damped least squares": _damped, "the same, clipped": _clipped}


@dataclass(frozen=True)
class Arm(SampledStudy):
    """A point of the arm moved at 10 cm/s: tracking error, limits and self-distance, alone and behind the last stage.

    By kinematics, from random postures about home within the joint limits, and from outside them.
    """

    n: int = 100
    """Random postures, points and directions."""

    def run(self) -> dict[str, Any]:
        """Return means over the movements with 95 % intervals; the smallest distance of all; times of three turns."""
        robot = load_icub()
        bodies, skins = SelfCollision(robot), {side: icub_skin(_PARTS[side]) for side in _PARTS}
        numbers: dict[str, Any] = {}
        for start in ("within limits", "outside limits"):
            tasks = [
                _draw(robot, bodies, skins, np.random.default_rng((seed, len(start))), start) for seed in self.seeds
            ]
            for stage in ("alone", "behind the last stage"):
                runs: dict[str, list[dict[str, Any]]] = {name: [] for name in SOLVERS}
                for task in tqdm(tasks, f"{start}, {stage}", disable=None):
                    move = partial(_move, robot, bodies, task=task, limited=stage != "alone")
                    turns = [{name: move(solver) for name, solver in SOLVERS.items()} for _ in range(TURNS)]
                    for name in SOLVERS:
                        ms = [spent for turn in turns for spent in turn[name]["ms"]]
                        runs[name].append({**turns[0][name], "ms": ms})
                numbers[f"{start}, {stage}"] = {name: _summary(of) for name, of in runs.items()}
        return numbers

    def chart(self, numbers: dict[str, Any]) -> "Figure":
        """Draw time against tracking error."""
        cells = {name: numbers[name] for name in numbers if name.startswith("within")}
        baselines = [name for name in SOLVERS if name != _OURS]
        label = "error of the point's velocity (cm/s)"
        return charts.speed_errors(cells, "error_cm_s", label, baselines, _OURS, "time (ms)")

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one row for each start, stage and controller."""
        columns = {
            "RMS error of 10 cm/s": "error_cm_s",
            "beyond joint limits (%)": "violating_percent",
            "worst excess (°)": "excess_deg",
            "under 20 mm (%)": "touching_percent",
            "smallest self-distance (mm)": "distance_mm",
        }
        rows = [
            [
                f"{case}: {name}",
                *(estimate([round(value, 6) for value in cell[key]]) for key in columns.values()),
                median_first(cell["ms"]),
            ]
            for case, cells in numbers.items()
            if "limits" in case
            for name, cell in cells.items()
        ]
        return {"": Table(["start, stage: controller", *columns, "ms, quartiles"], rows)}


_PARTS: Mapping[str, Any] = {side: (f"{side}_forearm", f"{side}_palm") for side in ("left", "right")}


def _draw(robot: Robot, bodies: SelfCollision, skins: Mapping[str, Skin], rng: np.random.Generator, start: str) -> Task:
    """A random movement; its start keeps 30 mm of self-distance, outside limits with a third of the arm's joints."""
    side = str(rng.choice(("left", "right")))
    columns = robot.indices(robot.names.arm(side))
    lower, upper = robot.lower_rad[columns], robot.upper_rad[columns]
    while True:
        q = home(robot)
        q[columns] = np.clip(_REST + _SPREAD_RAD * rng.standard_normal(len(columns)), lower, upper)
        if start == "outside limits":
            beyond = rng.uniform(0.02, 0.2, len(columns))
            outside = np.where(rng.random(len(columns)) < 0.5, lower - beyond, upper + beyond)
            q[columns] = np.where(rng.random(len(columns)) < 1 / 3, outside, q[columns])
        if bodies.distance_m(q) > 0.03:
            break
    part = skins[side].parts[int(rng.integers(2))]
    direction = rng.standard_normal(3)
    point = part.positions_m[int(rng.integers(len(part.ids)))]
    return Task(side, part.frame, point, direction / np.linalg.norm(direction), q, np.zeros(3))


def _move(robot: Robot, bodies: SelfCollision, solver: Solver, task: Task, limited: bool) -> dict[str, Any]:
    """15 cm out, and back."""
    q, last, last_q = task.start_rad, None, None
    excess0, outside = _excess(robot, q), []
    errors, distances, ms = [], [], []
    for k in range(60):
        velocity = (_SPEED_M_S if k < 30 else -_SPEED_M_S) * task.direction
        posture = robot.at(q)
        now = Task(task.side, task.frame, task.point, task.direction, task.start_rad, velocity)
        dq, spent = timed(partial(solver, posture, now, bodies))
        ms.append(spent)
        if limited:
            command = limits.limit(LimitParams(), bodies, posture, JointVelocity(k * _DT_S, dq, _DT_S), last, last_q)
            last, last_q, dq = command, q, command.dq_rad_s
        q = q + _DT_S * dq
        moved = robot.at(q).point(task.frame, task.point) - posture.point(task.frame, task.point)
        errors.append(100 * float(np.linalg.norm(moved / _DT_S - velocity)))
        outside.append(np.max(_excess(robot, q) - excess0))
        distances.append(1000 * bodies.distance_m(q))
    return {"errors": errors, "excess": max(outside) / _DEG, "distance": min(distances), "ms": ms}


def _excess(robot: Robot, q: Array) -> Array:
    """(n_joints,) rad by which joints are beyond their limits."""
    return np.maximum(np.maximum(q - robot.upper_rad, robot.lower_rad - q), 0.0)


def _summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    excess, distance = np.array([run["excess"] for run in runs]), np.array([run["distance"] for run in runs])
    return {
        "error_cm_s": interval([run["errors"] for run in runs], rms),
        "violating_percent": interval(list(100.0 * (excess[:, None] > 1e-5)), mean),
        "excess_deg": [float(max(excess.max(), 0.0))],
        "touching_percent": interval(list(100.0 * (distance[:, None] < 1000 * _TOUCHING_M - 0.01)), mean),
        "distance_mm": [float(distance.min())],
        "ms": [float(ms) for ms in np.percentile(np.concatenate([run["ms"] for run in runs]), (25, 50, 75))],
    }
