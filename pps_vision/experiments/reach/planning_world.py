"""What planning with the torso is tried on: a robot, what it has learned, and which objects could be reached at all."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from control.into_reach import IntoReachParams, Learned
from learning.reach.map import ReachableMap
from learning.reach.torso_gaze import TorsoFrame, TorsoToGaze, random_gaze, torso_limits, turn_torso
from learning.reach.training import ArmLimits, MapParams, ReachOracle, train_reachable_map
from pps_vision.robot.chain import Chain
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.spherical_arm import SphericalArm
from pps_vision.types import Array, Mask

_DEG = np.pi / 180
GAZE = GazeLimits(pitch_rad=(-40 * _DEG, 30 * _DEG))
"""J's, the pitch as far as the iCub's own neck goes."""
ARM = ArmLimits(upper_rad=(5 * _DEG, 160 * _DEG, 80 * _DEG, 105 * _DEG))
"""J's, the first joint as far as the iCub's own goes."""
_MAX_FP, _N_TURNS, _TRUTH_STEP_RAD = 1e-4, 600, 2 * _DEG


@dataclass(frozen=True)
class PlanningWorld:
    """The right arm's map within limits that hold on the robot, the learned relation of its torso to its gaze, and
    how to get the arm there."""

    robot: Robot
    reachable_map: ReachableMap
    relation: TorsoToGaze
    learned: Learned

    @classmethod
    def make(cls, seed: int, n_labels: int = 12_000, noise_rad: float = 0.0) -> "PlanningWorld":
        """Everything learned anew; `noise_rad` is how well gaze angles are read while the torso turns."""
        robot, rng = load_icub(), np.random.default_rng(seed)
        params = MapParams(GAZE, ARM, n_labels, min(MapParams().round_labels, n_labels // 2))
        reachable_map = train_reachable_map(robot, IntoReachParams().side, rng, params)
        relation = TorsoToGaze()
        relation.learn(turn_torso(robot, _N_TURNS, rng, GAZE, noise_rad))
        oracle = ReachOracle(robot, IntoReachParams().side, params, rng)

        def hand_to(gaze: Array) -> tuple[Array, float]:
            found = oracle.solve(gaze[None])
            return found.q_rad[0], float(found.error[0])

        judge = partial(reachable_map.query, threshold=reachable_map.threshold(_MAX_FP))
        return cls(robot, reachable_map, relation, Learned(judge, relation, hand_to))


class Truth:
    """Whether the hand gets somewhere, by the arm in closed form, from some torso posture or from this one."""

    def __init__(self, robot: Robot) -> None:
        side = IntoReachParams().side
        palm = robot.names.palms[("left", "right").index(side)]
        chain = Chain.of(robot, robot.names.arm(side)[:4], palm)
        self._robot, self._arm = robot, SphericalArm.of(chain, ARM.lower_rad, ARM.upper_rad)
        self._frame = TorsoFrame(robot)
        axes = [np.arange(low, high + 1e-9, _TRUTH_STEP_RAD) for low, high in zip(*torso_limits(robot), strict=True)]
        self._torso = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)

    def reaches(self, points: Array) -> Mask:
        """Whether the hand gets to points (N, 3) with the torso upright."""
        return np.isfinite(self._arm.solve(points)[:, 0])

    def least_turn(self, point: Array) -> float:
        """How far (rad) the torso must at least turn for a point (3,) to be fixated and reached; inf where no posture
        of a grid of 2° does."""
        around = self._frame.from_upright(self._torso, np.tile(point, (len(self._torso), 1)))
        reached = np.flatnonzero(self.reaches(around))
        seen = np.isfinite(gaze_for_points(self._robot, around[reached], GAZE)[:, 0])
        return float(np.linalg.norm(self._torso[reached[seen]], axis=1).min(initial=np.inf))

    def unreachable(self, n: int, rng: np.random.Generator) -> Array:
        """(n, 3) points that can be fixated and not reached with the torso upright, in all directions, as many near
        as far."""
        points: Array = np.zeros((0, 3))
        while len(points) < n:
            more = fixation_points(self._robot, random_gaze(GAZE, n, rng))
            points = np.concatenate([points, more[~self.reaches(more)]])
        return points[:n]
