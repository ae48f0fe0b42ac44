"""Move away from what the skin predicts to touch it, or reach for it (R eq. 6), and return home.

Beyond R: an arm at rest does not respond to what will pass or has not come nearer, taxels leave the path of an object
that withdrawal along their normals is not predicted to escape, and reaching aims at the object, with the taxel that
touches it first at the speeds that the constraints allow.
"""

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from control import reaching
from control.arm import MovingPoint
from control.avoidance_params import AvoidanceParams, AvoidanceState, Response
from control.avoidance_response import (
    LINK_CLEARANCE_M,
    RespondingArm,
    angles_from_home,
    at_home,
    kept_clear,
    respond,
    return_home,
)
from control.limits import MAX_HOLD_S, check_times
from control.reaching import HORIZON_S, distances_ahead, radius_m
from pps_vision.errors import InputError
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.bare_links import BareLinks, Near
from pps_vision.robot.model import Posture
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, JointVelocity, Track3D

__all__ = ["AvoidanceParams", "AvoidanceState", "ControlPoint", "Response", "control_points", "step"]

_REACH_FOR_S = 3.0  # for which reaching outlasts the activation: an object that waits to be touched has no TTC
# Positions of the object are compared over this time.
_COME_WITHIN_S = 0.5
_WAIT_S = 1.0  # for which the arm stays where it is when the object is lost, before it goes home
# An object that interrupted the return must move by so much before the arm returns again: it does not swing before an
# object at rest.
_GONE_M = 0.05
_LINK_LEAD_S = 0.5  # links without taxels respond if the object is to come nearer within it and no taxel is active
_AT_HOME_RAD = np.deg2rad(0.2)  # largest angle from home that counts as being there
_GIVE_UP_S = 6.0  # longest return: a joint that is stuck never gets home
_FULL_SPEED_NORMAL = 0.5  # a mean normal that is shorter (60° from all normals to it, or more) slows the response


def step(
    params: AvoidanceParams,
    state: AvoidanceState,
    posture: Posture,
    skin: Skin,
    activations: ArrayLike,
    stamp_s: float,
    may_reach: bool = False,
    hold_s: float = MAX_HOLD_S,
    self_collision: SelfCollision | None = None,
    track: Track3D | None = None,
    bare_links: BareLinks | None = None,
) -> tuple[AvoidanceState, JointVelocity, Response]:
    """One control step from the activations (n,) of `skin`, the taxels this arm carries.

    The arm reaches only while `may_reach`: while the reachable-space map calls the object reachable; it avoids in any
    case.  It reaches with the body part that is most likely to be touched, also after the object has stopped, and
    withdraws all parts at once.  The command may be held for `hold_s`; the response keeps clear of the bodies of
    `self_collision`.  Of a `track` (None: unknown) an arm that avoids keeps the `bare_links`, which have no taxels,
    clear too, and when it is lost the arm holds still, then goes home.  InputError if an activation is not in [0, 1],
    if there is not one per taxel, or if the stamp is not finite or before the last one.
    """
    check_times("avoidance", stamp_s, hold_s, state.stamp_s)
    last, a = state, np.asarray(activations, dtype=float)
    seen = _seen(params, last, stamp_s, track)
    known = track if track is not None and track.is_known else None
    found, came, near = _candidates(params, last, posture, skin, a, known, seen, bare_links)
    allowed = may_reach or params.behaviour == "avoid"
    state = _next(params, last, posture, found if allowed else [], stamp_s, allowed, track, came)
    if state.mode == "reach" and known is not None:
        state = _aimed(params, last, state, posture, skin, known, seen)
        near = reaching.other_parts(posture, skin, state.points[0].frame, known)
    so_far = last.aside if last.mode == state.mode == "avoid" else None
    state = replace(state, stamp_s=stamp_s, seen=seen, aside=so_far)
    dq, response = 0 * posture.q_rad, Response(state.mode, np.zeros(3), np.full(3, np.nan))
    if state.mode in ("avoid", "reach"):
        follows = state.mode == "reach" or state.since_s == stamp_s
        arm = RespondingArm.of(params, posture, hold_s, self_collision, kept_clear(posture, near, hold_s))
        state, dq = respond(arm, state, skin, known if follows else None)
        first = state.points[0]
        response = Response(state.mode, np.asarray(first.velocity_root), posture.point(first.frame, first.point))
    elif state.mode == "return":
        dq = return_home(params, posture, stamp_s - state.since_s, kept_clear(posture, near, hold_s))
    return state, JointVelocity(stamp_s, dq, hold_s), response


