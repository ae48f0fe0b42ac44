"""Exact images of the rendered room by ray casting: no triangles, no textures in levels, no OpenGL. Slow.

It draws the scene of `rendering` (its room, lamps and robot), to compare the renderer with.
"""

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import map_coordinates

from pps_vision.experiments.films.raycast import ball_row, cylinder_row, first_hits, panel_row
from pps_vision.geometry.camera import View
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask
from rendering.renderer import diffuse_light
from rendering.room import atlas, room_surface
from rendering.scene import SceneState
from rendering.shapes import Color


def ray_cast(
    robot: Robot,
    view: View,
    state: SceneState,
    radius_m: float,
    color: Color,
    samples: int = 4,
    where: Mask | None = None,
) -> Array:
    """Return the light (height, width, 3), grey levels of 255, of the room, the robot and a ball.

    Each pixel is the mean of samples² rays; only pixels of `where` (height, width) are cast, the others are 0.
    """
    c = view.camera
    mask = np.ones((c.height, c.width), bool) if where is None else where
    v, u = np.nonzero(mask)
    solids = list(_solids(robot, state, radius_m, color))
    total = np.zeros((c.height, c.width, 3))
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    for du in offsets:
        for dv in offsets:
            total[mask] += _light(view.center, view.rays(np.column_stack([u + du, v + dv])), solids)
    return total / samples**2


def _light(eye: Array, rays: Array, solids: list[tuple[Array, Color | Array]]) -> Array:
    """(n, 3) grey levels of the first solid on each of the rays (n, 3); 0 where they meet nothing."""
    rows = np.array([row for row, _ in solids if not _is_back(row, eye)])
    paints = [paint for row, paint in solids if not _is_back(row, eye)]
    distance, which, normals = first_hits(eye, rays, rows)
    normals *= -np.sign(np.sum(normals * rays, axis=1, keepdims=True))  # towards the eye
    light = np.zeros((len(rays), 3))
    for k in np.unique(which[which >= 0]).tolist():
        hit = which == k
        paint = paints[k]
        diffuse = diffuse_light(normals[hit])[:, None]
        if isinstance(paint, tuple):
            light[hit] = 255 * np.minimum(np.array(paint) * diffuse, 1)
        else:
            at = eye + distance[hit, None] * rays[hit] - rows[k, 1:4]
            along = 0.5 * (1 + at @ rows[k, 4:10].reshape(2, 3).T)
            light[hit] = np.minimum(_texture(paint[0] + along @ (paint[1:] - paint[0])) * diffuse, 255)
    return light


def _is_back(row: Array, eye: Array) -> bool:
    """Whether the eye is behind a panel: its normal points to the back."""
    return bool(row[10:13].any() and row[10:13] @ (row[1:4] - eye) <= 0)


def _solids(robot: Robot, state: SceneState, radius_m: float, color: Color) -> Iterator[tuple[Array, Color | Array]]:
    """Rows of `raycast` with their colour, or texture coordinates (3, 2) of top left, top right and bottom left."""
    if state.position is not None:
        yield ball_row(state.position, radius_m), color
    posture = robot.at(state.q_rad)
    for body in robot.bodies:
        T = posture.T_root(body.frame) @ body.T_frame_body
        if body.shape == "sphere":
            yield ball_row(T[:3, 3], *body.size_m), body.color
        elif body.shape == "cylinder":
            yield cylinder_row(T[:3, 3], T[:3, 2], *body.size_m), body.color
        else:
            half = T[:3, :3] * np.array(body.size_m) / 2
            for k in range(3):
                for sign in (-1, 1):
                    right = half[:, (k + 1) % 3]
                    yield panel_row(T[:3, 3] + sign * half[:, k], right, -sign * half[:, (k + 2) % 3]), body.color
    surface = room_surface()
    if surface.texture_uv is None:
        raise ValueError("the room has no texture; expected a picture on every surface")
    for k in range(0, len(surface.positions), 4):
        first, second, third, last = surface.positions[k : k + 4]
        row = panel_row((first + last) / 2, (second - first) / 2, (third - first) / 2)
        yield row, surface.texture_uv[k : k + 3]


def _texture(uv: Array) -> Array:
    """(n, 3) bilinear samples at places (n, 2), of which v counts from the last row's lower edge up."""
    picture = np.asarray(atlas(), dtype=float)
    height, width = picture.shape[:2]
    places = [height * (1 - uv[:, 1]) - 0.5, width * uv[:, 0] - 0.5]
    return np.column_stack([map_coordinates(channel, places, order=1) for channel in np.moveaxis(picture, 2, 0)])
