"""Two-stage inverse kinematics: time and verdicts of the batched solver beside SciPy and IPOPT one by one (J: IPOPT).

All solvers take the same problems and start from the same babbled postures: the one whose hand is nearest to the point,
and of the next fifteen the one most unlike it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure

from learning.reach.labels import ReachOracle
from learning.reach.params import MapParams
from pps_vision.errors import InputError
from pps_vision.experiments import charts
from pps_vision.experiments.baselines.inverse_kinematics import Solver, two_stage_by
from pps_vision.experiments.reach.map_truth import closed_form
from pps_vision.experiments.study import SampledStudy, rms
from pps_vision.experiments.tables import Table
from pps_vision.experiments.timing import timed
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.self_motion import FarFromLimits
from pps_vision.robot.two_stage import TwoStage, two_stage
from pps_vision.types import Array

_BATCHED = ("batched, 1 start", "batched, 2 starts")

Solve = Callable[[Array, Array], TwoStage]
"""Points (N, 3) and starts (2, N, 4) to postures."""


@dataclass(frozen=True)
class Solvers(SampledStudy):
    """Time per problem and verdicts of the batched solver, SciPy and IPOPT, from one start and two."""

    SHORT: ClassVar[Mapping[str, Any]] = {"n": 100, "n_single": 10}

    n: int = 52_000
    """Problems for the batched solvers, as many as J solved."""
    n_single: int = 1500
    """How many of them the solvers that take one at a time are given."""

    def run(self) -> dict[str, Any]:
        """Return by solver ms per problem, verdicts unlike the closed form (percent), and RMS optimality lost."""
        if self.n_single > self.n:
            raise InputError(
                "bench reach_solvers", f"n_single {self.n_single} of n {self.n}; expected 1 to all of them"
            )
        rng = np.random.default_rng(self.seed)
        oracle = ReachOracle(load_icub(), "right", MapParams(), rng)
        limits = oracle.params.gaze_limits
        points = fixation_points(oracle.robot, rng.uniform(limits.lower, limits.upper, (self.n, 3)))
        starts = oracle.starts(points)
        _, effort = closed_form(oracle.robot).least_effort(points)
        rows = {}
        for name, solve in solvers(oracle).items():
            n = self.n if name in _BATCHED else self.n_single
            solve(points[:1], starts[:, :1])  # loads and compiles
            found, ms = timed(partial(solve, points[:n], starts[:, :n]))
            rows[name] = {"ms": ms / n, "problems": n, **_judge(found, effort[:n])}
        for row in rows.values():
            row["ipopt_over_this"] = rows["IPOPT, 1 start"]["ms"] / row["ms"]
        return {"solvers": rows}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw time per problem against wrong verdicts, and against optimality lost."""
        figure, axes = charts.panels(2, width=5.4)
        rows = numbers["solvers"]
        others = [name for name in rows if name not in _BATCHED]
        errors = {"wrong_percent": "wrong verdicts (%)", "optimality_lost": "RMS optimality lost"}
        for axis, (metric, label) in zip(axes, errors.items(), strict=True):
            charts.speed_error(axis, rows, metric, others, _BATCHED[1], "processor time per problem (ms)", label)
        axes[0].legend(fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return time, verdicts and optimality of each solver."""
        header = ["solver", "ms per problem", "IPOPT / this", "wrong verdicts (%)", "optimality lost"]
        keys = ("ms", "ipopt_over_this", "wrong_percent", "optimality_lost")
        rows = [[name, *(f"{row[key]:.3g}" for key in keys)] for name, row in numbers["solvers"].items()]
        return {"": Table(header, rows)}


def solvers(oracle: ReachOracle) -> dict[str, Solve]:
    """Return every solver by name."""
    limits, inverse = (oracle.lower, oracle.upper), oracle.params.inverse
    measure, names = FarFromLimits(*limits), oracle.robot.names
    chain = oracle.robot.chain(names.arm("right")[: len(oracle.lower)], names.palms[1])

    def batched(n_starts: int, points: Array, starts: Array) -> TwoStage:
        return two_stage(oracle.forward, points, starts[:n_starts], *limits, measure, inverse)

    def single(solver: Solver, n_starts: int, points: Array, starts: Array) -> TwoStage:
        return two_stage_by(solver, chain, points, starts[:n_starts], measure, inverse)

    return {
        _BATCHED[0]: partial(batched, 1),
        _BATCHED[1]: partial(batched, 2),
        "SciPy, 1 start": partial(single, "scipy", 1),
        "IPOPT, 1 start": partial(single, "ipopt", 1),
        "IPOPT, 2 starts": partial(single, "ipopt", 2),
    }


def _judge(found: TwoStage, effort: Array) -> dict[str, float]:
    """Return wrong verdicts and optimality lost against the least M of the closed form (N,), NaN out of reach."""
    reachable = np.isfinite(effort)
    both = found.reachable & reachable
    return {
        "wrong_percent": 100 * float(np.mean(found.reachable != reachable)),
        "missed": int(np.sum(reachable & ~found.reachable)),
        "optimality_lost": rms(1 - effort[both] - found.quality[both]),
    }
