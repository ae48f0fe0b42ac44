"""R's sessions by robots that misjudge themselves, at R's speeds: the finger is aimed by the robot's model and touches
what it happens to; objects are perceived where they are not."""

from dataclasses import dataclass, replace
from itertools import cycle, islice
from typing import Any

import numpy as np
from tqdm import tqdm

from control.double_touch import FINGERTIP_RADIUS_M, DoubleTouch, DoubleTouching, DoubleTouchParams
from learning.pps.trials import TouchTrial
from pps_vision.experiments.pps.movements import TRIALS, SessionName, finger_movement, is_in_view, plans
from pps_vision.experiments.pps.perceived import FOREARM, Session
from pps_vision.experiments.pps.robot_errors import ErringRobot, ErrorSources
from pps_vision.experiments.pps.table5 import PAPER, counted
from pps_vision.experiments.pps.trials import exact_trials
from pps_vision.experiments.study import SampledStudy, interval
from pps_vision.experiments.tables import Table, estimate
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
    """Minutes, samples and taxels touched in R's sessions (R Table 5) by robots with R's sources of error, at R's
    speeds; nothing is rendered."""

    n: int = 8
    """Robots, each with its own errors."""
    share: float = 1.0
    """Share of the trials of every session."""

    def run(self) -> dict[str, Any]:
        """Return the columns of Table 5 with 95 % over robots, and of every robot which taxels were touched."""
        robots = [ErringRobot.draw(ErrorSources(), np.random.default_rng((self.seed, k))) for k in range(self.n)]
        found = {}
        for name in tqdm(PAPER, desc="sessions", disable=None):
            sessions = [Session.of(name, self._trials(name, r, k), r.model, r.skin) for k, r in enumerate(robots)]
            counts = [{**counted(one), **reached(one)} for one in sessions]
            found[name] = {key: interval([[one[key]] for one in counts]) for key in counts[0]}
            found[name]["touched_by_robot"] = [one["touched"] for one in counts]
        return {"sessions": found}

    def _trials(self, name: SessionName, robot: ErringRobot, k: int) -> list[TouchTrial]:
        """Trials of a session as robot `k` makes and perceives them."""
        n = max(round(self.share * TRIALS[name]), 1)
        if name in ("motor", "visual"):
            return misaimed_touches(robot, n, name == "visual", self.seed + k)
        rng = np.random.default_rng((self.seed, k))
        return [robot.observe(trial, True, rng) for trial in exact_trials(name, n, self.seed, R_SPEEDS_M_S)]

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the columns of Table 5, beside the paper's where it has them."""
        columns = [key for key in next(iter(numbers["sessions"].values())) if key != "touched_by_robot"]
        rows = [
            [name, *(estimate(of[key]) + (f" / {PAPER[name][key]}" if key in PAPER[name] else "") for key in columns)]
            for name, of in numbers["sessions"].items()
        ]
        return {"": Table(["session (these robots / R)", *(key.replace("_", " ") for key in columns)], rows)}


def reached(session: Session) -> dict[str, float]:
    """Return how many taxels were aimed at, were touched of these, and were the nearest to a touch."""
    aimed = list(session.aimed)
    nearest = {int(np.linalg.norm(trial.d_m[-1], axis=1).argmin()) for trial in session.trials}
    touched = np.any([trial.touched for trial in session.trials], axis=0)[aimed]
    return {"aimed": len(aimed), "touched": int(touched.sum()), "nearest": len(nearest.intersection(aimed))}


def misaimed_touches(robot: ErringRobot, n: int, seen: bool, seed: int) -> list[TouchTrial]:
    """Return the first `n` double touches (fewer if ten times as many attempts do not suffice) that touch the left
    forearm anywhere, as the robot perceives them: `seen` by its eyes, or felt.

    The inner taxels are aimed at in turn. The movement goes on until the true skin is touched, at most to where it
    was planned to end, 3 cm under the assumed skin.
    """
    icub, skin = load_icub(), icub_skin()
    (assumed,) = (part for part in robot.skin.parts if part.name == FOREARM)
    p = DoubleTouchParams()
    end = replace(assumed, positions_m=assumed.positions_m - p.press_m * assumed.normals)
    params = replace(p, start_m=p.start_m + p.press_m, press_m=0.0, peak_m_s=R_SPEEDS_M_S)
    planner = DoubleTouching(robot.model, end, params)
    touches = {i: plans(planner, i, (seed, int(seen))) for i in INNER_FOREARM}
    rng = np.random.default_rng((seed, 2 + int(seen)))
    found: list[TouchTrial] = []
    for i in islice(cycle(INNER_FOREARM), _ATTEMPTS * n):
        slack = robot.slack_rad * rng.standard_normal(robot.model.n_joints)
        erring = replace(robot, joint_offsets_rad=robot.joint_offsets_rad + slack, slack_rad=0.0)
        touch = _until_touch(icub, skin, next(touches[i]), erring.joint_offsets_rad)
        if touch is not None:
            trial = finger_movement(icub, skin, touch).trial
            if not seen or is_in_view(icub, trial):
                found.append(erring.observe(trial, seen, rng))
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
