"""Stereo pairs of matt balls in a room of smooth colours, ray cast: the tests of the tracker need no renderer."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pps_vision.experiments.films.raycast import ball_row, first_hits, panel_row
from pps_vision.geometry.camera import Camera, StereoRig, View
from pps_vision.types import Array, Image, StereoFrame

ROOM_M = 1.5
"""Half the side of the cubic room."""
_AXES = ROOM_M * np.eye(3)
_WALLS = np.array(  # larger than the sides, so that no ray passes between them
    [panel_row(sign * _AXES[k], 1.1 * _AXES[k - 1], 1.1 * _AXES[k - 2]) for k in range(3) for sign in (-1, 1)]
)
_FINE = 2  # rays along the side of a pixel that may show a ball
_LAMP = np.array([0.3, 0.4, 0.866])


@dataclass(frozen=True)
class Sphere:
    """A matt ball; `stripes` > 0 paints that many bands on it."""

    center: Array
    radius_m: float
    color: tuple[float, float, float]
    stripes: int = 0


def look(view: View, spheres: list[Sphere], rng: np.random.Generator | None = None, noise: float = 2.0) -> Image:
    """Return the image of one eye, with pixel noise (grey levels) if there is a generator."""
    R = view.T_root_camera[:3, :3].T
    rays = _bearings(view.camera, 1) @ R
    image = _light(view.center, rays, []).reshape(view.camera.height, view.camera.width, 3)
    near = np.zeros(image.shape[:2], bool)
    for sphere in spheres:  # seen under a few pixels more than its radius
        away = sphere.center - view.center
        center_distance = float(np.linalg.norm(away))
        cosine = np.sqrt(max(1 - (1.02 * sphere.radius_m / center_distance + 0.01) ** 2, 0))
        near |= (rays @ away > center_distance * cosine).reshape(near.shape)
    if near.any():
        fine = _bearings(view.camera, _FINE).reshape(near.shape[0], _FINE, near.shape[1], _FINE, 3).swapaxes(1, 2)
        rays = fine[near].reshape(-1, 3) @ R
        image[near] = _light(view.center, rays, spheres).reshape(-1, _FINE**2, 3).mean(axis=1)
    if rng is not None:
        image = image + noise * rng.standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def frame(
    rig: StereoRig, q: Array, spheres: list[Sphere], stamp_s: float, rng: np.random.Generator | None = None
) -> StereoFrame:
    """Return both eyes' images at joints `q`."""
    view = rig.view(q)
    return StereoFrame(look(view.left, spheres, rng), look(view.right, spheres, rng), stamp_s, stamp_s, q, q)


@lru_cache(maxsize=8)
def _bearings(camera: Camera, per_pixel: int) -> Array:
    """Unit vectors (rows × columns, 3) through `n` places along the side of each pixel."""
    v, u = np.mgrid[: camera.height * per_pixel, : camera.width * per_pixel]
    return camera.bearings((np.stack([u, v], axis=-1).reshape(-1, 2) + 0.5) / per_pixel - 0.5)


def _light(eye: Array, rays: Array, spheres: list[Sphere]) -> Array:
    """Grey levels (n, 3) along rays (n, 3)."""
    solids = np.array([*(ball_row(s.center, s.radius_m) for s in spheres), *_WALLS])
    distance, which, surface_normals = first_hits(eye, rays, solids)
    points = eye + distance[:, None] * rays
    light = _wall(points)
    for k, sphere in enumerate(spheres):
        hit = which == k
        normals = surface_normals[hit]
        shade = 0.4 + 0.6 * np.clip(normals @ _LAMP, 0, 1)
        if sphere.stripes:
            shade *= 0.75 + 0.25 * np.sign(np.sin(sphere.stripes * np.pi * normals[:, 0]))
        light[hit] = np.array(sphere.color) * shade[:, None]
    return light


def _wall(points: Array) -> Array:
    """Smooth blotches of brown and grey at points (n, 3) of the walls."""
    x, y, z = points.T
    coarse = np.sin(9 * x + 5 * z + 1.0) * np.sin(8 * y - 6 * z)
    fine = np.sin(31 * x - 23 * y + 11 * z) * np.cos(29 * z + 17 * x)
    level = 105 + 30 * coarse + 25 * fine
    return np.stack([level, 0.9 * level + 6 * coarse, 0.82 * level - 8 * fine], axis=-1)
