"""The controllers of the arm by name: ours, R's own, and baselines of the literature with our perception.

A controller is one function of (activations (n,) of the arm's taxels, track, posture) that returns joint rates
(n_joints,) rad/s. `pps-vision encounters --controller MODULE:FUNCTION` adds another one: FUNCTION is given an
`ArmScene` at the start of each encounter and returns the controller for it.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from qpsolvers import solve_qp

from control import avoidance
from control.arm import ArmParams, KeepIn
from control.avoidance import HORIZON_S, ArmInput, ArmState, AvoidanceParams, control_point
from control.differential_kinematics import rate_limits, solve_rates
from control.limits import MAX_HOLD_S, LimitParams
from learning.pps.memory import PPSMemory
from learning.pps.receptive_field import CONE, NEAR, ReceptiveField
from pps_vision.app.encounters.training import Memories, MemoryName
from pps_vision.app.simulation import Side
from pps_vision.errors import InputError
from pps_vision.geometry.paths import passing_distances
from pps_vision.robot.bare_links import BareLinks
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, Track3D

Controller = Callable[[Array, Track3D, Posture], Array]
"""Joint rates (n_joints,) rad/s of activations (n,), track and posture."""
ControllerParams = Mapping[str, Any]  # parameters of a controller by name
SPEED_M_S = 0.10  # speed of the control point (R), the same for all controllers
RADIUS_M = 0.20  # radius of the palm's sphere about its start (R)
GATE_M = 0.05, 0.01
"""An engineer's gates: largest distance from the skin at which the object's path passes, least approach."""
_HISTORY_S = 0.5  # within which the object must have approached
_DAMPING_M = 0.003
_RETURN_PER_S = 3.0
_AT_HOME_RAD = np.deg2rad(0.2)
_SOFT = 1e3  # weight of a row's excess in (m/s)² against joint rates in (rad/s)²
OURS, TRUE, NONE = "ours", "true positions", "no avoidance"
"""Ours; the upper bound, ours on tracks without error; the lower bound, which never moves."""
ONE, ONE_GATED, GEOMETRY = "constant 1, no gates", "constant 1, gates", "geometry only"
"""Controls that have learned nothing: activation 1 wherever the object is within D and approaches within the horizon,
by itself, with our hand-set gates, and for the taxels near the extrapolated path."""


@dataclass(frozen=True)
class ArmScene:
    """Robot, arm and memory of an encounter, given to a controller at its start."""

    robot: Robot  # kinematics
    skin: Skin  # the arm's n taxels
    side: Side  # the arm
    home_rad: Array  # (n_joints,) posture at the start
    self_collision: SelfCollision  # distances of the robot's bodies
    hold_s: float = MAX_HOLD_S
    """Time for which a command may be held; a short one lets a joint come to its limit sooner."""

    @cached_property
    def arm(self) -> list[int]:
        """Indices of the arm's joints in the configuration vector."""
        return self.robot.indices(self.robot.names.arm(self.side))

    @cached_property
    def palm(self) -> str:
        """The arm's palm frame."""
        return self.robot.names.palm(self.side)

    @cached_property
    def palm_home(self) -> Array:
        """(3,) m, position of the palm at the start."""
        return self.robot.at(self.home_rad).point(self.palm)


NewController = Callable[[ArmScene], Controller]


def ours(scene: ArmScene, numbers: ControllerParams | None = None) -> Controller:
    """Return the controller of the closed loop: R eq. 6 for every active taxel, a quadratic programme with all limits.

    `numbers`: parameters that differ from the defaults.
    """
    home = tuple(scene.home_rad[scene.arm].tolist())
    params = replace(AvoidanceParams(home, scene.side, radius_m=RADIUS_M), **(numbers or {}))
    body = scene.self_collision, BareLinks(scene.robot, scene.skin, scene.side)
    state = ArmState()

    def act(activations: Array, track: Track3D, posture: Posture) -> Array:
        nonlocal state
        arm = ArmInput(track.stamp_s, posture, scene.skin, activations, track, scene.hold_s, *body)
        state, response = avoidance.step(params, state, arm)
        return response.command.dq_rad_s

    return act


def at_rest(scene: ArmScene) -> Controller:
    """Return the controller that never moves the arm."""
    return lambda activations, track, posture: np.zeros(scene.robot.n_joints)


def paper(scene: ArmScene, numbers: ControllerParams, sign: float = -1.0) -> Controller:
    """Return R's own controller: eq. 6, a Cartesian controller, the response lasting and the arm going home.

    An activation of 1 gives 10 cm/s (R Fig 10). `numbers`: threshold; confirmation_s, persist_s; `sign`: −1 to avoid,
    1 to reach.
    """
    active_since_s = np.inf
    home = HomeReturn(scene)
    last: tuple[float, str, Array, Array] | None = None

    def act(activations: Array, track: Track3D, posture: Posture) -> Array:
        nonlocal active_since_s, last
        t = track.stamp_s
        point = control_point(numbers["threshold"], posture, scene.skin, activations)
        active_since_s = np.inf if point is None else min(active_since_s, t)
        if point is not None and t - active_since_s >= numbers["confirmation_s"] - 1e-9:
            frame, position, direction = point
            last = t, frame, position, sign * SPEED_M_S * direction
        if last is not None and t - last[0] <= numbers["persist_s"] + 1e-9:
            home.left = True
            return move_point(scene, posture, *last[1:])
        return home.pull(posture)

    return act


