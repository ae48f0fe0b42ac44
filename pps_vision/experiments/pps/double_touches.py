"""Double touch (R milestone 1): the taxels that the finger can reach, and those it touches with encoder offsets."""

from collections import Counter
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from matplotlib.figure import Figure

from control.double_touch import FINGERTIP_RADIUS_M, DoubleTouch, DoubleTouching, Infeasible
from pps_vision.experiments.charts import bars, curves, panels
from pps_vision.experiments.study import Study, interval, percent
from pps_vision.robot.icub import load_icub
from pps_vision.robot.skin import INNER_FOREARM, OUTER_FOREARM, TOUCH_RADIUS_M, icub_skin
from pps_vision.types import Array

ENCODER_DEG = (0.0, 0.5, 1.0, 2.0, 4.0)  # standard deviations of the encoders' offsets
_LAST = 15  # steps: the fingertip comes from 6 cm away, farther than these offsets displace it


@dataclass(frozen=True)
class DoubleTouches(Study):
    """Feasibility of double touches of each forearm taxel, and the taxels touched by robots with encoder offsets.

    R aimed at eight inner taxels, of which six were ever touched.
    """

    seed: int = 0
    """Seed of the starts and the offsets."""
    starts: int = 24
    """Random start postures for each taxel."""
    n: int = 5
    """Robots for each size of the offsets."""

    def run(self) -> dict[str, Any]:
        """Return the outcomes by taxel, and by offset how often the aimed taxel is touched and how many ever are."""
        planner = DoubleTouching(load_icub(), icub_skin(("left_forearm",)).parts[0])
        plans = {
            i: planner.plan(planner.part.ids.index(i), self.starts, np.random.default_rng((self.seed, i)))
            for i in INNER_FOREARM + OUTER_FOREARM
        }
        counts = {i: Counter("feasible" if isinstance(p, DoubleTouch) else p for p in of) for i, of in plans.items()}
        touches = {i: [p for p in plans[i] if isinstance(p, DoubleTouch)] for i in INNER_FOREARM}
        return {
            "outcomes": {
                i: {name: of[name] for name in ("feasible", *get_args(Infeasible))} for i, of in counts.items()
            },
            "encoder_offsets": {std: self._touched(planner, touches, std) for std in ENCODER_DEG},
        }

    def _touched(
        self, planner: DoubleTouching, touches: dict[int, list[DoubleTouch]], std_deg: float
    ) -> dict[str, Any]:
        """Touched taxels of robots whose encoder offsets have a standard deviation."""
        hits = np.zeros((self.n, len(INNER_FOREARM), len(planner.part.ids) + 1), dtype=int)
        for robot in range(self.n):
            rng = np.random.default_rng((self.seed, robot))
            error = np.deg2rad(std_deg) * rng.standard_normal(planner.robot.n_joints)
            for row, aimed in enumerate(INNER_FOREARM):
                for touch in touches[aimed]:
                    hits[robot, row, first_touched(planner, touch.joints_rad[-_LAST:] + error)] += 1
        inner = [planner.part.ids.index(i) for i in INNER_FOREARM]
        aimed_hit = hits[:, np.arange(len(inner)), inner].sum(axis=1) / hits.sum(axis=(1, 2))
        return {
            "aimed_is_touched_percent": interval(aimed_hit[:, None], percent),
            "nothing_touched_percent": round(100 * float(hits[..., -1].sum() / hits.sum()), 1),
            "inner_taxels_ever_touched": (hits[..., inner].sum(axis=1) > 0).sum(axis=1).tolist(),
        }

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw the feasible share by taxel; and how often the aimed taxel is touched, against the offsets."""
        feasible, (axis,) = panels(1, width=6.0)
        share = {k: 100 * of["feasible"] / sum(of.values()) for k, of in numbers["outcomes"].items()}
        bars(axis, [str(k) for k in share], {"all starts": list(share.values())}, "feasible starts (%)")
        axis.set_xlabel("taxel aimed at (the last four on the outer side)")
        touched, (axis,) = panels(1)
        of = numbers["encoder_offsets"]
        series = {"aimed taxel is touched": [row["aimed_is_touched_percent"] for row in of.values()]}
        curves(axis, [float(std) for std in of], series, "encoder offsets, σ (°)", "aimed taxel touched (%)")
        axis.set_ylim(0, 102)
        return {"feasible": feasible, "touched": touched}


def first_touched(planner: DoubleTouching, joints_rad: Array) -> int:
    """Return the index of the taxel that the fingertip touches first along joints (T, k); their number if none."""
    n = len(planner.part.ids)
    for q in joints_rad:
        posture = planner.robot.at(q)
        taxels = posture.point(planner.part.frame, planner.part.positions_m)
        gaps = np.linalg.norm(taxels - posture.point(planner.robot.names.index_tips[1]), axis=1) - FINGERTIP_RADIUS_M
        if gaps.min() <= 0:
            return int(gaps.argmin())
    nearest = int(gaps.argmin())
    return nearest if gaps[nearest] <= TOUCH_RADIUS_M else n
