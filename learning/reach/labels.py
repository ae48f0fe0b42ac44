"""Labels of gaze postures by inverse kinematics: can the hand reach their fixation point (J, "Training the maps")?

Where it cannot, the nearest point that it does reach lies on the border of the reachable region.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial import cKDTree

from learning.reach import MeasureName
from learning.reach.babbling import SeenHand
from learning.reach.forward_model import RevoluteModel
from learning.reach.params import MAP, N_NEAR, MapParams
from pps_vision.errors import InputError
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.inverse_kinematics import ForwardModel, IKParams, solve_ik
from pps_vision.robot.model import Robot
from pps_vision.robot.self_motion import (
    DirectionCoverage,
    FarFromLimits,
    Manipulability,
    Measure,
    TwoStage,
    covered_directions,
    two_stage,
)
from pps_vision.robot.skin import EndPoint, Skin
from pps_vision.types import Array, Mask

# m/rad: with a steeper descent left, inverse kinematics is farther than 0.1 mm from the nearest point.  Matters for
# forward models with gaps (tests/stability/test_reachable_space.py).
_SETTLED = 5e-3
_EXACT = IKParams(tolerance=1e-6, max_steps=100, min_step_rad=1e-6)  # the tolerance of labels misjudges 0.05 %
_N_SAMPLED = 20_000  # postures among which the greatest manipulability is looked for
_FAR_M = 0.1  # a point farther than this from the nearest of all babbled hands is out of reach


@dataclass(frozen=True)
class Labels:
    """Answers of inverse kinematics for n gaze postures."""

    gaze_rad: Array  # (n, 3)
    reachable: Mask  # (n,) whether the hand reaches the fixation point
    error_m: Array  # (n,) distance left from hand to fixation point; NaN: not converged, which tells nothing of reach
    optimality: Array  # (n,) of the best posture; NaN where out of reach
    border_rad: Array  # (n, 3) gaze posture of the nearest point that the hand does reach; NaN where there is none

    def __post_init__(self) -> None:
        n = len(self.gaze_rad)
        shapes = {f.name: getattr(self, f.name).shape for f in fields(self)}
        expected = {name: (n, 3) if name.endswith("rad") else (n,) for name in shapes}
        if shapes != expected:
            raise ValueError(f"labels of shapes {shapes}: expected {expected}")

    @property
    def answered(self) -> Mask:
        """Where inverse kinematics found a posture that reaches, or the one that comes nearest."""
        return np.isfinite(self.error_m)

    def only(self, where: Mask) -> "Labels":
        """The labels at `where` (n,)."""
        return Labels(*(getattr(self, f.name)[where] for f in fields(self)))

    def joined(self, more: "Labels") -> "Labels":
        """These labels and `more`, in this order."""
        return Labels(*(np.concatenate([getattr(self, f.name), getattr(more, f.name)]) for f in fields(self)))


@dataclass(frozen=True)
class HandModel:
    """Kinematics that inverse kinematics needs, in any frame common to all fields."""

    forward: ForwardModel  # arm joints (N, k) → positions of the hand (N, 3) and Jacobians (N, 3, k)
    points: Callable[[Array], Array]  # gaze postures (N, 3) → the points (N, 3) that they fixate
    gaze: Callable[[Array, GazeLimits], Array]  # points (N, 3), limits → gaze postures (N, 3), NaN beyond the limits
    tried: Array | None = None  # (n, k) arm postures to start from; None: random ones
    normals: Callable[[Array], Array] | None = None  # arm joints (N, k) → directions (N, 3) that the hand faces

    @classmethod
    def of(cls, robot: Robot, forward: ForwardModel) -> "HandModel":
        """A forward model in the root frame, with the gaze kinematics of the robot's own head."""
        model = GazeModel(robot)
        return cls(forward, model.points, model.gaze)

    @classmethod
    def seen(cls, robot: Robot, side: str, seen: SeenHand) -> "HandModel":
        """The robot's own forward model, corrected by where the eyes saw the hand."""
        own = robot.chain(robot.names.arm(side)[: seen.arm_rad.shape[1]], robot.names.palm(side)).positions
        correction = RevoluteModel.of_offsets(seen.arm_rad, seen.positions - own(seen.arm_rad)[0], seen.covs)

        def forward(arm_rad: Array) -> tuple[Array, Array]:
            hand, J = own(arm_rad)
            offset, J_offset = correction.forward(arm_rad)
            return hand + offset, J + J_offset

        return cls.of(robot, forward)


def hand_and_params(
    robot: Robot, side: str, end_point: str, measure: MeasureName, params: MapParams, skin: Skin | None = None
) -> tuple[HandModel, MapParams]:
    """Arguments of `train_reachable_map` for an end point ("palm", or a taxel such as "left_forearm:27") and a measure;
    ValueError for a point that this arm does not carry."""
    lower, upper = np.array([params.arm_limits.lower_rad, params.arm_limits.upper_rad])
    point = EndPoint.of(robot, side, end_point, len(lower), skin)
    hand = replace(HandModel.of(robot, point.positions), normals=point.normals)
    return hand, replace(params, measure=_measure(measure, point, lower, upper))


