"""The controllers of the suite by name, and the baselines of the literature with the same perception: potential field,
depth-space repulsion, taxel constraints."""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np
from qpsolvers import solve_qp

from control.arm import ArmParams, KeepIn
from control.limits import MAX_HOLD_S
from learning.pps.memory import PPSMemory
from learning.pps.receptive_field import CONE, NEAR, ReceptiveField
from pps_vision.app.encounters.controllers import (
    RADIUS_M,
    SPEED_M_S,
    ArmScene,
    Controller,
    ControllerParams,
    HomeReturn,
    gated,
    geometry_only,
    move_point,
    on_arm,
    ours,
    paper,
    room,
)
from pps_vision.app.encounters.training import Memories, MemoryName
from pps_vision.errors import InputError
from pps_vision.robot.model import Posture
from pps_vision.types import Array, Track3D

_SOFT = 1e3  # weight of a row's excess in (m/s)² against joint rates in (rad/s)²
_SHAPE = 6.0  # Flacco et al. 2012: steepness of the repulsion
_SAMPLES = 24  # points of the object's surface
_FIBONACCI = np.pi * (3 - np.sqrt(5))

NewController = Callable[[ArmScene], Controller]
OURS, TRUE, NONE = "ours", "true positions", "no avoidance"
"""Ours; the upper bound, ours on tracks without error; the lower bound, which never moves."""
WRIST_AT_REST = "ours, wrist at rest"
"""The three joints of the wrist at rest, as R's robot moved."""
R_MAP = "ours, R's map"
"""Our controller on the activations of R's 8 × 4 map, which does not know the path."""
ONE, ONE_GATED, GEOMETRY = "constant 1, no gates", "constant 1, gates", "geometry only"
"""Controls that have learned nothing: activation 1 wherever the object is within D and approaches within the horizon,
by itself, with our hand-set gates, and for the taxels near the extrapolated path."""
UNLEARNED = (ONE, ONE_GATED, GEOMETRY)
MEMORY_OF: dict[str, MemoryName] = {
    "distance only": "of_distance",
    **dict.fromkeys((R_MAP, "R eq. 6", "taxel constraints"), "of_both"),
    **dict.fromkeys(UNLEARNED, "constant"),
}
"""The memory whose activations a controller is given; default: the probability of touch."""
REACHING = (OURS, "R eq. 6", "distance only", TRUE)
"""Controllers that can reach as well."""


def potential_field(scene: ArmScene, numbers: ControllerParams) -> Controller:
    """Return Khatib's (1986) potential field: every taxel nearer to the object than ρ₀ is pushed away from it.

    f = (1/ρ − 1/ρ₀)/ρ² along the distance ρ of surface and taxel, q̇ ∝ Σ Jᵀf towards and an attraction home; the
    fastest taxel moves at most at 10 cm/s. `numbers`: range_m (ρ₀), gain, home_per_s.
    """
    range_m = numbers["range_m"]
    home = HomeReturn(scene, numbers["home_per_s"])

    def act(activations: Array, track: Track3D, posture: Posture) -> Array:
        pull = home.pull(posture)
        if not track.is_known:
            return pull
        positions, _ = scene.skin.at(posture)
        d = positions - track.position
        distance = np.linalg.norm(d, axis=1)
        rho = np.maximum(distance - track.radius_m, 0.005)
        force = np.where(rho < range_m, (1 / rho - 1 / range_m) / rho**2, 0.0)[:, None] * d / distance[:, None]
        if not force.any():
            return pull
        home.left = True
        J = scene.skin.jacobians(posture, scene.arm)
        rates = numbers["gain"] * np.einsum("ndk,nd->k", J, force)
        fastest = float(np.linalg.norm(J @ rates, axis=1).max())
        rates = rates * min(1.0, SPEED_M_S / max(fastest, 1e-9))
        rates = rates + pull[scene.arm] * max(0.0, 1 - fastest / SPEED_M_S)
        return on_arm(scene, np.clip(rates, *room(scene, posture)))

    return act


def depth_space(scene: ArmScene, numbers: ControllerParams) -> Controller:
    """Return the repulsion of Flacco et al. (2012) in the left eye's depth space.

    The object also occupies the space that it occludes: a surface point in front of a taxel counts at the taxel's
    depth. The nearest taxel is moved along the mean direction at V/(1 + e^{(2D/ρ − 1)α}); joints that move other taxels
    towards the object are slowed. If the object follows, the direction turns aside by a share. `numbers`: range_m (ρ),
    aside.
    """
    k = np.arange(_SAMPLES) + 0.5
    polar = np.arccos(1 - 2 * k / _SAMPLES)
    azimuth = _FIBONACCI * k
    sphere = np.column_stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    range_m = numbers["range_m"]
    home = HomeReturn(scene)

    def act(activations: Array, track: Track3D, posture: Posture) -> Array:
        pull = home.pull(posture)
        if not track.is_known:
            return pull
        T = posture.T_root(scene.robot.names.left_eye)
        taxels = (scene.skin.at(posture)[0] - T[:3, 3]) @ T[:3, :3]
        center = (track.position - T[:3, 3]) @ T[:3, :3]
        surface = center + max(track.radius_m, 0.001) * sphere
        surface = surface[(surface - center) @ center < 0]
        stretched = np.maximum(taxels[:, 2, None] / surface[None, :, 2], 1.0)  # or farther along their rays
        away = taxels[:, None] - surface[None] * stretched[:, :, None]
        distance = np.linalg.norm(away, axis=2)
        nearest = distance.min(axis=1)
        strength = 1 / (1 + np.exp(np.minimum((2 * nearest / range_m - 1) * _SHAPE, 50.0)))
        most = int(strength.argmax())
        if nearest[most] > range_m:
            return pull
        home.left = True
        near = distance[most] < range_m
        direction = _unit((away[most][near] / distance[most][near][:, None]).mean(axis=0))
        direction = T[:3, :3] @ direction
        if direction @ track.velocity > 0:
            across = direction - (direction @ track.velocity) * track.velocity / float(track.velocity @ track.velocity)
            direction = _unit((1 - numbers["aside"]) * direction + numbers["aside"] * _unit(across))
        frame = scene.skin.parts[scene.skin.part_index[most]].frame
        point = np.concatenate([part.positions_m for part in scene.skin.parts])[most]
        rates = move_point(scene, posture, frame, point, SPEED_M_S * strength[most] * direction)[scene.arm]
        closest = away[np.arange(len(away)), distance.argmin(axis=1)] @ T[:3, :3].T
        towards = -np.einsum("ndk,nd->nk", scene.skin.jacobians(posture, scene.arm), closest)
        slowed = 1 - strength[:, None]
        slowest, fastest = room(scene, posture)
        slowest = np.where(towards < 0, slowed * slowest, slowest).max(axis=0)
        fastest = np.where(towards > 0, slowed * fastest, fastest).min(axis=0)
        rates = np.clip(rates, np.minimum(slowest, fastest), np.maximum(slowest, fastest))
        return on_arm(scene, rates)

    return act


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


