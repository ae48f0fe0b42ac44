"""Move away from what the skin predicts to touch it, or reach for it (R eq. 6), and return home.

Beyond R: an arm at rest does not respond to what will pass or has not come nearer, taxels leave the path of an object
that withdrawal along their normals is not predicted to escape, and reaching aims at the object, with the taxel that
touches it first at the speeds that the constraints allow.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from control import reaching
from control.arm import ArmConstraints, ArmParams, KeepIn, MovingPoint, arm_constraints, arm_velocity
from control.limits import MAX_HOLD_S, LimitParams, check_times
from control.path_clearance import direction_off_path
from control.reaching import HORIZON_S, distances_ahead, radius_m
from pps_vision.errors import InputError
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.bare_links import BareLinks, Near
from pps_vision.robot.model import Posture
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, JointVelocity, Track3D

Mode = Literal["idle", "avoid", "reach", "hold", "return"]
_REACH_FOR_S = 3.0  # for which reaching outlasts the activation: an object that waits to be touched has no TTC
# Positions of the object are compared over this time.
_COME_WITHIN_S = 0.5
_WAIT_S = 1.0  # for which the arm stays where it is when the object is lost, before it goes home
# An object that interrupted the return must move by so much before the arm returns again: it does not swing before an
# object at rest.
_GONE_M = 0.05
# Links without taxels come no nearer to the object, and respond if it is to come nearer within the lead time and no
# taxel is active.  While the arm reaches, the taxels of its other body parts keep this distance too.
_LINK_CLEARANCE_M, _LINK_LEAD_S = 0.03, 0.5
_RETURN_PER_S = 3.0  # rate of the return home, of the angles left
_EASE_IN_S = 0.3  # over which the return speeds up
_AT_HOME_RAD = np.deg2rad(0.2)  # largest angle from home that counts as being there
_GIVE_UP_S = 6.0  # longest return: a joint that is stuck never gets home
_FULL_SPEED_NORMAL = 0.5  # a mean normal that is shorter (60° from all normals to it, or more) slows the response


@dataclass(frozen=True)
class AvoidanceParams:
    """Response of one arm to its skin (R, "Avoidance and reaching")."""

    home_arm_rad: tuple[float, ...]
    """(k,) the arm's joints at home."""
    side: Literal["left", "right"] = "left"
    """The arm."""
    behaviour: Literal["avoid", "reach"] = "avoid"
    """Move against the normal of the control point, or towards the object."""
    threshold: float = 0.4
    """Activation above which a taxel responds."""
    speed_m_s: float = 0.10
    """Speed of the control point."""
    withdraws: Literal["taxels", "point"] = "taxels"
    """Every active taxel against its normal, by least squares and free to move across, and the nearest one reaches; or
    one point of each body part does either, against the mean normal (R)."""
    weighting: Literal["sum", "count"] = "sum"
    """What Σ a n is divided by: Σ a, so that the speed is constant (the robot's code), or the number of taxels, so that
    it grows with the activation (R eq. 6 as printed).  P is divided by Σ a in both: otherwise it is no point of the
    arm."""
    radius_m: float = 0.20
    """The palm stays this near to its place at home."""
    path_m: float = 0.05
    """An arm at rest responds only to what comes so near to its skin if it moves on as it has come; inf: to every
    activation (R).  D and TTC do not tell what passes from what comes."""
    come_m: float = 0.01
    """An arm at rest responds to a tracked object only if it has come nearer to the skin by so much within half
    a second, as the positions show, and then at once; 0: its estimated velocity decides.  That of an object that stops
    overshoots and points back for a quarter of a second; the positions do not."""
    confirm_s: float = 0.15
    """Time above threshold before the arm responds to what is not seen to come nearer."""
    clear_m: float = 0.05
    """Where the taxels' withdrawal is predicted to leave less between skin and object, and moving across the object's
    path to leave more, they move across; 0: never (R)."""
    persist_s: float = 0.3
    """Time for which avoidance outlasts the activation."""
    reach_damping_m: float = 0.03
    """Damping that an arm that reaches tries beside that of `arm`: with little damping joints turn fast against each
    other, and the last stage, which proves the whole motion clear of the body, slows them all; with more the arm stops
    at singular postures."""
    arm: ArmParams = field(default_factory=ArmParams)
    """Limits and damping of the arm."""

    @property
    def each_taxel(self) -> bool:
        """Whether every active taxel is a control point of its own."""
        return self.withdraws == "taxels"

    def __post_init__(self) -> None:
        if self.side not in ("left", "right") or self.behaviour not in ("avoid", "reach"):
            raise ValueError(f"{self.behaviour!r} by the {self.side!r} arm; expected avoid or reach, left or right")
        if self.weighting not in ("sum", "count") or self.withdraws not in ("taxels", "point"):
            raise ValueError(
                f"weighting {self.weighting!r}, withdraws {self.withdraws!r}; expected sum or count, taxels or point"
            )
        if not self.home_arm_rad or not np.isfinite(self.home_arm_rad).all():
            raise ValueError(f"home_arm_rad {self.home_arm_rad}; expected an angle for each joint")
        least_0 = self.confirm_s, self.persist_s, self.come_m, self.clear_m
        above_0 = self.threshold, self.path_m, self.speed_m_s, self.radius_m, self.reach_damping_m
        if not (all(v >= 0 for v in least_0) and all(v > 0 for v in above_0) and self.threshold <= 1):
            raise ValueError(f"{self}; expected no time below 0, the rest above, a threshold of at most 1")


