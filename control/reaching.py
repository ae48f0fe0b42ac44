"""Reach for an object: which side of the arm it comes to, and with which of its taxels the arm touches it first."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from control.arm import MovingPoint
from control.limits import MAX_HOLD_S
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.bare_links import Near
from pps_vision.robot.model import Posture
from pps_vision.robot.skin import TOUCH_RADIUS_M, Skin
from pps_vision.types import Array, Track3D

AT_REST_M_S = 1e-6
"""A slower control point never arrives."""
HORIZON_S = 3.0
"""How long an object is expected to go on as it goes: R's longest time to contact."""
_FAR_AHEAD_S = 10.0  # of the object's path: at 5 cm/s, R's slowest, it comes from half a metre


class Way(NamedTuple):
    """One way to touch the object."""

    touches_s: float
    """When it touches if the speed stays."""
    point: MovingPoint
    """The taxel."""
    dq: Array
    """(n_joints,) rad/s."""


def radius_m(track: Track3D) -> float:
    """The radius of the object, 0 where it is not known."""
    return track.radius_m if np.isfinite(track.radius_m) else 0.0


def distance(posture: Posture, point: MovingPoint, position: Array) -> float:
    """m from a control point to a position (3,) in the root frame."""
    return float(np.linalg.norm(position - posture.point(point.frame, point.point)))


def distances_ahead(points: Array, position: Array, velocity: Array, horizon_s: float) -> Array:
    """How near (n,) an object comes to points (n, 3) if it moves on from a position (3,) at a velocity (3,), m."""
    d = points - position
    nearest_s = np.clip(d @ velocity / max(float(velocity @ velocity), 1e-12), 0.0, horizon_s)
    return np.asarray(np.linalg.norm(d - nearest_s[:, None] * velocity, axis=1))


def taxel_to_touch(skin: Skin, home: Posture, track: Track3D, seen: Sequence[tuple[float, Array]]) -> int:
    """Number of the taxel that the object comes to: the nearest to its path with the arm at `home`, since the arm's own
    motion does not change where the object goes.

    The path leads on from where the object was `seen` (stamps and positions (3,) m, the last one now): its estimated
    velocity overshoots when it stops.
    """
    taxels, _ = skin.at(home)
    (first_s, first), (last_s, last) = seen[0], seen[-1]
    velocity = (last - first) / (last_s - first_s) if last_s > first_s else track.velocity
    return int(distances_ahead(taxels, track.position, velocity, _FAR_AHEAD_S).argmin())


def first_to_touch(
    speed_m_s: float,
    aimed_at: int,
    posture: Posture,
    skin: Skin,
    track: Track3D,
    velocity: Callable[[tuple[MovingPoint, ...]], Array],
) -> Way:
    """With which taxel of the same part and side as the taxel `aimed_at` the arm touches the object first, at the speed
    towards it that the constraints allow now; `velocity`: joint rates (n_joints,) of control points within them."""
    positions, normals = skin.at(posture)
    part = skin.part_index[aimed_at]
    taxels = positions[(skin.part_index == part) & (normals @ normals[aimed_at] > 0)]
    frame, d = skin.parts[part].frame, track.position - taxels
    distances = np.linalg.norm(d, axis=1)
    ways = []
    for k, point in enumerate(move_points(inverse(posture.T_root(frame)), taxels)):
        one = aimed(speed_m_s, MovingPoint(frame, point, np.zeros(3)), posture, track)
        dq = velocity((one,))
        towards_m_s = float(d[k] @ posture.jacobian(frame, point)[:3] @ dq) / max(distances[k], 1e-9)
        gap = max(distances[k] - radius_m(track) - TOUCH_RADIUS_M, 0.0)
        ways.append(Way(gap / max(towards_m_s, AT_REST_M_S), one, dq))
    return min(ways, key=lambda way: way.touches_s)


def aimed(speed_m_s: float, point: MovingPoint, posture: Posture, track: Track3D) -> MovingPoint:
    """The control point on its way to the surface of the object, where it stops."""
    d, far_m = track.position - posture.point(point.frame, point.point), distance(posture, point, track.position)
    gap = max(far_m - radius_m(track), 0.0)
    return point._replace(velocity_root=min(speed_m_s, gap / MAX_HOLD_S) * d / max(far_m, 1e-9))


def other_parts(posture: Posture, skin: Skin, frame: str, track: Track3D) -> list[Near]:
    """The taxel nearest to the object of each body part but that of `frame`, which is to touch it."""
    d = track.position - skin.at(posture)[0]
    distances = np.linalg.norm(d, axis=1)
    near = []
    for k, part in enumerate(skin.parts):
        if part.frame != frame:
            i = int(np.argmin(np.where(skin.part_index == k, distances, np.inf)))
            gap = float(distances[i]) - radius_m(track)
            near.append(Near(part.frame, track.position - d[i], d[i] / max(distances[i], 1e-9), gap))
    return near
