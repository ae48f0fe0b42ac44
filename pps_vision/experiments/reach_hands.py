"""Two hands that choose which of them reaches, beside one, and the objects that neither can reach.

By kinematics: the true position and velocity of the object come in place of a tracker, joints follow their commands.
What is within reach is so with the torso upright; leaning brings more within reach.  An object comes along the normal
of any taxel of both arms at home, stops before it and waits.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from tqdm import tqdm

from control.lean import LeanParams
from control.reaching import ReachingParams
from learning.pps.memory import PPSMemory
from learning.reach.map import ReachableMap
from learning.reach.training import train_reachable_map
from pps_vision.app.intervals import percent_of
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.app.simulation import Side
from pps_vision.experiments.reach_truth import ARMS, closed_form, map_params
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.icub import HOME_ARM_RAD, home, load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import TOUCH_RADIUS_M, Skin, icub_skin
from pps_vision.types import Array, Status, StereoFrame, Track3D
from tracking.tracker import TrackerStep

_DEG = np.pi / 180
_DT_S = 0.05
_SECONDS = 15.0
_SPEED_M_S = 0.06
_BEGIN_M = 0.1  # from where the object begins to where it stops
_STOP_M = (0.05, 0.18)  # from there to the taxel's centre
_RADIUS_M = 0.02
_PLACES = 11  # of an object's path, all out of reach of an object that is
_GAZE = GazeLimits(pitch_rad=(-80 * _DEG, 40 * _DEG))  # down to both hands at home
_BLACK = np.zeros((2, 2, 3), np.uint8)
_VARIANTS: Mapping[str, tuple[tuple[Side, ...], LeanParams | None]] = {
    "both hands, the torso leans": (("left", "right"), LeanParams()),
    "both hands, upright": (("left", "right"), None),
    "right hand, upright": (("right",), None),
}
"""Hands that reach, and the lean of the torso."""
Motion = Callable[[float], tuple[Array, Array]]  # time → position (3,) m and velocity (3,) m/s


@dataclass(frozen=True)
class _KnownTrack:
    """In place of a tracker: the object's true position and velocity."""

    motion: Motion

    def step(self, frame: StereoFrame) -> TrackerStep:
        """Return the track at the frame's stamp."""
        mean = np.array([*self.motion(frame.stamp_s), np.zeros(3), np.zeros(3)])
        track = Track3D(frame.stamp_s, mean, 1e-6 * np.eye(12), _RADIUS_M, 1e-8, Status.TRACKING)
        return TrackerStep(track, (), None, np.zeros((2, 3)))


@dataclass(frozen=True)
class ReachHands(SampledStudy):
    """Objects that come to the skin of both arms, reached for by both hands or one."""

    MINUTES: ClassVar[int] = 6
    SHORT: ClassVar[Mapping[str, Any]] = {"n": 2, "n_labels": 600}

    n: int = 100  # objects that can be fixated and stop within reach of a hand; half as many never within reach
    n_labels: int = 12_000  # inverse-kinematics solutions of each hand's map

    def run(self) -> dict[str, Any]:
        """Return by variant the objects that were felt, reached for and touched by a palm."""
        robot = load_icub()
        skin = icub_skin()
        params = replace(map_params(self.n_labels), gaze_limits=_GAZE)
        rng = np.random.default_rng(self.seed)
        maps = {side: train_reachable_map(robot, side, rng, params) for side in ARMS}
        arms = [closed_form(robot, side) for side in ARMS]
        model = GazeModel(robot)
        q_home = home(robot)
        points, normals = skin.at(robot.at(q_home))
        drawn: dict[bool, list[Motion]] = {True: [], False: []}
        rng = np.random.default_rng(self.seed + 1_000_000)
        while len(drawn[True]) < self.n or len(drawn[False]) < self.n // 2:
            motion = _comes(points, normals, rng)
            path = np.array([motion(t)[0] for t in np.linspace(0.0, _BEGIN_M / _SPEED_M_S, _PLACES)])
            gaze = model.gaze(model.to_upright(q_home[None], path[-1]), _GAZE)
            if np.isnan(gaze).any():
                continue  # no map answers for what cannot be fixated
            reached = np.any([np.isfinite(arm.solve(path)[:, 0]) for arm in arms], axis=0)
            if reached[-1] and len(drawn[True]) < self.n:
                drawn[True].append(motion)
            elif not reached.any() and len(drawn[False]) < self.n // 2:
                drawn[False].append(motion)
        return {
            variant: {
                name: [
                    _meet(robot, skin, motion, *how, maps) for motion in tqdm(drawn[within], desc=variant, disable=None)
                ]
                for name, within in (("within reach", True), ("out of reach", False))
            }
            for variant, how in _VARIANTS.items()
        }

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return a row for each variant."""
        rows = []
        for variant in _VARIANTS:
            near, far = (numbers[variant][name] for name in ("within reach", "out of reach"))
            counts = [
                f"{sum(row[key] for row in objects)} of {len(objects)}"
                for objects, key in ((near, "felt"), (far, "tried"), (far, "touched"))
            ]
            touched = estimate(percent_of(sum(row["touched"] for row in near), len(near)))
            rows.append([variant, touched, *counts])
        columns = "within reach: touched (%)", "felt", "out of reach upright: tried", "touched"
        return {"": Table(["reaching", *columns], rows)}


def _comes(points: Array, normals: Array, rng: np.random.Generator) -> Motion:
    """An object's motion to a random one of the taxels at `points` (n, 3) m with `normals` (n, 3)."""
    k = rng.integers(len(points))
    stop_m = rng.uniform(*_STOP_M)

    def motion(t: float) -> tuple[Array, Array]:
        left_m = max(_BEGIN_M - _SPEED_M_S * t, 0.0)
        return points[k] + (stop_m + left_m) * normals[k], -_SPEED_M_S * (left_m > 0) * normals[k]

    return motion


def _meet(
    robot: Robot,
    skin: Skin,
    motion: Motion,
    hands: tuple[Side, ...],
    lean: LeanParams | None,
    maps: Mapping[str, ReachableMap],
) -> dict[str, bool]:
    """Whether the skin feels the object come, an arm moves, and a palm touches it."""
    reaching = [ReachingParams(HOME_ARM_RAD, side=side) for side in hands]
    params = PipelineParams(arm=reaching[0], other_arm=reaching[1] if len(reaching) > 1 else None, lean=lean)
    tracker: Any = _KnownTrack(motion)
    memory = PPSMemory.constant(skin)
    pipeline = Pipeline(params, robot, skin, tracker, memory, np.random.default_rng(0), *(maps[side] for side in hands))
    is_palm = np.isin([skin.parts[k].frame for k in skin.part_index], [robot.names.palm(side) for side in hands])
    arms = np.concatenate([robot.indices(robot.names.arm(side)) for side in ARMS])
    q = home(robot)
    met = {"felt": False, "tried": False, "touched": False}
    for t in np.arange(0.0, _SECONDS, _DT_S).tolist():
        step = pipeline.step(StereoFrame(_BLACK, _BLACK, t, t, q, q))
        met["felt"] |= bool(step.activation.probability.max() > params.arm.threshold)
        met["tried"] |= bool(step.command.dq_rad_s[arms].any())
        q = robot.clamp(q + _DT_S * step.command.dq_rad_s)
        gaps_m = np.linalg.norm(skin.at(robot.at(q))[0][is_palm] - motion(t + _DT_S)[0], axis=1) - _RADIUS_M
        if gaps_m.min() <= TOUCH_RADIUS_M:
            met["touched"] = True
            break
    return met
