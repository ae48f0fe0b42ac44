"""The controllers of the suite by name, and taxel constraints, a baseline of the literature with our perception."""

import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np
from qpsolvers import solve_qp

from control.arm import ArmParams, KeepIn
from control.limits import MAX_HOLD_S
from learning.pps.memory import PPSMemory
from learning.pps.receptive_field import CONE, NEAR, ReceptiveField
from pps_vision.app.encounters import controllers
from pps_vision.app.encounters.controllers import ArmScene, Controller, ControllerParams, HomeReturn
from pps_vision.app.encounters.training import Memories, MemoryName
from pps_vision.errors import InputError
from pps_vision.robot.model import Posture
from pps_vision.types import Array, Track3D

_SOFT = 1e3  # weight of a row's excess in (m/s)² against joint rates in (rad/s)²

NewController = Callable[[ArmScene], Controller]
OURS, TRUE, NONE = "ours", "true positions", "no avoidance"
"""Ours; the upper bound, ours on tracks without error; the lower bound, which never moves."""
ONE, ONE_GATED, GEOMETRY = "constant 1, no gates", "constant 1, gates", "geometry only"
"""Controls that have learned nothing: activation 1 wherever the object is within D and approaches within the horizon,
by itself, with our hand-set gates, and for the taxels near the extrapolated path."""


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
        most = controllers.SPEED_M_S * np.clip(np.where(margin < 0, numbers["gain"] * margin, margin), -1.0, 1.0)
        distance, parting = scene.self_collision.parting(posture.q_rad, arm.near_m, scene.arm)
        sphere = KeepIn(scene.palm, scene.palm_home, controllers.RADIUS_M)
        out, out_m_s = sphere.row(posture, scene.arm)
        rows = np.vstack([outwards, -parting, out])
        limits = np.concatenate([most, (distance - arm.clearance_m) / MAX_HOLD_S, [out_m_s]])
        rates = nearest_rates(pull[scene.arm], controllers.room(scene, posture), rows, limits)
        return controllers.on_arm(scene, np.where(np.abs(rates) < 1e-6, 0.0, rates))

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
    OURS: Entry(controllers.ours),
    ONE: Entry(controllers.ours, "constant"),
    ONE_GATED: Entry(controllers.gated, "constant"),
    GEOMETRY: Entry(partial(controllers.geometry_only, numbers=TUNED[GEOMETRY]), "constant"),
    "R eq. 6": Entry(partial(controllers.paper, numbers=TUNED["R eq. 6"]), "of_both"),
    "taxel constraints": Entry(partial(taxel_constraints, numbers=TUNED["taxel constraints"]), "of_both"),
    NONE: Entry(controllers.at_rest),
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
