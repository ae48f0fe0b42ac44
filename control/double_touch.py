"""Double touch: the right index fingertip on a taxel of the left forearm (R, "Double-touch using inverse kinematics").

Both arms move.  The finger opposes the taxel's normal and arrives along it, at the speed of a minimum-jerk movement
that is planned to end under the skin and stops where it touches.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from pps_vision.geometry.se3 import move_points
from pps_vision.robot.chain import Chain
from pps_vision.robot.icub import HOME_ARM_RAD, home
from pps_vision.robot.inverse_kinematics import IKParams, IKSolution, solve_ik
from pps_vision.robot.model import Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import SkinPart, taxel_frame
from pps_vision.types import Array

FINGERTIP_RADIUS_M = 0.010
INDEX_FINGER = np.array([0.8993, -0.4373, 0.0])  # where the right index points, in the frame of its tip
_FINGER_BODY = "right_palm_4"  # the right index finger among the robot's bodies: it is what touches
_LEVER_M = 0.1  # distance of two points of the finger that must lie on the normal: a tilt of 0.1 rad counts as 1 cm
_MOVED_M = 0.001  # distance from the start at which a movement begins
_CHECK_EVERY = 5  # steps: a tip moves 4 cm meanwhile
_IK = IKParams(tolerance=1e-5, max_steps=40)


@dataclass(frozen=True)
class DoubleTouchParams:
    """How the fingertip and the arms move."""

    start_m: float = 0.22  # distance of the fingertip from the taxel at the start
    start_aside_m: float = 0.06  # largest distance from the taxel's normal at the start
    peak_m_s: tuple[float, float] = (0.10, 0.16)  # range of the peak speed
    press_m: float = 0.03  # depth under the skin at which the movement is planned to end
    step_s: float = 0.05  # sampling period
    spread_rad: float = np.deg2rad(25.0)  # standard deviation about home of the postures that the search starts from
    max_rate_rad_s: float = np.deg2rad(60.0)  # rate limit of the joints
    clearance_m: float = 0.005  # smallest self-collision distance


@dataclass(frozen=True, slots=True)
class DoubleTouch:
    """A movement that ends with the touch."""

    stamps_s: Array  # (T,), the last is the touch's
    joints_rad: Array  # (T, n_joints)


Infeasible = Literal["out of reach", "limits on the way", "too fast", "self-collision"]


class DoubleTouching:
    """Plans double touches of one part of the left arm's skin with the right index finger."""

    def __init__(self, robot: Robot, part: SkinPart, params: DoubleTouchParams | None = None) -> None:
        self.robot = robot
        self.part = part
        self.params = params or DoubleTouchParams()
        left = robot.names.arm("left")[:5]  # the left wrist moves no forearm
        right = robot.names.arm("right")
        arms = robot.chain(left, part.frame), robot.chain(right, robot.names.index_tips[1])
        self._T_root_skin, self._chain = _from_skin_to_finger(*arms)
        self._columns = robot.indices(left + right)
        self._limits = robot.lower_rad[self._columns], robot.upper_rad[self._columns]
        self._self_collision = SelfCollision(robot, (_FINGER_BODY,))

    def plan(self, taxel: int, n: int, rng: np.random.Generator) -> tuple[DoubleTouch | Infeasible, ...]:
        """Movements to the part's `taxel` (its index) from `n` random starts, or the reason why there is none."""
        p = self.params
        at_home = np.array([*HOME_ARM_RAD[:5], *HOME_ARM_RAD])
        starts = at_home + p.spread_rad * rng.standard_normal((n, len(at_home)))
        azimuth = rng.uniform(0, 2 * np.pi, n)
        aside = p.start_aside_m * np.sqrt(rng.uniform(size=n))
        asides = aside[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
        heights, before_s = self._heights(rng.uniform(*p.peak_m_s, n))
        contact = self._reach(self._line(taxel, heights[:, 0], asides), starts)
        path = [contact.q_rad]
        alive = np.flatnonzero(contact.converged)
        for height in heights.T[1:]:  # solved backwards, from the touch to the start
            tip = self._line(taxel, height, asides)[alive, :3]  # off the skin the finger may turn as it likes
            step = self._reach(tip, path[-1][alive])
            path.append(path[-1].copy())
            path[-1][alive] = step.q_rad
            alive = alive[step.converged]
        outcomes: list[DoubleTouch | Infeasible] = [
            "limits on the way" if reached else "out of reach" for reached in contact.converged
        ]
        for k in alive:
            moves = heights[k, ::-1] < p.start_m - _MOVED_M
            outcomes[k] = self._checked(before_s[::-1][moves], np.array(path)[::-1][moves, k])
        return tuple(outcomes)

    def _checked(self, before_s: Array, arms: Array) -> DoubleTouch | Infeasible:
        """A movement of the arms (T, 12), unless a joint moves too fast or the self-collision distance is too small."""
        joints = np.tile(home(self.robot), (len(arms), 1))
        joints[:, self._columns] = arms
        if np.abs(np.diff(arms, axis=0)).max() > self.params.max_rate_rad_s * self.params.step_s:
            return "too fast"
        if any(self._self_collision.distance_m(q) < self.params.clearance_m for q in joints[::-_CHECK_EVERY]):
            return "self-collision"
        return DoubleTouch(before_s[0] - before_s, joints)

    def _heights(self, peak: Array) -> tuple[Array, Array]:
        """Heights (N, T) of the fingertip's centre above the skin 0, 1, … steps before the touch, and these times."""
        p = self.params
        whole = p.start_m + p.press_m - FINGERTIP_RADIUS_M
        lasts = 1.875 * whole / peak
        touches_at = brentq(lambda tau: minimum_jerk(tau) - (p.start_m - FINGERTIP_RADIUS_M) / whole, 0, 1)
        before_s = p.step_s * np.arange(int(lasts.max() * touches_at / p.step_s) + 1)
        tau = np.maximum(touches_at - before_s / lasts[:, None], 0)
        return p.start_m - whole * minimum_jerk(tau), before_s

    def _line(self, taxel: int, height: Array, asides: Array) -> Array:
        """(N, 6) where the fingertip's centre and a point of the finger behind it are to be, the left arm at zero, for
        the tip to be at `height` (N,) over the taxel; the higher, the nearer to `asides` (N, 2) beside the normal."""
        T = self._T_root_skin @ taxel_frame(self.part.positions_m[taxel], self.part.normals[taxel])
        share = ((height - FINGERTIP_RADIUS_M) / (self.params.start_m - FINGERTIP_RADIUS_M)) ** 2
        tip = move_points(T, np.column_stack([share[:, None] * asides, height]))
        return np.hstack([tip, tip + _LEVER_M * T[:3, 2]])

    def _reach(self, targets: Array, starts: Array) -> IKSolution:
        """Postures (N, 12) near `starts` (N, 12) with the fingertip, and the point behind it if asked, there."""
        points = (np.zeros(3), -_LEVER_M * INDEX_FINGER)[: targets.shape[1] // 3]

        def forward(q: Array) -> tuple[Array, Array]:
            x, J = zip(*(self._chain.positions(q, point) for point in points), strict=True)
            return np.concatenate(x, axis=1), np.concatenate(J, axis=1)

        return solve_ik(forward, targets, starts[None], *self._limits, _IK)


def _from_skin_to_finger(left: Chain, right: Chain) -> tuple[Array, Chain]:
    """Both arms as one chain: where the finger would be if the left arm were at zero and the rest of the robot moved
    instead; and the frame of the skin then.  Going out of the left arm, its joints come last first and turn back."""
    n = len(left.joints)
    order = left.order[::-1] + tuple(n + i for i in right.order)
    screws = np.vstack([-left.screws, right.screws])
    return left.T_root_frame, Chain(left.joints + right.joints, order, screws, right.T_root_frame)


def minimum_jerk(tau: ArrayLike) -> Array:
    """Share of a movement's length at the share `tau` of its duration."""
    t = np.asarray(tau, dtype=float)
    return np.asarray(t**3 * (10 - 15 * t + 6 * t**2))
