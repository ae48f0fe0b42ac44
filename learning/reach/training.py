"""Training of the reachable-space map with inverse kinematics (J, "Training the maps").

Each label is one inverse-kinematics problem: can the hand reach this fixation point?  Where it cannot, the nearest
point that it does reach lies on the border of the reachable region.  After a first round over all gaze postures,
labels are drawn near the border, far from earlier ones (active learning).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree

from learning.reach.gaze_spline import GazeSpline, first_of_close
from learning.reach.map import Labels, Lattice, ReachableMap, isotropic
from pps_vision.errors import InputError
from pps_vision.robot.chain import Chain
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.inverse_kinematics import ForwardModel, solve_ik
from pps_vision.robot.model import Robot
from pps_vision.robot.self_motion import DirectionCoverage, FarFromLimits, Measure, covered_directions
from pps_vision.robot.two_stage import TwoStage, TwoStageParams, two_stage
from pps_vision.types import Array, Mask

_DEG = np.pi / 180
_FAR_VERGENCE_RAD = 1 * _DEG  # border points may lie beyond the gaze limits, but must be finite
_MARGIN_RAD = 0.5
_NEAR = 16
_COARSER = 4
_VOTERS = 8
_CURVATURE = 0.5  # times step²: error between lattice points of a border with a radius of curvature of 0.25
_SETTLED = 5e-3  # m/rad: with a steeper descent left, inverse kinematics is farther than 0.1 mm from the nearest point


@dataclass(frozen=True)
class ArmLimits:
    """J's limits of the first four arm joints in the order of the chain (shoulder rows 3–5, elbow)."""

    lower_rad: tuple[float, ...] = (-95 * _DEG, 0.0, -20 * _DEG, 15 * _DEG)
    upper_rad: tuple[float, ...] = (10 * _DEG, 160 * _DEG, 80 * _DEG, 105 * _DEG)


@dataclass(frozen=True)
class HandModel:
    """Kinematics that inverse kinematics needs, in any frame common to all fields."""

    forward: ForwardModel
    """Arm joints (N, k) → positions of the hand (N, 3) and Jacobians (N, 3, k)."""
    points: Callable[[Array], Array]
    """Gaze postures (N, 3) → the points (N, 3) that they fixate."""
    gaze: Callable[[Array, GazeLimits], Array]
    """Points (N, 3), limits → the gaze postures (N, 3) that fixate them; NaN where the limits forbid it."""
    tried: Array | None = None
    """(n, k) arm postures to start from; None: random ones."""
    normals: Callable[[Array], Array] | None = None
    """Arm joints (N, k) → directions (N, 3) that the hand faces, for `DirectionCoverage`."""

    @classmethod
    def of(cls, robot: Robot, forward: ForwardModel) -> "HandModel":
        """Of joints → root frame, with the robot's own head."""
        return cls(forward, partial(fixation_points, robot), partial(gaze_for_points, robot))


@dataclass(frozen=True)
class MapParams:
    """Extent and cost of the training."""

    gaze_limits: GazeLimits = field(default_factory=GazeLimits)
    """Gaze postures that the map covers."""
    arm_limits: ArmLimits = field(default_factory=ArmLimits)
    """Limits of the arm's joints."""
    n_labels: int = 6000
    """Largest number of labels."""
    round_labels: int = 1500
    """Labels per round; the first round is uniform over all gaze postures."""
    max_error: float = 0.0
    """Training ends when no larger share of gaze postures is expected to be misjudged."""
    n_babble: int = 100_000
    """Random arm postures among which inverse kinematics finds its starts."""
    inverse: TwoStageParams = field(default_factory=TwoStageParams)
    """Of inverse kinematics."""
    measure: Callable[[Array, Array], Measure] | DirectionCoverage = FarFromLimits
    """What the second stage optimises, made from the joints' lower and upper limits."""
    border_band: tuple[float, float] = (-0.14, 0.05)
    """Signed distances, in isotropic coordinates, between which later labels are drawn."""
    node_spacing: float = 0.0026
    """Border points closer together than this, in isotropic coordinates, count once."""
    border_clearance: float = 0.017
    """Labels closer to the border than this, in isotropic coordinates, are no nodes of the spline."""
    lattice: float = 0.04
    """Step of the map's lattice in isotropic coordinates."""

    def __post_init__(self) -> None:
        if not 2 <= 2 * self.round_labels <= self.n_labels:
            raise InputError(
                "reachable-space map",
                f"{self.n_labels} labels in rounds of {self.round_labels}: expected at least two rounds, "
                "of which the later ones test what the earlier ones learned",
            )
        if self.n_babble < _NEAR:
            raise InputError("reachable-space map", f"{self.n_babble} random arm postures: expected at least {_NEAR}")
        if not 0 <= self.max_error < 1:
            raise InputError(
                "reachable-space map", f"a share of {self.max_error} misjudged: expected at least 0 and below 1"
            )


