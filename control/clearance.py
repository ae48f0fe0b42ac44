"""How much room a two-armed robot leaves between its arms and its trunk: bodies as capsules."""

from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.geometry.se3 import move_points
from pps_vision.robot.model import Body, Robot
from pps_vision.types import Array

_SAMPLES = np.linspace(0, 1, 7)  # along a capsule's axis: 1.5 cm apart on a forearm of radius 3 cm


class Clearance:
    """The gap between the right arm and the left arm or trunk, and between the left arm and the trunk.

    Upper arms, which are joined to the trunk, are only kept clear of the other arm.  The right index finger is
    left out: it is what touches.  Frames are told apart by their names: left_…, right_…, …_upper_arm.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        tip = robot.at(np.zeros(robot.n_joints))
        finger = tip.point(robot.names.index_tips[1])
        bodies = [(body, *_capsule(body)) for body in robot.bodies]
        bodies = [b for b in bodies if np.linalg.norm(tip.point(b[0].frame, b[1]) - finger, axis=1).min() > 0.015]
        self._frames = [body.frame for body, _, _ in bodies]
        self._axes = [axis for _, axis, _ in bodies]
        radii = np.array([radius for _, _, radius in bodies])
        pairs = [(i, j) for i, j in product(range(len(bodies)), repeat=2) if _matters(self._frames[i], self._frames[j])]
        self._one, self._other = np.array(pairs).T
        self._sum_m = radii[self._one] + radii[self._other]

    def gap_m(self, q_rad: ArrayLike) -> float:
        """The smallest gap at a configuration (k,); negative where bodies overlap."""
        posture = self._robot.at(q_rad)
        T = {frame: posture.T_root(frame) for frame in set(self._frames)}
        axes = np.array([move_points(T[frame], axis) for frame, axis in zip(self._frames, self._axes, strict=True)])
        apart = axes[self._one][:, :, None] - axes[self._other][:, None]
        return float((np.sqrt(np.einsum("pijk,pijk->pij", apart, apart).min(axis=(1, 2))) - self._sum_m).min())


def _matters(one: str, other: str) -> bool:
    """Whether the body of frame `one`, of an arm, is to keep clear of `other`."""
    if one.startswith("right_"):
        return other.startswith("left_") or (not other.startswith("right_") and "upper_arm" not in one)
    return one.startswith("left_") and "upper_arm" not in one and not other.startswith(("left_", "right_"))


def _capsule(body: Body) -> tuple[Array, float]:
    """Points (7, 3) on the axis of the capsule that stands for a body, in the body's frame, and its radius."""
    size = np.array(body.size_m)
    if body.shape == "sphere":
        direction, length, radius = np.zeros(3), 0.0, float(size[0])
    elif body.shape == "cylinder":
        direction, length, radius = np.array([0.0, 0.0, 1.0]), float(size[1]), float(size[0])
    else:  # around a box's longest side; a flat one is given the width of its second
        direction, radius = np.eye(3)[size.argmax()], 0.5 * float(np.sort(size)[1])
        length = max(float(size.max()) - 2 * radius, 0.0)
    return move_points(body.T_frame_body, (_SAMPLES[:, None] - 0.5) * length * direction), radius
