"""Whether withdrawing clears the predicted path of an object, and in which direction to leave the path if it does not.

The candidate motion with the largest predicted distance is taken, as in the dynamic window of Fox et al. (1997).
"""

from collections.abc import Callable

import numpy as np

from control.reaching import HORIZON_S, radius_m
from pps_vision.geometry.se3 import rotation_to
from pps_vision.robot.model import Posture
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, Track3D

_DIRECTIONS = 8  # across the path
_INSTANTS = 12  # of the prediction
_BEYOND_M = 0.05  # how far the object is followed beyond the last taxel that it passes
_SLOWEST_M_S = 0.01  # what is slower has no path
_GAIN_M = 0.01  # by which another direction must be better than the one taken so far


def direction_off_path(
    posture: Posture,
    columns: list[int],
    skin: Skin,
    track: Track3D,
    rates_towards: Callable[[Array | None], Array],
    enough_m: float,
    so_far: Array | None,
    free_share: Callable[[Array], float],
) -> Array | None:
    """The direction (3,) across the object's path in which the taxels should move; None: against their normals.

    Args:
        posture: The robot now.
        columns: Where the arm's k joints are in the configuration vector.
        skin: The arm's taxels.
        track: The object.
        rates_towards: Returns the rates (k,) within all limits of a motion in a direction, or of that against the
            normals (None).
        enough_m: No other direction is taken while withdrawal is predicted to leave so much between object and skin.
        so_far: The direction chosen in the last frame; kept unless another leaves 1 cm more.
        free_share: Returns the share of rates (k,) that is left where they lead near the body; asked for the best
            motion, until one slowed by its share is the best.
    """
    speed = float(np.linalg.norm(track.velocity))
    if speed < _SLOWEST_M_S:
        return None
    withdrawing = rates_towards(None)
    withdrawing = free_share(withdrawing) * withdrawing
    if so_far is None and predicted_distances(posture, columns, skin, withdrawing[None], track)[0] > enough_m:
        return None
    across = rotation_to(track.velocity / speed)[:, :2]
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    directions = [None, *(np.column_stack([np.cos(angles), np.sin(angles)]) @ across.T)]
    if so_far is not None:
        directions.append(so_far)
    rates = np.array([withdrawing, *(rates_towards(one) for one in directions[1:])])
    kept_m = np.zeros(len(rates))
    kept_m[0 if so_far is None else -1] = _GAIN_M
    left_m = kept_m + predicted_distances(posture, columns, skin, rates, track)
    slowed = {0}
    while (best := int(left_m.argmax())) not in slowed:
        slowed.add(best)
        if (share := free_share(rates[best])) < 1:
            slower = share * rates[best]
            left_m[best] = kept_m[best] + predicted_distances(posture, columns, skin, slower[None], track)[0]
    return directions[best]


def predicted_distances(posture: Posture, columns: list[int], skin: Skin, rates: Array, track: Track3D) -> Array:
    """Smallest distances (m,) m from the object's surface to the taxels' centres if the object moves on as it does.

    Args:
        posture: The robot now.
        columns: Where the k joints of `rates` are in the configuration vector.
        skin: The arm's taxels.
        rates: (m, k) rad/s, each held until a joint limit stops it; taxels follow their Jacobians.
        track: The object, which moves.
    """
    taxels, J = skin.at(posture)[0], skin.jacobians(posture, columns)
    speed = float(np.linalg.norm(track.velocity))
    last_m = float(((taxels - track.position) @ track.velocity).max()) / speed + _BEYOND_M
    times = np.linspace(0.0, np.clip(last_m / speed, 0.1, HORIZON_S), _INSTANTS + 1)[1:]
    q, robot = posture.q_rad[columns], posture.robot
    lower, upper = np.minimum(robot.lower_rad[columns], q), np.maximum(robot.upper_rad[columns], q)
    turned = np.clip(q + times[:, None] * rates[:, None], lower, upper) - q
    d = np.einsum("ndk,mtk->mtnd", J, turned) + taxels - (track.position + times[:, None] * track.velocity)[:, None]
    return np.asarray(np.sqrt(np.sum(d * d, axis=3).min(axis=(1, 2))) - radius_m(track))