class ReachOracle:
    """Answers by inverse kinematics with the given forward model, by default the robot's own."""

    def __init__(
        self, robot: Robot, side: str, params: MapParams, rng: np.random.Generator, hand: HandModel | None = None
    ) -> None:
        """InputError for a side other than left or right."""
        if side not in ("left", "right"):
            raise InputError("reachable-space map", f"side {side!r}: expected left or right")
        self.robot, self.params = robot, params
        palm = robot.names.palms[("left", "right").index(side)]
        self.lower, self.upper = np.array(params.arm_limits.lower_rad), np.array(params.arm_limits.upper_rad)
        own = Chain.of(robot, robot.names.arm(side)[: len(self.lower)], palm).positions
        self.hand = hand or HandModel.of(robot, own)
        self.forward, tried = self.hand.forward, self.hand.tried
        if tried is None:
            tried = rng.uniform(self.lower, self.upper, (params.n_babble, len(self.lower)))
        self.babbled = tried
        self._tree = cKDTree(self.forward(self.babbled)[0])

    def solve(self, gaze: Array) -> TwoStage:
        """The best posture of the arm for what each gaze posture (n, 3) fixates, or the one that comes nearest."""
        points, measure = self.hand.points(gaze), self.params.measure
        starts = self.starts(points)
        ends, inverse = (self.lower, self.upper), self.params.inverse
        if isinstance(measure, DirectionCoverage):
            found = two_stage(self.forward, points, starts, *ends, FarFromLimits(*ends), inverse)
            good = np.where(found.reachable, self._covered(points, starts, measure), np.nan)
            return TwoStage(found.q_rad, found.error, found.reachable, good)
        return two_stage(self.forward, points, starts, *ends, measure(*ends), inverse)

    def _covered(self, points: Array, starts: Array, coverage: DirectionCoverage) -> Array:
        """(n,) the share of directions the hand can face at points (n, 3), from all starts together."""
        if self.hand.normals is None:
            raise ValueError(f"{coverage} of a hand without normals; expected its normals")
        met = np.zeros((len(points), coverage.n), bool)
        ends, inverse = (self.lower, self.upper), self.params.inverse
        for start in starts:
            first = solve_ik(self.forward, points, start[None], *ends, inverse.reach)
            there = first.converged
            met[there] |= covered_directions(
                self.forward, self.hand.normals, points[there], first.q_rad[there], *ends, coverage, inverse.improve
            )
        share: Array = met.mean(axis=1)
        return share

    def label(self, gaze: Array) -> Labels:
        """Answers for gaze postures (n, 3); to some there may be none."""
        points, found = self.hand.points(gaze), self.solve(gaze)
        failed = ~found.reachable
        border = np.full(gaze.shape, np.nan)
        nearest, J = self.forward(found.q_rad[failed])
        settled = _slope(points[failed] - nearest, J, found.q_rad[failed], self.lower, self.upper) < _SETTLED
        border[failed] = np.where(settled[:, None], self.hand.gaze(nearest, self._beyond()), np.nan)
        error = found.error.copy()
        error[failed] = np.where(settled, error[failed], np.nan)
        return Labels(gaze, found.reachable, error, found.quality, border)

    def starts(self, points: Array) -> Array:
        """(2, n, k) for each point (n, 3), of the postures whose hand was nearest to it, the nearest and the one most
        unlike that: the other way to hold an arm there."""
        near = self.babbled[self._tree.query(points, k=_NEAR)[1]]
        unlike = np.linalg.norm(near - near[:, :1], axis=2).argmax(axis=1)
        return np.stack([near[:, 0], near[np.arange(len(near)), unlike]])

    def _beyond(self) -> GazeLimits:
        low, high = self.params.gaze_limits.lower - _MARGIN_RAD, self.params.gaze_limits.upper + _MARGIN_RAD
        return GazeLimits((low[0], high[0]), (low[1], high[1]), (_FAR_VERGENCE_RAD, high[2]))


