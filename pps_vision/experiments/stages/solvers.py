"""Two-stage inverse kinematics: time and verdicts of the batched solver beside IPOPT, one problem at a time (J).

Both take the same problems and start from the same babbled postures: the one whose hand is nearest to the point, and of
the next fifteen the most different one.
"""

from functools import partial
from typing import Any

import numpy as np

from learning.reach.labels import ReachOracle
from learning.reach.params import MapParams
from pps_vision.experiments.baselines.ipopt import two_stage_by_ipopt
from pps_vision.experiments.charts import cells_chart
from pps_vision.experiments.reach_truth import closed_form
from pps_vision.experiments.study import rms
from pps_vision.experiments.timing import timed
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.self_motion import FarFromLimits, TwoStage, two_stage
from pps_vision.types import Array

DEFAULT = "batched, 2 starts"
ERRORS = ("wrong verdicts (%)", "RMS optimality lost")  # against the arm in closed form
chart = cells_chart("error", "error", ("IPOPT, 1 start", "IPOPT, 2 starts"), DEFAULT, "processor time per problem (ms)")


def run(study: Any) -> dict[str, Any]:
    """Return by error and solver: ms per problem, and the error."""
    n = study.n_problems
    rng = np.random.default_rng(study.seed)
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

    cells: dict[str, Any] = {error: {} for error in ERRORS}
    for solver, solve, n_solved in (("batched", batched, n), ("IPOPT", ipopt, study.n_ipopt)):
        for n_starts in (1, 2):
            solve(points[:1], starts[:n_starts, :1])  # loads and compiles
            solution, ms = timed(partial(solve, points[:n_solved], starts[:n_starts, :n_solved]))
            reachable = np.isfinite(effort[:n_solved])
            both = solution.reachable & reachable
            wrong = 100 * float(np.mean(solution.reachable != reachable))
            lost = rms(1 - effort[:n_solved][both] - solution.quality[both])
            for error, value in zip(ERRORS, (wrong, lost), strict=True):
                name = f"{solver}, {n_starts} {'start' if n_starts == 1 else 'starts'}"
                cells[error][name] = {"ms": [ms / n_solved] * 3, "error": value, "n": n_solved}
    return {"cells": cells}
