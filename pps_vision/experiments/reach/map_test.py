"""What a reachable-space map is judged on: gaze postures and locations whose answer is known in closed form."""

from dataclasses import asdict, dataclass

import numpy as np

from learning.pps.scores import expected_calibration_error, reliability
from learning.reach.map import ReachableMap
from learning.reach.training import ArmLimits, MapParams, ReachOracle
from pps_vision.robot.chain import Chain
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.model import Robot
from pps_vision.robot.spherical_arm import SphericalArm
from pps_vision.types import Array, Mask

# J's box of locations in the root frame (FACTS §6)
BOX_LOW, BOX_HIGH = np.array([-0.376, -0.10, 0.1524]), np.array([-0.226, 0.10, 0.3524])


@dataclass(frozen=True)
class MapTest:
    """Gaze postures (N, 3), whether the right hand gets there, 1 − M of the best posture, and the error left (m, NaN
    where reachable or not known); gaze postures of J's box of locations, and whether the hand gets there."""

    gaze_rad: Array
    reachable: Mask
    optimality: Array
    error_m: Array
    box_gaze_rad: Array
    box_reachable: Mask

    @classmethod
    def of(cls, robot: Robot, n: int, rng: np.random.Generator) -> "MapTest":
        """`n` gaze postures and 9000 locations, of which those are kept that can be fixated."""
        limits = GazeLimits()
        gaze = rng.uniform(limits.lower, limits.upper, (n, 3))
        arm = closed_form(robot)
        _, effort = arm.least_effort(fixation_points(robot, gaze))
        reachable = np.isfinite(effort)
        # how near the hand gets has no closed form: the oracle's answer, from as many starts again
        error = np.full(n, np.nan)
        error[~reachable] = ReachOracle(robot, "right", MapParams(), rng).label(gaze[~reachable]).error_m
        points = rng.uniform(BOX_LOW, BOX_HIGH, (9000, 3))
        box = gaze_for_points(robot, points)
        seen = np.isfinite(box[:, 0])
        return cls(gaze, reachable, 1 - effort, error, box[seen], np.isfinite(arm.solve(points[seen])[:, 0]))

    def verdict(self, said: Mask) -> dict[str, float]:
        """JE of all, FN of the reachable, FP of the others, percent."""
        return rates(said, self.reachable)

    def judge(self, learned: ReachableMap) -> dict[str, float]:
        """The same of a map, of J's box too, and the RMS error of its degree (Enhanced map)."""
        said = learned.query(self.gaze_rad)
        box = rates(learned.query(self.box_gaze_rad).reachable, self.box_reachable)
        outside = 0.5 - 0.5 * np.minimum(self.error_m / learned.max_error_m, 1)
        degree = np.where(self.reachable, 0.5 + 0.5 * self.optimality, outside)
        return {
            **self.verdict(said.reachable),
            "degree_rmse": float(np.sqrt(np.nanmean((said.degree - degree) ** 2))),
            **{f"box_{name}": value for name, value in box.items()},
        }

    def calibration(self, learned: ReachableMap) -> dict[str, object]:
        """Whether a probability is one: expected calibration error and reliability of those that are not plain."""
        probability = learned.query(self.gaze_rad).probability
        open_ = (probability > 0.01) & (probability < 0.99)
        return {
            "ece": expected_calibration_error(self.reachable, probability),
            "open_share": float(open_.mean()),
            "open_ece": expected_calibration_error(self.reachable[open_], probability[open_]),
            "reliability": asdict(reliability(self.reachable[open_], probability[open_])),
        }

    def thresholds(self, learned: ReachableMap) -> list[dict[str, float]]:
        """What is asked for by --max-fp, and what comes of it."""
        rows = []
        for asked in (1e-4, 3e-4, 1e-3, 3e-3, 1e-2):
            threshold = learned.threshold(asked)
            said = learned.query(self.gaze_rad, threshold).reachable
            rows.append({"asked_fp": 100 * asked, "threshold": threshold, **self.verdict(said)})
        return rows


def closed_form(robot: Robot) -> SphericalArm:
    """The right arm within J's limits."""
    limits = ArmLimits()
    chain = Chain.of(robot, robot.names.arm("right")[:4], robot.names.palms[1])
    return SphericalArm.of(chain, limits.lower_rad, limits.upper_rad)


def rates(said: Mask, true: Mask) -> dict[str, float]:
    """Misjudged of all (JE), of the reachable (FN) and of the others (FP), percent."""
    return {
        "je": 100 * float(np.mean(said != true)),
        "fn": 100 * float(np.mean(~said[true])),
        "fp": 100 * float(np.mean(said[~true])),
    }