def train_reachable_map(
    robot: Robot,
    side: str,
    rng: np.random.Generator,
    params: MapParams | None = None,
    hand: HandModel | None = None,
    into: ReachableMap | None = None,
) -> ReachableMap:
    """Learn the map of one arm ("left" or "right"), or go on from a map learned before, whose labels are kept and not
    counted; `hand` says where it is, by default as the robot's own model has it.  ValueError for a map of another arm
    or other limits, and where inverse kinematics came to no answer at all."""
    params = params or MapParams()
    return learned_from(ReachOracle(robot, side, params, rng, hand).label, side, rng, params, into)


def learned_from(
    label: Callable[[Array], Labels],
    side: str,
    rng: np.random.Generator,
    params: MapParams,
    into: ReachableMap | None = None,
) -> ReachableMap:
    """As `train_reachable_map`, with any function that labels gaze postures (n, 3)."""
    limits, n = params.gaze_limits, params.round_labels
    if into is None:
        labels = label(rng.uniform(limits.lower, limits.upper, (n, 3)))
        spent, unanswered = n, n - int(labels.answered.sum())
        labels = labels.only(labels.answered)
    elif into.side == side and into.limits == limits:
        labels, spent, unanswered = into.labels, 0, into.unanswered
    else:
        raise InputError(
            "reachable-space map", f"{into.side}, {into.limits}; expected one of {side}, {limits}, to continue from"
        )
    softness, expected = np.nan, 1.0
    while spent + n <= params.n_labels and expected > params.max_error:
        border = GazeSpline(*_nodes(_consistent(labels), params))
        asked, share = _near_border(border, labels, n, params, rng)
        more = label(asked)
        spent, unanswered = spent + n, unanswered + n - int(more.answered.sum())
        more = more.only(more.answered)
        predicted = border(more.gaze_rad)
        softness = _softness(predicted, more.reachable, _CURVATURE * params.lattice**2)
        expected = share * float(np.mean((predicted > 0) != more.reachable))
        labels = labels.joined(more)
    return replace(_on_lattice(side, labels, softness, expected, params), unanswered=unanswered)


def _slope(residual: Array, J: Array, q: Array, lower: Array, upper: Array) -> Array:
    """(N,) how fast, at most, a joint that is free to move would bring the hand nearer, m/rad: 0 at a posture that
    comes nearest.  `residual` (N, 3) from hand to target, J (N, 3, k) at q (N, k)."""
    distance = np.maximum(np.linalg.norm(residual, axis=1), 1e-12)
    nearer: Array = (J * residual[:, :, None]).sum(axis=1) / distance[:, None]
    stuck = ((q <= lower) & (nearer < 0)) | ((q >= upper) & (nearer > 0))
    return np.where(np.isfinite(distance), np.abs(np.where(stuck, 0, nearer)).max(axis=1), np.inf)