def geometry_only(scene: ArmScene, numbers: ControllerParams) -> Controller:
    """Return our controller of the taxels that the object's extrapolated path passes near.

    `numbers`: margin_m, the largest distance from the object's surface there to the taxel's centre.
    """
    of_activations = ours(scene)

    def act(activations: Array, track: Track3D, posture: Posture) -> Array:
        if track.is_known:
            path = track.position, track.velocity, HORIZON_S
            miss = passing_distances(scene.skin.at(posture)[0], *path) - track.radius_m
            activations = np.where(miss < numbers["margin_m"], activations, 0.0)
        return of_activations(activations, track, posture)

    return act


def gated(scene: ArmScene) -> Controller:
    """Return our controller behind an engineer's gates: an arm that does not move responds only to an object that has
    come nearer by 1 cm within half a second, on a path that passes within 5 cm of the skin (`GATE_M`)."""
    of_activations = ours(scene)
    seen: list[tuple[float, Array]] = []
    is_moving = False

    def threatens(track: Track3D, taxels: Array) -> bool:
        seen[:] = [s for s in seen if s[0] >= track.stamp_s - _HISTORY_S - 1e-9] + [(track.stamp_s, track.position)]
        distance = [np.linalg.norm(position - taxels, axis=1).min() for _, position in seen]
        since_s, farthest = seen[k := int(np.argmax(distance))]
        if distance[k] - distance[-1] < GATE_M[1]:
            return False
        velocity = (track.position - farthest) / (track.stamp_s - since_s)
        miss = passing_distances(taxels, track.position, velocity, HORIZON_S).min() - track.radius_m
        return bool(miss < GATE_M[0])

    def act(activations: Array, track: Track3D, posture: Posture) -> Array:
        nonlocal is_moving
        if track.is_known and not (threatens(track, scene.skin.at(posture)[0]) or is_moving):
            activations = np.zeros_like(activations)
        rates = of_activations(activations, track, posture)
        is_moving = bool(rates.any())
        return rates

    return act


def move_point(scene: ArmScene, posture: Posture, frame: str, point: Array, velocity: Array) -> Array:
    """Return the joint rates that move a point of a frame, by damped least squares within the joints' limits.

    The palm's velocity out of its sphere is taken away first.
    """
    offset = posture.point(scene.palm) - scene.palm_home
    distance = float(np.linalg.norm(offset))
    if distance >= RADIUS_M and offset @ velocity > 0:
        velocity = velocity - (offset @ velocity) * offset / distance**2
    J = posture.jacobian(frame, point)[:3, scene.arm]
    return on_arm(scene, solve_rates(J, velocity, np.zeros(len(scene.arm)), _DAMPING_M, room(scene, posture)))


@dataclass
class HomeReturn:
    """The way back to the posture at the start, for an arm that has left it by a response."""

    scene: ArmScene  # robot and arm
    per_s: float = _RETURN_PER_S  # rate of the return, of the angles left
    left: bool = False  # whether the arm has responded and is not back

    def pull(self, posture: Posture) -> Array:
        """Return joint rates (n_joints,) towards home, the palm at most at the speed of a response."""
        scene = self.scene
        away = scene.home_rad[scene.arm] - posture.q_rad[scene.arm]
        self.left = self.left and bool(np.abs(away).max() > _AT_HOME_RAD)
        if not self.left:
            return np.zeros(scene.robot.n_joints)
        rates = self.per_s * away
        speed = np.linalg.norm(posture.jacobian(scene.palm)[:3, scene.arm] @ rates)
        return on_arm(scene, rates / max(speed / SPEED_M_S, np.abs(rates).max() / LimitParams().joint_rad_s, 1.0))


def room(scene: ArmScene, posture: Posture) -> tuple[Array, Array]:
    """Return the lowest and highest rates (k,) of the arm's joints."""
    lower = scene.robot.lower_rad[scene.arm]
    upper = scene.robot.upper_rad[scene.arm]
    return rate_limits(posture.q_rad[scene.arm], lower, upper, LimitParams().joint_rad_s, 1 / scene.hold_s)


def on_arm(scene: ArmScene, rates: Array) -> Array:
    """Return the rates of all joints (n_joints,): the arm's (k,), the others 0."""
    dq = np.zeros(scene.robot.n_joints)
    dq[scene.arm] = rates
    return dq


