"""Ground truth of reachable-space maps: closed-form inverse kinematics at gaze postures and locations."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from learning.reach.labels import HandModel, Labels, ReachOracle
from learning.reach.map import MapPrediction
from learning.reach.params import ArmLimits, MapParams
from pps_vision.experiments.babbling import Babbled
from pps_vision.experiments.baselines import jamone
from pps_vision.experiments.baselines.jamone import MapQuery
from pps_vision.experiments.baselines.revolute_arm import RevoluteArm
from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.experiments.study import percent, rms
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

ARMS = ("left", "right")
N_TEST = 700  # postures at which forward models are judged, as in J
SCORES = {"JE (%)": "je", "FN (%)": "fn", "FP (%)": "fp", "RMSE of R": "degree_rmse", "JE in J's box (%)": "box_je"}
"""Scores of a map by their names in tables."""
BOX = np.array([[-0.10, 0.10], [0.75, 0.95], [0.20, 0.35]])  # J's X, Y, Z, m in the axes of its simulator (Y up)
_SIMULATOR_M = np.array([0.0, 0.5976, -0.026])  # p_sim = (−y, z, −x) of the root frame + this, from its public code
_N_BOX = 9000


@dataclass(frozen=True)
class MapTruth:
    """Gaze postures and locations with their exact answers for one arm, or for both."""

    gaze_rad: Array  # (N, 3) gaze postures, uniform within J's limits
    reachable: Mask  # (N,) whether the hand reaches the fixation point
    optimality: Array  # (N,) 1 − M of the best posture (J IV.7); NaN out of reach
    error_m: Array  # (N,) smallest distance of the hand, by the oracle (no closed form); NaN where reachable or unknown
    box_gaze_rad: Array  # (M, 3) gaze postures that fixate locations of J's box
    box_reachable: Mask  # (M,) whether the hand reaches them

    @classmethod
    def of(cls, robot: Robot, n: int, rng: np.random.Generator, side: str = "right") -> "MapTruth":
        """Draw `n` gaze postures, and 9000 locations; locations that cannot be fixated are dropped."""
        limits = GazeLimits()
        gaze = rng.uniform(limits.lower, limits.upper, (n, 3))
        low, high = np.sort(to_root(BOX.T), axis=0)
        points = rng.uniform(low, high, (_N_BOX, 3))
        arm = closed_form(robot, side)
        _, effort = arm.least_effort(fixation_points(robot, gaze))
        reachable = np.isfinite(effort)
        error = np.full(n, np.nan)
        error[~reachable] = ReachOracle(robot, side, MapParams(), rng).label(gaze[~reachable]).error_m
        box = gaze_for_points(robot, points)
        fixated = np.isfinite(box[:, 0])
        return cls(gaze, reachable, 1 - effort, error, box[fixated], np.isfinite(arm.solve(points[fixated])[:, 0]))

    def with_arm(self, second: "MapTruth") -> "MapTruth":
        """Return the answers for both arms at once, given the other arm's at the same gaze postures."""
        reachable = self.reachable & second.reachable
        distances = [np.where(arm.reachable, 0.0, arm.error_m) for arm in (self, second)]
        return replace(
            self,
            reachable=reachable,
            optimality=np.minimum(self.optimality, second.optimality),
            error_m=np.where(reachable, np.nan, np.maximum(*distances)),
            box_reachable=self.box_reachable & second.box_reachable,
        )

    def judge(self, query: MapQuery, max_error_m: float) -> dict[str, float]:
        """Return JE, FN, FP (percent), the same in J's box, and the RMS error of the degree R."""
        box = rates(query(self.box_gaze_rad).reachable, self.box_reachable)
        degree = jamone.degree(self.reachable, self.optimality, self.error_m, max_error_m)
        exact = scores(query(self.gaze_rad), self.reachable, degree)
        return exact | {f"box_{name}": value for name, value in box.items()}


def rates(predicted: Mask, reachable: Mask) -> dict[str, float]:
    """Return the misjudged share (percent) of all (JE), of the reachable (FN) and of the unreachable (FP) ones."""
    wrong = predicted != reachable
    return {"je": percent(wrong), "fn": percent(wrong[reachable]), "fp": percent(wrong[~reachable])}


def scores(prediction: MapPrediction, reachable: Mask, degree: Array) -> dict[str, float]:
    """Return JE, FN, FP (percent), and the RMS error of the degree where both degrees exist."""
    difference = prediction.degree - degree
    return {**rates(prediction.reachable, reachable), "degree_rmse": rms(difference[np.isfinite(difference)])}


def judge_by_labels(query: MapQuery, labels: Labels, max_error_m: float) -> dict[str, float]:
    """Return the scores against inverse-kinematics labels, as J judges its maps."""
    degree = jamone.degree(labels.reachable, labels.optimality, labels.error_m, max_error_m)
    return scores(query(labels.gaze_rad), labels.reachable, degree)


def closed_form(robot: Robot, side: str = "right", limits: ArmLimits | None = None) -> SphericalArm:
    """Return the exact inverse kinematics of an arm, by default within J's limits."""
    limits = limits or ArmLimits()
    chain = robot.chain(robot.names.arm(side)[:4], robot.names.palm(side))
    return SphericalArm.of(chain, limits.lower_rad, limits.upper_rad)


def exact_map(robot: Robot, max_error_m: float) -> MapQuery:
    """Return the true answers for the right arm: verdict in closed form, distance by the oracle."""
    arm = closed_form(robot)
    oracle = ReachOracle(robot, "right", MapParams(), np.random.default_rng(0))

    def query(gaze: Array) -> MapPrediction:
        _, effort = arm.least_effort(fixation_points(robot, gaze), 21)
        reachable = np.isfinite(effort)
        degree = jamone.degree(reachable, 1 - effort, oracle.label(gaze).error_m, max_error_m)
        return MapPrediction(np.ones(len(gaze), bool), reachable, reachable.astype(float), degree)

    return query


def to_simulator(points_root: Array) -> Array:
    """Return points (N, 3) of the root frame in the axes of J's simulator, m."""
    x, y, z = points_root.T
    return np.stack([-y, z, -x], axis=1) + _SIMULATOR_M


def to_root(points_simulator: Array) -> Array:
    """Return the inverse of `to_simulator`."""
    x, y, z = (points_simulator - _SIMULATOR_M).T
    return np.stack([-z, -x, y], axis=1)


def first(babbled: Babbled, n: int) -> Babbled:
    """Return the first `n` samples."""
    return replace(babbled, arm_rad=babbled.arm_rad[:n], gaze_rad=babbled.gaze_rad[:n])


def gaze_rmse_deg(model: Callable[[Array], Array], test: Babbled) -> tuple[float, float]:
    """Return a forward model's RMSE over postures and gaze angles where it has an answer, and the unanswered share."""
    difference = model(test.arm_rad) - test.gaze_rad
    answered = np.isfinite(difference).all(axis=1)
    return float(np.rad2deg(rms(difference[answered]))), 1 - float(answered.mean())


def map_params(n_labels: int) -> MapParams:
    """Return the default parameters of a map of `n_labels` labels, in at least two rounds."""
    return MapParams(n_labels=n_labels, round_labels=min(MapParams.round_labels, n_labels // 2))


def learn_hand(babbled: Babbled) -> HandModel:
    """Return our forward model, learned from babbling, for inverse kinematics."""
    model = RevoluteArm()
    model.learn(babbled.arm_rad, babbled.gaze_rad)
    return HandModel(model.forward, model.points, model.gaze)
