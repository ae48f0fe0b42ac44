"""Move an arm away from an object that is predicted to touch its skin, and return home (R, "Avoidance and reaching").

Every taxel above the activation threshold withdraws against its normal.  Beyond R: links without taxels keep clear; and
where withdrawal is predicted to leave too little clearance, the arm moves as leaves most.
`control_point` is R eq. 6 itself.
"""

from dataclasses import dataclass, field, replace
from functools import cache
from typing import ClassVar, Literal

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from control.arm import ArmParams, KeepIn, MovingPoint, arm_constraints, arm_velocity
from control.limits import MAX_HOLD_S, LimitParams, check_times
from pps_vision.errors import InputError
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.bare_links import BareLinks, NearestPoint
from pps_vision.robot.model import Posture
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, JointVelocity, Track3D

HORIZON_S = 3.0  # prediction horizon of the object's motion: R's longest time to contact
_HISTORY_S = 0.5  # duration of the object's position history
_LOST_WAIT_S = 1.0  # the arm holds still for this time after the object is lost, then returns home
_UNBLOCKED_M = 0.05  # an object that interrupted the return must move by this before the arm returns again
_AT_HOME_RAD = np.deg2rad(0.2)  # largest joint angle from home that counts as being there
_MAX_RETURN_S = 6.0  # longest return: a joint that is stuck never gets home
_RETURN_PER_S = 3.0  # rate of the return, of the angles from home
_EASE_IN_S = 0.3  # time in which the return speeds up
_LINK_CLEARANCE_M = 0.03  # smallest distance that links without taxels approach the object to
_LINK_LEAD_S = 0.5  # prediction horizon for links without taxels
_DIRECTIONS = 32  # directions in which the taxels leave the object's path that are compared
_VARIANTS = 64  # variations of the best joint rates that are compared
_SPREADS = 0.5, 0.2  # their standard deviations, as shares of its norm
_FASTEST = 1.5  # speed of any taxel, as a multiple of the responding taxels' speed
_ESCAPE_GAIN_M = 0.01  # clearance by which other joint rates must exceed the present ones
_MIN_PATH_SPEED_M_S = 0.01  # a slower object has no path
_PREDICTION_INSTANTS = 8
_PASSED_M = 0.05  # the prediction ends when the object is this far beyond the last taxel

Mode = Literal["idle", "avoid", "reach", "hold", "return"]
Points = tuple[MovingPoint, ...]


@dataclass(frozen=True)
class ResponseParams:
    """The arm, and when it responds to its skin; shared by avoidance and reaching."""

    mode: ClassVar[Mode]
    home_arm_rad: tuple[float, ...]
    """(k,) the arm's joints at home."""
    side: Literal["left", "right"] = "left"
    """The arm."""
    threshold: float = 0.4
    """Activation above which a taxel responds."""
    speed_m_s: float = 0.10
    """Largest speed of the taxels that respond."""
    radius_m: float = 0.20
    """Largest distance of the palm from its place at home."""
    confirmation_s: float = 0.0
    """Time above threshold before the arm responds."""
    persist_s: float = 0.3
    """Time for which the response outlasts the activation."""
    arm: ArmParams = field(default_factory=ArmParams)
    """Limits and damping of the arm."""

    def __post_init__(self) -> None:
        if self.side not in ("left", "right"):
            raise InputError("arm", f"side {self.side!r}; expected left or right")
        if not self.home_arm_rad or not np.isfinite(self.home_arm_rad).all():
            raise InputError("arm", f"home_arm_rad {self.home_arm_rad}; expected an angle for each joint")
        positive = self.threshold, self.speed_m_s, self.radius_m
        durations = self.confirmation_s, self.persist_s
        if not (min(positive) > 0 and min(durations) >= 0 and self.threshold <= 1):
            expected = "expected positive numbers, a threshold of at most 1, times of at least 0"
            raise InputError("arm", f"{self}; {expected}")


