"""Both stages of inverse kinematics as J solved them, one problem at a time with IPOPT; needs CasADi."""

from typing import Any

import casadi as ca
import numpy as np

from pps_vision.robot.chain import Chain
from pps_vision.robot.inverse_kinematics import ForwardModel
from pps_vision.types import Array

_QUIET: dict[str, Any] = {
    "print_time": False,
    "ipopt": {"print_level": 0, "sb": "yes", "mu_strategy": "adaptive", "max_iter": 100, "tol": 1e-8},
}


class Ipopt:
    """Nearest posture, then the least M (J IV.5) among those that reach."""

    def __init__(self, forward: ForwardModel, lower: Array, upper: Array) -> None:
        self.lower, self.upper = lower, upper
        q, p = ca.MX.sym("q", len(lower)), ca.MX.sym("p", 3)
        chain = getattr(forward, "__self__", None)
        if isinstance(chain, Chain):  # as an expression, so that IPOPT has its exact derivatives
            self._model, options = expression(chain), _QUIET
        else:
            self._model = _Model(forward, len(lower))
            options = {**_QUIET, "ipopt": {**_QUIET["ipopt"], "hessian_approximation": "limited-memory"}}
        off = self._model(q) - p
        middle, half = (upper + lower) / 2, (upper - lower) / 2
        effort = ca.sumsqr((q - middle) / half) / len(lower)
        self._closest = ca.nlpsol("closest", "ipopt", {"x": q, "p": p, "f": ca.sumsqr(off)}, options)
        self._best = ca.nlpsol("best", "ipopt", {"x": q, "p": p, "f": effort, "g": off}, options)

    def closest(self, target: Array, start: Array) -> Array:
        """The posture (k,) nearest to a target (3,)."""
        return self._solve(self._closest, target, start)

    def best(self, target: Array, start: Array) -> Array:
        """The posture (k,) of least M whose hand is at a target (3,)."""
        return self._solve(self._best, target, start, lbg=0.0, ubg=0.0)

    def _solve(self, solver: Any, target: Array, start: Array, **bounds: float) -> Array:
        found = solver(x0=start, p=target, lbx=self.lower, ubx=self.upper, **bounds)["x"]
        return np.asarray(found, dtype=float).ravel().clip(self.lower, self.upper)


def expression(chain: Chain) -> Any:
    """The chain's frame origin (3,) as a CasADi function of its joints (k,)."""
    q = ca.SX.sym("q", len(chain.joints))
    R, t = ca.SX.eye(3), ca.SX.zeros(3)
    for i in chain.order:
        v, w = chain.screws[i, :3], chain.screws[i, 3:]
        K = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        sine, versine = ca.sin(q[i]), 1 - ca.cos(q[i])
        t = t + R @ (q[i] * v + versine * (K @ v) + (q[i] - sine) * (K @ K @ v))
        R = R @ (np.eye(3) + sine * K + versine * (K @ K))
    return ca.Function("position", [q], [R @ chain.T_root_frame[:3, 3] + t])


class _Model(ca.Callback):  # type: ignore[misc, unused-ignore]  # Any where CasADi is absent
    """A learned forward model, with the Jacobian that comes with it."""

    def __init__(self, forward: ForwardModel, k: int, slope: bool = False) -> None:
        ca.Callback.__init__(self)
        self._model, self._k, self._is_slope = forward, k, slope
        self._slopes: list[_Model] = []
        self.construct("slope" if slope else "model", {})

    def get_n_in(self) -> int:
        """The joints; of the slope, and what the model gave."""
        return 1 + self._is_slope

    def get_sparsity_in(self, i: int) -> Any:
        """Shape of input i."""
        return ca.Sparsity.dense(self._k if i == 0 else 3, 1)

    def get_sparsity_out(self, i: int) -> Any:
        """Shape of the output."""
        return ca.Sparsity.dense(3, self._k if self._is_slope else 1)

    def eval(self, arg: Any) -> list[Any]:
        """The model, or its Jacobian."""
        return [self._model(np.asarray(arg[0], dtype=float).reshape(1, -1))[self._is_slope][0]]

    def has_jacobian(self) -> bool:
        """The model has one."""
        return not self._is_slope

    def get_jacobian(self, name: str, inames: Any, onames: Any, opts: Any) -> Any:
        """The Jacobian as a function of its own, for each who asks; kept, for CasADi does not."""
        self._slopes.append(_Model(self._model, self._k, slope=True))
        return self._slopes[-1]
