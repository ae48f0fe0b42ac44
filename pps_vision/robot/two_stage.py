"""Inverse kinematics in two stages (J): reach the target, then be the best of the postures that do.

Three ways: all problems as one batch (here; NumPy or torch), or one by one with SciPy or IPOPT (CasADi: extra `test`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np
from array_api_compat import array_namespace
from scipy.optimize import least_squares, minimize

from pps_vision.errors import InputError
from pps_vision.robot.inverse_kinematics import ForwardModel, IKParams, IKSolution, length, solve_ik
from pps_vision.robot.self_motion import FarFromLimits, Measure, WalkParams, walk
from pps_vision.types import Array, Mask

Solver = Literal["batched", "scipy", "ipopt"]


@dataclass(frozen=True)
class TwoStageParams:
    """`reach` says what counts as reached (m): J's ε."""

    reach: IKParams = IKParams(tolerance=1e-4, max_steps=100, min_step_rad=3e-4)
    improve: WalkParams = field(default_factory=WalkParams)


@dataclass(frozen=True)
class TwoStage:
    """Postures `q_rad` (N, k), what is left between hand and target, `error` (N,) m, which are `reachable` (N,), and
    how `good` (N,) the best posture is, NaN out of reach."""

    q_rad: Array
    error: Array
    reachable: Mask
    good: Array


def two_stage(
    forward: ForwardModel,
    targets: Any,
    starts: Any,
    lower_rad: Any,
    upper_rad: Any,
    measure: Measure,
    params: TwoStageParams | None = None,
    solver: Solver = "batched",
) -> TwoStage:
    """Both stages from every start: `targets` (N, m), `starts` (S, N, k), limits (k,); the best of what is found.

    ValueError for shapes that do not fit, and where IPOPT is asked for and not installed.
    """
    params = params or TwoStageParams()
    reach, improve = _STAGES[solver](forward, lower_rad, upper_rad, measure, params)
    xp = array_namespace(targets)
    best_q, best_error = starts[0], xp.full_like(targets[:, 0], xp.inf)
    good = xp.full_like(targets[:, 0], -xp.inf)
    for start in starts:
        first = reach(targets, start)
        nearer = (first.error < best_error) & ~(good > -xp.inf)
        best_q = xp.where(nearer[:, None], first.q_rad, best_q)
        best_error = xp.where(first.error < best_error, first.error, best_error)
        there = xp.nonzero(first.converged)[0]
        if len(there):
            q, value = improve(targets[there], first.q_rad[there])
            better = value > good[there]
            best_q[there] = xp.where(better[:, None], q, best_q[there])
            good[there] = xp.where(better, value, good[there])
    reachable = good > -xp.inf
    return TwoStage(best_q, best_error, reachable, xp.where(reachable, good, xp.nan))


_Reach = Callable[[Any, Any], IKSolution]  # targets, starts
_Improve = Callable[[Any, Any], tuple[Any, Any]]  # targets, postures that reach them -> the best, how good it is


def _batched(
    forward: ForwardModel, lower: Any, upper: Any, measure: Measure, params: TwoStageParams
) -> tuple[_Reach, _Improve]:
    def improve(targets: Array, q: Array) -> tuple[Array, Array]:
        xp = array_namespace(q)
        low, high = (xp.asarray(limit, dtype=q.dtype, device=q.device) for limit in (lower, upper))
        return walk(forward, targets, q, low, high, measure, params.improve)

    return lambda targets, start: solve_ik(forward, targets, start[None], lower, upper, params.reach), improve


class _OneByOne:
    """A problem at a time: `closest(target, start)` and `best(target, q)` each return a posture (k,)."""

    def __init__(self, forward: ForwardModel, measure: Measure, params: TwoStageParams) -> None:
        self.forward, self.measure, self.tolerance = forward, measure, params.reach.tolerance

    def stages(self, closest: Callable[[Array, Array], Array], best: Callable[[Array, Array], Array]) -> Any:
        """The two stages, of many problems."""
        return partial(self._reach, closest), partial(self._improve, best)

    def value(self, q: Array) -> float:
        """How good a posture (k,) is."""
        return float(self.measure(q[None], self.forward(q[None])[1])[0])

    def _reach(self, closest: Callable[[Array, Array], Array], targets: Array, starts: Array) -> IKSolution:
        q = np.array([closest(target, start) for target, start in zip(targets, starts, strict=True)])
        error = length(self.forward(q)[0] - targets)
        return IKSolution(q, error, error <= self.tolerance)

    def _improve(self, best: Callable[[Array, Array], Array], targets: Array, starts: Array) -> tuple[Array, Array]:
        q = np.array([best(target, start) for target, start in zip(targets, starts, strict=True)])
        kept = length(self.forward(q)[0] - targets) <= self.tolerance
        q = np.where(kept[:, None], q, starts)
        return q, self.measure(q, self.forward(q)[1])


def _scipy(
    forward: ForwardModel, lower: Array, upper: Array, measure: Measure, params: TwoStageParams
) -> tuple[_Reach, _Improve]:
    """Trust-region reflective least squares, then sequential quadratic programming."""
    one, scale = _OneByOne(forward, measure, params), 1 / params.reach.tolerance
    inside = np.asarray(lower) + 1e-9, np.asarray(upper) - 1e-9

    def off(q: Array, target: Array) -> Array:
        return (forward(q[None])[0][0] - target) * scale

    def slope(q: Array, target: Array) -> Array:
        return forward(q[None])[1][0] * scale

    def closest(target: Array, start: Array) -> Array:
        q = np.clip(start, *inside)
        return least_squares(off, q, slope, (lower, upper), args=(target,), xtol=1e-6, max_nfev=100).x

    def best(target: Array, start: Array) -> Array:
        stay = {"type": "eq", "fun": off, "jac": slope, "args": (target,)}
        bounds = list(zip(lower, upper, strict=True))
        found = minimize(lambda q: -one.value(q), start, bounds=bounds, constraints=stay, method="SLSQP")
        return found.x.clip(lower, upper)

    return one.stages(closest, best)


def _ipopt(
    forward: ForwardModel, lower: Array, upper: Array, measure: Measure, params: TwoStageParams
) -> tuple[_Reach, _Improve]:
    """IPOPT through CasADi, which is told the model's own Jacobian."""
    try:
        from pps_vision.robot.ipopt import Ipopt
    except ImportError:
        raise InputError("solver ipopt", "CasADi is not installed; expected the extra pps-vision[test]") from None
    if not isinstance(measure, FarFromLimits):
        raise ValueError(f"solver ipopt, {measure}: expected FarFromLimits, the one measure it has as an expression")
    solver = Ipopt(forward, np.asarray(lower), np.asarray(upper))
    return _OneByOne(forward, measure, params).stages(solver.closest, solver.best)


_STAGES = {"batched": _batched, "scipy": _scipy, "ipopt": _ipopt}