@dataclass(frozen=True)
class AvoidanceParams(ResponseParams):
    """Parameters of avoidance."""

    mode: ClassVar[Mode] = "avoid"
    escape_clearance_m: float = 0.05
    """Where withdrawal along the normals is predicted to leave less than this between skin and object, the arm moves as
    leaves most; 0: never (R)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.escape_clearance_m >= 0:
            raise InputError("arm", f"escape_clearance_m {self.escape_clearance_m}; expected at least 0")


@dataclass(frozen=True, slots=True)
class ArmInput:
    """Input of one control step of an arm."""

    stamp_s: float  # stamp of the command
    posture: Posture  # the robot when the command takes effect
    skin: Skin  # the n taxels that the arm carries
    activations: Array  # (n,) predicted touch, in [0, 1]
    track: Track3D  # the object to respond to, or an unknown track
    hold_s: float = MAX_HOLD_S  # time for which the command may be held
    self_collision: SelfCollision | None = None  # distances between the robot's bodies; None: they are not limited
    bare_links: BareLinks | None = None  # links of the arm without taxels; None: they do not keep clear

    @property
    def object_radius_m(self) -> float:
        """Radius of the object, 0 where it is unknown."""
        return self.track.radius_m if np.isfinite(self.track.radius_m) else 0.0


@dataclass(frozen=True, slots=True)
class ArmState:
    """State of an arm that avoids or reaches."""

    mode: Mode = "idle"
    since_s: float = 0.0  # stamp of the last activation responded to, or of the begin of a hold or return
    active_since_s: float = np.inf  # begin of the uninterrupted activation of any taxel; inf without one
    points: Points = ()  # control points with their commanded velocities, the most activated first
    blocked_by: Array | None = None  # (3,) m, position of the object that interrupted the return
    escape_rad_s: Array | None = None  # (k,) rates out of the object's path; None: against the normals
    target_taxel: int | None = None  # of reaching: number of the taxel that the object's path passes nearest
    positions: tuple[tuple[float, Array], ...] = ()  # stamps and positions (3,) m of the object in the last half second
    felt_s: float = -np.inf  # of reaching: stamp of the last activation of any taxel
    track_id: int = 0  # last known object
    stamp_s: float = -np.inf  # stamp of the last step


@dataclass(frozen=True, slots=True)
class Response:
    """Output of one control step of an arm."""

    mode: Mode
    command: JointVelocity  # rates of the arm's joints
    velocity_root: Array  # (3,) m/s of the most activated control point; zero unless the arm avoids or reaches


def step(params: AvoidanceParams, state: ArmState, arm: ArmInput) -> tuple[ArmState, Response]:
    """Advance avoidance by one control step.

    InputError unless there is an activation in [0, 1] for each taxel, and a finite stamp, not before the last one.
    """
    state = observed(state, arm)
    points = _active_taxels(params, arm)
    link_points, approached_links = _bare_links(params, arm)
    threats = points or _link_points(params, arm, approached_links)
    last_mode = state.mode
    state = next_state(params, state, arm, bool(threats))
    clearance = clearance_rows(arm, link_points)
    dq = np.zeros_like(arm.posture.q_rad)
    if state.mode == "avoid":
        state = replace(state, points=threats or state.points)
        escape = state.escape_rad_s if last_mode == "avoid" else None
        motion = ArmMotion(params, arm, clearance)
        if threats and arm.track.is_known and arm.skin.parts and params.escape_clearance_m > 0:
            escape = _escape_rates(motion, state.points, escape, params.escape_clearance_m)
        state = replace(state, escape_rad_s=escape)
        if escape is None:
            dq = motion.rates(state.points)
        else:
            dq[motion.constraints.columns] = motion.scaled(state.points, escape[None])[0]
            state = replace(state, points=motion.moving(state.points, dq))
    elif state.mode == "return":
        taxels = nearest_taxels(arm) if arm.track.is_known else []
        dq = return_home(params, arm, arm.stamp_s - state.since_s, clearance_rows(arm, [*link_points, *taxels]))
    return state, response(state, arm, dq)


def control_point(threshold: float, posture: Posture, skin: Skin, activation: Array) -> tuple[str, Array, Array] | None:
    """P = Σ aᵢpᵢ / Σ aᵢ and N = Σ aᵢnᵢ / k over the k taxels above `threshold` (R eq. 6); None if k = 0.

    Returns the frame that carries P, that of the body part with the largest Σ a; P (3,) m in it; and N (3,) in the root
    frame.  P is divided by Σ aᵢ as in R's code: as printed, divided by k, it is no point of the arm.
    """
    a = np.where(activation > threshold, activation, 0.0)
    if not a.any():
        return None
    positions, normals = skin.at(posture)
    by_part = np.bincount(skin.part_index, a, len(skin.parts))
    frame = skin.parts[int(by_part.argmax())].frame
    T = posture.T_root(frame)
    point = (a @ positions / a.sum() - T[:3, 3]) @ T[:3, :3]
    return frame, point, a @ normals / np.count_nonzero(a)


def observed(state: ArmState, arm: ArmInput) -> ArmState:
    """Check an input and append the object's position to the history.  InputError as in `step`."""
    check_times("arm", arm.stamp_s, arm.hold_s, state.stamp_s)
    n = len(arm.skin.taxel_ids)
    a = arm.activations
    if a.shape != (n,) or not np.all((a >= 0) & (a <= 1)):
        raise InputError("arm", f"activations {a}; expected {n} numbers in [0, 1], one a taxel")
    begin_s = arm.stamp_s - _HISTORY_S - 1e-9
    positions = tuple(entry for entry in state.positions if entry[0] >= begin_s)
    if not arm.track.is_known:
        return replace(state, positions=positions, stamp_s=arm.stamp_s)
    earlier = positions if arm.track.track_id == state.track_id else ()
    positions = (*earlier, (arm.stamp_s, arm.track.position))
    return replace(state, positions=positions, stamp_s=arm.stamp_s, track_id=arm.track.track_id)


