"""One object out of reach and the robot before it, by kinematics: joints obey, what is fixated is known."""

from dataclasses import dataclass

import numpy as np

from control import fixation, into_reach
from control.fixation import FixationParams, fixation_error, gaze_at
from control.into_reach import IntoReachParams, IntoReachState
from pps_vision.experiments.reach.planning_world import GAZE, PlanningWorld
from pps_vision.robot.gaze import fixated_gaze
from pps_vision.types import Array

DT_S, _LONGEST_S = 0.05, 20.0


@dataclass(frozen=True)
class Attempt:
    """One object: what the robot said last, how far palm and object were apart then, the worst fixation error, by how
    much joints left their limits at most, how long it took, how far the torso turned in all, and how fast the fastest
    joint was."""

    said: str
    palm_off_m: float
    fixation_rad: float
    beyond_limits_rad: float
    seconds: float
    turned_rad: float
    fastest_rad_s: float
    trace: Array  # (T, 4) torso yaw, pitch, degree, fixation error


def attempt(world: PlanningWorld, point: Array, leads: bool = True) -> Attempt:
    """From fixation with the torso upright until the robot says that it is there or cannot; with `leads` the head turns
    along by the learned relation, else only fixation's own law moves it."""
    robot, params = world.robot, IntoReachParams()
    palm = robot.names.palms[("left", "right").index(params.side)]
    gaze_joints = robot.indices(robot.names.gaze_joints)
    torso_joints = robot.indices(robot.names.torso)
    q = gaze_at(robot, robot.clamp(np.zeros(robot.n_joints)), point)
    state, trace, turned, beyond, fastest, t = IntoReachState(), [], 0.0, 0.0, 0.0, 0.0
    while t < _LONGEST_S:
        posture = robot.at(q)
        gaze = fixated_gaze(posture, GAZE)
        state, command = into_reach.step(params, world.learned, state, posture, gaze, DT_S, t)
        degree = float(world.learned.judge(gaze[None]).degree[0])
        trace.append([*q[torso_joints], degree, fixation_error(posture, point)])
        if state.mode in ("there", "out of reach"):
            break
        dq = command.dq_rad_s.copy()
        if not leads:
            dq[gaze_joints] = 0.0
        dq += fixation.step(FixationParams(), posture, point, dt_s=DT_S, stamp_s=t).dq_rad_s
        moved = q + DT_S * dq
        q = robot.clamp(moved)
        beyond = max(beyond, float(np.abs(moved - q).max()))
        turned += DT_S * float(np.linalg.norm(dq[torso_joints]))
        fastest = max(fastest, float(np.abs(dq).max()))
        t += DT_S
    off = float(np.linalg.norm(robot.at(q).point(palm) - point))
    rows = np.array(trace)
    return Attempt(state.mode, off, float(rows[:, 3].max()), beyond, t, turned, fastest, rows)
