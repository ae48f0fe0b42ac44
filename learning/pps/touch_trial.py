"""One movement up to a touch, as the robot recorded it: the input of offline learning and calibration."""

from dataclasses import dataclass

import numpy as np

from learning.pps.receptive_field import ReceptiveField, perceive
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, Mask


@dataclass(frozen=True, slots=True)
class TouchTrial:
    """T samples from the start of a movement to its touch or its end; NaN while the object is unknown."""

    stamps_s: Array
    """(T,)"""
    joints_rad: Array
    """(T, k) all joints of the robot."""
    positions: Array
    """(T, 3) m, root frame: centre of the object."""
    velocities: Array
    """(T, 3) m/s, root frame."""
    velocity_covs: Array
    """(T, 3, 3) m²/s²."""
    radius_m: Array
    """(T,)"""
    touched: Mask
    """(n,) taxels of the skin that were touched at the end."""
    aimed: str
    """Name "part:id" of the taxel that the object was aimed at."""


def perceived(trial: TouchTrial, robot: Robot, skin: Skin, field: ReceptiveField) -> tuple[Array, Array]:
    """D in m and TTC in s (T, n) of a trial's object for every taxel, which moves with the joints.

    NaN where the object is unknown or outside the taxel's receptive field.  Where the field subtracts a radius,
    it is the median of what was known of it.
    """
    positions, normals = (np.array(a) for a in zip(*(skin.at(robot.at(q)) for q in trial.joints_rad), strict=True))
    moving = np.gradient(positions, trial.stamps_s, axis=0) if len(positions) > 1 else np.zeros_like(positions)
    known = trial.radius_m[np.isfinite(trial.radius_m)]
    radius = float(np.median(known)) if len(known) else 0.0
    return perceive(field, positions, normals, trial.positions, trial.velocities, radius, trial.velocity_covs, moving)
