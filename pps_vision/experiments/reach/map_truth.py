"""What reachable-space maps are judged by: closed-form inverse kinematics on gaze postures and locations."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from learning.reach.babbling import Babbled
from learning.reach.labels import Labels, ReachOracle
from learning.reach.lattice import isotropic
from learning.reach.map import MapPrediction
from learning.reach.params import ArmLimits, MapParams
from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.experiments.reach import jamone
from pps_vision.experiments.study import percent, rms
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

BOX_LOW, BOX_HIGH = np.array([-0.376, -0.10, 0.1524]), np.array([-0.226, 0.10, 0.3524])
"""J's box of locations in the root frame: X ±0.10, Y 0.75–0.95, Z 0.20–0.35 m of its simulator, whose public code has
p_sim = (−y, z + 0.5976, −x − 0.026)."""
_N_BOX = 9000


SCORES = {"JE (%)": "je", "FN (%)": "fn", "FP (%)": "fp", "RMSE of R": "degree_rmse", "JE in J's box (%)": "box_je"}
"""Scores of a map by their names in tables."""


@dataclass(frozen=True)
class MapTruth:
    """Gaze postures and locations with their exact answers for one arm, or for both at once."""

    gaze_rad: Array
    """(N, 3) gaze postures, uniform within J's limits."""
    reachable: Mask
    """(N,) whether the hand reaches what they fixate."""
    optimality: Array
    """(N,) 1 − M of the best posture (J IV.7); NaN out of reach."""
    error_m: Array
    """(N,) smallest distance of the hand, by the oracle (it has no closed form); NaN where reachable or unknown."""
    box_gaze_rad: Array
    """(M, 3) gaze postures that fixate locations of J's box."""
    box_reachable: Mask
    """(M,) whether the hand reaches them."""

    @classmethod
    def of(cls, robot: Robot, n: int, rng: np.random.Generator, side: str = "right") -> "MapTruth":
        """Draw `n` gaze postures and 9000 locations, of which those are kept that can be fixated."""
        limits = GazeLimits()
        gaze = rng.uniform(limits.lower, limits.upper, (n, 3))
        points = rng.uniform(BOX_LOW, BOX_HIGH, (_N_BOX, 3))
        arm = closed_form(robot, side)
        _, effort = arm.least_effort(fixation_points(robot, gaze))
        reachable = np.isfinite(effort)
        error = np.full(n, np.nan)
        error[~reachable] = ReachOracle(robot, side, MapParams(), rng).label(gaze[~reachable]).error_m
        box = gaze_for_points(robot, points)
        fixated = np.isfinite(box[:, 0])
        return cls(gaze, reachable, 1 - effort, error, box[fixated], np.isfinite(arm.solve(points[fixated])[:, 0]))

    def both(self, other: "MapTruth") -> "MapTruth":
        """Return the answers for both arms at once, given those of the other arm; ValueError for other postures."""
        if not (
            np.array_equal(self.gaze_rad, other.gaze_rad) and np.array_equal(self.box_gaze_rad, other.box_gaze_rad)
        ):
            raise ValueError("truths of two arms at different gaze postures: expected the same, from the same seed")
        reachable = self.reachable & other.reachable
        farther = np.maximum(*(np.where(one.reachable, 0.0, one.error_m) for one in (self, other)))
        return replace(
            self,
            reachable=reachable,
            optimality=np.minimum(self.optimality, other.optimality),
            error_m=np.where(reachable, np.nan, farther),
            box_reachable=self.box_reachable & other.box_reachable,
        )

    def judge(self, query: Callable[[Array], MapPrediction], max_error_m: float) -> dict[str, float]:
        """Return JE, FN, FP (percent), the same in J's box, and the RMS error of the degree R."""
        box = rates(query(self.box_gaze_rad).reachable, self.box_reachable)
        degree = jamone.degree(self.reachable, self.optimality, self.error_m, max_error_m)
        return {**scores(query(self.gaze_rad), self.reachable, degree), **{f"box_{k}": v for k, v in box.items()}}


def scores(said: MapPrediction, reachable: Mask, degree: Array) -> dict[str, float]:
    """Return JE, FN, FP (percent), and the RMS error of the degree where both are known."""
    off = said.degree - degree
    return {**rates(said.reachable, reachable), "degree_rmse": rms(off[np.isfinite(off)])}


def judge_by_labels(query: Callable[[Array], MapPrediction], labels: Labels, max_error_m: float) -> dict[str, float]:
    """Return the scores against inverse-kinematics labels, as J judges its maps."""
    degree = jamone.degree(labels.reachable, labels.optimality, labels.error_m, max_error_m)
    return scores(query(labels.gaze_rad), labels.reachable, degree)


def rates(said: Mask, true: Mask) -> dict[str, float]:
    """Return the percentage misjudged of all (JE), of the reachable (FN) and of the unreachable (FP)."""
    wrong = said != true
    return {"je": percent(wrong), "fn": percent(wrong[true]), "fp": percent(wrong[~true])}


def closed_form(robot: Robot, side: str = "right", limits: ArmLimits | None = None) -> SphericalArm:
    """Return the exact inverse kinematics of an arm, by default within J's limits."""
    limits = limits or ArmLimits()
    palm = robot.names.palm(side)
    return SphericalArm.of(robot.chain(robot.names.arm(side)[:4], palm), limits.lower_rad, limits.upper_rad)


def exact_map(robot: Robot, max_error_m: float, side: str = "right") -> jamone.MapQuery:
    """Return what the true kinematics say: verdict in closed form, distance by the oracle."""
    arm, oracle = closed_form(robot, side), ReachOracle(robot, side, MapParams(), np.random.default_rng(0))

    def query(gaze: Array) -> MapPrediction:
        _, effort = arm.least_effort(fixation_points(robot, gaze), 21)
        reachable = np.isfinite(effort)
        degree = jamone.degree(reachable, 1 - effort, oracle.label(gaze).error_m, max_error_m)
        return MapPrediction(np.ones(len(gaze), bool), reachable, reachable.astype(float), degree)

    return query


def first(babbled: Babbled, n: int) -> Babbled:
    """Return the first `n` samples."""
    return replace(babbled, arm_rad=babbled.arm_rad[:n], gaze_rad=babbled.gaze_rad[:n])


def random_gaze(limits: GazeLimits, n: int, rng: np.random.Generator) -> Array:
    """Return (n, 3) gaze postures in all directions, their distances spread evenly in the logarithm."""
    at = rng.uniform(isotropic(limits.lower), isotropic(limits.upper), (n, 3))
    at[:, 2] = 2 * np.arctan(np.exp(at[:, 2]))
    return at


def gaze_rmse_deg(model: Callable[[Array], Array], test: Babbled) -> tuple[float, float]:
    """Return a forward model's RMSE over postures and gaze angles where it has an answer, and the share unanswered."""
    off = model(test.arm_rad) - test.gaze_rad
    answered = np.isfinite(off).all(axis=1)
    return float(np.rad2deg(rms(off[answered]))), 1 - float(answered.mean())
