"""Whether withdrawing clears the predicted path of an object, and in which direction to leave the path if it does not.

The candidate motion with the largest predicted distance is taken, as in the dynamic window of Fox et al. (1997).
"""

from collections.abc import Sequence

import numpy as np

from control.arm import ArmParams, MovingPoint
from pps_vision.geometry.se3 import rotation_to
from pps_vision.robot.model import Posture
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, Track3D

_DIRECTIONS = 8  # across the path
_INSTANTS = 12  # of the prediction
_BEYOND_M = 0.05  # how far the object is followed beyond the last taxel that it passes
_HORIZON_S = 3.0  # R's longest time to contact
_SLOWEST_M_S = 0.01  # what is slower has no path
_GAIN_M = 0.01  # by which another direction must be better than the one taken so far


def direction_off_path(
    params: ArmParams,
    posture: Posture,
    side: str,
    skin: Skin,
    points: Sequence[MovingPoint],
    track: Track3D,
    enough_m: float,
    so_far: Array | None = None,
) -> Array | None:
    """The direction (3,) across the object's path in which all `points` should move instead; None: as they are to.

    They keep moving as they are to while that is predicted to leave `enough_m` between object and skin, and where no
    direction leaves more.  `so_far` is the direction chosen in the last frame.
    """
    speed = float(np.linalg.norm(track.velocity))
    if speed < _SLOWEST_M_S or not points:
        return None
    across = rotation_to(track.velocity / speed)[:, :2]
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    directions = np.column_stack([np.cos(angles), np.sin(angles)]) @ across.T
    if so_far is not None:
        directions = np.vstack([directions, so_far])
    wanted = np.array([one.velocity_root for one in points], dtype=float)
    aside = np.linalg.norm(wanted, axis=1).max() * directions
    velocities = np.concatenate([wanted[None], np.repeat(aside[:, None], len(points), axis=1)])
    columns = posture.robot.indices(posture.robot.names.arm(side))
    left_m = predicted_distances(posture, columns, skin, _rates(params, posture, columns, points, velocities), track)
    if so_far is None and left_m[0] > enough_m:
        return None
    left_m[0 if so_far is None else -1] += _GAIN_M
    best = int(left_m.argmax())
    return None if best == 0 else np.asarray(directions[best - 1])


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
    times = np.linspace(0.0, np.clip(last_m / speed, 0.1, _HORIZON_S), _INSTANTS + 1)[1:]
    q, robot = posture.q_rad[columns], posture.robot
    lower, upper = np.minimum(robot.lower_rad[columns], q), np.maximum(robot.upper_rad[columns], q)
    turned = np.clip(q + times[:, None] * rates[:, None], lower, upper) - q
    d = np.einsum("ndk,mtk->mtnd", J, turned) + taxels - (track.position + times[:, None] * track.velocity)[:, None]
    radius_m = track.radius_m if np.isfinite(track.radius_m) else 0.0
    return np.asarray(np.sqrt(np.sum(d * d, axis=3).min(axis=(1, 2))) - radius_m)


def _rates(
    params: ArmParams, posture: Posture, columns: list[int], points: Sequence[MovingPoint], velocities: Array
) -> Array:
    """Joint rates (m, k) of the arm for velocities (m, n, 3) of n points that are free to move across them.

    Damped least squares, scaled so that no point is faster in all than it is to be along its velocity.
    """
    J = np.array([posture.jacobian(one.frame, one.point)[:3, columns] for one in points])
    speeds, weights = np.linalg.norm(velocities, axis=2), np.sqrt([one.weight for one in points])
    unit = velocities / np.maximum(speeds, 1e-9)[:, :, None]
    A = np.einsum("mnd,ndk->mnk", unit, J) * weights[:, None]
    A[:, :, len(columns) - params.resting :] = 0.0
    H = np.einsum("mnk,mnl->mkl", A, A) + params.damping_m**2 * np.eye(len(columns))
    rates = np.linalg.solve(H, np.einsum("mnk,mn->mk", A, weights * speeds)[..., None])[..., 0]
    rates = np.clip(rates, -params.max_rate_rad_s, params.max_rate_rad_s)
    fastest = np.linalg.norm(np.einsum("ndk,mk->mnd", J, rates), axis=2).max(axis=1)
    scaled: Array = rates * np.minimum(1.0, speeds.max(axis=1) / np.maximum(fastest, 1e-9))[:, None]
    return scaled
