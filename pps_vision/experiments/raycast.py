"""The rendered room by ray casting: exact solids and lens, no triangles and no OpenGL.  Slow; to compare with."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import inverse, move_points, transform
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from rendering.light import diffuse_light
from rendering.room import atlas, room_surface
from rendering.scene import SceneState
from rendering.shapes import Color


@dataclass(frozen=True)
class Solid:
    """A sphere (radius,), a cylinder about z (radius, length) or a box (x, y, z), centred at its own origin, m."""

    shape: str
    size_m: tuple[float, ...]
    T_root_solid: Array
    color: Color


def ray_cast(robot: Robot, view: View, state: SceneState, radius_m: float, color: Color, samples: int = 4) -> Array:
    """(height, width, 3) light, grey levels of 255, of the room, the robot and a ball; samples² rays a pixel."""
    c = view.camera
    v, u = np.mgrid[: c.height, : c.width]
    solids = list(_solids(robot, state, radius_m, color))
    total = np.zeros((c.height * c.width, 3))
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    for du in offsets:
        for dv in offsets:
            rays = view.rays(np.stack([u + du, v + dv], axis=-1).reshape(-1, 2))
            total += _light_along(view.center, rays, solids)
    return total.reshape(c.height, c.width, 3) / samples**2


def _solids(robot: Robot, state: SceneState, radius_m: float, color: Color) -> Iterator[Solid]:
    posture = robot.at(state.q_rad)
    for body in robot.bodies:
        T_root_body = posture.T_root(body.frame) @ body.T_frame_body
        yield Solid(body.shape, tuple(body.size_m), T_root_body, body.color)
    if state.position is not None:
        yield Solid("sphere", (radius_m,), transform(translation=state.position), color)


def _light_along(origin: Array, rays: Array, solids: list[Solid]) -> Array:
    """(n, 3) what comes along rays (n, 3) into a point."""
    nearest, light = _room(origin, rays)
    for solid in solids:
        T = inverse(solid.T_root_solid)
        o, reach = move_points(T, origin), float(np.linalg.norm(solid.size_m))  # no point is farther from its centre
        far = float(np.linalg.norm(o))
        cosine = float(np.sqrt(1 - (reach / far) ** 2)) if far > reach else -1.0
        near = np.flatnonzero(rays @ (solid.T_root_solid[:3, 3] - origin) >= cosine * far)
        distance, normals = _first_hit(solid, o, rays[near] @ T[:3, :3].T)
        hit = distance < nearest[near]
        normals_root = normals[hit] @ solid.T_root_solid[:3, :3].T
        nearest[near[hit]] = distance[hit]
        light[near[hit]] = 255 * np.minimum(np.array(solid.color) * diffuse_light(normals_root)[:, None], 1)
    return light


def _first_hit(solid: Solid, o: Array, d: Array) -> tuple[Array, Array]:
    """Distance (n,), inf where none, and outward normal (n, 3) at the first hit, in the solid's coordinates.

    A convex solid is an intersection of slabs, a sphere or an infinite cylinder: a ray is inside between its last
    entry and its first exit.
    """
    if solid.shape == "box":
        parts = [_slab(o, d, axis, size / 2) for axis, size in enumerate(solid.size_m)]
    elif solid.shape == "cylinder":
        parts = [_round(o, d, solid.size_m[0], np.array([1.0, 1.0, 0.0])), _slab(o, d, 2, solid.size_m[1] / 2)]
    else:
        parts = [_round(o, d, solid.size_m[0], np.ones(3))]
    entries, exits, normals = (np.stack(part) for part in zip(*parts, strict=True))
    last = entries.argmax(axis=0)
    entry = entries.max(axis=0)
    entry[~((entry < exits.min(axis=0)) & (entry > 0))] = np.inf
    return entry, np.take_along_axis(normals, last[None, :, None], axis=0)[0]


def _round(o: Array, d: Array, radius: float, axes: Array) -> tuple[Array, Array, Array]:
    """Entry, exit and entry normal of a sphere, or of a cylinder without ends where `axes` leaves one out."""
    a, b, c = (axes * d * d).sum(axis=1), (axes * d * o).sum(axis=1), float(axes @ (o * o)) - radius**2
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(b * b - a * c)
        entry, leave = (-b - root) / a, (-b + root) / a
        missed = ~(b * b >= a * c)
        entry[missed], leave[missed] = np.inf, -np.inf
        normals = axes * (o + np.where(missed, 0, entry)[:, None] * d) / radius
    return entry, leave, normals


def _slab(o: Array, d: Array, axis: int, half: float) -> tuple[Array, Array, Array]:
    """The same between two planes across an axis."""
    with np.errstate(divide="ignore"):
        one, other = (-half - o[axis]) / d[:, axis], (half - o[axis]) / d[:, axis]
    normals = np.zeros_like(d)
    normals[:, axis] = -np.sign(d[:, axis])
    return np.minimum(one, other), np.maximum(one, other), normals


def _room(origin: Array, rays: Array) -> tuple[Array, Array]:
    """Distance (n,) and light (n, 3) of the room's surfaces, rectangles of four corners each."""
    surface, picture = room_surface(), atlas().astype(float)
    nearest, light = np.full(len(rays), np.inf), np.zeros((len(rays), 3))
    if surface.texture_uv is None:
        raise ValueError("the room has no texture; expected a picture on every surface")
    for k in range(0, len(surface.positions), 4):
        (corner, right, below, _), normal = surface.positions[k : k + 4], surface.normals[k]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (normal @ (corner - origin)) / (rays @ normal)
            place = origin + distance[:, None] * rays - corner
            along = np.column_stack([place @ side / (side @ side) for side in (right - corner, below - corner)])
            inside = np.all(np.abs(along - 0.5) <= 0.5, axis=1)
        hit = (distance > 0) & (distance < nearest) & (rays @ normal < 0) & inside
        uv = surface.texture_uv[k : k + 3]
        in_texture = uv[0] + along[hit] @ (uv[1:] - uv[0])
        nearest[hit] = distance[hit]
        light[hit] = np.minimum(_texture(picture, in_texture) * diffuse_light(normal[None]), 255)
    return nearest, light


def _texture(picture: Array, uv: Array) -> Array:
    """(n, 3) bilinear samples at places (n, 2), of which v counts from the last row's lower edge up."""
    height, width = picture.shape[:2]
    x, y = width * uv[:, 0] - 0.5, height * (1 - uv[:, 1]) - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    a, b = (x - left)[:, None], (y - top)[:, None]
    upper = (1 - a) * picture[top, left] + a * picture[top, left + 1]
    lower = (1 - a) * picture[top + 1, left] + a * picture[top + 1, left + 1]
    return (1 - b) * upper + b * lower