def taxel_constraints(scene: ArmScene, numbers: ControllerParams) -> Controller:
    """Return a quadratic programme after HARMONIOUS (Rozlivek et al. 2023): every taxel is a constraint.

    The joint rates nearest to the return home such that no taxel moves outwards faster than V·(θ − a)/θ along its
    normal; above the threshold θ it has to withdraw. `numbers`: threshold, gain (of the withdrawal), home_per_s.
    """
    threshold = numbers["threshold"]
    arm = ArmParams()
    home = HomeReturn(scene, numbers["home_per_s"])

    def act(activations: Array, track: Track3D, posture: Posture) -> Array:
        home.left = home.left or bool((activations > threshold).any())
        if not home.left:
            return np.zeros(scene.robot.n_joints)
        pull = home.pull(posture)
        _, normals = scene.skin.at(posture)
        outwards = np.einsum("ndk,nd->nk", scene.skin.jacobians(posture, scene.arm), normals)
        margin = (threshold - activations) / threshold
        most = SPEED_M_S * np.clip(np.where(margin < 0, numbers["gain"] * margin, margin), -1.0, 1.0)
        distance, parting = scene.self_collision.parting(posture.q_rad, arm.near_m, scene.arm)
        sphere = KeepIn(scene.palm, scene.palm_home, RADIUS_M)
        out, out_m_s = sphere.row(posture, scene.arm)
        rows = np.vstack([outwards, -parting, out])
        limits = np.concatenate([most, (distance - arm.clearance_m) / MAX_HOLD_S, [out_m_s]])
        rates = nearest_rates(pull[scene.arm], room(scene, posture), rows, limits)
        return on_arm(scene, np.where(np.abs(rates) < 1e-6, 0.0, rates))

    return act


def nearest_rates(wanted: Array, room: tuple[Array, Array], rows: Array, most: Array) -> Array:
    """Return the rates x (k,) within `room` that minimise ‖x − wanted‖² + w‖s‖² with rows x ≤ most + s, s ≥ 0.

    Taxels may have to withdraw in ways that exclude each other, so the rows are soft; the limits are not.
    """
    k = len(wanted)
    m = len(rows)
    H = np.diag(np.r_[np.ones(k), np.full(m, _SOFT)])
    g = np.r_[-wanted, np.zeros(m)]
    lower = np.r_[room[0], np.zeros(m)]
    upper = np.r_[room[1], np.full(m, np.inf)]
    x = solve_qp(H, g, np.hstack([rows, -np.eye(m)]), most, lb=lower, ub=upper, solver="daqp")
    if x is None:
        raise RuntimeError(f"no rates for {wanted}, limits {room}, rows {rows.tolist()} of at most {most}")
    return np.clip(x[:k], *room)


class Entry(NamedTuple):
    """A controller, and the memory whose activations it is given."""

    new: NewController
    memory: MemoryName = "probability"

    def memory_of(self, memories: Memories) -> PPSMemory:
        """Return the memory whose activations it is given."""
        memory: PPSMemory = getattr(memories, self.memory)
        return memory

    @property
    def field(self) -> ReceptiveField:
        """The receptive field of its memory."""
        return CONE if self.memory in ("of_both", "of_distance") else NEAR


TUNED: dict[str, ControllerParams] = {
    "R eq. 6": {"threshold": 0.4203, "confirmation_s": 0.1306, "persist_s": 0.3889},
    "taxel constraints": {"threshold": 0.5284, "gain": 13.8, "home_per_s": 0.6069},
    GEOMETRY: {"margin_m": 0.03},
}
"""Parameters of the baselines: the best of the part `tuning` of `bench encounters`."""
CONTROLLERS = {
    OURS: Entry(ours),
    ONE: Entry(ours, "constant"),
    ONE_GATED: Entry(gated, "constant"),
    GEOMETRY: Entry(partial(geometry_only, numbers=TUNED[GEOMETRY]), "constant"),
    "R eq. 6": Entry(partial(paper, numbers=TUNED["R eq. 6"]), "of_both"),
    "taxel constraints": Entry(partial(taxel_constraints, numbers=TUNED["taxel constraints"]), "of_both"),
    NONE: Entry(at_rest),
}
"""The controllers of the command; the studies have more."""


def controller(name: str) -> Entry:
    """Return one of `CONTROLLERS`, or that of "MODULE:FUNCTION"; InputError if there is none."""
    if name in CONTROLLERS:
        return CONTROLLERS[name]
    _imported(name)  # refuse an unknown one at once
    return Entry(partial(_plugged_in, name))


def _plugged_in(name: str, scene: ArmScene) -> Controller:
    return _imported(name)(scene)  # anew, in whichever process an encounter is simulated


def _imported(name: str) -> NewController:
    module, _, function = name.partition(":")
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)  # last, so that no file of the user's replaces a library
    try:
        imported: NewController = getattr(import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        expected = f"expected MODULE:FUNCTION that can be imported, or one of {', '.join(CONTROLLERS)}"
        raise InputError("controller", f"{name!r}: {error}; {expected}") from error
    return imported
