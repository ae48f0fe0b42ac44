"""Velocities of a point of the arm: the quadratic programme beside damped least squares.

By kinematics, from random postures about home within the joint limits: 15 cm out at 10 cm/s, and back; alone and behind
the last stage of every command (`control.limits`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from control import limits
from control.arm import ArmParams, MovingPoint, arm_constraints, arm_velocity
from control.differential_kinematics import rate_limits
from control.limits import LimitParams
from pps_vision.experiments.charts import cells_chart
from pps_vision.experiments.study import TURNS, Metric, Values, compare, percent, rms
from pps_vision.experiments.timing import timed
from pps_vision.robot.icub import HOME_ARM_RAD, home, load_icub
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array, JointVelocity

OURS = "quadratic programme"
SCENARIOS = {"alone": False, "behind the last stage": True}  # whether the command passes through the last stage
DAMPING_M = 0.05  # λ in m/rad (Buss 2004 tunes it by hand; 0.01–0.2 tried on development postures)
_DT_S = 0.05
_STEPS = 30  # out; as many back
_SPEED_M_S = 0.1
_SPREAD_RAD = np.deg2rad(25)
_FREE_M = 0.03  # self-collision distance of the first posture
_REST = np.array(HOME_ARM_RAD)
_PARAMS = ArmParams()
_METRICS = {
    "error_cm_s": Metric("error_cm_s", rms),
    "violating_percent": Metric("is_beyond_limits", percent),
    "touching_percent": Metric("is_too_near", percent),
}


@dataclass(frozen=True)
class Task:
    """A point of an arm, the velocity it is to have, and the posture of the robot at the start."""

    robot: Robot
    bodies: SelfCollision
    side: str
    frame: str
    point: Array  # (3,) in `frame`, m
    start_rad: Array  # (n_joints,)
    velocity: Array  # (3,) m/s
    limited: bool = False  # whether the command passes through the last stage


Solver = Callable[[Posture, Task], Array]  # returns joint rates (n_joints,)


def _quadratic(posture: Posture, task: Task) -> Array:
    points = [MovingPoint(task.frame, task.point, task.velocity)]
    constraints = arm_constraints(_PARAMS, posture, task.side, _REST, hold_s=_DT_S, self_collision=task.bodies)
    return arm_velocity(_PARAMS, posture, constraints, points)


def damped_least_squares(posture: Posture, task: Task, hold_s: float | None = None) -> Array:
    """Joint rates (n_joints,) q̇ = Jᵀ(J Jᵀ + λ²)⁻¹ v + (1 − J⁺J) k (rest − q) (Nakamura & Hanafusa 1986; Liégeois 1977).

    All rates are scaled by one factor to the rate limit. With `hold_s` each joint's rate is then clipped so that the
    joint stays within its limits for that time.
    """
    robot = posture.robot
    columns = robot.indices(robot.names.arm(task.side))
    q = posture.q_rad[columns]
    J = posture.jacobian(task.frame, task.point)[:3, columns]
    inverse: Array = J.T @ np.linalg.inv(J @ J.T + DAMPING_M**2 * np.eye(3))
    preferred = _PARAMS.posture_per_s * (_REST - q)
    rates = inverse @ task.velocity + preferred - inverse @ (J @ preferred)
    rates *= min(1.0, _PARAMS.max_rate_rad_s / max(float(np.abs(rates).max()), 1e-12))
    if hold_s is not None:
        bounds = rate_limits(q, robot.lower_rad[columns], robot.upper_rad[columns], _PARAMS.max_rate_rad_s, 1 / hold_s)
        rates = np.clip(rates, *bounds)
    dq = np.zeros(robot.n_joints)
    dq[columns] = rates
    return dq


SOLVERS: Mapping[str, Solver] = {
    OURS: _quadratic,
    "damped least squares": damped_least_squares,
    "the same, clipped": partial(damped_least_squares, hold_s=_DT_S),
}
_BASELINES = [name for name in SOLVERS if name != OURS]
chart = cells_chart("error_cm_s", "error of the point's velocity (cm/s)", _BASELINES, OURS, "time (ms)")


def run(study: Any) -> dict[str, Any]:
    """Return by scenario and method: error of the velocity, movements beyond limits or too near the body, time."""
    robot = load_icub()
    bodies = SelfCollision(robot)
    seeds = range(study.seed, study.seed + study.n_movements)
    scenarios = {name: partial(_draw, robot, bodies, limited) for name, limited in SCENARIOS.items()}
    methods = {name: partial(_move, solver) for name, solver in SOLVERS.items()}
    return {"cells": compare(scenarios, methods, _METRICS, seeds, repeated=TURNS)}


def _draw(robot: Robot, bodies: SelfCollision, limited: bool, seed: int) -> Task:
    """A random movement; its start keeps 30 mm of self-distance."""
    rng = np.random.default_rng(seed)
    side = str(rng.choice(("left", "right")))
    columns = robot.indices(robot.names.arm(side))
    q = home(robot)
    while True:
        q[columns] = _REST + _SPREAD_RAD * rng.standard_normal(len(columns))
        q = robot.clamp(q)
        if bodies.distance_m(q) > _FREE_M:
            break
    part = [part for part in icub_skin().parts if part.name.startswith(side)][int(rng.integers(2))]
    direction = rng.standard_normal(3)
    velocity = _SPEED_M_S * direction / np.linalg.norm(direction)
    point = part.positions_m[int(rng.integers(len(part.ids)))]
    return Task(robot, bodies, side, part.frame, point, q, velocity, limited)


def _move(solver: Solver, task: Task, seed: int) -> Values:
    """Values of one movement."""
    robot = task.robot
    q = task.start_rad
    last = None
    last_q = None
    errors, distances, excess, ms = [], [], [], []
    for k in range(2 * _STEPS):
        posture = robot.at(q)
        now = task if k < _STEPS else replace(task, velocity=-task.velocity)
        dq, step_ms = timed(partial(solver, posture, now))
        ms.append(step_ms)
        if task.limited:
            wanted = JointVelocity(k * _DT_S, dq, _DT_S)
            last = limits.limit(LimitParams(), task.bodies, posture, wanted, last, last_q)
            last_q = q
            dq = last.dq_rad_s
        q = q + _DT_S * dq
        moved = robot.at(q).point(task.frame, task.point) - posture.point(task.frame, task.point)
        errors.append(100 * float(np.linalg.norm(moved / _DT_S - now.velocity)))
        excess.append(float(np.max(np.maximum(q - robot.upper_rad, robot.lower_rad - q))))
        distances.append(1000 * task.bodies.distance_m(q))
    return {
        "error_cm_s": errors,
        "is_beyond_limits": [max(excess) > 1e-5],
        "is_too_near": [min(distances) < 1000 * LimitParams().clearance_m - 0.01],
        "ms": ms,
    }
