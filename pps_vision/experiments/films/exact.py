"""Exact images of the rendered room by ray casting: no triangles, no textures in levels, no OpenGL. Slow.

It draws the scene of `rendering` (its room, lamps and robot), to compare the renderer with.
"""

from collections.abc import Iterator

import numpy as np

from pps_vision.experiments.films.raycast import (
    BALL_COLUMNS,
    CYLINDER_COLUMNS,
    PANEL_COLUMNS,
    ball_row,
    cylinder_normals,
    cylinder_row,
    first_hits,
    panel_row,
)
from pps_vision.geometry.camera import View
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask
from rendering.light import diffuse_light
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
    seen = np.ones((c.height, c.width), bool) if where is None else where
    v, u = np.nonzero(seen)
    scene = _Scene(robot, state, radius_m, color, view.center)
    total = np.zeros((c.height, c.width, 3))
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    for du in offsets:
        for dv in offsets:
            total[seen] += scene.light(view.rays(np.column_stack([u + du, v + dv])))
    return total / samples**2


class _Scene:
    """Everything that rays from one point can meet: solids with colours, and the room's rectangles with pictures."""

    def __init__(self, robot: Robot, state: SceneState, radius_m: float, color: Color, eye: Array) -> None:
        self.eye = eye
        solids: dict[str, list[tuple[Array, Color]]] = {"ball": [], "panel": [], "cylinder": []}
        if state.position is not None:
            solids["ball"].append((ball_row(state.position, radius_m), color))
        posture = robot.at(state.q_rad)
        for body in robot.bodies:
            T = posture.T_root(body.frame) @ body.T_frame_body
            if body.shape == "sphere":
                solids["ball"].append((ball_row(T[:3, 3], *body.size_m), body.color))
            elif body.shape == "cylinder":
                solids["cylinder"].append((cylinder_row(T[:3, 3], T[:3, 2], *body.size_m), body.color))
            else:
                solids["panel"].extend((side, body.color) for side in _sides(T, np.array(body.size_m)))
        solids["panel"] = [(row, paint) for row, paint in solids["panel"] if _faces(row, eye)]
        self.n_plain = len(solids["panel"])
        self.room = [(row, uv) for row, uv in _room() if _faces(row, eye)]
        self.balls = _rows(solids["ball"], BALL_COLUMNS)
        self.panels = np.vstack([_rows(solids["panel"], PANEL_COLUMNS), *(row for row, _ in self.room)])
        self.cylinders = _rows(solids["cylinder"], CYLINDER_COLUMNS)
        self.colors = {kind: [paint for _, paint in those] for kind, those in solids.items()}

    def light(self, rays: Array) -> Array:
        """Return what comes along rays (n, 3): (n, 3) grey levels; 0 where they meet nothing."""
        distance, which = first_hits(self.eye, rays, self.balls, self.panels, self.cylinders)
        points, light = self.eye + distance[:, None] * rays, np.zeros((len(rays), 3))
        first_panel, first_cylinder = len(self.balls), len(self.balls) + len(self.panels)
        for k in np.unique(which[which >= 0]).tolist():
            hit = which == k
            at = points[hit]
            if k < first_panel:
                color, normals = self.colors["ball"][k], (at - self.balls[k, :3]) / self.balls[k, 3]
            elif k >= first_cylinder:
                row = self.cylinders[k - first_cylinder]
                color, normals = self.colors["cylinder"][k - first_cylinder], cylinder_normals(row, at)
            else:
                row = self.panels[k - first_panel]
                normals = -row[None, 9:12] / np.linalg.norm(row[9:12])  # towards the eye
                if k - first_panel >= self.n_plain:
                    uv = self.room[k - first_panel - self.n_plain][1]
                    along = 0.5 * (1 + (at - row[:3]) @ row[3:9].reshape(2, 3).T)
                    picture = _texture(uv[0] + along @ (uv[1:] - uv[0]))
                    light[hit] = np.minimum(picture * diffuse_light(normals), 255)
                    continue
                color = self.colors["panel"][k - first_panel]
            light[hit] = 255 * np.minimum(np.array(color) * diffuse_light(normals)[:, None], 1)
        return light


def _rows(solids: list[tuple[Array, Color]], columns: int) -> Array:
    return np.array([row for row, _ in solids]).reshape(-1, columns)


def _faces(row: Array, eye: Array) -> bool:
    """Whether a panel shows its front, which is where its normal does not point."""
    return bool(row[9:12] @ (row[:3] - eye) > 0)


def _sides(T_root_box: Array, size_m: Array) -> Iterator[Array]:
    """The six sides of a box, as panels whose fronts are outside."""
    half = T_root_box[:3, :3] * size_m / 2
    for k in range(3):
        for sign in (-1, 1):
            right, down = half[:, (k + 1) % 3], half[:, (k + 2) % 3]
            yield panel_row(T_root_box[:3, 3] + sign * half[:, k], right, -sign * down)


def _room() -> Iterator[tuple[Array, Array]]:
    """The room's rectangles, with texture coordinates (3, 2) of top left, top right and bottom left."""
    surface = room_surface()
    if surface.texture_uv is None:
        raise ValueError("the room has no texture; expected a picture on every surface")
    for k in range(0, len(surface.positions), 4):
        first, second, third, last = surface.positions[k : k + 4]
        row = panel_row((first + last) / 2, (second - first) / 2, (third - first) / 2)
        yield row, surface.texture_uv[k : k + 3]


def _texture(uv: Array) -> Array:
    """(n, 3) bilinear samples at places (n, 2), of which v counts from the last row's lower edge up."""
    picture = atlas()
    height, width = picture.shape[:2]
    x, y = width * uv[:, 0] - 0.5, height * (1 - uv[:, 1]) - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    a, b = (x - left)[:, None], (y - top)[:, None]
    upper = (1 - a) * picture[top, left] + a * picture[top, left + 1]
    lower = (1 - a) * picture[top + 1, left] + a * picture[top + 1, left + 1]
    return (1 - b) * upper + b * lower