class ControlPoint(NamedTuple):
    """P and N of one body part, or of one taxel (R eq. 6)."""

    frame: str
    """The frame that carries P."""
    point_root: Array
    """(3,) P, m."""
    direction: Array
    """(3,) N; of length 1 at full speed, shorter where normals cancel or, by weighting, for a lower activation."""
    weight: float
    """Σ a over the taxels above threshold."""
    likeliest: float
    """The largest a."""


def control_points(
    threshold: float,
    posture: Posture,
    skin: Skin,
    activations: Array,
    weighting: Literal["sum", "count"] = "sum",
    each: bool = False,
) -> list[ControlPoint]:
    """R eq. 6 for each body part with taxels above threshold, or for `each` of these, that with the largest Σ a first.

    P = Σ a p / Σ a; N = Σ a n / Σ a made a unit vector, but shorter where normals cancel, or N = Σ a n / k.
    """
    n = len(skin.taxel_ids)
    if activations.shape != (n,) or not np.all((activations >= 0) & (activations <= 1)):
        raise InputError("avoidance", f"activations {activations}; expected {n} numbers in [0, 1], one a taxel")
    active = np.flatnonzero(activations > threshold)
    if not len(active):
        return []
    positions, normals = skin.at(posture)
    found = []
    ends = np.arange(1, len(active)) if each else np.flatnonzero(np.diff(skin.part_index[active])) + 1
    for group in np.split(active, ends):
        a, total = activations[group], float(activations[group].sum())
        mean: Array = a @ normals[group] / total
        by_sum = mean / max(float(np.linalg.norm(mean)), _FULL_SPEED_NORMAL)
        direction = by_sum if weighting == "sum" else a @ normals[group] / len(group)
        frame = skin.parts[skin.part_index[group[0]]].frame
        found.append(ControlPoint(frame, a @ positions[group] / total, direction, total, float(a.max())))
    return sorted(found, key=lambda one: -one.weight)


def _candidates(
    params: AvoidanceParams,
    state: AvoidanceState,
    posture: Posture,
    skin: Skin,
    activations: Array,
    track: Track3D | None,
    seen: tuple[tuple[float, Array], ...],
    bare_links: BareLinks | None,
) -> tuple[list[ControlPoint], bool, list[Near]]:
    """Control points that the arm may respond with, whether the object of a `track` has come nearer to one of the skin,
    and the nearest points of links without taxels."""
    found = control_points(params.threshold, posture, skin, activations, params.weighting, each=params.each_taxel)
    came = False
    if track is not None and skin.parts:
        came, comes = _comes(params, posture, skin, track, seen)
        found = found if comes or state.mode != "idle" else []
    came = came and bool(found)  # what threatens links without taxels has to last
    if params.behaviour == "reach":
        return sorted(found, key=lambda one: -one.likeliest)[:1], came, []
    if bare_links is None or track is None:
        return found, came, []
    near, threatened = _near(params, bare_links, posture, track)
    return found or [_of_link(one) for one in threatened], came, near


def _seen(
    params: AvoidanceParams, state: AvoidanceState, stamp_s: float, track: Track3D | None
) -> tuple[tuple[float, Array], ...]:
    """Where the object was in the last `_COME_WITHIN_S`, and is."""
    kept = tuple(one for one in state.seen if one[0] >= stamp_s - _COME_WITHIN_S - 1e-9)
    return (*kept, (stamp_s, track.position)) if track is not None and track.is_known else kept


def _comes(
    params: AvoidanceParams, posture: Posture, skin: Skin, track: Track3D, seen: tuple[tuple[float, Array], ...]
) -> tuple[bool, bool]:
    """Whether the object has come nearer, by `come_m`, to where the skin is now, and whether it then comes within
    `path_m` of a taxel if it moves on as it has since it was farthest away; without `come_m`, at its velocity."""
    taxels, _ = skin.at(posture)
    times, places = np.array([at_s for at_s, _ in seen]), np.array([position for _, position in seen])
    distance = np.linalg.norm(places[:, None] - taxels, axis=2).min(axis=1)
    k = int(distance.argmax())
    came = bool(times[-1] > times[k] and 0 < params.come_m <= distance[k] - distance[-1])
    velocity = (places[-1] - places[k]) / (times[-1] - times[k]) if came else track.velocity
    nearest_m = distances_ahead(taxels, track.position, velocity, HORIZON_S).min() - radius_m(track)
    return came, bool((came or params.come_m == 0) and nearest_m < params.path_m)