@dataclass(frozen=True, slots=True)
class AvoidanceState:
    """What the arm does."""

    mode: Mode = "idle"
    since_s: float = 0.0
    """Stamp of the last activation that it responds to; of a hold and of the way home, when that began."""
    active_since_s: float = np.inf
    """Since when some taxel is above threshold without a break; inf if none is."""
    points: tuple[MovingPoint, ...] = ()
    """Control points with their commanded velocities, the most activated first."""
    blocked_by: Array | None = None
    """(3,) where the object was when it interrupted the return, m."""
    aimed_at: int | None = None
    """Number of the taxel that the object's path comes nearest to, for an arm that reaches."""
    aside: Array | None = None
    """(3,) direction across the object's path in which the control points move; None: against the normals."""
    seen: tuple[tuple[float, Array], ...] = ()
    """Stamps and positions (3,) m of the object in the last `_COME_WITHIN_S`."""
    stamp_s: float = -np.inf
    """Stamp of the last step."""


@dataclass(frozen=True, slots=True)
class Response:
    """What is commanded, for reports."""

    mode: Mode
    velocity_root: Array
    """(3,) m/s of the most activated control point; zero unless the arm avoids or reaches."""
    point_root: Array
    """(3,) that control point, m; NaN unless the arm avoids or reaches."""


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
        arm = _Arm.of(params, posture, hold_s, self_collision, _kept_clear(posture, near, hold_s))
        state, dq = _respond(arm, state, skin, known if follows else None)
        first = state.points[0]
        response = Response(state.mode, np.asarray(first.velocity_root), posture.point(first.frame, first.point))
    elif state.mode == "return":
        dq = _return(params, posture, stamp_s - state.since_s, _kept_clear(posture, near, hold_s))
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
        aimed_at = reaching.taxel_to_touch(skin, _at_home(params, posture), track, seen)
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
        distance < min(one.distance_m - nearer_m, _LINK_CLEARANCE_M)
        for one, distance in zip(near, nearest, strict=True)
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
        at_home = np.abs(_angles_from_home(params, posture)).max() < _AT_HOME_RAD
        if at_home or since_s > _GIVE_UP_S:
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


@dataclass(frozen=True)
class _Arm:
    """An arm, and what its joint rates obey in one frame."""

    params: AvoidanceParams
    posture: Posture
    within: ArmConstraints
    hold_s: float
    self_collision: SelfCollision | None

    @classmethod
    def of(
        cls,
        params: AvoidanceParams,
        posture: Posture,
        hold_s: float,
        self_collision: SelfCollision | None,
        rows: tuple[Array, Array],
    ) -> "_Arm":
        """The palm stays within its sphere, the rates within the `rows`."""
        palm = _palm(params, posture)
        keep_in = KeepIn(palm, _at_home(params, posture).point(palm), params.radius_m)
        of_arm = posture, params.side, params.home_arm_rad, keep_in, hold_s, self_collision, rows
        return cls(params, posture, arm_constraints(params.arm, *of_arm), hold_s, self_collision)

    def velocity(self, points: tuple[MovingPoint, ...], params: ArmParams | None = None) -> Array:
        """Joint rates (n_joints,) that move control points as commanded, none of them faster than `speed_m_s`."""
        dq = arm_velocity(params or self.params.arm, self.posture, self.within, points)
        jacobians = (self.posture.jacobian(one.frame, one.point)[:3] for one in points)
        fastest = max(float(np.linalg.norm(jacobian @ dq)) for jacobian in jacobians)
        return dq * min(1.0, self.params.speed_m_s / max(fastest, 1e-9))

    def free_share(self, rates: Array) -> float:
        """The share of rates (k,) that the last stage, which proves the motion clear of the body, lets through."""
        if self.self_collision is None:
            return 1.0
        change = np.zeros_like(self.posture.q_rad)
        change[self.within.columns] = self.hold_s * rates
        return self.self_collision.clear_share(self.posture.q_rad, change, LimitParams().clearance_m)