def next_state(
    params: ResponseParams,
    state: ArmState,
    arm: ArmInput,
    is_active: bool,
    may_respond: bool = True,
) -> ArmState:
    """Respond to a confirmed activation, keep responding for a while, return home, then rest.

    Hold before the return while the object is lost, or while it stays where it interrupted a return.
    """
    is_active = is_active and may_respond
    is_known = arm.track.is_known
    elapsed_s = arm.stamp_s - state.since_s
    active_since_s = min(state.active_since_s, arm.stamp_s) if is_active else np.inf
    is_confirmed = arm.stamp_s - active_since_s > params.confirmation_s - 1e-6
    state = replace(state, active_since_s=active_since_s)
    responding = state.mode == params.mode
    if is_active and (responding or state.mode == "hold" or is_confirmed):
        blocked_by = state.blocked_by
        if state.mode == "return":
            blocked_by = arm.track.position if is_known else None
        return replace(state, mode=params.mode, since_s=arm.stamp_s, blocked_by=blocked_by)
    is_blocked = False
    if state.blocked_by is not None and is_known:
        is_blocked = float(np.linalg.norm(arm.track.position - state.blocked_by)) < _UNBLOCKED_M
    has_ended = responding and (not is_known or not may_respond or elapsed_s > params.persist_s)
    if has_ended and (not is_known or is_blocked):
        return replace(state, mode="hold", since_s=arm.stamp_s)
    if has_ended or (state.mode == "hold" and not is_blocked and (is_known or elapsed_s > _LOST_WAIT_S)):
        return replace(state, mode="return", since_s=arm.stamp_s, blocked_by=None)
    if state.mode == "return":
        is_home = np.abs(_angles_from_home(params, arm.posture)).max() < _AT_HOME_RAD
        if is_home or elapsed_s > _MAX_RETURN_S:
            return replace(state, mode="idle", since_s=arm.stamp_s)
    return state


def response(state: ArmState, arm: ArmInput, dq: Array) -> Response:
    """The output for joint rates (n_joints,)."""
    command = JointVelocity(arm.stamp_s, dq, arm.hold_s)
    velocity = state.points[0].velocity_root if state.mode in ("avoid", "reach") else np.zeros(3)
    return Response(state.mode, command, np.asarray(velocity))


