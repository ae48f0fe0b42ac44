"""Distance and time to contact of a tracked object, as the reports show them."""

import numpy as np

from pps_vision.types import Array

_SLOWEST_M_S = 0.01  # slower approaches have no time to contact


def distance_and_ttc_of_origin(position: Array, velocity: Array) -> tuple[Array, Array]:
    """Distance (…) in m from the root frame's origin, and the time (…) in s until the object at `position` would be
    there at its present speed of approach, from its `velocity`, both (…, 3); NaN where it does not approach."""
    distance = np.linalg.norm(position, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        closing = -np.sum(position * velocity, axis=-1) / distance
        return distance, np.where(closing > _SLOWEST_M_S, distance / closing, np.nan)