def _measure(name: MeasureName, point: EndPoint, lower: Array, upper: Array) -> Measure | DirectionCoverage | None:
    if name == "approach":
        return DirectionCoverage()
    if name == "joint-limits":
        return None
    if name == "isotropy":
        return Manipulability(isotropy=True)
    q = np.random.default_rng(0).uniform(lower, upper, (_N_SAMPLED, len(lower)))
    most = float(Manipulability()(q, point.positions(q)[1]).max())
    return Manipulability(most)


class ReachOracle:
    """Answers by inverse kinematics with the given forward model, by default the robot's own."""

    def __init__(
        self, robot: Robot, side: str, params: MapParams, rng: np.random.Generator, hand: HandModel | None = None
    ) -> None:
        """InputError for a side other than left or right."""
        if side not in ("left", "right"):
            raise InputError(MAP, f"side {side!r}: expected left or right")
        self.robot = robot
        self.params = params
        self.lower, self.upper = np.array([params.arm_limits.lower_rad, params.arm_limits.upper_rad])
        own = robot.chain(robot.names.arm(side)[: len(self.lower)], robot.names.palm(side)).positions
        self.hand = hand or HandModel.of(robot, own)
        self.forward = self.hand.forward
        tried = self.hand.tried
        random = (params.n_babble, len(self.lower))
        self.babbled = rng.uniform(self.lower, self.upper, random) if tried is None else tried
        self._tree = cKDTree(self.forward(self.babbled)[0])

    def solve(self, gaze: Array) -> TwoStage:
        """The best posture of the arm for the fixation point of each gaze posture (n, 3), or the nearest one."""
        points = self.hand.points(gaze)
        measure = self.params.measure
        starts = self.starts(points)
        limits = (self.lower, self.upper)
        optimized = FarFromLimits(*limits) if measure is None or isinstance(measure, DirectionCoverage) else measure
        solution = two_stage(self.forward, points, starts, *limits, optimized, self.params.inverse)
        if isinstance(measure, DirectionCoverage):
            covered = self._covered(points, starts, measure)
            return replace(solution, quality=np.where(solution.reachable, covered, np.nan))
        return solution

    def _covered(self, points: Array, starts: Array, coverage: DirectionCoverage) -> Array:
        """(n,) the share of directions the hand can face at points (n, 3), from all starts together."""
        if self.hand.normals is None:
            raise ValueError(f"{coverage} of a hand without normals; expected its normals")
        covered = np.zeros((len(points), coverage.n), bool)
        limits = (self.lower, self.upper)
        inverse = self.params.inverse
        for start in starts:
            first = solve_ik(self.forward, points, start[None], *limits, inverse.reach)
            k = first.converged
            covered[k] |= covered_directions(
                self.forward, self.hand.normals, points[k], first.q_rad[k], *limits, coverage, inverse.improve
            )
        return np.asarray(covered.mean(axis=1))

    def label(self, gaze: Array) -> Labels:
        """Answers for gaze postures (n, 3); to some there may be none."""
        points = self.hand.points(gaze)
        solution = self.solve(gaze)
        failed = ~solution.reachable
        q = solution.q_rad[failed]
        border = np.full(gaze.shape, np.nan)
        nearest, J = self.forward(q)
        settled = _slope(points[failed] - nearest, J, q, self.lower, self.upper) < _SETTLED
        border[failed] = np.where(settled[:, None], self.hand.gaze(nearest, self.params.gaze_limits), np.nan)
        error = solution.error.copy()
        error[failed] = np.where(settled, error[failed], np.nan)
        return Labels(gaze, solution.reachable, error, solution.quality, border)

    def verdicts(self, gaze: Array) -> Mask:
        """(n,) whether the hand reaches the fixation point of each gaze posture (n, 3): from at least one of the 16
        babbled postures that bring it nearest, however many fail."""
        points = self.hand.points(gaze)
        away_m, near = self._tree.query(points, k=N_NEAR)
        close = away_m[:, 0] < _FAR_M
        starts = self.babbled[near[close]].swapaxes(0, 1)
        verdict = np.zeros(len(gaze), bool)
        verdict[close] = solve_ik(self.forward, points[close], starts, self.lower, self.upper, _EXACT).converged
        return verdict

    def starts(self, points: Array) -> Array:
        """(2, n, k) for each point (n, 3), of the postures whose hand was nearest to it, the nearest and the one most
        unlike that: the other way to hold an arm there."""
        near = self.babbled[self._tree.query(points, k=N_NEAR)[1]]
        unlike = np.linalg.norm(near - near[:, :1], axis=2).argmax(axis=1)
        return np.stack([near[:, 0], near[np.arange(len(near)), unlike]])


def _slope(residual: Array, J: Array, q: Array, lower: Array, upper: Array) -> Array:
    """(N,) how fast, at most, a joint that is free to move would bring the hand nearer, m/rad: 0 at a posture that
    comes nearest.  `residual` (N, 3) from hand to target, none of them 0, J (N, 3, k) at q (N, k)."""
    distance = np.linalg.norm(residual, axis=1)
    nearer: Array = (J * residual[:, :, None]).sum(axis=1) / distance[:, None]
    stuck = ((q <= lower) & (nearer < 0)) | ((q >= upper) & (nearer > 0))
    return np.where(np.isfinite(distance), np.abs(np.where(stuck, 0, nearer)).max(axis=1), np.inf)