def _active_taxels(params: AvoidanceParams, arm: ArmInput) -> Points:
    """The taxels above threshold, moving against their normals; weighted by their shares of Σ a."""
    active = np.flatnonzero(arm.activations > params.threshold)
    if not active.size:
        return ()
    active = active[np.argsort(-arm.activations[active], kind="stable")]
    _, normals = arm.skin.at(arm.posture)
    shares = arm.activations[active] / arm.activations[active].sum()
    return tuple(
        MovingPoint(*arm.skin.taxel(k), -params.speed_m_s * normals[k], share, free_across=True)
        for k, share in zip(active.tolist(), shares.tolist(), strict=True)
    )


def _bare_links(params: AvoidanceParams, arm: ArmInput) -> tuple[list[NearestPoint], list[NearestPoint]]:
    """The nearest points of all links without taxels, and of the links that the object is predicted to approach."""
    if arm.bare_links is None or not arm.track.is_known:
        return [], []
    present, *later = (
        arm.bare_links.nearest_points(arm.posture, arm.track.position + s * arm.track.velocity, arm.object_radius_m)
        for s in (0.0, 0.5 * _LINK_LEAD_S, _LINK_LEAD_S)
    )
    min_approach_m = 0.1 * params.speed_m_s * _LINK_LEAD_S  # an object at rest approaches by its velocity's noise
    approached = []
    for near, *predicted in zip(present, *later, strict=True):
        distance_m = min(link.distance_m for link in predicted)
        if distance_m < min(near.distance_m - min_approach_m, _LINK_CLEARANCE_M):
            approached.append(near)
    return present, approached


def _link_points(params: AvoidanceParams, arm: ArmInput, links: list[NearestPoint]) -> Points:
    """The nearest points of links, moving away from the object as fully activated taxels would."""
    return tuple(
        MovingPoint(
            link.frame,
            move_points(inverse(arm.posture.T_root(link.frame)), link.point_root),
            -params.speed_m_s * link.normal,
            1 / len(links),
            free_across=True,
        )
        for link in links
    )


class ArmMotion:
    """Joint rates of an arm within its constraints in one control step."""

    def __init__(self, params: ResponseParams, arm: ArmInput, clearance: tuple[Array, Array]) -> None:
        """The palm stays within its sphere, rates within the `clearance` rows."""
        palm = arm.posture.robot.names.palm(params.side)
        keep_in = KeepIn(palm, at_home(params, arm.posture).point(palm), params.radius_m)
        limited_by = (keep_in, arm.hold_s, arm.self_collision, clearance)
        self.params = params
        self.arm = arm
        self._jacobians: dict[tuple[str, bytes], Array] = {}
        self.constraints = arm_constraints(params.arm, arm.posture, params.side, params.home_arm_rad, *limited_by)

    def rates(self, points: Points, arm_params: ArmParams | None = None) -> Array:
        """Joint rates (n_joints,) that move control points as commanded, none faster than `speed_m_s`."""
        J = [self._jacobian(point) for point in points]
        dq = arm_velocity(arm_params or self.params.arm, self.arm.posture, self.constraints, points, J)
        fastest = float(np.linalg.norm(np.array(J) @ dq, axis=1).max())
        return dq * min(1.0, self.params.speed_m_s / max(fastest, 1e-9))

    def _jacobian(self, point: MovingPoint) -> Array:
        """(3, n_joints) of a point's position, computed once: many directions are compared for the same points."""
        key = point.frame, np.asarray(point.point, dtype=float).tobytes()
        if key not in self._jacobians:
            self._jacobians[key] = self.arm.posture.jacobian(point.frame, point.point)[:3]
        return self._jacobians[key]

    def towards(self, points: Points, directions: Array) -> Array:
        """Joint rates (m, k) that move the points along directions (m, 3), free across; of any length."""
        columns = self.constraints.columns
        along = np.einsum("md,ndk->mnk", directions, [self._jacobian(point)[:, columns] for point in points])
        weights = np.array([point.weight for point in points])
        damping = self.params.arm.damping_m**2 * np.eye(len(columns))
        squares = np.einsum("n,mnk,mnl->mkl", weights, along, along) + damping
        return np.asarray(np.linalg.solve(squares, np.einsum("n,mnk->mk", weights, along)[..., None])[..., 0])

    def scaled(self, points: Points, rates: Array) -> Array:
        """Joint rates (m, k) as fast as the constraints allow: no point faster than `speed_m_s`, no taxel than
        `_FASTEST` times that."""
        columns, limits, _, rows, most = self.constraints
        J = np.array([self._jacobian(point)[:, columns] for point in points])
        J = np.concatenate([J, self.arm.skin.jacobians(self.arm.posture, columns) / _FASTEST])
        fastest = np.linalg.norm(np.einsum("ndk,mk->mnd", J, rates), axis=2).max(axis=1)
        rates = np.clip(rates * (self.params.speed_m_s / np.maximum(fastest, 1e-9))[:, None], *limits)
        excess = np.max(rates @ rows.T / np.maximum(most, 1e-9), axis=1, initial=1.0)
        return np.asarray(rates / excess[:, None])

    def moving(self, points: Points, dq: Array) -> Points:
        """The points with the velocities that joint rates (n_joints,) give them."""
        return tuple(point._replace(velocity_root=self._jacobian(point) @ dq) for point in points)

    def unhindered_share(self, rates: Array) -> float:
        """Share of rates (k,) that the self-collision check of the last stage (`limits`) lets through."""
        if self.arm.self_collision is None:
            return 1.0
        change = np.zeros_like(self.arm.posture.q_rad)
        change[self.constraints.columns] = self.arm.hold_s * rates
        return self.arm.self_collision.clear_share(self.arm.posture.q_rad, change, LimitParams().clearance_m)


