"""Training of the reachable-space map (J, "Training the maps") by active learning.

After a first round over all gaze postures, labels are asked for near the border, and some inside for the degree of
reachability, far from earlier ones.  If they suggest that the map is good enough, a test on new ones bounds its error.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree
from scipy.special import betaincinv

from learning.reach.labels import HandModel, Labels, ReachOracle
from learning.reach.lattice import GazeSpline, Lattice, isotropic
from learning.reach.map import ReachableMap
from learning.reach.params import MAP, MapParams
from pps_vision.errors import InputError
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

_COARSER = 4  # steps of the lattice on which splines are evaluated far from the border; 1 takes four times as long
_VOTERS = 8  # neighbours that judge a label; matters only for wrong labels (bench severity)
_ROUNDS = 16  # a round is at least 1/16 of all labels, which it revisits, so that the cost stays linear
_CURVATURE = 0.5  # times step²: error between lattice points of a border with a radius of curvature of 0.25


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
    oracle = ReachOracle(robot, side, params, rng, hand)
    return learned_from(oracle.label, side, rng, params, into, oracle.verdicts)


def learned_from(
    label: Callable[[Array], Labels],
    side: str,
    rng: np.random.Generator,
    params: MapParams,
    into: ReachableMap | None = None,
    verdicts: Callable[[Array], Mask] | None = None,
) -> ReachableMap:
    """As `train_reachable_map`, with any function that labels gaze postures (n, 3), and one that says which are
    reachable, to test the map by (default: as labelled)."""
    verdicts = verdicts or (lambda gaze: label(gaze).reachable)
    limits = params.gaze_limits
    spent = 0
    if into is None:
        spent = params.round_labels
        labels = label(rng.uniform(limits.lower, limits.upper, (spent, 3)))
        unanswered = spent - int(labels.answered.sum())
        labels = labels.only(labels.answered)
    elif into.side == side and into.limits == limits:
        labels = into.labels
        unanswered = into.unanswered
    else:
        raise InputError(MAP, f"{into.side}, {into.limits}; expected one of {side}, {limits}, to continue from")
    good_enough = 0.5 * params.max_error
    risk = 1 - params.confidence
    while (unspent := params.n_labels - spent) >= params.round_labels:
        n = max(params.round_labels, len(labels.gaze_rad) // _ROUNDS)
        n = n if unspent >= n + params.round_labels else unspent
        border = GazeSpline(*_nodes(_consistent(labels), params))
        gaze, share = _near_border(border, labels, n, params, rng)
        more = label(gaze)
        spent += n
        unanswered += n - int(more.answered.sum())
        more = more.only(more.answered)
        predicted = border(more.gaze_rad)
        softness = _softness(predicted, more.reachable, _CURVATURE * params.lattice**2)
        near = predicted <= params.border_band[1]
        wrong = near & ((predicted > 0) != more.reachable)
        expected = share * float(wrong.sum() / max(near.sum(), 1))
        labels = labels.joined(more)
        worth_testing = params.max_error > 0 and expected <= good_enough
        if worth_testing and params.n_labels - spent >= params.round_labels:
            risk /= 2  # risk of this test, the other half for later tests
            learned = _on_lattice(side, labels, softness, expected, unanswered, params)
            learned = _tested(learned, verdicts, risk, params, rng)
            if learned.error_bound <= params.max_error:
                return learned
            good_enough /= 2
    learned = _on_lattice(side, labels, softness, expected, unanswered, params)
    return _tested(learned, verdicts, risk, params, rng) if params.test_postures else learned


def _tested(
    learned: ReachableMap, verdicts: Callable[[Array], Mask], risk: float, params: MapParams, rng: np.random.Generator
) -> ReachableMap:
    """The map with the upper bound of its error that is too low with a probability of at most `risk` (Clopper–Pearson),
    from uniform gaze postures."""
    n = params.test_postures
    gaze = rng.uniform(params.gaze_limits.lower, params.gaze_limits.upper, (n, 3))
    wrong = int(np.sum(learned.query(gaze).reachable != verdicts(gaze)))
    return replace(learned, error_bound=float(betaincinv(wrong + 1, n - wrong, 1 - risk)) if wrong < n else 1.0)


def _on_lattice(
    side: str, labels: Labels, softness: float, expected: float, unanswered: int, params: MapParams
) -> ReachableMap:
    """The map of these labels: values of the splines on the lattice."""
    lattice = Lattice.of_spacing(params.gaze_limits, params.lattice)
    coarse = Lattice.of_spacing(params.gaze_limits, _COARSER * params.lattice)
    consistent = _consistent(labels)
    inside = consistent.only(consistent.reachable)
    outside = consistent.only(~consistent.reachable)
    gaze = lattice.gaze_rad

    def evaluate(at: Array, values: Array, where: Callable[[Array], Mask] | None) -> Array:
        """Values of a spline on the lattice: interpolated from the coarse one, exact `where` that matters."""
        spline = GazeSpline(at, values)
        rough = coarse.interpolate(spline(coarse.gaze_rad).reshape(1, *coarse.shape), gaze)[0]
        if where is not None:
            near = where(rough)
            rough[near] = spline(gaze[near])
        return rough

    near_m = params.lattice * 3 + 0.06
    signed = evaluate(*_nodes(consistent, params), lambda s: np.abs(s) < near_m)
    good: Array = np.zeros(len(gaze))
    if len(inside.gaze_rad):
        good = evaluate(inside.gaze_rad, inside.optimality, lambda _: signed > -2 * params.lattice)
    error = evaluate(outside.gaze_rad, outside.error_m, lambda e: (signed < 2 * params.lattice) & (e < params.exact_m))
    signed, good, error = (v.reshape(lattice.shape) for v in (signed, good, error))
    most_m = float(labels.error_m.max())
    return ReachableMap(side, params.gaze_limits, signed, good, error, most_m, softness, expected, labels, unanswered)


def _consistent(labels: Labels) -> Labels:
    """The labels without contradictions of their neighbours: among the nearest labels, if nearer than any border point,
    at least two and more than half have the other answer."""
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
    """Gaze postures and their signed distance to the border: 0 at border points, else the distance to the nearest."""
    border = labels.border_rad[np.isfinite(labels.border_rad[:, 0])]
    if len(labels.gaze_rad) == 0:
        raise InputError(MAP, "inverse kinematics never converged; expected a forward model that it can invert")
    if len(border) == 0:
        n = len(labels.gaze_rad)
        raise InputError(MAP, f"all {n} labels are within reach: expected some beyond the border to learn")
    distance, _ = cKDTree(isotropic(border)).query(isotropic(labels.gaze_rad))
    clear = distance > params.border_clearance
    signed = np.where(labels.reachable, distance, -distance)[clear]
    return np.concatenate([border, labels.gaze_rad[clear]]), np.concatenate([np.zeros(len(border)), signed])


def _near_border(
    border: Callable[[Array], Array], labels: Labels, n: int, params: MapParams, rng: np.random.Generator
) -> tuple[Array, float]:
    """(n, 3) gaze postures in the band about the border (or nearest to it where the band is small) and inside, the
    farthest from the labels; and the share of all gaze postures that lies in the band."""
    limits = params.gaze_limits
    candidates = rng.uniform(limits.lower, limits.upper, (8 * n, 3))
    signed = border(candidates)
    alone, _ = cKDTree(isotropic(labels.gaze_rad)).query(isotropic(candidates))
    low, high = params.border_band
    beyond = np.maximum(np.maximum(low - signed, signed - high), 0)
    share = float(np.mean(beyond == 0))
    inside = np.flatnonzero(signed > high)
    inside = inside[np.argsort(-alone[inside])[: round(params.inside_share * n)]]
    beyond[inside] = np.inf  # asked already
    n -= len(inside)
    near = np.argsort(beyond, kind="stable")[: max(n, min(round(share * len(candidates)), 2 * n))]
    near = near[np.argsort(-alone[near])[:n]]
    return candidates[np.concatenate([near, inside])], share


def _softness(predicted: Array, reachable: Mask, least: float) -> float:
    """Maximum-likelihood scale τ of P = 1/(1 + e^(−s/τ)) for answers with predicted signed distance s, at least
    `least`, as few answers may all be right by chance."""
    sign = np.where(reachable, -1.0, 1.0)

    def negative_log_likelihood(log_tau: float) -> float:
        return float(np.logaddexp(0, sign * predicted / np.exp(log_tau)).sum())

    bounds = (np.log(least), np.log(0.5))
    return float(np.exp(minimize_scalar(negative_log_likelihood, bounds=bounds, method="bounded").x))