def _respond(arm: _Arm, state: AvoidanceState, skin: Skin, track: Track3D | None) -> tuple[AvoidanceState, Array]:
    """Joint rates that reach for the object of a `track`, or withdraw from it."""
    if not arm.params.each_taxel:
        return state, arm_velocity(arm.params.arm, arm.posture, arm.within, state.points)
    if state.mode == "reach" and track is not None and state.aimed_at is not None:
        return _reach(arm, state, state.aimed_at, skin, track)
    return _withdraw(arm, state, skin, track)


def _reach(arm: _Arm, state: AvoidanceState, aimed_at: int, skin: Skin, track: Track3D) -> tuple[AvoidanceState, Array]:
    """With the taxel and the damping that touch the object first."""
    ways = []
    for params in (replace(arm.params.arm, damping_m=arm.params.reach_damping_m), arm.params.arm):
        velocity = partial(arm.velocity, params=params)
        way = reaching.first_to_touch(arm.params.speed_m_s, aimed_at, arm.posture, skin, track, velocity)
        free = arm.free_share(way.dq[arm.within.columns])
        ways.append(way._replace(touches_s=way.touches_s / max(free, reaching.AT_REST_M_S)))
    _, point, dq = min(ways, key=lambda way: way.touches_s)
    return replace(state, points=(point,)), dq


def _withdraw(arm: _Arm, state: AvoidanceState, skin: Skin, track: Track3D | None) -> tuple[AvoidanceState, Array]:
    """Against the taxels' normals, or off the path of the object."""
    columns, aside = arm.within.columns, state.aside

    def rates_towards(direction: Array | None) -> Array:
        return arm.velocity(_moved(state.points, direction))[columns]

    if track is not None and arm.params.clear_m and state.mode == "avoid":
        on = arm.posture, columns, skin, track, rates_towards, arm.params.clear_m
        aside = direction_off_path(*on, aside, arm.free_share) if skin.parts else None
    state = replace(state, aside=aside, points=_moved(state.points, aside))
    return state, arm.velocity(state.points)


def _moved(points: tuple[MovingPoint, ...], direction: Array | None) -> tuple[MovingPoint, ...]:
    """The control points, moving in a direction (3,) if there is one, as fast."""
    if direction is None:
        return points
    return tuple(one._replace(velocity_root=float(np.linalg.norm(one.velocity_root)) * direction) for one in points)


def _kept_clear(posture: Posture, near: list[Near], hold_s: float) -> tuple[Array, Array]:
    """Speeds (m, n_joints) of links without taxels towards the object per joint rate, and their largest values (m,)."""
    near = [one for one in near if np.isfinite(one.distance_m)]
    rows = np.empty((len(near), posture.robot.n_joints))
    for k, one in enumerate(near):
        point = move_points(inverse(posture.T_root(one.frame)), one.point_root)
        rows[k] = one.normal @ posture.jacobian(one.frame, point)[:3]
    return rows, np.array([max(one.distance_m - _LINK_CLEARANCE_M, 0.0) / hold_s for one in near])


def _return(params: AvoidanceParams, posture: Posture, elapsed_s: float, rows: tuple[Array, Array]) -> Array:
    """Joint rates towards home: eased in and out, the palm no faster than the control point of a response, and no
    faster than the `rows` of links near the object allow."""
    dq = np.zeros_like(posture.q_rad)
    dq[_columns(params, posture)] = -_RETURN_PER_S * _angles_from_home(params, posture)
    palm_speed = np.linalg.norm(posture.jacobian(_palm(params, posture))[:3] @ dq)
    excess = max(palm_speed / params.speed_m_s, np.abs(dq).max() / params.arm.max_rate_rad_s, 1.0)
    eased = elapsed_s / _EASE_IN_S if elapsed_s < _EASE_IN_S else 1.0
    dq *= eased / excess
    towards = rows[0] @ dq
    return dq * np.min(rows[1][towards > 0] / towards[towards > 0], initial=1.0)


def _at_home(params: AvoidanceParams, posture: Posture) -> Posture:
    """The robot with the arm at home."""
    q = posture.q_rad.copy()
    q[_columns(params, posture)] = params.home_arm_rad
    return posture.robot.at(q)


def _columns(params: AvoidanceParams, posture: Posture) -> list[int]:
    """Where the arm's joints are in the configuration vector."""
    return posture.robot.indices(posture.robot.names.arm(params.side))


def _palm(params: AvoidanceParams, posture: Posture) -> str:
    """The frame of the arm's palm."""
    return posture.robot.names.palm(params.side)


def _angles_from_home(params: AvoidanceParams, posture: Posture) -> Array:
    """(k,) rad."""
    return np.asarray(posture.q_rad[_columns(params, posture)] - params.home_arm_rad)