def _escape_rates(motion: ArmMotion, points: Points, current: Array | None, clearance_m: float) -> Array | None:
    """Rates (k,) rad/s of the arm's joints that leave the largest predicted distance to the object, as in the dynamic
    window of Fox et al. (1997); None: against the normals, as the `points` move.

    Compared are the `current` rates, kept unless others leave 1 cm more, withdrawal against the normals, kept while it
    leaves `clearance_m`, motions of the points in all directions, and variations of the best.
    """
    if float(np.linalg.norm(motion.arm.track.velocity)) < _MIN_PATH_SPEED_M_S:
        return None
    columns = motion.constraints.columns
    withdrawal = motion.rates(points)[columns]
    withdrawal = motion.unhindered_share(withdrawal) * withdrawal
    if current is None and predicted_distances(motion.arm, columns, withdrawal[None])[0] > clearance_m:
        return None
    kept = withdrawal if current is None else motion.scaled(points, current[None])[0]
    more = motion.scaled(points, motion.towards(points, _directions(_DIRECTIONS, 3)))
    rates = np.vstack([kept, withdrawal, more])
    scores = predicted_distances(motion.arm, columns, rates)
    scores[0] += _ESCAPE_GAIN_M
    for spread in _SPREADS:
        best = rates[scores.argmax()]
        variants = best + spread * np.linalg.norm(best) * _directions(_VARIANTS, len(columns))
        rates = np.vstack([rates, more := motion.scaled(points, variants)])
        scores = np.append(scores, predicted_distances(motion.arm, columns, more))
    checked = set()  # the body may slow the best motion: score the slowed one
    while (k := int(scores.argmax())) not in checked:
        checked.add(k)
        if (share := motion.unhindered_share(rates[k])) < 1:
            rates[k] *= share
            scores[k] = predicted_distances(motion.arm, columns, rates[k][None])[0] + _ESCAPE_GAIN_M * (k == 0)
    return np.asarray(rates[k])


