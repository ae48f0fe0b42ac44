"""The robot's own right index finger as a carrier: the arm follows so that its tip is where it should be."""

from collections.abc import Iterable

from pps_vision.robot.chain import Chain
from pps_vision.robot.inverse_kinematics import IKParams, solve_ik
from pps_vision.robot.model import Robot
from pps_vision.types import Array

_PARAMS = IKParams(tolerance=1e-5)


class RightFinger:
    """Inverse kinematics of the right index fingertip by the arm's seven joints."""

    def __init__(self, robot: Robot) -> None:
        names = robot.names.arm("right")
        self._chain = Chain.of(robot, names, robot.names.index_tips[1])
        self._columns = robot.indices(names)
        self._lower, self._upper = robot.lower_rad[self._columns], robot.upper_rad[self._columns]

    def at(self, q_rad: Array, p_root: Array) -> Array | None:
        """The configuration near `q_rad` whose right fingertip is at `p_root` (3,); None out of reach."""
        start = q_rad[self._columns][None, None]
        found = solve_ik(self._chain.positions, p_root[None], start, self._lower, self._upper, _PARAMS)
        if not found.converged[0]:
            return None
        q = q_rad.copy()
        q[self._columns] = found.q_rad[0]
        return q

    def follow(self, q_rad: Array, path: Iterable[Array]) -> Array | None:
        """The configuration at the start of a path of points, if the finger reaches all of them in turn."""
        first: Array | None = None
        q: Array | None = q_rad
        for p in path:
            q = self.at(q, p) if q is not None else None
            first = q if first is None else first
        return None if q is None else first
