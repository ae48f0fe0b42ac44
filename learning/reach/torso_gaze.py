"""How the gaze must change to stay on a point while the torso turns: the motor–motor relation of J's outlook.

Torso and head are joints in series, so that what a small turn does to the gaze depends on the gaze and the torso.  It
is learned from turns made while something is fixated; no kinematics of the torso enters.
"""

from dataclasses import dataclass

import numpy as np

from learning.reach.babbling import crossing, gaze_at
from learning.reach.gaussian_process import GaussianProcess
from learning.reach.map import isotropic
from pps_vision.robot.chain import Chain
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.model import Robot
from pps_vision.types import Array

_DEG = np.pi / 180
_EYE_DISTANCES = 4.0  # the unit of the regressor's lengths; most of what a hand gets to is nearer
_AROUND = GazeLimits((-90 * _DEG, 90 * _DEG), (-90 * _DEG, 90 * _DEG), (0.5 * _DEG, 150 * _DEG))


@dataclass(frozen=True)
class TorsoTurns:
    """N points fixated with `gaze_rad` (N, 3) from `torso_rad` (N, 2; yaw, pitch), and the gaze (N, 2, 2, 3) that
    fixates them after yaw (0) or pitch (1) has turned back (0) or on (1) by `turn_rad`."""

    gaze_rad: Array
    torso_rad: Array
    after_rad: Array
    turn_rad: float


def turn_torso(
    robot: Robot,
    n: int,
    rng: np.random.Generator,
    limits: GazeLimits | None = None,
    noise_rad: float = 0.0,
    turn_rad: float = 3 * _DEG,
) -> TorsoTurns:
    """Up to `n` points, in all directions and as many near as far, from torso postures within the robot's limits; the
    gaze by kinematics, each angle read with `noise_rad`.  What no gaze fixates after the turn is left out."""
    low, high = torso_limits(robot)
    torso = rng.uniform(low, high, (n, 2))
    gaze = random_gaze(limits or GazeLimits(), n, rng)
    points = fixation_points(robot, gaze)
    seen = TorsoFrame(robot)
    after = np.empty((n, 2, 2, 3))
    for joint, way in np.ndindex(2, 2):
        turned = torso + (2 * way - 1) * turn_rad * np.eye(2)[joint]
        after[:, joint, way] = gaze_for_points(robot, seen.from_upright(turned, seen.to_root(torso, points)), _AROUND)
    known = np.isfinite(after).all(axis=(1, 2, 3))
    noisy = [angles[known] + noise_rad * rng.standard_normal(angles[known].shape) for angles in (gaze, after)]
    return TorsoTurns(noisy[0], torso[known], noisy[1], turn_rad)


def random_gaze(limits: GazeLimits, n: int, rng: np.random.Generator) -> Array:
    """(n, 3) gaze postures in all directions, their distances spread evenly in the logarithm."""
    at = rng.uniform(isotropic(limits.lower), isotropic(limits.upper), (n, 3))
    at[:, 2] = 2 * np.arctan(np.exp(at[:, 2]))
    return at


def torso_limits(robot: Robot) -> tuple[Array, Array]:
    """Lower and upper (2,) of the torso's yaw and pitch, rad."""
    index = robot.indices(robot.names.torso)
    return robot.lower_rad[index], robot.upper_rad[index]


class TorsoFrame:
    """Points as they lie for head and arms, both of which the torso carries: in the root frame, were it upright."""

    def __init__(self, robot: Robot) -> None:
        self._chain = Chain.of(robot, robot.names.torso, robot.names.left_eye)  # the head at zero goes with the torso
        self._R, self._t = (part[0] for part in self._chain.frames(np.zeros((1, 2))))

    def to_root(self, torso_rad: Array, points: Array) -> Array:
        """(N, 3) root of points (N, 3) that move with the torso, (N, 2) rad."""
        R, t = self._chain.frames(torso_rad)
        moved: Array = np.einsum("nij,nj->ni", R, (points - self._t) @ self._R) + t
        return moved

    def from_upright(self, torso_rad: Array, points_root: Array) -> Array:
        """The inverse of `to_root`."""
        R, t = self._chain.frames(torso_rad)
        points: Array = np.einsum("nji,nj->ni", R, points_root - t) @ self._R.T + self._t
        return points


class TorsoToGaze:
    """The learned relation.  As `ArmToGaze`'s, its regressor speaks of where the lines of sight cross, the angles
    follow: turning moves that point almost linearly."""

    def __init__(self) -> None:
        self.regressor = GaussianProcess()

    def learn(self, turns: TorsoTurns) -> None:
        """From turns made while something was fixated."""
        at = crossing(turns.after_rad.reshape(-1, 3)).reshape(turns.after_rad.shape) / _EYE_DISTANCES
        slopes = (at[:, :, 1] - at[:, :, 0]) / (2 * turns.turn_rad)  # (N, joint, 3)
        self.regressor.update(self._input(turns.gaze_rad, turns.torso_rad), slopes.reshape(-1, 6))

    def __call__(self, gaze_rad: Array, torso_rad: Array, turns_rad: Array) -> Array:
        """The gaze (M, 3) that keeps what a gaze (3,) fixates at torso (2,), after small turns (M, 2)."""
        slopes = self.regressor.predict(self._input(gaze_rad[None], torso_rad[None])).reshape(2, 3)
        return gaze_at(crossing(gaze_rad[None]) + _EYE_DISTANCES * turns_rad @ slopes)

    def _input(self, gaze_rad: Array, torso_rad: Array) -> Array:
        return np.hstack([crossing(gaze_rad) / _EYE_DISTANCES, torso_rad])