@cache
def _directions(n: int, k: int) -> Array:
    """Unit vectors (n, k), evenly spread (Halton 1960)."""
    vectors = ndtri(qmc.Halton(k, scramble=False).random(n + 1)[1:])
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def predicted_distances(arm: ArmInput, columns: list[int], rates: Array) -> Array:
    """Smallest distances (m,) m from the object's surface to the taxels' centres while the object moves on.

    `rates` (m, k) rad/s of the joints at `columns` last until a joint limit stops them; taxels follow their Jacobians.
    """
    posture = arm.posture
    position = arm.track.position
    velocity = arm.track.velocity
    taxels, _ = arm.skin.at(posture)
    J = arm.skin.jacobians(posture, columns)
    speed = float(np.linalg.norm(velocity))
    last_m = float(((taxels - position) @ velocity).max()) / speed + _PASSED_M
    times = np.linspace(0.0, np.clip(last_m / speed, 0.1, HORIZON_S), _PREDICTION_INSTANTS)
    q = posture.q_rad[columns]
    lower = np.minimum(posture.robot.lower_rad[columns], q)
    upper = np.maximum(posture.robot.upper_rad[columns], q)
    turned = np.clip(q + times[:, None] * rates[:, None], lower, upper) - q
    d = np.einsum("ndk,mtk->mtnd", J, turned) + taxels - (position + times[:, None] * velocity)[:, None]
    step = np.diff(d, axis=1)  # between two instants the taxels move straight
    share = np.clip(-np.sum(d[:, :-1] * step, axis=3) / np.maximum(np.sum(step * step, axis=3), 1e-12), 0.0, 1.0)
    nearest = d[:, :-1] + share[..., None] * step
    return np.asarray(np.sqrt(np.sum(nearest * nearest, axis=3).min(axis=(1, 2))) - arm.object_radius_m)


def nearest_taxels(arm: ArmInput) -> list[NearestPoint]:
    """The taxel nearest to the object of each body part that has taxels."""
    if not arm.skin.parts:
        return []
    d = arm.track.position - arm.skin.at(arm.posture)[0]
    distances = np.linalg.norm(d, axis=1)
    near = []
    for k, part in enumerate(arm.skin.parts):
        i = int(np.argmin(np.where(arm.skin.part_index == k, distances, np.inf)))
        gap = float(distances[i]) - arm.object_radius_m
        near.append(NearestPoint(part.frame, arm.track.position - d[i], d[i] / max(distances[i], 1e-9), gap))
    return near


def clearance_rows(arm: ArmInput, near: list[NearestPoint]) -> tuple[Array, Array]:
    """Links keep 3 cm from the object: speeds (m, n_joints) towards it per joint rate, and the largest (m,) m/s."""
    near = [link for link in near if np.isfinite(link.distance_m)]
    rows = np.empty((len(near), arm.posture.robot.n_joints))
    for k, link in enumerate(near):
        point = move_points(inverse(arm.posture.T_root(link.frame)), link.point_root)
        rows[k] = link.normal @ arm.posture.jacobian(link.frame, point)[:3]
    return rows, np.array([max(link.distance_m - _LINK_CLEARANCE_M, 0.0) / arm.hold_s for link in near])


def return_home(params: ResponseParams, arm: ArmInput, elapsed_s: float, clearance: tuple[Array, Array]) -> Array:
    """Joint rates (n_joints,) towards home: eased in and out, the palm no faster than `speed_m_s`, links no faster
    towards the object than the `clearance` rows allow."""
    posture = arm.posture
    dq = np.zeros_like(posture.q_rad)
    dq[_columns(params, posture)] = -_RETURN_PER_S * _angles_from_home(params, posture)
    palm_speed = np.linalg.norm(posture.jacobian(posture.robot.names.palm(params.side))[:3] @ dq)
    excess = max(palm_speed / params.speed_m_s, np.abs(dq).max() / params.arm.max_rate_rad_s, 1.0)
    dq *= min(elapsed_s / _EASE_IN_S, 1.0) / excess
    rows, largest = clearance
    towards = rows @ dq
    return dq * np.min(largest[towards > 0] / towards[towards > 0], initial=1.0)


def at_home(params: ResponseParams, posture: Posture) -> Posture:
    """The robot with the arm at home."""
    q = posture.q_rad.copy()
    q[_columns(params, posture)] = params.home_arm_rad
    return posture.robot.at(q)


def _columns(params: ResponseParams, posture: Posture) -> list[int]:
    """Where the arm's joints are in the configuration vector."""
    return posture.robot.indices(posture.robot.names.arm(params.side))


def _angles_from_home(params: ResponseParams, posture: Posture) -> Array:
    """(k,) rad."""
    return np.asarray(posture.q_rad[_columns(params, posture)] - params.home_arm_rad)
