"""R's felt double touches by robots that misjudge themselves, at R's speeds: the finger is aimed by the robot's model
and touches what it happens to."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import cycle, islice
from typing import Any, ClassVar

import numpy as np
from tqdm import tqdm

from control.double_touch import FINGERTIP_RADIUS_M, DoubleTouch, DoubleTouching, DoubleTouchParams
from learning.pps.trials import TouchTrial
from pps_vision.experiments.pps.movements import TRIALS, finger_movement, plans
from pps_vision.experiments.pps.perceived import FOREARM, Session
from pps_vision.experiments.pps.robot_errors import ErringRobot, ErrorSources
from pps_vision.experiments.pps.table5 import PAPER, counted
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import INNER_FOREARM, TOUCH_RADIUS_M, Skin, icub_skin
from pps_vision.types import Array

R_SPEEDS_M_S = (0.05, 0.15)
"""Range of the speed of R's simulated approaches, the only ones of which R states it."""
_ATTEMPTS = 10  # for each touch
_LEAST_STEPS = 3  # of a movement, for its velocity


@dataclass(frozen=True)
class Misaimed(SampledStudy):
    """Samples and taxels touched in R's felt double touches (R Table 5) by robots with R's sources of error."""

    SHORT: ClassVar[Mapping[str, Any]] = {"share": 0.05}

    n: int = 5
    """Robots, each with its own errors."""
    share: float = 1.0
    """Share of R's trials."""

    def run(self) -> dict[str, Any]:
        """Return the columns of Table 5 and the taxels reached, of every robot."""
        robots = []
        for k in tqdm(range(self.n), desc="robots", disable=None):
            robot = ErringRobot.draw(ErrorSources(), np.random.default_rng((self.seed, k)))
            trials = misaimed_touches(robot, max(round(self.share * TRIALS["motor"]), 1), self.seed + k)
            session = Session.of("motor", trials, robot.model, robot.skin)
            robots.append({**counted(session), **reached(session)})
        return {"robots": robots}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return a row for each robot, and R's."""
        columns = list(numbers["robots"][0])
        rows = [[str(k + 1), *(f"{one[key]:g}" for key in columns)] for k, one in enumerate(numbers["robots"])]
        rows.append(["R", *(str({**PAPER["motor"], "aimed": 8, "touched": 6}.get(key, "–")) for key in columns)])
        return {"": Table(["robot", *(key.replace("_", " ") for key in columns)], rows)}


def reached(session: Session) -> dict[str, float]:
    """Return how many taxels were aimed at, were touched of these, and were the nearest to a touch."""
    aimed = list(session.aimed)
    nearest = {int(np.linalg.norm(trial.d_m[-1], axis=1).argmin()) for trial in session.trials}
    touched = np.any([trial.touched for trial in session.trials], axis=0)[aimed]
    return {"aimed": len(aimed), "touched": int(touched.sum()), "nearest": len(nearest.intersection(aimed))}


def misaimed_touches(robot: ErringRobot, n: int, seed: int) -> list[TouchTrial]:
    """Return the first `n` double touches (fewer if ten times as many attempts do not suffice) that touch the left
    forearm anywhere, as the robot feels them.

    The inner taxels are aimed at in turn. The movement goes on until the true skin is touched, at most to where it
    was planned to end, 3 cm under the assumed skin.
    """
    icub, skin = load_icub(), icub_skin()
    (assumed,) = (part for part in robot.skin.parts if part.name == FOREARM)
    p = DoubleTouchParams()
    end = replace(assumed, positions_m=assumed.positions_m - p.press_m * assumed.normals)
    params = replace(p, start_m=p.start_m + p.press_m, press_m=0.0, peak_m_s=R_SPEEDS_M_S)
    planner = DoubleTouching(robot.model, end, params)
    touches = {i: plans(planner, i, (seed,)) for i in INNER_FOREARM}
    rng = np.random.default_rng(seed)
    found: list[TouchTrial] = []
    for i in islice(cycle(INNER_FOREARM), _ATTEMPTS * n):
        slack = robot.slack_rad * rng.standard_normal(robot.model.n_joints)
        erring = replace(robot, joint_offsets_rad=robot.joint_offsets_rad + slack, slack_rad=0.0)
        plan = next(touches[i], None)  # None: as this robot believes its joints, the finger cannot get there
        touch = plan and _until_touch(icub, skin, plan, erring.joint_offsets_rad)
        if touch is not None:
            found.append(erring.observe(finger_movement(icub, skin, touch).trial, False, rng))
        if len(found) == n:
            break
    return found


def _until_touch(icub: Robot, skin: Skin, plan: DoubleTouch, offsets_rad: Array) -> DoubleTouch | None:
    """The true movement of encoders that read `plan`, up to where the fingertip meets the skin; None if it does not.

    It meets the skin where it comes below the tangent plane of a taxel that it then touches.
    """
    joints = plan.joints_rad - offsets_rad
    part = next(one for one in skin.parts if one.name == FOREARM)
    for k, q in enumerate(joints):
        posture = icub.at(q)
        T = posture.T_root(part.frame)
        away = T[:3, :3].T @ (posture.point(icub.names.index_tips[1]) - T[:3, 3]) - part.positions_m
        below = (away * part.normals).sum(axis=1) <= FINGERTIP_RADIUS_M
        if (below & (np.linalg.norm(away, axis=1) <= FINGERTIP_RADIUS_M + TOUCH_RADIUS_M)).any():
            return DoubleTouch(plan.stamps_s[: k + 1], joints[: k + 1]) if k >= _LEAST_STEPS else None
    return None
