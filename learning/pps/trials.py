"""A trial in the root frame: an object approaches the skin and touches some taxels at the end."""

from dataclasses import dataclass

from pps_vision.types import Array, Mask


@dataclass(frozen=True, slots=True)
class TouchTrial:
    """T samples of a robot and an object, from the start of a movement to its touch or its end; NaN while the object is
    unknown."""

    stamps_s: Array  # (T,)
    joints_rad: Array  # (T, k) all joints of the robot
    positions: Array  # (T, 3) m, root frame: centre of the object
    velocities: Array  # (T, 3) m/s, root frame
    velocity_covs: Array  # (T, 3, 3) m²/s²
    radius_m: Array  # (T,)
    touched: Mask  # (n,) taxels of the skin that were touched at the end
