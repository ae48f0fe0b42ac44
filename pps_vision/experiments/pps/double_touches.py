"""Double touch (R milestone 1): which taxels the finger can reach, and which it touches where joints read wrong."""

from collections import Counter
from dataclasses import dataclass
from typing import Any, get_args

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from control.double_touch import FINGERTIP_RADIUS_M, DoubleTouch, DoubleTouching, Infeasible
from pps_vision.experiments.study import Study
from pps_vision.robot.icub import load_icub
from pps_vision.robot.skin import INNER_FOREARM, OUTER_FOREARM, TOUCH_RADIUS_M, icub_skin
from pps_vision.types import Array

_OUTCOMES = ("feasible", *get_args(Infeasible))
_COLORS = ("tab:blue", "0.3", "tab:orange", "tab:red", "0.7")
_SHOWN_DEG = 2.0
_LAST = 15  # steps in which the fingertip comes from 6 cm off: joints that err by a few degrees bring it no nearer


@dataclass(frozen=True)
class DoubleTouches(Study):
    """Double touches of every forearm taxel from random starts; and what a robot whose joints are not what it
    reads really touches first, of the eight inner taxels that it aims at (R: six of eight were ever touched)."""

    seed: int = 0
    """Seed of the starts and the joints' errors."""
    starts: int = 24
    """Starts a taxel."""
    robots: int = 5
    """Robots whose joints are off, each by its own."""
    joint_deg: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0, 4.0)
    """Standard deviations of the joints' errors."""

    def run(self) -> dict[str, Any]:
        """By taxel: outcomes of the starts; by the joints' error: right ones, and how far off, of what is touched."""
        if self.starts < 1 or self.robots < 1:
            raise ValueError(f"--starts {self.starts}, --robots {self.robots}; expected at least 1 of each")
        planner = DoubleTouching(load_icub(), icub_skin(("left_forearm",)).parts[0])
        plans = {
            i: planner.plan(planner.part.ids.index(i), self.starts, np.random.default_rng((self.seed, i)))
            for i in INNER_FOREARM + OUTER_FOREARM
        }
        counts = {i: Counter("feasible" if isinstance(p, DoubleTouch) else p for p in of) for i, of in plans.items()}
        touches = {i: [p for p in plans[i] if isinstance(p, DoubleTouch)] for i in INNER_FOREARM}
        return {
            "outcomes": {i: {name: of[name] for name in _OUTCOMES} for i, of in counts.items()},
            "infeasible_taxels": [i for i, of in counts.items() if not of["feasible"]],
            "joint_errors": [self._touched(planner, touches, std) for std in self.joint_deg],
        }

    def _touched(
        self, planner: DoubleTouching, touches: dict[int, list[DoubleTouch]], std_deg: float
    ) -> dict[str, Any]:
        """What is touched by robots whose joints are off by so much."""
        matrix = np.zeros((self.robots, len(INNER_FOREARM), len(planner.part.ids) + 1), dtype=int)
        apart = []
        for robot in range(self.robots):
            rng = np.random.default_rng((self.seed, robot))
            error = np.deg2rad(std_deg) * rng.standard_normal(planner.robot.n_joints)
            for row, aimed in enumerate(INNER_FOREARM):
                for touch in touches[aimed]:
                    gaps = np.array([_gaps(planner, q + error) for q in touch.joints_rad[-_LAST:]])
                    met = int(np.argmax(gaps.min(axis=1) <= 0)) if (gaps <= 0).any() else -1
                    nearest = int(gaps[met].argmin())
                    hit = nearest if gaps[met, nearest] <= TOUCH_RADIUS_M else len(planner.part.ids)
                    matrix[robot, row, hit] += 1
                    apart.append(gaps[-1, planner.part.ids.index(aimed)])
        inner = [planner.part.ids.index(i) for i in INNER_FOREARM]
        right = matrix[:, np.arange(len(inner)), inner].sum() / matrix.sum()
        return {
            "joint_deg": std_deg,
            "aimed_is_touched_percent": round(100 * float(right), 1),
            "nothing_touched_percent": round(100 * float(matrix[..., -1].sum() / matrix.sum()), 1),
            "inner_taxels_ever_touched": [int(n) for n in (matrix[..., inner].sum(axis=1) > 0).sum(axis=1)],
            "gap_to_the_aimed_mm_rms": round(1000 * float(np.sqrt(np.mean(np.square(apart)))), 2),
            "aimed_by_touched": matrix.sum(axis=0).tolist(),
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """What becomes of the starts, and what is touched where joints are off by 2°."""
        figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4.2), layout="constrained")
        taxels = list(numbers["outcomes"])
        below = np.zeros(len(taxels))
        for name, color in zip(_OUTCOMES, _COLORS, strict=True):
            share = np.array([100 * of[name] / self.starts for of in numbers["outcomes"].values()])
            left.bar([str(i) for i in taxels], share, bottom=below, color=color, label=name)
            below += share
        left.set_xlabel("taxel aimed at (the last four on the outer side)")
        left.set_ylabel("starts (%)")
        left.legend(fontsize=7, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
        shown = next(
            (of for of in numbers["joint_errors"] if of["joint_deg"] == _SHOWN_DEG), numbers["joint_errors"][-1]
        )
        matrix = np.array(shown["aimed_by_touched"], dtype=float)
        image = right.imshow(
            100 * matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1), cmap="Blues", vmin=0, vmax=100
        )
        ids = icub_skin(("left_forearm",)).parts[0].ids
        right.set_xticks(range(len(ids) + 1), [*(str(i) for i in ids), "none"], fontsize=8)
        right.set_yticks(range(len(INNER_FOREARM)), [str(i) for i in INNER_FOREARM], fontsize=8)
        right.set_xlabel("taxel nearest to the fingertip when it meets the skin")
        right.set_ylabel("taxel aimed at")
        right.set_title(f"joints off by {shown['joint_deg']:g}° (standard deviation)", fontsize=9)
        figure.colorbar(image, ax=right, label="touches (%)", shrink=0.8)
        figure.suptitle(
            "Inner taxels are in reach from nearly every start; joints that read wrong make the finger touch another",
            fontsize=11,
        )
        return figure


def _gaps(planner: DoubleTouching, q: Array) -> Array:
    """(n,) m from the fingertip's surface to each taxel's centre."""
    posture = planner.robot.at(q)
    taxels = posture.point(planner.part.frame, planner.part.positions_m)
    tip = posture.point(planner.robot.names.index_tips[1])
    gaps: Array = np.linalg.norm(taxels - tip, axis=1) - FINGERTIP_RADIUS_M
    return gaps
