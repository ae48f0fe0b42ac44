"""How fast and how well the eyes fixate: points that stand still and points that move (J IV.1)."""

from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from control.fixation import FixationParams, fixation_error, gaze_at, step
from pps_vision.experiments.scenarios import EYES_M
from pps_vision.experiments.study import SampledStudy
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import home, icub_rig, load_icub, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from rendering.motions import make_motion
from rendering.names import MotionName

_DT_S = 0.05


@dataclass(frozen=True)
class Fixation(SampledStudy):
    """Fixation at 20 Hz: how soon a static point is within 0.5°, how far 15 cm/s at 0.4 m gets away.

    The controller is told where the point truly was one frame ago: this measures control, not sight.
    """

    n: int = 100
    """Points of each kind."""

    def run(self) -> dict[str, object]:
        """Degrees and seconds: medians and worst."""
        rng = np.random.default_rng(self.seed)
        robot = load_icub()
        settled = [
            _settling_time(robot, *_start_and_point(robot, rng)) for _ in tqdm(range(self.n), "static", disable=None)
        ]
        held = [_worst_lag(robot, rng) for _ in tqdm(range(self.n), "moving", disable=None)]
        return {
            "static_within_0.5_deg_after_s": {"median": float(np.median(settled)), "worst": float(np.max(settled))},
            "moving_15_cm_s_worst_lag_deg": {"median": float(np.median(held)), "worst": float(np.max(held))},
        }


def _start_and_point(robot: Robot, rng: np.random.Generator) -> tuple[Array, Array]:
    """A random gaze posture, and the fixation point of another one that the first has in view."""
    limits, rig = GazeLimits(), icub_rig(robot)
    lower, upper = limits.lower, np.minimum(limits.upper, np.deg2rad([55, 30, 90]))  # the iCub's own pitch
    while True:
        yaw, pitch, vergence = rng.uniform(lower, upper)
        q = set_gaze(robot, home(robot), yaw, pitch, 0.0, 0.0, vergence)
        point = fixation_points(robot, rng.uniform(lower, upper)[None])[0]
        view = rig.view(q)
        if view.left.sees(point) and view.right.sees(point):
            return q, point


def _settling_time(robot: Robot, q: Array, point: Array) -> float:
    """When the error is within 0.5° for good, s; inf if not within 3 s."""
    errors = []
    for _ in range(60):
        errors.append(fixation_error(robot.at(q), point))
        q = robot.clamp(q + _DT_S * step(FixationParams(), robot.at(q), point, dt_s=_DT_S).dq_rad_s)
    late = np.flatnonzero(np.array(errors) > np.deg2rad(0.5))
    if not len(late):
        return 0.0
    return float("inf") if late[-1] == len(errors) - 1 else _DT_S * (late[-1] + 1)


def _worst_lag(robot: Robot, rng: np.random.Generator) -> float:
    """Largest error in degrees from the first second on, of 5 s about a point 0.4 m before the eyes."""
    way = np.array([-1.0, rng.uniform(-0.4, 0.4), rng.uniform(-0.6, 0.1)])
    kind: MotionName = rng.choice(["circle", "figure8"])  # who turns on the spot is 2° away before any frame shows it
    motion = make_motion(kind, rng, EYES_M + 0.4 * way / np.linalg.norm(way), 0.15)
    q = gaze_at(robot, home(robot), motion(0.0)[0])
    worst = 0.0
    for k in range(1, 100):
        p, v = motion((k - 1) * _DT_S)
        q = robot.clamp(q + _DT_S * step(FixationParams(), robot.at(q), p, v, _DT_S).dq_rad_s)
        if k >= 20:
            worst = max(worst, np.rad2deg(fixation_error(robot.at(q), motion(k * _DT_S)[0])))
    return float(worst)
