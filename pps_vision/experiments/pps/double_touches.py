"""Double touch (R milestone 1): the taxels that the finger can reach, and those it touches with encoder offsets."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure

from control.double_touch import FINGERTIP_RADIUS_M, DoubleTouch, DoubleTouching
from pps_vision.experiments.charts import bars, curves, panels
from pps_vision.experiments.study import SampledStudy, interval, percent
from pps_vision.robot.icub import load_icub
from pps_vision.robot.skin import INNER_FOREARM, OUTER_FOREARM, TOUCH_RADIUS_M, icub_skin
from pps_vision.types import Array

ENCODER_DEG = (0.0, 0.5, 1.0, 2.0, 4.0)  # standard deviations of the encoders' offsets
_LAST = 15  # steps: the fingertip comes from 6 cm away, farther than these offsets displace it


@dataclass(frozen=True)
class DoubleTouches(SampledStudy):
    """Feasibility of double touches of each forearm taxel, and the taxels touched by robots with encoder offsets.

    R aimed at eight inner taxels, of which six were ever touched.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"starts": 4}

    starts: int = 24
    """Random start postures for each taxel."""
    n: int = 5
    """Robots for each size of the offsets."""

    def run(self) -> dict[str, Any]:
        """Return, by taxel, the share of feasible starts, and by offset how often the aimed taxel is touched."""
        planner = DoubleTouching(load_icub(), icub_skin(("left_forearm",)).parts[0])
        touches = {}
        for i in INNER_FOREARM + OUTER_FOREARM:
            plans = planner.plan(planner.part.ids.index(i), self.starts, np.random.default_rng((self.seed, i)))
            touches[i] = [plan for plan in plans if isinstance(plan, DoubleTouch)]
        return {
            "feasible_percent": {i: 100 * len(of) / self.starts for i, of in touches.items()},
            "aimed_is_touched_percent": {std: self._touched(planner, touches, std) for std in ENCODER_DEG},
        }

    def _touched(self, planner: DoubleTouching, touches: dict[int, list[DoubleTouch]], std_deg: float) -> list[float]:
        """Percentage of touches of inner taxels that touch the one aimed at, with 95 % over robots."""
        robots = []
        for robot in range(self.n):
            rng = np.random.default_rng((self.seed, robot))
            error = np.deg2rad(std_deg) * rng.standard_normal(planner.robot.n_joints)
            robots.append([
                first_touched(planner, touch.joints_rad[-_LAST:] + error) == planner.part.ids.index(aimed)
                for aimed in INNER_FOREARM
                for touch in touches[aimed]
            ])  # fmt: skip
        return interval(robots, percent)

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw the feasible share by taxel; and how often the aimed taxel is touched, against the offsets."""
        feasible, (axis,) = panels(1, width=6.0)
        share = numbers["feasible_percent"]
        bars(axis, list(share), {"all starts": list(share.values())}, "feasible starts (%)")
        axis.set_xlabel("taxel aimed at (the last four on the outer side)")
        touched, (axis,) = panels(1)
        of = numbers["aimed_is_touched_percent"]
        series = {"aimed taxel is touched": list(of.values())}
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
