"""Two-stage inverse kinematics: time and verdicts of the batched solver beside IPOPT, one problem at a time (J).

All solvers take the same problems and start from the same babbled postures: the one whose hand is nearest to the point,
and of the next fifteen the most different one.
"""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.reach.labels import ReachOracle
from learning.reach.params import MapParams
from pps_vision.errors import InputError
from pps_vision.experiments import charts
from pps_vision.experiments.baselines.ipopt import two_stage_by_ipopt
from pps_vision.experiments.reach_truth import closed_form
from pps_vision.experiments.study import rms
from pps_vision.experiments.timing import timed
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.self_motion import FarFromLimits
from pps_vision.robot.two_stage import TwoStage, two_stage
from pps_vision.types import Array

_DEFAULT = "batched, 2 starts"


def run(seed: int, n: int, n_ipopt: int) -> dict[str, Any]:
    """Return by solver ms per problem, wrong verdicts (percent, against the closed form), and RMS optimality lost."""
    if n_ipopt > n:
        raise InputError("bench reach_paper", f"--n-ipopt {n_ipopt} of --n-problems {n}; expected at most {n}")
    rng = np.random.default_rng(seed)
    robot = load_icub()
    oracle = ReachOracle(robot, "right", MapParams(), rng)
    limits = oracle.params.gaze_limits
    points = fixation_points(robot, rng.uniform(limits.lower, limits.upper, (n, 3)))
    starts = oracle.starts(points)
    _, effort = closed_form(robot).least_effort(points)
    measure = FarFromLimits(oracle.lower, oracle.upper)
    inverse = oracle.params.inverse
    chain = robot.chain(robot.names.arm("right")[: len(oracle.lower)], robot.names.palm("right"))

    def batched(targets: Array, starts: Array) -> TwoStage:
        return two_stage(oracle.forward, targets, starts, oracle.lower, oracle.upper, measure, inverse)

    def ipopt(targets: Array, starts: Array) -> TwoStage:
        return two_stage_by_ipopt(chain, targets, starts, measure, inverse)

    rows = {}
    for solver, solve, n_solved in (("batched", batched, n), ("IPOPT", ipopt, n_ipopt)):
        for n_starts in (1, 2):
            solve(points[:1], starts[:n_starts, :1])  # loads and compiles
            solution, ms = timed(partial(solve, points[:n_solved], starts[:n_starts, :n_solved]))
            reachable = np.isfinite(effort[:n_solved])
            both = solution.reachable & reachable
            rows[f"{solver}, {n_starts} {'start' if n_starts == 1 else 'starts'}"] = {
                "ms": ms / n_solved,
                "problems": n_solved,
                "wrong_percent": 100 * float(np.mean(solution.reachable != reachable)),
                "optimality_lost": rms(1 - effort[:n_solved][both] - solution.quality[both]),
            }
    return {"solvers": rows}


def chart(numbers: dict[str, Any]) -> Figure:
    """Draw time per problem against wrong verdicts, and against optimality lost."""
    figure, axes = charts.panels(2, width=5.4)
    solvers = numbers["solvers"]
    baselines = [name for name in solvers if name.startswith("IPOPT")]
    errors = {"wrong_percent": "wrong verdicts (%)", "optimality_lost": "RMS optimality lost"}
    for axis, (metric, label) in zip(axes, errors.items(), strict=True):
        charts.speed_error(axis, solvers, metric, baselines, _DEFAULT, "processor time per problem (ms)", label)
    axes[0].legend(fontsize=8)
    return figure
