"""Three ways to solve inverse kinematics in two stages, on the same random gaze postures (J: IPOPT, one by one).

All start from the same postures: the one of many babbled whose hand was nearest, and the most unlike of the next
fifteen.  A verdict is judged by the arm in closed form, and by the union of all solvers: a posture found by any proves
a point reachable.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure

from learning.reach.training import MapParams, ReachOracle
from pps_vision.experiments.chart import panels
from pps_vision.experiments.reach.map_test import closed_form
from pps_vision.experiments.study import Study
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.self_motion import FarFromLimits
from pps_vision.robot.two_stage import Solver, TwoStage, two_stage
from pps_vision.types import Array, Mask

_BATCH, _TORCH = "batch, NumPy", "batch, torch"
_DEFAULT = _BATCH


@dataclass(frozen=True)
class Solvers(Study):
    """Time a problem and verdicts of the batch (NumPy, torch), SciPy and IPOPT, with one start and with two."""

    seed: int = 0
    """Seed of the gaze postures and of the babbled ones."""
    n: int = 52_000
    """Problems for the batches, as many as J solved."""
    n_alone: int = 1500
    """How many of them the solvers that take one at a time are given."""

    def run(self) -> dict[str, object]:
        """By solver: ms a problem, agreement with the closed form and with the union of all, optimality lost."""
        if not 1 <= self.n_alone <= self.n:
            raise ValueError(
                f"bench reach solvers: --n-alone {self.n_alone} of --n {self.n}; expected 1 to all of them"
            )
        problems = _Problems.of(self.seed, self.n)
        rows = {name: run(problems) for name, run in _batches().items()}
        few = problems.first(self.n_alone)
        for name, run in _alone().items():
            try:
                rows[name] = run(few)
            except ValueError as error:  # IPOPT is an extra
                rows[name] = {"skipped": str(error)}
        found = [row.pop("reachable")[: self.n_alone] for row in rows.values() if "reachable" in row]
        union = np.any(found, axis=0)
        for row, one in zip((row for row in rows.values() if "ms" in row), found, strict=True):
            row["with_union_percent"] = 100 * float(np.mean(one == union))
        ipopt = [row["ms"] for name, row in rows.items() if name.startswith("IPOPT") and "ms" in row]
        faster = {name: min(ipopt) / row["ms"] for name, row in rows.items() if ipopt and name.startswith("batch")}
        return {"solvers": rows, "faster_than_ipopt": faster}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time a problem against verdicts missed, and against optimality lost."""
        figure, axes = panels(2)
        for name, row in numbers["solvers"].items():
            if "ms" not in row:
                continue
            marker = "o" if name.startswith("batch") else "s"
            for axis, wrong in zip(axes, (100 - row["with_union_percent"], row["optimality_rms"]), strict=True):
                axis.plot(row["ms"], wrong, marker, label=name if axis is axes[0] else None)
                if name == f"{_DEFAULT}, 2 starts":
                    axis.plot(row["ms"], wrong, "o", ms=13, mfc="none", mec="0.2")
        axes[0].set(ylabel="verdicts other than the union's (%)")
        axes[1].set(ylabel="RMS optimality lost to the best posture")
        for axis in axes:
            axis.set(xscale="log", xlabel="processor time a problem (ms)", ylim=(0, None))
            axis.grid(alpha=0.25, which="both")
        figure.legend(loc="outside lower center", ncols=4, fontsize=8)
        return figure


@dataclass(frozen=True)
class _Problems:
    """Points (N, 3) with starts (2, N, 4), whether they are reachable, and the least effort there."""

    oracle: ReachOracle
    points: Array
    starts: Array
    reachable: Mask
    effort: Array
    measure: FarFromLimits = field(repr=False)

    @classmethod
    def of(cls, seed: int, n: int) -> "_Problems":
        rng = np.random.default_rng(seed)
        oracle = ReachOracle(load_icub(), "right", MapParams(), rng)
        limits = oracle.params.gaze_limits
        points = fixation_points(oracle.robot, rng.uniform(limits.lower, limits.upper, (n, 3)))
        _, effort = closed_form(oracle.robot).least_effort(points)
        measure = FarFromLimits(oracle.lower, oracle.upper)
        return cls(oracle, points, oracle.starts(points), np.isfinite(effort), effort, measure)

    def first(self, n: int) -> "_Problems":
        """The first n."""
        few = (self.points[:n], self.starts[:, :n], self.reachable[:n], self.effort[:n])
        return _Problems(self.oracle, *few, self.measure)

    def solve(self, solver: Solver, starts: int, to_torch: bool = False) -> dict[str, Any]:
        """One solver's numbers; its verdicts too."""
        oracle = self.oracle
        asked = self.points, np.ascontiguousarray(self.starts[:starts])
        if to_torch:
            asked = torch.from_numpy(asked[0]), torch.from_numpy(asked[1])  # type: ignore[assignment]
        begun = time.process_time()
        found: TwoStage = two_stage(
            oracle.forward, *asked, oracle.lower, oracle.upper, self.measure, oracle.params.inverse, solver
        )
        ms = 1000 * (time.process_time() - begun) / len(self.points)
        reachable, good = np.asarray(found.reachable), np.asarray(found.good)
        both = reachable & self.reachable
        return {
            "ms": ms,
            "problems": len(self.points),
            "closed_form_percent": 100 * float(np.mean(reachable == self.reachable)),
            "missed": int(np.sum(self.reachable & ~reachable)),
            "within_tolerance_only": int(np.sum(reachable & ~self.reachable)),
            "optimality_rms": float(np.sqrt(np.mean((1 - self.effort[both] - good[both]) ** 2))),
            "reachable": reachable,
        }


_Run = Callable[[_Problems], dict[str, Any]]


def _batches() -> dict[str, _Run]:
    return {
        f"{_BATCH}, 1 start": lambda p: p.solve("batched", 1),
        f"{_BATCH}, 2 starts": lambda p: p.solve("batched", 2),
        f"{_TORCH}, 2 starts": lambda p: p.solve("batched", 2, to_torch=True),
    }


def _alone() -> dict[str, _Run]:
    return {
        "SciPy, 1 start": lambda p: p.solve("scipy", 1),
        "IPOPT, 1 start": lambda p: p.solve("ipopt", 1),
        "IPOPT, 2 starts": lambda p: p.solve("ipopt", 2),
    }
