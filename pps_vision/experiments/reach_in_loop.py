"""The reachable-space map in use: asked by the torso that leans."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
from tqdm import tqdm

from control import fixation, head, lean
from control.fixation import FixationParams, fixation_error, gaze_at
from control.lean import LeanParams, LeanStatus
from learning.reach.labels import ReachOracle
from learning.reach.lattice import isotropic
from learning.reach.map import ReachableMap
from learning.reach.params import ArmLimits
from learning.reach.training import train_reachable_map
from pps_vision.experiments.reach_truth import closed_form, map_params
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

_DEG = np.pi / 180
GAZE = GazeLimits(pitch_rad=(-40 * _DEG, 30 * _DEG))  # J's, within the pitch of the iCub's neck
ARM = ArmLimits(upper_rad=(5 * _DEG, 160 * _DEG, 80 * _DEG, 105 * _DEG))  # J's, within the iCub's first joint
SIDE = "right"
MAX_FP = 1e-4
_TORSO_STEP_RAD = 2 * _DEG  # grid step of the ground truth
_DT_S = 0.05
_MAX_LEAN_S = 20.0
_TOUCH_M = 0.01


class Attempt(NamedTuple):
    """Result of leaning towards one object."""

    status: LeanStatus  # last status of the controller
    is_touched: bool  # whether the palm meets the object within 1 cm, with the arm by inverse kinematics
    fixation_deg: float  # largest fixation error
    seconds: float  # duration of the turn


def attempt(oracle: ReachOracle, learned: ReachableMap, threshold: float, point: Array, compensates: bool) -> Attempt:
    """Lean from fixation with the torso upright until the object is within reach, or cannot be.

    Unless the head `compensates` for the torso, fixation only reacts.
    """

    def is_reachable(gaze: Array) -> Mask:
        return learned.query(gaze, threshold).reachable

    robot = oracle.robot
    model = GazeModel(robot)
    q = gaze_at(robot, robot.clamp(np.zeros(robot.n_joints)), point)
    status: LeanStatus = "leaning"
    error = 0.0
    t = 0.0
    while t < _MAX_LEAN_S:
        posture = robot.at(q)
        error = max(error, fixation_error(posture, point))
        status, command = lean.step(LeanParams(), model, GAZE, is_reachable, posture, point, _DT_S, t)
        if status != "leaning":
            break
        carried = compensates * head.carried_velocity(posture, point, command.dq_rad_s)
        gaze_command = fixation.step(FixationParams(), posture, point, -carried, _DT_S, t)
        q = robot.clamp(q + _DT_S * (command.dq_rad_s + gaze_command.dq_rad_s))
        t += _DT_S
    solution = oracle.solve(model.gaze(model.to_upright(q[None], point), GAZE))
    q[robot.indices(robot.names.arm(SIDE))[:4]] = solution.q_rad[0]
    palm = robot.at(q).point(robot.names.palm(SIDE))
    is_touched = status == "within reach" and bool(np.linalg.norm(palm - point) <= _TOUCH_M)
    return Attempt(status, is_touched, error / _DEG, t)


def can_be_reached(robot: Robot, points: Array) -> Mask:
    """Return (N,) whether points (N, 3) can be fixated and reached from a torso posture of a grid, in closed form."""
    model = GazeModel(robot)
    arm = closed_form(robot, SIDE, ARM)
    torso = robot.indices(robot.names.torso)
    axes = [np.arange(robot.lower_rad[i], robot.upper_rad[i] + 1e-9, _TORSO_STEP_RAD) for i in torso]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(torso))
    q = np.zeros((len(grid), robot.n_joints))
    q[:, torso] = grid

    def is_reached(point: Array) -> bool:
        upright = model.to_upright(q, point)
        gaze = model.gaze(upright, GAZE)
        return bool((np.isfinite(arm.solve(upright)[:, 0]) & np.isfinite(gaze[:, 0])).any())

    return np.array([is_reached(point) for point in points])


def draw_unreachable(robot: Robot, n: int, rng: np.random.Generator) -> Array:
    """(n, 3) points that can be fixated, not reached, with the torso upright."""
    model = GazeModel(robot)
    arm = closed_form(robot, SIDE, ARM)
    points: Array = np.zeros((0, 3))
    while len(points) < n:
        gaze = rng.uniform(isotropic(GAZE.lower), isotropic(GAZE.upper), (n, 3))  # uniform in log distance
        gaze[:, 2] = 2 * np.arctan(np.exp(gaze[:, 2]))
        candidates = model.points(gaze)
        points = np.concatenate([points, candidates[np.isnan(arm.solve(candidates)[:, 0])]])
    return points[:n]


@cache
def leaning(seed: int, n: int, n_labels: int) -> tuple[Array, partial[Attempt], ReachableMap]:
    """Return `n` objects beyond the reach of the upright iCub, `attempt` with a learned map, and that map."""
    robot = load_icub()
    rng = np.random.default_rng(seed)
    params = replace(map_params(n_labels), gaze_limits=GAZE, arm_limits=ARM)
    learned = train_reachable_map(robot, SIDE, rng, params)
    points = draw_unreachable(robot, n, np.random.default_rng(seed + 1_000_000))
    return points, partial(attempt, ReachOracle(robot, SIDE, params, rng), learned), learned


_ROWS = {
    "objects": "objects that the upright robot does not reach",
    "reachable_with_torso": "reachable with the torso",
    "touched": "touched",
    "refused_rightly": "unreachable and refused",
    "refused_wrongly": "reachable and refused",
    "fixation_error_deg": "fixation error (°)",
    "fixation_error_reacting_deg": "fixation error, head only reacting (°)",
    "seconds": "time (s)",
}


@dataclass(frozen=True)
class ReachInLoop(SampledStudy):
    """Objects reached by leaning, by kinematics: joints follow their commands and the object's position is known."""

    MINUTES: ClassVar[int] = 2
    SHORT: ClassVar[Mapping[str, Any]] = {"n": 4}

    n: int = 200  # objects out of reach of the upright robot
    n_labels: int = 12_000  # inverse-kinematics solutions of the map

    def run(self) -> dict[str, Any]:
        """Return counts; median, 95 % quantile and maximum over the objects touched."""
        points, attempt_at, learned = leaning(self.seed, self.n, self.n_labels)
        lean_once = partial(attempt_at, learned.threshold(MAX_FP))
        possible = can_be_reached(load_icub(), points)
        attempts = [lean_once(point, compensates=True) for point in tqdm(points, desc="objects", disable=None)]
        touched = [row for row in attempts if row.is_touched]
        refused = np.array([row.status == "out of reach" for row in attempts])
        reacting = [lean_once(point, compensates=False) for point in points[possible][: max(self.n // 8, 1)]]
        quantiles = {
            "fixation_error_deg": [row.fixation_deg for row in touched],
            "fixation_error_reacting_deg": [row.fixation_deg for row in reacting],
            "seconds": [row.seconds for row in touched],
        }
        return {
            "objects": self.n,
            "reachable_with_torso": int(possible.sum()),
            "touched": len(touched),
            "refused_rightly": int((refused & ~possible).sum()),
            "refused_wrongly": int((refused & possible).sum()),
            **{name: np.quantile(v or [np.nan], (0.5, 0.95, 1.0)).tolist() for name, v in quantiles.items()},
        }

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the counts, and the quantiles over the objects touched."""
        rows = []
        for key, name in _ROWS.items():
            value = numbers[key]
            rows.append([name, *([estimate([x]) for x in value] if isinstance(value, list) else [str(value), "", ""])])
        return {"": Table(["leaning", "number or median", "95 %", "maximum"], rows)}
