"""One movement that ended in a touch, as the robot lived it: what learning offline starts from."""

from dataclasses import dataclass

import numpy as np

from learning.pps.receptive_field import ReceptiveField, perceive
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, Mask


@dataclass(frozen=True, slots=True)
class TouchTrial:
    """From the start of a movement to its touch, or to where it ends without one.

    `stamps_s` (T,); `joints_rad` (T, k) of the whole robot; what is known of the object, in the root
    frame: `positions`, `velocities` (T, 3) m, m/s, `velocity_covs` (T, 3, 3) m²/s², `radius_m` (T,),
    NaN while unknown.  `touched` (n,) which of the skin's taxels were touched at the end; `aimed` the
    name "part:id" of the taxel that was meant to be.
    """

    stamps_s: Array
    joints_rad: Array
    positions: Array
    velocities: Array
    velocity_covs: Array
    radius_m: Array
    touched: Mask
    aimed: str


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
