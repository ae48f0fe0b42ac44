"""Objects out of reach of the upright robot: the torso turns until the map calls them reachable, then the arm moves.

By kinematics: joints obey and the fixated point is known.  The truth, from which torso posture a point can be fixated
and reached, is closed form on a grid of torso postures.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from control import fixation, into_reach
from control.fixation import FixationParams, fixation_error, gaze_at
from control.into_reach import IntoReachParams, IntoReachState, Learned
from learning.reach.torso_gaze import TorsoFrame, TorsoToGaze, random_gaze, torso_limits, turn_torso
from learning.reach.training import ArmLimits, MapParams, ReachOracle, train_reachable_map
from pps_vision.experiments import charts
from pps_vision.experiments.reach.map_truth import closed_form
from pps_vision.experiments.study import Study
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.gaze import GazeLimits, fixated_gaze, fixation_points, gaze_for_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

_DEG = np.pi / 180
_GAZE = GazeLimits(pitch_rad=(-40 * _DEG, 30 * _DEG))  # J's, within the pitch of the iCub's own neck
_ARM = ArmLimits(upper_rad=(5 * _DEG, 160 * _DEG, 80 * _DEG, 105 * _DEG))  # J's, within the iCub's own first joint
_PARAMS = MapParams(_GAZE, _ARM)
_PLAN = IntoReachParams()
_MAX_FP, _N_TURNS, _TRUTH_STEP_RAD = 1e-4, 600, 2 * _DEG
_DT_S, _LONGEST_S, _TOUCH_M, _HELD_RAD = 0.05, 20.0, 0.01, 2 * _DEG


def learn(robot: Robot, seed: int, n_labels: int) -> Learned:
    """Learn the right arm's map, and how the gaze follows the torso from 600 small turns."""
    rng = np.random.default_rng(seed)
    params = replace(_PARAMS, n_labels=n_labels, round_labels=min(_PARAMS.round_labels, n_labels // 2))
    learned = train_reachable_map(robot, _PLAN.side, rng, params)
    relation = TorsoToGaze()
    relation.learn(turn_torso(robot, _N_TURNS, rng, _GAZE))
    oracle = ReachOracle(robot, _PLAN.side, params, rng)

    def hand_to(gaze: Array) -> tuple[Array, float]:
        found = oracle.solve(gaze[None])
        return found.q_rad[0], float(found.error[0])

    return Learned(partial(learned.query, threshold=learned.threshold(_MAX_FP)), relation, hand_to)


class TorsoTruth:
    """Whether a point can be reached with the torso upright, or from some torso posture of a grid of 2°."""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._arm, self._frame = robot, closed_form(robot, _PLAN.side, _ARM), TorsoFrame(robot)
        axes = [np.arange(low, high + 1e-9, _TRUTH_STEP_RAD) for low, high in zip(*torso_limits(robot), strict=True)]
        self._torso = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)

    def reaches(self, points: Array) -> Mask:
        """Return whether the hand reaches points (N, 3) with the torso upright."""
        return np.isfinite(self._arm.solve(points)[:, 0])

    def smallest_turn(self, point: Array) -> float:
        """Return by how much (rad) the torso must turn to fixate and reach a point; inf where no turn does."""
        around = self._frame.from_upright(self._torso, np.tile(point, (len(self._torso), 1)))
        reached = np.flatnonzero(self.reaches(around))
        fixated = np.isfinite(gaze_for_points(self._robot, around[reached], _GAZE)[:, 0])
        return float(np.linalg.norm(self._torso[reached[fixated]], axis=1).min(initial=np.inf))

    def draw_unreachable(self, n: int, rng: np.random.Generator) -> Array:
        """Return (n, 3) points to fixate, not reach, with the torso upright; uniform in direction and log distance."""
        points: Array = np.zeros((0, 3))
        while len(points) < n:
            more = fixation_points(self._robot, random_gaze(_GAZE, n, rng))
            points = np.concatenate([points, more[~self.reaches(more)]])
        return points[:n]


@dataclass(frozen=True)
class Attempt:
    """What became of one object."""

    mode: str
    """What the planner said last."""
    palm_off_m: float
    """Distance of palm and object at the end."""
    beyond_limits_rad: float
    """By how much a joint was commanded beyond its limits, at most."""
    turned_rad: float
    """How far the torso turned in all."""
    fixation_rad: float
    """Largest fixation error."""
    seconds: float
    """How long it took."""


def attempt(robot: Robot, learned: Learned, point: Array, head_leads: bool = True) -> Attempt:
    """Run from fixation with the torso upright until the planner says that the hand is there, or that it cannot be.

    Without `head_leads` the head does not turn along with the torso; fixation alone reacts.
    """
    palm = robot.names.palms[("left", "right").index(_PLAN.side)]
    gaze_joints, torso = robot.indices(robot.names.gaze_joints), robot.indices(robot.names.torso)
    q = gaze_at(robot, robot.clamp(np.zeros(robot.n_joints)), point)
    state, error, turned, beyond = IntoReachState(), 0.0, 0.0, 0.0
    for t in np.arange(0, _LONGEST_S, _DT_S):
        posture = robot.at(q)
        state, command = into_reach.step(_PLAN, learned, state, posture, fixated_gaze(posture, _GAZE), _DT_S, t)
        error = max(error, fixation_error(posture, point))
        if state.mode in ("there", "out of reach"):
            break
        dq = command.dq_rad_s.copy()
        dq[gaze_joints] *= head_leads
        dq += fixation.step(FixationParams(), posture, point, dt_s=_DT_S, stamp_s=t).dq_rad_s
        turned += _DT_S * float(np.linalg.norm(dq[torso]))
        commanded = q + _DT_S * dq
        q = robot.clamp(commanded)
        beyond = max(beyond, float(np.abs(commanded - q).max()))
    palm_off_m = float(np.linalg.norm(robot.at(q).point(palm) - point))
    return Attempt(state.mode, palm_off_m, beyond, turned, error, float(t))


@dataclass(frozen=True)
class Planning(Study):
    """Objects that the right hand reaches only with the torso turned: touched, refused, and fixation meanwhile."""

    seed: int = 0
    """Seed of the learning and the objects."""
    n: int = 200
    """Objects out of reach of the upright robot."""
    n_labels: int = 12_000
    """Inverse-kinematics solutions the map is learned from."""

    def run(self) -> dict[str, Any]:
        """Return counts; median, 95 % quantile and maximum over the objects touched."""
        if self.n < 1:
            raise ValueError(f"n {self.n}: expected at least 1")
        robot = load_icub()
        learned, truth = learn(robot, self.seed, self.n_labels), TorsoTruth(robot)
        points = truth.draw_unreachable(self.n, np.random.default_rng(self.seed + 1_000_000))
        smallest = np.array([truth.smallest_turn(point) for point in points])
        possible = np.isfinite(smallest)
        attempts = [attempt(robot, learned, point) for point in tqdm(points, desc="objects", disable=None)]
        touched = np.array([one.palm_off_m <= _TOUCH_M for one in attempts])
        refused = np.array([one.mode == "out of reach" for one in attempts])
        brought = [one for one, t in zip(attempts, touched, strict=True) if t]
        rest = [one for one, hopeless in zip(attempts, refused & ~possible, strict=True) if hopeless]
        reacting = [attempt(robot, learned, point, head_leads=False) for point in points[possible][: self.n // 8]]
        return {
            "objects": self.n,
            "reachable_with_torso": int(possible.sum()),
            "touched": int((touched & possible).sum()),
            "touched_against_truth": int((touched & ~possible).sum()),
            "refused_rightly": int((refused & ~possible).sum()),
            "refused_wrongly": int((refused & possible).sum()),
            "neither": int((~touched & ~refused).sum()),
            "fixation_within_2_deg": sum(one.fixation_rad <= _HELD_RAD for one in brought),
            "palm_off_mm": _spread([1000 * one.palm_off_m for one in brought]),
            "fixation_error_deg": _spread([one.fixation_rad / _DEG for one in brought]),
            "fixation_error_head_reacting_deg": _spread(
                [one.fixation_rad / _DEG for one in reacting if one.palm_off_m <= _TOUCH_M]
            ),
            "seconds": _spread([one.seconds for one in brought]),
            "turned_deg": _spread([one.turned_rad / _DEG for one in brought]),
            "turned_when_refused_deg": _spread([one.turned_rad / _DEG for one in rest]),
            "beyond_limits_deg": max(one.beyond_limits_rad for one in attempts) / _DEG,
            "each": {
                "smallest_turn_deg": np.where(possible, smallest / _DEG, np.nan).round(2).tolist(),
                "turned_deg": [round(one.turned_rad / _DEG, 2) for one in attempts],
                "touched": touched.tolist(),
            },
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw the turn made against the smallest that suffices."""
        figure, (axis,) = charts.panels(1, width=5.4)
        each = {name: np.array(values, dtype=float) for name, values in numbers["each"].items()}
        for value, name, color in ((1, "touched", "C2"), (0, "not touched", "C3")):
            which = each["touched"] == value
            axis.plot(each["smallest_turn_deg"][which], each["turned_deg"][which], "o", ms=4, color=color, label=name)
        axis.axline((0, 0), slope=1, color="0.4", ls="--", lw=1, label="smallest turn")
        axis.set(xlabel="smallest turn of the torso that suffices (°)", ylabel="turn made (°)")
        axis.set_title(f"{numbers['touched']} of {numbers['reachable_with_torso']} reachable touched", fontsize=10)
        axis.legend(fontsize=8)
        axis.grid(alpha=0.25)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the spreads over the objects touched."""
        names = {
            "palm to object (mm)": "palm_off_mm",
            "fixation error (°)": "fixation_error_deg",
            "fixation error, head only reacting (°)": "fixation_error_head_reacting_deg",
            "turn of the torso (°)": "turned_deg",
            "time (s)": "seconds",
        }
        rows = [[name, *(estimate([value]) for value in numbers[key])] for name, key in names.items()]
        return {"": Table(["objects touched", "median", "95 %", "maximum"], rows)}


def _spread(values: list[float]) -> list[float]:
    """Return median, 95 % quantile and maximum."""
    return np.quantile(values, (0.5, 0.95, 1.0)).tolist() if values else [np.nan] * 3
