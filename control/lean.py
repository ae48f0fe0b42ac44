"""Lean: turn the torso until an object just outside the reachable space is within it (J's outlook).

The torso carries hand and eyes, so the reachable-space map, which takes the gaze at the object, holds in any posture.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from control.limits import check_times
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.model import Posture
from pps_vision.types import Array, JointVelocity, Mask

_DEG = np.pi / 180
_UPRIGHT_RAD = 0.1 * _DEG  # largest distance from the original joints that counts as upright
LeanStatus = Literal["within reach", "leaning", "out of reach"]


@dataclass(frozen=True)
class LeanParams:
    """Motion of the torso."""

    torso_rad_s: float = 15 * _DEG  # speed of the torso
    spacing_rad: float = 4 * _DEG  # spacing of the torso postures that are compared


def step(
    params: LeanParams,
    model: GazeModel,
    limits: GazeLimits,
    reachable: Callable[[Array], Mask],
    posture: Posture,
    p_root: Array,
    hold_s: float,
    stamp_s: float,
) -> tuple[LeanStatus, JointVelocity]:
    """Turn the torso straight to the nearest posture from which the object is reachable; rest where it already is.

    Args:
        params: Speed of the torso and spacing of its postures.
        model: Gaze kinematics of the robot.
        limits: Gaze limits of the map.
        reachable: The map's verdict (N,) on gaze postures (N, 3); False for NaN.
        posture: The robot now.
        p_root: (3,) m, the object in the root frame.
        hold_s: Duration of the command, in (0, 0.5] s, else InputError.
        stamp_s: Stamp of the command; InputError unless it is finite.
    """
    robot = posture.robot
    index = robot.indices(robot.names.torso)
    axes = [np.arange(robot.lower_rad[i], robot.upper_rad[i] + 1e-9, params.spacing_rad) for i in index]
    present = posture.q_rad[index]
    torso = np.vstack([present, np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)])
    q = np.tile(posture.q_rad, (len(torso), 1))
    q[:, index] = torso
    within = reachable(model.gaze(model.to_upright(q, p_root), limits))
    if not within.any():
        return "out of reach", _turn(params, posture, present, hold_s, stamp_s)
    reaching = torso[within]
    goal = reaching[np.linalg.norm(reaching - present, axis=1).argmin()]
    return "within reach" if within[0] else "leaning", _turn(params, posture, goal, hold_s, stamp_s)


def upright(params: LeanParams, posture: Posture, torso_rad: Array, hold_s: float, stamp_s: float) -> JointVelocity:
    """Turn the torso straight back to the joints (2,) before the lean; then rest."""
    present = posture.q_rad[posture.robot.indices(posture.robot.names.torso)]
    is_upright = np.linalg.norm(torso_rad - present) <= _UPRIGHT_RAD
    return _turn(params, posture, present if is_upright else torso_rad, hold_s, stamp_s)


def _turn(params: LeanParams, posture: Posture, torso_rad: Array, hold_s: float, stamp_s: float) -> JointVelocity:
    """Turn the torso straight to the joints (2,), and not past them while the command is held."""
    check_times("lean", stamp_s, hold_s)
    index = posture.robot.indices(posture.robot.names.torso)
    dq = np.zeros(posture.robot.n_joints)
    turn = torso_rad - posture.q_rad[index]
    dq[index] = turn / max(hold_s, float(np.linalg.norm(turn)) / params.torso_rad_s)
    return JointVelocity(stamp_s, dq, hold_s)
