"""Inverse kinematics by general solvers, one problem at a time: SciPy, IPOPT (J), and least squares for the gaze.

They have the same starts, limits and tolerance as `pps_vision.robot.two_stage`, which solves all problems as one batch.
"""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares, minimize

from pps_vision.robot.chain import Chain
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.inverse_kinematics import IKParams, IKSolution, length, solve_ik
from pps_vision.robot.self_motion import FarFromLimits
from pps_vision.robot.two_stage import TwoStage, TwoStageParams, best_of_starts
from pps_vision.types import Array

Solver = Literal["scipy", "ipopt"]
OneProblem = Callable[[Array, Array], Array]
"""A target (3,) and a start (k,) → a posture (k,)."""


def two_stage_by(
    solver: Solver,
    chain: Chain,
    targets: Array,
    starts: Array,
    measure: FarFromLimits,
    params: TwoStageParams | None = None,
) -> TwoStage:
    """Solve both stages for the origin of the chain's frame, within the limits that `measure` is of.

    `targets` (N, 3) m, `starts` (S, N, k) rad.  A posture of the second stage counts where it still reaches its target.
    """
    tolerance = (params or TwoStageParams()).reach.tolerance
    nearest, best = (_scipy if solver == "scipy" else _ipopt)(chain, measure, tolerance)

    def solve_each(one: OneProblem, targets: Array, starts: Array) -> tuple[Array, Array]:
        q = np.array([one(target, start) for target, start in zip(targets, starts, strict=True)])
        q = q.clip(measure.lower_rad, measure.upper_rad)
        return q, length(chain.positions(q)[0] - targets)

    def reach(targets: Array, starts: Array) -> IKSolution:
        q, error = solve_each(nearest, targets, starts)
        return IKSolution(q, error, error <= tolerance)

    def improve(targets: Array, starts: Array) -> tuple[Array, Array]:
        q, error = solve_each(best, targets, starts)
        q = np.where((error <= tolerance)[:, None], q, starts)
        return q, measure(q, chain.positions(q)[1])

    return best_of_starts(reach, improve, targets, starts)


def _scipy(chain: Chain, measure: FarFromLimits, tolerance: float) -> tuple[OneProblem, OneProblem]:
    """Trust-region reflective least squares, then sequential quadratic programming."""
    lower, upper = measure.lower_rad, measure.upper_rad

    def residual(q: Array, target: Array) -> Array:
        return (chain.positions(q[None])[0][0] - target) / tolerance

    def jacobian(q: Array, target: Array) -> Array:
        return chain.positions(q[None])[1][0] / tolerance

    def nearest(target: Array, start: Array) -> Array:
        inside = start.clip(lower + 1e-9, upper - 1e-9)
        return least_squares(residual, inside, jacobian, (lower, upper), args=(target,), xtol=1e-6, max_nfev=100).x

    def best(target: Array, start: Array) -> Array:
        reached = {"type": "eq", "fun": residual, "jac": jacobian, "args": (target,)}
        bounds = list(zip(lower, upper, strict=True))
        return minimize(lambda q: -measure(q[None], q)[0], start, bounds=bounds, constraints=reached, method="SLSQP").x

    return nearest, best


def _ipopt(chain: Chain, measure: FarFromLimits, tolerance: float) -> tuple[OneProblem, OneProblem]:
    """IPOPT through CasADi, with the exact derivatives of the product of exponentials."""
    import casadi as ca

    lower, upper = measure.lower_rad, measure.upper_rad
    q, p = ca.MX.sym("q", len(lower)), ca.MX.sym("p", 3)
    offset = _position(chain)(q) - p
    effort = ca.sumsqr((q - (upper + lower) / 2) / ((upper - lower) / 2)) / len(lower)
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "mu_strategy": "adaptive", "max_iter": 100, "tol": 1e-8},
    }
    stages = {"x": q, "p": p, "f": ca.sumsqr(offset)}, {"x": q, "p": p, "f": effort, "g": offset}
    solvers = [ca.nlpsol("stage", "ipopt", stage, options) for stage in stages]

    def solve(solver: Any, target: Array, start: Array, **bounds: float) -> Array:
        found = solver(x0=start, p=target, lbx=lower, ubx=upper, **bounds)["x"]
        return np.asarray(found, dtype=float).ravel()

    return (
        lambda target, start: solve(solvers[0], target, start),
        lambda target, start: solve(solvers[1], target, start, lbg=0.0, ubg=0.0),
    )


def _position(chain: Chain) -> Any:
    """The origin (3,) of the chain's frame as a CasADi function of its joints (k,)."""
    import casadi as ca

    q = ca.SX.sym("q", len(chain.joints))
    R, t = ca.SX.eye(3), ca.SX.zeros(3)
    for i in chain.order:
        v, w = chain.screws[i, :3], chain.screws[i, 3:]
        K = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        sine, versine = ca.sin(q[i]), 1 - ca.cos(q[i])
        t = t + R @ (q[i] * v + versine * (K @ v) + (q[i] - sine) * (K @ K @ v))
        R = R @ (np.eye(3) + sine * K + versine * (K @ K))
    return ca.Function("position", [q], [R @ chain.T_root_frame[:3, 3] + t])


def gaze_by_least_squares(model: GazeModel, points: Array, limits: GazeLimits) -> Array:
    """(N, 3) gaze postures that fixate points (N, 3), by damped least squares from straight ahead; NaN where none."""

    def forward(gaze: Array) -> tuple[Array, Array]:
        h = 1e-7
        here, *ahead = model.points(np.concatenate([gaze, *(gaze + h * axis for axis in np.eye(3))])).reshape(4, -1, 3)
        return here, (np.stack(ahead, axis=2) - here[:, :, None]) / h

    starts = np.tile([0.0, 0.0, np.deg2rad(20)], (1, len(points), 1))
    params = IKParams(tolerance=1e-8, max_steps=30)
    found = solve_ik(forward, points, starts, limits.lower, limits.upper, params)
    return np.where(found.converged[:, None], found.q_rad, np.nan)