def _aimed(
    params: AvoidanceParams,
    last: AvoidanceState,
    state: AvoidanceState,
    posture: Posture,
    skin: Skin,
    track: Track3D,
    seen: tuple[tuple[float, Array], ...],
) -> AvoidanceState:
    """The state of an arm that reaches for an object, with its control points moving to it, and the taxel that the
    object comes to; the last one once none is active."""
    state = replace(state, points=tuple(reaching.aimed(params.speed_m_s, one, posture, track) for one in state.points))
    if not params.each_taxel:
        return state
    aimed_at = last.aimed_at if last.mode == "reach" else None
    if aimed_at is None or state.since_s > last.since_s:
        aimed_at = reaching.taxel_to_touch(skin, at_home(params, posture), track, seen)
    frame = skin.parts[skin.part_index[aimed_at]].frame
    return replace(state, aimed_at=aimed_at, points=(state.points[0]._replace(frame=frame),))


def _near(params: AvoidanceParams, links: BareLinks, posture: Posture, track: Track3D) -> tuple[list[Near], list[Near]]:
    """The nearest points of links without taxels, and those of them to which the object comes within the lead time."""
    radius = radius_m(track)
    near, *later = (
        links.near(posture, track.position + after_s * track.velocity, radius)
        for after_s in (0.0, 0.5 * _LINK_LEAD_S, _LINK_LEAD_S)
    )
    nearest = np.min([[one.distance_m for one in then] for then in later], axis=0)
    nearer_m = 0.1 * params.speed_m_s * _LINK_LEAD_S  # by the noise of its velocity what is at rest comes nearer
    comes = [
        distance < min(one.distance_m - nearer_m, LINK_CLEARANCE_M) for one, distance in zip(near, nearest, strict=True)
    ]
    return near, [one for one, it_comes in zip(near, comes, strict=True) if it_comes]


def _of_link(near: Near) -> ControlPoint:
    """The nearest point of a link without taxels, as if a taxel there were fully activated."""
    return ControlPoint(near.frame, near.point_root, near.normal, 1.0, 1.0)


def _next(
    params: AvoidanceParams,
    state: AvoidanceState,
    posture: Posture,
    found: list[ControlPoint],
    stamp_s: float,
    allowed: bool,
    track: Track3D | None,
    confirmed: bool,
) -> AvoidanceState:
    """Respond to a confirmed activation while allowed, keep responding for a while, then return, then rest.

    Before the return, hold when the object is lost, or has interrupted a return and not moved since.
    """
    active_since_s = min(state.active_since_s, stamp_s) if found else np.inf
    mode, since_s, blocked_by = state.mode, stamp_s - state.since_s, state.blocked_by
    responding, position = mode in ("avoid", "reach"), track.position if track and track.is_known else None
    confirmed = confirmed or stamp_s - active_since_s > params.confirm_s - 1e-6
    if found and (responding or mode == "hold" or confirmed):
        by = position if mode == "return" else blocked_by
        points = _moving(params, posture, found)
        if mode == "reach" and position is not None:  # with a point that is no farther from the object than the last
            points = min((state.points, points), key=lambda one: reaching.distance(posture, one[0], position))
        return AvoidanceState(params.behaviour, stamp_s, active_since_s, points, by)
    blocked = False
    if blocked_by is not None and position is not None:
        blocked = float(np.linalg.norm(position - blocked_by)) < _GONE_M
    lost = track is not None and position is None
    lasts_s = _REACH_FOR_S if mode == "reach" else params.persist_s
    ended = responding and (lost or not allowed or since_s > lasts_s)
    if ended and (lost or blocked):
        return AvoidanceState("hold", stamp_s, blocked_by=blocked_by)
    if ended or (mode == "hold" and not blocked and (not lost or since_s > _WAIT_S)):
        return AvoidanceState("return", stamp_s, active_since_s)
    if mode == "return":
        is_home = np.abs(angles_from_home(params, posture)).max() < _AT_HOME_RAD
        if is_home or since_s > _GIVE_UP_S:
            return AvoidanceState("idle", stamp_s, active_since_s)
    return replace(state, active_since_s=active_since_s)


def _moving(params: AvoidanceParams, posture: Posture, found: list[ControlPoint]) -> tuple[MovingPoint, ...]:
    """The control points in their frames, with their velocities; their weights are shares of Σ a."""
    speed = params.speed_m_s if params.behaviour == "reach" else -params.speed_m_s
    total = sum(one.weight for one in found)
    return tuple(
        MovingPoint(
            one.frame,
            move_points(inverse(posture.T_root(one.frame)), one.point_root),
            speed * one.direction,
            one.weight / total,
            free_across=params.each_taxel and params.behaviour == "avoid",
        )
        for one in found
    )
