"""Controllers of the arm from the literature, with the same perception as ours: potential field, depth-space
repulsion."""

import numpy as np

from pps_vision.app.encounters.registry import (
    SPEED_M_S,
    ArmScene,
    Controller,
    ControllerParams,
    HomeReturn,
    move_point,
    on_arm,
    room,
)
from pps_vision.robot.model import Posture
from pps_vision.types import Array, Track3D

_SHAPE = 6.0  # Flacco et al. 2012: steepness of the repulsion
_SAMPLES = 24  # points of the object's surface
_FIBONACCI = np.pi * (3 - np.sqrt(5))


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


def _unit(vector: Array) -> Array:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9))
