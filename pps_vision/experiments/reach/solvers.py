"""Two-stage inverse kinematics: time and verdicts of the batched solver beside SciPy and IPOPT one by one (J: IPOPT).

All solvers take the same problems and start from the same babbled postures: the one whose hand is nearest to the point,
and of the next fifteen the one most unlike it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from learning.reach.training import MapParams, ReachOracle
from pps_vision.errors import InputError
from pps_vision.experiments import charts
from pps_vision.experiments.baselines.inverse_kinematics import Solver, two_stage_by
from pps_vision.experiments.reach.map_truth import closed_form
from pps_vision.experiments.study import Study, rms
from pps_vision.experiments.tables import Table
from pps_vision.robot.chain import Chain
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.self_motion import FarFromLimits
from pps_vision.robot.two_stage import TwoStage, two_stage
from pps_vision.types import Array, Mask

_BATCHED = ("batched, 1 start", "batched, 2 starts")
_DEFAULT = _BATCHED[1]


class Problems(NamedTuple):
    """Points to reach, where to start from, and the exact answers."""

    oracle: ReachOracle
    points: Array
    """(N, 3) m."""
    starts: Array
    """(2, N, 4) arm postures."""
    reachable: Mask
    """(N,)."""
    effort: Array
    """(N,) least M of all postures that reach (J IV.7); NaN out of reach."""

    @classmethod
    def draw(cls, seed: int, n: int) -> "Problems":
        """Draw gaze postures within J's limits."""
        rng = np.random.default_rng(seed)
        oracle = ReachOracle(load_icub(), "right", MapParams(), rng)
        limits = oracle.params.gaze_limits
        points = fixation_points(oracle.robot, rng.uniform(limits.lower, limits.upper, (n, 3)))
        _, effort = closed_form(oracle.robot).least_effort(points)
        return cls(oracle, points, oracle.starts(points), np.isfinite(effort), effort)

    def first(self, n: int) -> "Problems":
        """Return the first `n`."""
        return Problems(self.oracle, self.points[:n], self.starts[:, :n], self.reachable[:n], self.effort[:n])


Solve = Callable[[Problems], TwoStage]


def solvers() -> dict[str, Solve]:
    """Return every solver by name."""

    def batched(n_starts: int, problems: Problems) -> TwoStage:
        oracle, starts = problems.oracle, np.ascontiguousarray(problems.starts[:n_starts])
        limits = oracle.lower, oracle.upper
        measure, inverse = FarFromLimits(*limits), oracle.params.inverse
        return two_stage(oracle.forward, problems.points, starts, *limits, measure, inverse)

    def single(solver: Solver, n_starts: int, problems: Problems) -> TwoStage:
        oracle, starts = problems.oracle, problems.starts[:n_starts]
        chain = Chain.of(oracle.robot, oracle.robot.names.arm("right")[: starts.shape[-1]], oracle.robot.names.palms[1])
        measure, inverse = FarFromLimits(oracle.lower, oracle.upper), oracle.params.inverse
        return two_stage_by(solver, chain, problems.points, starts, measure, inverse)

    return {
        _BATCHED[0]: partial(batched, 1),
        _BATCHED[1]: partial(batched, 2),
        "SciPy, 1 start": partial(single, "scipy", 1),
        "IPOPT, 1 start": partial(single, "ipopt", 1),
        "IPOPT, 2 starts": partial(single, "ipopt", 2),
    }


@dataclass(frozen=True)
class Solvers(Study):
    """Time per problem and verdicts of the batched solver, SciPy and IPOPT, from one start and two."""

    seed: int = 0
    """Seed of the gaze postures and of the babbled ones."""
    n: int = 52_000
    """Problems for the batched solvers, as many as J solved."""
    n_single: int = 1500
    """How many of them the solvers that take one at a time are given."""

    def run(self) -> dict[str, Any]:
        """Return by solver ms per problem, verdicts against closed form and union (percent), RMS optimality lost."""
        if self.n_single > self.n:
            raise InputError(
                "bench reach_solvers", f"n_single {self.n_single} of n {self.n}; expected 1 to all of them"
            )
        problems, rows, verdicts = Problems.draw(self.seed, self.n), {}, []
        for name, solve in solvers().items():
            given = problems if name in _BATCHED else problems.first(self.n_single)
            solve(problems.first(1))  # loads and compiles
            begun = process_time()
            found = solve(given)
            ms = 1000 * (process_time() - begun) / len(given.points)
            verdicts.append(np.asarray(found.reachable))
            rows[name] = {"ms": ms, "problems": len(given.points), **_judge(found, given)}
        union = np.any([verdict[: self.n_single] for verdict in verdicts], axis=0)
        for row, verdict in zip(rows.values(), verdicts, strict=True):
            row["not_union_percent"] = 100 * float(np.mean(verdict[: self.n_single] != union))
            row["ipopt_over_this"] = rows["IPOPT, 1 start"]["ms"] / row["ms"]
        return {"solvers": rows}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw time per problem against missed verdicts, and against optimality lost."""
        figure, (verdicts, optimality) = charts.panels(2, width=5.4)
        rows = numbers["solvers"]
        others = [name for name in rows if name not in _BATCHED]
        time, missed = "processor time per problem (ms)", "verdicts that differ from the union's (%)"
        charts.speed_error(verdicts, rows, "not_union_percent", others, _DEFAULT, time, missed)
        charts.speed_error(optimality, rows, "optimality_lost", others, _DEFAULT, time, "RMS optimality lost")
        verdicts.legend(fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return time, verdicts and optimality of each solver."""
        header = ["solver", "ms per problem", "IPOPT / this", "verdicts as the closed form (%)", "optimality lost"]
        keys = ("ms", "ipopt_over_this", "closed_form_percent", "optimality_lost")
        return {
            "": Table(
                header, [[name, *(f"{row[key]:.4g}" for key in keys)] for name, row in numbers["solvers"].items()]
            )
        }


def _judge(found: TwoStage, problems: Problems) -> dict[str, Any]:
    """Return verdicts and optimality against the closed form; those within the solver's tolerance of 0.1 mm apart."""
    reachable, good = np.asarray(found.reachable), np.asarray(found.quality)
    both = reachable & problems.reachable
    return {
        "closed_form_percent": 100 * float(np.mean(reachable == problems.reachable)),
        "missed": int(np.sum(problems.reachable & ~reachable)),
        "within_tolerance_only": int(np.sum(reachable & ~problems.reachable)),
        "optimality_lost": rms(1 - problems.effort[both] - good[both]),
    }