def _unit(vector: Array) -> Array:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9))


class Baseline(NamedTuple):
    """A baseline and the ranges that its parameters are drawn from; `TUNED` has their values."""

    new: Callable[[ArmScene, ControllerParams], Controller]
    ranges: Mapping[str, tuple[float, float]]  # uniform, the logarithm of `gain`


TUNED: dict[str, dict[str, float]] = {
    "R eq. 6": {"threshold": 0.4203, "confirmation_s": 0.1306, "persist_s": 0.3889},
    "distance only": {"threshold": 0.4319, "confirmation_s": 0.1949, "persist_s": 0.5954},
    "potential field": {"range_m": 0.06314, "gain": 0.009452, "home_per_s": 1.112},
    "depth space": {"range_m": 0.08746, "aside": 0.2517},
    "taxel constraints": {"threshold": 0.5284, "gain": 13.8, "home_per_s": 0.6069},
    GEOMETRY: {"margin_m": 0.03},
}
"""Parameters of the baselines: the best of the part `tuning` of `bench encounters`."""
_OF_ACTIVATION = {"threshold": (0.2, 0.7), "confirmation_s": (0.0, 0.2), "persist_s": (0.0, 0.6)}
_HOME_PER_S = (0.3, 3.0)
BASELINES = {
    "R eq. 6": Baseline(paper, _OF_ACTIVATION),
    "distance only": Baseline(paper, _OF_ACTIVATION),
    "potential field": Baseline(
        potential_field, {"range_m": (0.05, 0.3), "gain": (1e-4, 1e-1), "home_per_s": _HOME_PER_S}
    ),
    "depth space": Baseline(depth_space, {"range_m": (0.05, 0.3), "aside": (0.0, 1.0)}),
    "taxel constraints": Baseline(
        taxel_constraints, {"threshold": (0.2, 0.7), "gain": (0.5, 20.0), "home_per_s": _HOME_PER_S}
    ),
}
_OURS_RANGES = {
    "threshold": (0.2, 0.7),
    "confirmation_s": (0.0, 0.3),
    "escape_clearance_m": (0.0, 0.1),
    "persist_s": (0.0, 0.6),
}
TUNABLE = {
    **BASELINES,
    GEOMETRY: Baseline(geometry_only, {"margin_m": (0.0, 0.1)}),
    OURS: Baseline(lambda scene, numbers: ours(scene, numbers=numbers), _OURS_RANGES),
}
"""Controllers of the random search; ours is measured with its defaults."""
NAMES = (OURS, *UNLEARNED, *BASELINES, TRUE, NONE)


def memory_of(name: str, memories: Memories) -> PPSMemory:
    """Return the memory whose activations a controller is given."""
    memory: PPSMemory = getattr(memories, MEMORY_OF.get(name.partition("#")[0], "probability"))
    return memory


def field_of(name: str) -> ReceptiveField:
    """Return the receptive field of a controller's memory."""
    return CONE if MEMORY_OF.get(name.partition("#")[0]) in ("of_both", "of_distance") else NEAR


def new_controller(name: str, numbers: ControllerParams | None = None) -> NewController:
    """Return the maker of a controller: one of `NAMES`, of a baseline with other `numbers`, or "MODULE:FUNCTION";
    InputError if there is none."""
    if name in (OURS, TRUE, ONE, R_MAP):
        return lambda scene: ours(scene, numbers=numbers)
    if name == ONE_GATED:
        return gated
    if name == WRIST_AT_REST:
        return lambda scene: ours(scene, resting=3)
    if name == NONE:
        return lambda scene: lambda activations, track, posture: np.zeros(scene.robot.n_joints)
    if name in TUNED:
        baseline = TUNABLE[name]
        params = numbers or TUNED[name]
        return lambda scene: baseline.new(scene, params)
    module, _, function = name.partition(":")
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)  # last, so that no file of the user's replaces a library
    try:
        imported: NewController = getattr(import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        expected = f"expected MODULE:FUNCTION that can be imported, or one of {', '.join(NAMES)}"
        raise InputError("controller", f"{name!r}: {error}; {expected}") from error
    return imported
