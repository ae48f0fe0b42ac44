"""Objects out of reach of the upright robot: the torso leans until the map calls them reachable, then the hand goes.

By kinematics: joints obey and the object's position is known.  The truth, from which torso posture a point can be
fixated and reached, is closed form on a grid of torso postures.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from tqdm import tqdm

from control import fixation, head, lean
from control.fixation import FixationParams, fixation_error, gaze_at
from control.lean import LeanParams, LeanStatus
from learning.reach.labels import ReachOracle
from learning.reach.map import ReachableMap
from learning.reach.params import ArmLimits, MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments.reach.map_truth import closed_form, random_gaze
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.types import Array

_DEG = np.pi / 180
_GAZE = GazeLimits(pitch_rad=(-40 * _DEG, 30 * _DEG))  # J's, within the pitch of the iCub's own neck
_ARM = ArmLimits(upper_rad=(5 * _DEG, 160 * _DEG, 80 * _DEG, 105 * _DEG))  # J's, within the iCub's own first joint
_SIDE, _PARAMS = "right", MapParams(_GAZE, _ARM)
_MAX_FP, _TRUTH_STEP_RAD = 1e-4, 2 * _DEG
_DT_S, _LONGEST_S, _TOUCH_M = 0.05, 20.0, 0.01


@dataclass(frozen=True)
class Attempt:
    """What became of one object."""

    status: LeanStatus
    """What the controller said last."""
    palm_off_m: float
    """Distance of palm and object with the arm as inverse kinematics has it for the gaze at the end."""
    turned_rad: float
    """How far the torso turned in all."""
    fixation_rad: float
    """Largest fixation error."""
    seconds: float
    """How long the torso turned."""


def attempt(
    oracle: ReachOracle, learned: ReachableMap, threshold: float, point: Array, compensates: bool = True
) -> Attempt:
    """Lean from fixation with the torso upright until the object is within reach, or cannot be.

    Unless the head `compensates` for the torso, fixation only reacts.
    """
    robot, model = oracle.robot, GazeModel(oracle.robot)
    torso = robot.indices(robot.names.torso)
    q = gaze_at(robot, robot.clamp(np.zeros(robot.n_joints)), point)
    status: LeanStatus = "leaning"
    error, turned, t = 0.0, 0.0, 0.0
    while t < _LONGEST_S:
        posture = robot.at(q)
        error = max(error, fixation_error(posture, point))
        status, command = lean.step(
            LeanParams(), model, _GAZE, lambda gaze: learned.query(gaze, threshold).reachable, posture, point, _DT_S, t
        )
        if status != "leaning":
            break
        dq = command.dq_rad_s
        carried = compensates * head.carried_velocity(posture, point, dq)
        gaze_command = fixation.step(FixationParams(), posture, point, -carried, _DT_S, t)
        turned += _DT_S * float(np.linalg.norm(dq[torso]))
        q, t = robot.clamp(q + _DT_S * (dq + gaze_command.dq_rad_s)), t + _DT_S
    found = oracle.solve(model.gaze(model.to_upright(q[None], point), _GAZE))
    q[robot.indices(robot.names.arm(_SIDE))[:4]] = found.q_rad[0]
    palm = robot.at(q).point(robot.names.palms[1])
    return Attempt(status, float(np.linalg.norm(palm - point)), turned, error, t)


def smallest_turns(robot: Robot, points: Array) -> Array:
    """Return (N,) by how much (rad) the torso must turn to fixate and reach points (N, 3); inf where no turn does."""
    model, arm, index = GazeModel(robot), closed_form(robot, _SIDE, _ARM), robot.indices(robot.names.torso)
    axes = [np.arange(robot.lower_rad[i], robot.upper_rad[i] + 1e-9, _TRUTH_STEP_RAD) for i in index]
    torso = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    q = np.zeros((len(torso), robot.n_joints))
    q[:, index] = torso
    found = []
    for point in points:
        upright = model.to_upright(q, point)
        reached = np.isfinite(arm.solve(upright)[:, 0]) & np.isfinite(model.gaze(upright, _GAZE)[:, 0])
        found.append(np.linalg.norm(torso[reached], axis=1).min(initial=np.inf))
    return np.array(found)


def draw_unreachable(robot: Robot, n: int, rng: np.random.Generator) -> Array:
    """Return (n, 3) points to fixate, not reach, with the torso upright; uniform in direction and log distance."""
    model, arm = GazeModel(robot), closed_form(robot, _SIDE, _ARM)
    points: Array = np.zeros((0, 3))
    while len(points) < n:
        more = model.points(random_gaze(_GAZE, n, rng))
        points = np.concatenate([points, more[np.isnan(arm.solve(more)[:, 0])]])
    return points[:n]


@dataclass(frozen=True)
class Lean(SampledStudy):
    """Objects that the right hand reaches only with the torso turned: touched, refused, and fixation meanwhile."""

    SHORT: ClassVar[Mapping[str, Any]] = {"n": 4}

    n: int = 200
    """Objects out of reach of the upright robot."""
    n_labels: int = 12_000
    """Inverse-kinematics solutions the map is learned from."""

    def run(self) -> dict[str, Any]:
        """Return counts; median, 95 % quantile and maximum over the objects touched."""
        robot, rng = load_icub(), np.random.default_rng(self.seed)
        params = replace(_PARAMS, n_labels=self.n_labels, round_labels=min(_PARAMS.round_labels, self.n_labels // 2))
        learned, oracle = train_reachable_map(robot, _SIDE, rng, params), ReachOracle(robot, _SIDE, params, rng)
        threshold = learned.threshold(_MAX_FP)
        points = draw_unreachable(robot, self.n, np.random.default_rng(self.seed + 1_000_000))
        smallest = smallest_turns(robot, points)
        possible = np.isfinite(smallest)
        attempts = [attempt(oracle, learned, threshold, p) for p in tqdm(points, desc="objects", disable=None)]
        touched = np.array([one.status == "within reach" and one.palm_off_m <= _TOUCH_M for one in attempts])
        refused = np.array([one.status == "out of reach" for one in attempts])
        brought = [one for one, t in zip(attempts, touched, strict=True) if t]
        reacting = [attempt(oracle, learned, threshold, p, False) for p in points[possible][: max(self.n // 8, 1)]]
        return {
            "objects": self.n,
            "reachable_with_torso": int(possible.sum()),
            "touched": int(touched.sum()),
            "refused_rightly": int((refused & ~possible).sum()),
            "refused_wrongly": int((refused & possible).sum()),
            "palm_off_mm": _spread([1000 * one.palm_off_m for one in brought]),
            "fixation_error_deg": _spread([one.fixation_rad / _DEG for one in brought]),
            "fixation_error_reacting_deg": _spread([one.fixation_rad / _DEG for one in reacting]),
            "turned_deg": _spread([one.turned_rad / _DEG for one in brought]),
            "seconds": _spread([one.seconds for one in brought]),
        }

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the counts, and the spreads over the objects touched."""
        counts = {
            "objects that the upright robot does not reach": "objects",
            "reachable with the torso": "reachable_with_torso",
            "touched": "touched",
            "unreachable and refused": "refused_rightly",
            "reachable and refused": "refused_wrongly",
        }
        spreads = {
            "palm to object (mm)": "palm_off_mm",
            "fixation error (°)": "fixation_error_deg",
            "fixation error, head only reacting (°)": "fixation_error_reacting_deg",
            "turn of the torso (°)": "turned_deg",
            "time (s)": "seconds",
        }
        rows = [[name, str(numbers[key]), "", ""] for name, key in counts.items()]
        rows += [[name, *(estimate([value]) for value in numbers[key])] for name, key in spreads.items()]
        return {"": Table(["leaning", "number or median", "95 %", "maximum"], rows)}


def _spread(values: list[float]) -> list[float]:
    """Return median, 95 % quantile and maximum."""
    return np.quantile(values, (0.5, 0.95, 1.0)).tolist() if values else [np.nan] * 3
