"""Self-collision distance: how far apart the two arms and the trunk are, by coal through Pinocchio."""

from itertools import combinations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pps_vision.robot.model import Robot


class SelfCollision:
    """Measures the distances between the bodies of the left arm, the right arm and the trunk.

    Bodies of one limb are not compared, nor adjacent ones: a body and the next body towards the root (upper arm and
    chest) touch by construction.
    """

    def __init__(self, robot: Robot, ignored: tuple[str, ...] = ()) -> None:
        """Of `robot.bodies` but for those named in `ignored`."""
        self._model, self._data = robot.model, robot.model.createData()
        self._geometry = robot.geometry.copy()
        self._geometry.removeAllCollisionPairs()
        bodies = [(i, body) for i, body in enumerate(robot.geometry.geometryObjects) if body.name not in ignored]
        bodied = {body.parentJoint for _, body in bodies}
        arms = [{i + 1 for i in robot.indices(robot.names.arm(side))} for side in ("left", "right")]

        def limb(joint: int) -> list[bool]:
            return [not arm.isdisjoint(robot.model.supports[joint]) for arm in arms]

        def carrier(joint: int) -> int:
            """The next joint towards the root that has bodies, or the root."""
            return max((j for j in robot.model.supports[joint] if j in bodied and j != joint), default=0)

        for (i, one), (j, other) in combinations(bodies, 2):
            a, b = one.parentJoint, other.parentJoint
            if limb(a) != limb(b) and carrier(max(a, b)) != min(a, b):  # Pinocchio numbers parents before children
                self._geometry.addCollisionPair(pin.CollisionPair(i, j))
        self._distances = pin.GeometryData(self._geometry)

    def distance_m(self, q_rad: ArrayLike) -> float:
        """The smallest distance at a configuration (n_joints,); negative where bodies overlap."""
        pin.computeDistances(self._model, self._data, self._geometry, self._distances, np.asarray(q_rad, dtype=float))
        return float(min(result.min_distance for result in self._distances.distanceResults))
