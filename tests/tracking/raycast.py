"""An independent scene: textured room and shaded spheres, cast ray by ray, no renderer involved."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pps_vision.geometry.camera import Camera, StereoRig, View
from pps_vision.types import Array, Image, StereoFrame

SUPERSAMPLING = 2
ROOM_M = 1.5  # half the side of the cubic room


@dataclass(frozen=True)
class Sphere:
    """A matt ball; `stripes` > 0 paints that many bands on it."""

    center: Array
    radius_m: float
    color: tuple[float, float, float]
    stripes: int = 0


@lru_cache(maxsize=8)
def _directions(camera: Camera, per_pixel: int) -> Array:
    v, u = np.mgrid[: camera.height * per_pixel, : camera.width * per_pixel]
    pixels = (np.stack([u, v], axis=-1) + 0.5) / per_pixel - 0.5
    return camera.bearings(pixels).astype(np.float32)


def _room(points: Array) -> Array:
    """A colour for every point of the walls: smooth blotches, brown and grey."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    coarse = np.sin(9 * x + 5 * z + 1.0) * np.sin(8 * y - 6 * z)
    fine = np.sin(31 * x - 23 * y + 11 * z) * np.cos(29 * z + 17 * x)
    level = 105 + 30 * coarse + 25 * fine
    return np.stack([level, 0.9 * level + 6 * coarse, 0.82 * level - 8 * fine], axis=-1)


def look(view: View, spheres: list[Sphere], rng: np.random.Generator | None = None, noise: float = 2.0) -> Image:
    """What one eye sees; `noise` in grey levels.  The walls are smooth: one ray a pixel will do for them."""
    R, o = view.T_root_camera[:3, :3].T.astype(np.float32), view.center.astype(np.float32)
    d = _directions(view.camera, 1) @ R
    with np.errstate(divide="ignore"):
        reach = np.where(d > 0, (ROOM_M - o) / d, (-ROOM_M - o) / d).min(axis=-1)
    image = _room(o + reach[..., None] * d)
    near = np.zeros(image.shape[:2], bool)
    for s in spheres:  # seen under a few pixels more than its radius
        to = s.center.astype(np.float32) - o
        near |= d @ to > np.sqrt(max(to @ to - (1.02 * s.radius_m + 0.01 * np.sqrt(to @ to)) ** 2, 0))
    if near.any():
        rows, cols = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
        top, bottom, left, right, k = rows[0], rows[-1] + 1, cols[0], cols[-1] + 1, SUPERSAMPLING
        fine = image[top:bottom, left:right].repeat(k, axis=0).repeat(k, axis=1)
        rays = _directions(view.camera, k)[k * top : k * bottom, k * left : k * right] @ R
        _paint(fine, rays, o, spheres)
        image[top:bottom, left:right] = fine.reshape(bottom - top, k, right - left, k, 3).mean(axis=(1, 3))
    if rng is not None:
        image = image + noise * rng.standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _paint(image: Array, d: Array, o: Array, spheres: list[Sphere]) -> None:
    """The spheres, the farthest first, as seen from `o` along the rays `d`."""
    for s in sorted(spheres, key=lambda one: -float(np.linalg.norm(one.center - o))):
        gap = o - s.center.astype(np.float32)
        b = d @ gap
        under = b * b - (gap @ gap - s.radius_m**2)
        hit = under > 0
        normal = (gap + (-b[hit] - np.sqrt(under[hit]))[:, None] * d[hit]) / s.radius_m
        shade = 0.4 + 0.6 * np.clip(normal @ np.array([0.3, 0.4, 0.866], np.float32), 0, 1)
        if s.stripes:
            shade = shade * (0.75 + 0.25 * np.sign(np.sin(s.stripes * np.pi * normal[:, 0])))
        image[hit] = np.array(s.color, np.float32) * shade[:, None]


def frame(
    rig: StereoRig, q: Array, spheres: list[Sphere], stamp_s: float, rng: np.random.Generator | None = None
) -> StereoFrame:
    """Both eyes at joints `q`."""
    view = rig.view(q)
    return StereoFrame(look(view.left, spheres, rng), look(view.right, spheres, rng), stamp_s, stamp_s, q, q)
