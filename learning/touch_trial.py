"""One movement that ended in a touch, as the robot lived it: what learning offline starts from."""

from dataclasses import dataclass

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