def _on_lattice(side: str, labels: Labels, softness: float, expected: float, params: MapParams) -> ReachableMap:
    """The map of these labels: values of the splines on the lattice."""
    lattice = Lattice.of_spacing(params.gaze_limits, params.lattice)
    coarse = Lattice.of_spacing(params.gaze_limits, _COARSER * params.lattice)
    consistent = _consistent(labels)
    inside, outside = consistent.reachable, ~consistent.reachable
    gaze = lattice.gaze_rad

    def evaluate(at: Array, values: Array, where: Callable[[Array], Mask] | None) -> Array:
        """Values of a spline on the lattice: interpolated from the coarse one, exact `where` that matters."""
        spline = GazeSpline(at, values)
        rough = coarse.interpolate(spline(coarse.gaze_rad)[:, None], gaze)[:, 0]
        if where is not None:
            near = where(rough)
            rough[near] = spline(gaze[near])
        return rough

    near_m = params.lattice * 3 + 0.06
    signed = evaluate(*_nodes(consistent, params), lambda s: np.abs(s) < near_m)
    good: Array = np.zeros(len(gaze))
    if inside.any():
        good = evaluate(
            consistent.gaze_rad[inside], consistent.optimality[inside], lambda _: signed > -2 * params.lattice
        )
    error = evaluate(consistent.gaze_rad[outside], consistent.error_m[outside], None)
    signed, good, error = (v.reshape(lattice.shape) for v in (signed, good, error))
    return ReachableMap(
        side, params.gaze_limits, signed, good, error, float(labels.error_m.max()), softness, expected, labels
    )


def _consistent(labels: Labels) -> Labels:
    """All labels but those that contradict their neighbours: of the nearest labels, counting only those nearer than any
    border point, at least two and more than half have the other answer."""
    border = labels.border_rad[np.isfinite(labels.border_rad[:, 0])]
    if len(border) == 0 or len(labels.gaze_rad) <= _VOTERS:
        return labels
    at = isotropic(labels.gaze_rad)
    room, _ = cKDTree(isotropic(border)).query(at)
    distance, index = cKDTree(at).query(at, k=_VOTERS + 1)
    votes = distance[:, 1:] < room[:, None]
    against = votes & (labels.reachable[index[:, 1:]] != labels.reachable[:, None])
    return labels.only(against.sum(axis=1) <= np.maximum(votes.sum(axis=1) / 2, 1))


def _nodes(labels: Labels, params: MapParams) -> tuple[Array, Array]:
    """Gaze postures and their signed distance to the border: 0 at border points, elsewhere the
    distance to the nearest of them."""
    border = labels.border_rad[np.isfinite(labels.border_rad[:, 0])]
    if len(labels.gaze_rad) == 0:
        raise InputError(
            "reachable-space map", "inverse kinematics never converged; expected a forward model that it can invert"
        )
    if len(border) == 0:
        raise InputError(
            "reachable-space map",
            f"all {len(labels.gaze_rad)} labels are within reach: expected some beyond the border to learn",
        )
    border = border[first_of_close(isotropic(border), params.node_spacing)]
    distance, _ = cKDTree(isotropic(border)).query(isotropic(labels.gaze_rad))
    clear = distance > params.border_clearance
    signed = np.where(labels.reachable, distance, -distance)[clear]
    return np.concatenate([border, labels.gaze_rad[clear]]), np.concatenate([np.zeros(len(border)), signed])


def _near_border(
    border: Callable[[Array], Array], labels: Labels, n: int, params: MapParams, rng: np.random.Generator
) -> tuple[Array, float]:
    """(n, 3) gaze postures in the band about the border (or nearest to it where the band is small), those farthest from
    the labels so far; and the share of all gaze postures that lies in the band."""
    limits = params.gaze_limits
    candidates = rng.uniform(limits.lower, limits.upper, (8 * n, 3))
    signed = border(candidates)
    low, high = params.border_band
    beyond = np.maximum(np.maximum(low - signed, signed - high), 0)
    inside = beyond == 0
    enough = max(n, min(int(inside.sum()), 2 * n))
    near = candidates[np.argsort(beyond, kind="stable")[:enough]]
    alone, _ = cKDTree(isotropic(labels.gaze_rad)).query(isotropic(near))
    return near[np.argsort(-alone)[:n]], float(inside.mean())


def _softness(predicted: Array, reachable: Mask, least: float) -> float:
    """Maximum-likelihood scale τ of P = 1/(1 + e^(−s/τ)) for answers with predicted signed distance s, at least
    `least`, as few answers may all be right by chance."""
    sign = np.where(reachable, -1.0, 1.0)

    def negative_log_likelihood(log_tau: float) -> float:
        return float(np.logaddexp(0, sign * predicted / np.exp(log_tau)).sum())

    return float(
        np.exp(minimize_scalar(negative_log_likelihood, bounds=(np.log(least), np.log(0.5)), method="bounded").x)
    )
