"""Two-stage inverse kinematics by IPOPT (J's solver), one problem at a time, through CasADi.

Starts, limits and tolerance are as in `pps_vision.robot.two_stage`, which solves all problems as one batch.
"""

from typing import Any

import numpy as np

from pps_vision.robot.chain import Chain
from pps_vision.robot.inverse_kinematics import IKSolution, length
from pps_vision.robot.self_motion import FarFromLimits, TwoStage, TwoStageParams, best_of_starts
from pps_vision.types import Array

_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt": {"print_level": 0, "sb": "yes", "mu_strategy": "adaptive", "max_iter": 100, "tol": 1e-8},
}


def two_stage_by_ipopt(
    chain: Chain, targets: Array, starts: Array, measure: FarFromLimits, params: TwoStageParams
) -> TwoStage:
    """Solve both stages for the origin of the chain's frame, within the joint limits of `measure`.

    A posture of the second stage counts where it still reaches its target.

    Args:
        chain: The arm, k joints.
        targets: (N, 3) m.
        starts: (S, N, k) rad.
        measure: Measure that the second stage maximizes (J IV.5).
        params: Tolerance of the first stage.
    """
    import casadi as ca

    tolerance = params.reach.tolerance
    lower = measure.lower_rad
    upper = measure.upper_rad
    q = ca.MX.sym("q", len(lower))
    target = ca.MX.sym("target", 3)
    offset = _position(chain)(q) - target
    effort = ca.sumsqr((q - (upper + lower) / 2) / ((upper - lower) / 2)) / len(lower)
    stages: list[Any] = [{"x": q, "p": target, "f": ca.sumsqr(offset)}, {"x": q, "p": target, "f": effort, "g": offset}]
    nearest, best = (ca.nlpsol("stage", "ipopt", stage, _OPTIONS) for stage in stages)

    def solve(solver: Any, targets: Array, starts: Array, **constraints: float) -> tuple[Array, Array]:
        solutions = [
            np.asarray(solver(x0=start, p=target, lbx=lower, ubx=upper, **constraints)["x"], dtype=float).ravel()
            for target, start in zip(targets, starts, strict=True)
        ]
        postures = np.array(solutions).clip(lower, upper)
        return postures, length(chain.positions(postures)[0] - targets)

    def reach(targets: Array, starts: Array) -> IKSolution:
        postures, error = solve(nearest, targets, starts)
        return IKSolution(postures, error, error <= tolerance)

    def improve(targets: Array, starts: Array) -> tuple[Array, Array]:
        postures, error = solve(best, targets, starts, lbg=0.0, ubg=0.0)
        postures = np.where((error <= tolerance)[:, None], postures, starts)
        return postures, measure(postures, chain.positions(postures)[1])

    return best_of_starts(reach, improve, targets, starts)


def _position(chain: Chain) -> Any:
    """Origin (3,) of the chain's frame as a CasADi function of its joints (k,): product of exponentials."""
    import casadi as ca

    q = ca.SX.sym("q", len(chain.joints))
    R = ca.SX.eye(3)
    t = ca.SX.zeros(3)
    for i in chain.order:
        v = chain.screws[i, :3]
        w = chain.screws[i, 3:]
        K = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        sine = ca.sin(q[i])
        versine = 1 - ca.cos(q[i])
        t = t + R @ (q[i] * v + versine * (K @ v) + (q[i] - sine) * (K @ K @ v))
        R = R @ (np.eye(3) + sine * K + versine * (K @ K))
    return ca.Function("position", [q], [R @ chain.T_root_frame[:3, 3] + t])
