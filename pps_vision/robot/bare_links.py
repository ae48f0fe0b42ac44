"""Links of an arm without taxels and their distances from an object, by coal."""

from typing import NamedTuple

import coal
import numpy as np

from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.skin import Skin
from pps_vision.types import Array

_MAX_DISTANCE_M = 0.5  # from the middle of a body; the distance of an object farther away is inf


class NearestPoint(NamedTuple):
    """The point of a body nearest to an object."""

    frame: str  # the link
    point_root: Array  # (3,) m
    normal: Array  # (3,) unit vector from the body to the object
    distance_m: float  # negative where they overlap


class BareLinks:
    """The bodies that an arm moves and whose links carry no skin."""

    def __init__(self, robot: Robot, skin: Skin, side: str) -> None:
        joints = set(robot.names.arm(side))
        covered = {part.frame for part in skin.parts}
        self._bodies = [
            (body, shape.geometry)
            for body, shape in zip(robot.bodies, robot.geometry.geometryObjects, strict=True)
            if body.frame not in covered and not joints.isdisjoint(robot.moving(body.frame))
        ]

    def nearest_points(self, posture: Posture, center_root: Array, radius_m: float) -> list[NearestPoint]:
        """Each body's nearest point to a ball about `center_root` (3,) m; the distance of distant bodies is inf."""
        ball = coal.Sphere(max(radius_m, 1e-6))
        T_root_ball = coal.Transform3s(np.eye(3), np.asarray(center_root, dtype=float))
        points = []
        for body, shape in self._bodies:
            T = posture.T_root(body.frame) @ body.T_frame_body
            if not np.linalg.norm(center_root - T[:3, 3]) < _MAX_DISTANCE_M + radius_m:
                points.append(NearestPoint(body.frame, T[:3, 3], np.zeros(3), np.inf))
                continue
            result = coal.DistanceResult()
            T_root_body = coal.Transform3s(T[:3, :3], T[:3, 3])
            distance = coal.distance(shape, T_root_body, ball, T_root_ball, coal.DistanceRequest(), result)
            nearest = result.getNearestPoint1().copy()
            points.append(NearestPoint(body.frame, nearest, result.normal.copy(), float(distance)))
        return points
