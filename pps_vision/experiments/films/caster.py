"""Light of painted balls, panels and cylinders in a room whose walls show a photograph, by ray casting.

Shares no code with `rendering`. The lens is OpenCV's. Coordinates are those of the stage frame (m): x to the right,
y down, z ahead, origin midway between the eyes at rest. Levels are grey levels of 255, proportional to light.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.films.raycast import (
    FAST,
    ball_row,
    cylinder_row,
    difference,
    first_hit,
    first_hits,
    panel_coordinates,
    panel_row,
)
from pps_vision.jit import njit
from pps_vision.types import Array, Image

Pattern = Literal["plain", "striped", "chequered", "textured"]
Levels = tuple[float, float, float]  # RGB, 0–255
PATTERNS: tuple[Pattern, ...] = ("plain", "striped", "chequered", "textured")
PHOTOS = (
    "rubberwhale/frame10.png",
    "motorcycle/motorcycle_left.png",
    "vot_ball1/frames/00000001.jpg",
    "otb_crossing/img/0001.jpg",
    "segtrack2_girl/img/0000.png",
    "chessboards/left01.jpg",
)
LIGHT = np.array([-0.3, -0.8, -0.52]) / np.linalg.norm([-0.3, -0.8, -0.52])  # direction to the lamp
AMBIENT = 0.45  # share of the light without a direction
INSTANTS = 16  # of an exposure, one for each sample of a pixel
# Instant of each sample of a pixel: a magic square, so that time and place are uncorrelated.
_INSTANT_OF_SAMPLE = np.array([[15, 2, 1, 12], [4, 9, 10, 7], [8, 5, 6, 11], [3, 14, 13, 0]])
_COARSE_INSTANTS = (1, 5, 10, 14)  # of a background that moves
_COARSE_INSTANT_OF_SAMPLE = np.array([[0, 2], [3, 1]])
_WIDEST_RAD = np.deg2rad(55.0)  # from the optical axis: farther out the lens model may fold back


@dataclass(frozen=True)
class Paint:
    """Colours of a solid; `count` stripes or squares across, `photo` the texture of `textured`."""

    color: Levels
    pattern: Pattern = "plain"
    color2: Levels = (235.0, 235.0, 235.0)
    count: int = 3
    photo: int = 1


@dataclass(frozen=True)
class Ball:
    """A sphere; `R_stage_body` (3, 3) turns its pattern."""

    center: Array
    radius_m: float
    paint: Paint
    R_stage_body: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Panel:
    """A flat rectangle about `center`; `right` and `down` (3,) lead from there to the middle of two edges."""

    center: Array
    right: Array
    down: Array
    paint: Paint


@dataclass(frozen=True)
class Cylinder:
    """A cylinder with flat ends; `half` (3,) leads from `center` to the middle of one end."""

    center: Array
    half: Array
    radius_m: float
    paint: Paint


Solid = Ball | Panel | Cylinder


@dataclass(frozen=True)
class Solids:
    """The solids of a scene at one instant."""

    balls: tuple[Ball, ...] = ()
    panels: tuple[Panel, ...] = ()
    cylinders: tuple[Cylinder, ...] = ()

    @property
    def all(self) -> tuple[Solid, ...]:
        """Balls, panels, cylinders."""
        return (*self.balls, *self.panels, *self.cylinders)


@dataclass(frozen=True)
class Room:
    """A box whose walls show a photograph; the front wall is `ahead_m` away."""

    photo: int = 0
    ahead_m: float = 1.6


@lru_cache(maxsize=32)
def photograph(data: Path, index: int, width: int) -> NDArray[np.float32]:
    """Return a photograph (h, width, 3), RGB levels; a procedural texture where its file is absent."""
    file = data / PHOTOS[index % len(PHOTOS)]
    image = cv2.imread(str(file), cv2.IMREAD_COLOR) if file.exists() else None
    picture = procedural(index) if image is None else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
    height = max(1, round(width * picture.shape[0] / picture.shape[1]))
    interpolation = cv2.INTER_AREA if width < picture.shape[1] else cv2.INTER_CUBIC
    scaled = cv2.resize(picture.astype(np.float32), (width, height), interpolation=interpolation)
    return np.clip(np.asarray(scaled, dtype=np.float32), 0, 255)


def procedural(index: int) -> Image:
    """Return coloured noise of many scales (480, 640, 3), different for every index."""
    rng = np.random.default_rng((7, index))
    total: Any = np.zeros((480, 640, 3), np.float32)
    for cells in (4, 8, 16, 32, 64, 128, 256):
        noise = rng.standard_normal((cells * 3 // 4, cells, 3)) + 2 * rng.standard_normal((cells * 3 // 4, cells, 1))
        total += cv2.resize(noise.astype(np.float32), (640, 480), interpolation=cv2.INTER_CUBIC) * cells**-0.4
    level = rng.uniform(80, 140, 3) + 45 * total / total.std()
    return np.clip(level, 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class FilmLens:
    """A camera as numbers: image size, K (3, 3) and OpenCV's distortion (k1, k2, p1, p2, k3)."""

    width: int
    height: int
    K: Array
    distortion: Array

    @cached_property
    def rays(self) -> NDArray[np.float32]:
        """(h + 2, w + 2, 2) x and y, for z = 1, of the ray of each pixel centre, with a border of one pixel."""
        v, u = np.mgrid[-1 : self.height + 1, -1 : self.width + 1].astype(np.float64)
        pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-10)
        xy = cv2.undistortPointsIter(pixels, self.K, self.distortion, np.eye(3), np.eye(3), stop)
        return np.asarray(xy, dtype=np.float32).reshape(*u.shape, 2)

    def project(self, T_stage_camera: Array, points: Array) -> Array:
        """Return the pixels (n, 2) of points (n, 3); NaN behind the camera or too far from its axis."""
        p = (np.atleast_2d(points) - T_stage_camera[:3, 3]) @ T_stage_camera[:3, :3]
        pixels = np.asarray(
            cv2.projectPoints(p.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), self.K, self.distortion)[0]
        )
        outside = np.arctan2(np.hypot(p[:, 0], p[:, 1]), p[:, 2]) > _WIDEST_RAD
        return np.asarray(np.where(outside[:, None], np.nan, pixels.reshape(-1, 2)))


class RayCaster:
    """Casts rays through one lens into a room. A static background is cast once for each pose."""

    def __init__(self, lens: FilmLens, room: Room, data: Path) -> None:
        self.lens = lens
        self._data = data
        self._focal = float(lens.K[0, 0])
        # as sharp as a lens: half a pixel of blur, which also keeps one sample a pixel from aliasing
        self._walls = cv2.GaussianBlur(photograph(data, room.photo, lens.width), (0, 0), 0.5)
        self._texture_px: dict[int, int] = {}
        half = np.array([1.25 * room.ahead_m, 1.0 * room.ahead_m, room.ahead_m])
        self._room = np.array([*-half, *half, room.ahead_m / self._focal])  # the last: size of a texel
        self._background: tuple[Array, tuple[Panel, ...], NDArray[np.float32]] | None = None

    def light(
        self, poses: list[Array], solids: list[Solids], static_panels: tuple[Panel, ...] = ()
    ) -> NDArray[np.float32]:
        """Return the mean light (h, w, 3) over the instants of an exposure: 1, or 16 in the order of time.

        Args:
            poses: T_stage_camera (4, 4) at each instant.
            solids: Moving solids at each instant.
            static_panels: Panels that never move.
        """
        if len(poses) not in (1, INSTANTS) or len(solids) != len(poses):
            raise ValueError(f"{len(poses)} poses, {len(solids)} sets of solids; expected 1 or {INSTANTS} of both")
        image = self._static(poses, static_panels)
        scenes = [replace(moving, panels=(*moving.panels, *static_panels)) for moving in solids]
        instants = _INSTANT_OF_SAMPLE if len(poses) > 1 else np.zeros_like(_INSTANT_OF_SAMPLE)
        for region in self._regions(poses, solids):
            self._cast(poses, scenes, instants, region, image)
        return image

    def _static(self, poses: list[Array], panels: tuple[Panel, ...]) -> NDArray[np.float32]:
        whole = (0, 0, self.lens.width, self.lens.height)
        image = np.empty((self.lens.height, self.lens.width, 3), np.float32)
        scene = Solids((), panels)
        if any(not np.array_equal(pose, poses[0]) for pose in poses):
            coarse = [poses[k] for k in _COARSE_INSTANTS]
            self._cast(coarse, [scene] * len(coarse), _COARSE_INSTANT_OF_SAMPLE, whole, image)
            return image
        samples = 3
        if self._background is not None and self._background[1] is panels:
            if np.array_equal(self._background[0], poses[0]):
                return self._background[2].copy()
            samples = 1  # the eye moves from frame to frame
        self._cast(poses[:1], [scene], np.zeros((samples, samples), np.int64), whole, image)
        self._background = (poses[0], panels, image.copy())
        return image

    def _regions(self, poses: list[Array], solids: list[Solids]) -> list[tuple[int, int, int, int]]:
        """x0, y0, x1, y1 of the pixels that each moving solid may cover."""
        size = (self.lens.width, self.lens.height)
        regions = []
        for first, last in zip(solids[0].all, solids[-1].all, strict=True):
            ends = ((poses[0], first), (poses[-1], last))
            pixels = np.concatenate([self.lens.project(pose, outline(solid, pose[:3, 3])) for pose, solid in ends])
            if np.isnan(pixels).all():
                continue
            if np.isnan(pixels).any():  # extends beyond the lens's range
                regions.append((0, 0, *size))
                continue
            x0, y0 = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 2, 0)
            x1, y1 = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 3, size)
            if x0 < x1 and y0 < y1:
                regions.append((int(x0), int(y0), int(x1), int(y1)))
        return regions

    def _cast(
        self,
        poses: list[Array],
        scenes: list[Solids],
        instants: NDArray[np.int64],
        region: tuple[int, int, int, int],
        image: NDArray[np.float32],
    ) -> None:
        textured = [solid for solid in scenes[0].all if solid.paint.pattern == "textured"]
        textures = [self._walls, *(self._texture(solid, poses[0][:3, 3]) for solid in textured)]
        texels = np.concatenate([texture.reshape(-1, 3) for texture in textures])
        sizes = np.array([texture.shape[:2] for texture in textures])
        rows = np.array([np.concatenate([pose[:3, :3].ravel(), pose[:3, 3]]) for pose in poses])
        solids = _packed(scenes)
        _cast(self.lens.rays, rows, *solids, self._room, texels, sizes, np.array(region), instants, LIGHT, image)

    def _texture(self, solid: Solid, eye: Array) -> NDArray[np.float32]:
        """As wide as the solid's circumference or width is in the first image."""
        if solid.paint.photo not in self._texture_px:
            size_m = 2 * float(np.linalg.norm(solid.right)) if isinstance(solid, Panel) else 2 * np.pi * solid.radius_m
            width_px = size_m * self._focal / max(float(np.linalg.norm(solid.center - eye)), 0.1)
            self._texture_px[solid.paint.photo] = max(8, round(width_px))
        return photograph(self._data, solid.paint.photo, self._texture_px[solid.paint.photo])


def outline(solid: Solid, eye: Array) -> Array:
    """Return points (n, 3) whose image encloses that of a solid: a ball's rim seen from `eye`, or corners."""
    signs = (-1, 1)
    if isinstance(solid, Panel):
        return solid.center + np.array([a * solid.right + b * solid.down for a in signs for b in signs])
    if isinstance(solid, Cylinder):
        across = solid.radius_m * np.linalg.svd(solid.half[None])[2][1:]
        corners = [solid.half * c + a * across[0] + b * across[1] for a in signs for b in signs for c in signs]
        return np.asarray(solid.center + corners)
    sight = solid.center - eye
    distance = float(np.linalg.norm(sight))
    if distance <= solid.radius_m:
        return np.full((1, 3), np.nan)
    sine = solid.radius_m / distance
    first = np.cross(sight, np.eye(3)[np.argmin(np.abs(sight))])
    first /= np.linalg.norm(first)
    second = np.cross(sight / distance, first)
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)[:, None]
    rim_radius = solid.radius_m * np.sqrt(1 - sine**2)
    return solid.center - sight * sine**2 + rim_radius * (np.cos(angle) * first + np.sin(angle) * second)


def visible_share(
    lens: FilmLens, T_stage_camera: Array, solids: Solids, solid: Ball | Panel, static_panels: tuple[Panel, ...]
) -> float:
    """Return the share of the image of one of the solids that is inside the picture and not occluded."""
    eye = T_stage_camera[:3, 3]
    if isinstance(solid, Ball):
        rim = outline(solid, eye)
        if np.isnan(rim).any():
            return 0.0
        middle = rim.mean(axis=0)
        angle = 2.399963 * np.arange(256)[:, None]  # golden angle: points spread evenly over the disc
        radius = np.sqrt((np.arange(256)[:, None] + 0.5) / 256)
        points = middle + radius * (np.cos(angle) * (rim[0] - middle) + np.sin(angle) * (rim[12] - middle))
    else:
        s, t = np.meshgrid(np.linspace(-0.97, 0.97, 16), np.linspace(-0.97, 0.97, 16))
        points = solid.center + s.reshape(-1, 1) * solid.right + t.reshape(-1, 1) * solid.down
    pixels = lens.project(T_stage_camera, points)
    inside = np.all((pixels > -0.5) & (pixels < np.array([lens.width, lens.height]) - 0.5), axis=1)
    balls = tuple(ball for ball in solids.balls if ball is not solid)
    panels = (*(panel for panel in solids.panels if panel is not solid), *static_panels)
    occluders = _packed([Solids(balls, panels, solids.cylinders)])
    distance, _ = first_hits(eye, points - eye, *(rows[0] for rows in occluders))
    return float(np.mean(inside & (distance >= 1)))


def _packed(scenes: list[Solids]) -> tuple[Array, Array, Array]:
    """Balls (k, n, 22), panels (k, m, 21) and cylinders (k, l, 17): rows of `raycast`, paint, and a ball's rotation.

    Texture 0 is the walls'; textured solids count from 1 in the order of `Solids.all`.
    """
    balls = np.zeros((len(scenes), len(scenes[0].balls), 22))
    panels = np.zeros((len(scenes), len(scenes[0].panels), 21))
    cylinders = np.zeros((len(scenes), len(scenes[0].cylinders), 17))
    for k, scene in enumerate(scenes):
        texture = 0
        for row, ball in zip(balls[k], scene.balls, strict=True):
            texture += ball.paint.pattern == "textured"
            row[:4] = ball_row(ball.center, ball.radius_m)
            row[4:13] = _paint_columns(ball.paint, texture)
            row[13:22] = ball.R_stage_body.T.ravel()
        for row, panel in zip(panels[k], scene.panels, strict=True):
            texture += panel.paint.pattern == "textured"
            row[:12] = panel_row(panel.center, panel.right, panel.down)
            row[12:21] = _paint_columns(panel.paint, texture)
        for row, cylinder in zip(cylinders[k], scene.cylinders, strict=True):
            texture += cylinder.paint.pattern == "textured"
            half_m = float(np.linalg.norm(cylinder.half))
            row[:8] = cylinder_row(cylinder.center, cylinder.half / half_m, cylinder.radius_m, 2 * half_m)
            row[8:17] = _paint_columns(cylinder.paint, texture)
    return balls, panels, cylinders


def _paint_columns(paint: Paint, texture: int) -> list[float]:
    return [float(PATTERNS.index(paint.pattern)), float(texture), *paint.color, *paint.color2, paint.count]


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def _mirrored(i, size):  # type: ignore[no-untyped-def]
    """Index within a texture that is mirrored beyond its edges."""
    i = i % (2 * size)
    return min(i, 2 * size - 1 - i)


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def _texel(texels, start, h, w, u, v):  # type: ignore[no-untyped-def]
    """Bilinear colour of a texture at texels u, v."""
    left = np.floor(u)
    top = np.floor(v)
    i0 = int(left)
    j0 = int(top)
    i1 = i0 + 1
    j1 = j0 + 1
    p = u - left
    q = v - top
    if i0 < 0 or j0 < 0 or i1 >= w or j1 >= h:
        i0 = _mirrored(i0, w)
        i1 = _mirrored(i1, w)
        j0 = _mirrored(j0, h)
        j1 = _mirrored(j1, h)
    a = (1 - p) * (1 - q)
    b = p * (1 - q)
    c = (1 - p) * q
    d = p * q
    j0 = start + j0 * w
    j1 = start + j1 * w
    return (
        a * texels[j0 + i0, 0] + b * texels[j0 + i1, 0] + c * texels[j1 + i0, 0] + d * texels[j1 + i1, 0],
        a * texels[j0 + i0, 1] + b * texels[j0 + i1, 1] + c * texels[j1 + i0, 1] + d * texels[j1 + i1, 1],
        a * texels[j0 + i0, 2] + b * texels[j0 + i1, 2] + c * texels[j1 + i0, 2] + d * texels[j1 + i1, 2],
    )


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _cast(rays, poses, balls, panels, cylinders, room, texels, sizes, region, instants, lamp, image):  # type: ignore[no-untyped-def]
    """Write the mean colour of the samples of each pixel of a region into the image."""
    side = instants.shape[0]
    weight = 1 / (side * side)
    for y in range(region[1], region[3]):
        for x in range(region[0], region[2]):
            red = 0.0
            green = 0.0
            blue = 0.0
            ax = 0.5 * (rays[y + 1, x + 2, 0] - rays[y + 1, x, 0])
            ay = 0.5 * (rays[y + 1, x + 2, 1] - rays[y + 1, x, 1])
            bx = 0.5 * (rays[y + 2, x + 1, 0] - rays[y, x + 1, 0])
            by = 0.5 * (rays[y + 2, x + 1, 1] - rays[y, x + 1, 1])
            for j in range(side):
                for i in range(side):
                    k = instants[j, i]
                    su = (i + 0.5) / side - 0.5
                    sv = (j + 0.5) / side - 0.5
                    a = rays[y + 1, x + 1, 0] + su * ax + sv * bx
                    b = rays[y + 1, x + 1, 1] + su * ay + sv * by
                    ox = poses[k, 9]
                    oy = poses[k, 10]
                    oz = poses[k, 11]
                    dx = poses[k, 0] * a + poses[k, 1] * b + poses[k, 2]
                    dy = poses[k, 3] * a + poses[k, 4] * b + poses[k, 5]
                    dz = poses[k, 6] * a + poses[k, 7] * b + poses[k, 8]
                    t, index = first_hit(ox, oy, oz, dx, dy, dz, balls[k], panels[k], cylinders[k])
                    px = ox + t * dx
                    py = oy + t * dy
                    pz = oz + t * dz
                    panel = index - balls.shape[1]
                    cylinder = panel - panels.shape[1]
                    if index < 0:
                        color = _wall(ox, oy, oz, dx, dy, dz, room, texels, sizes[0, 0], sizes[0, 1])
                    elif panel < 0:
                        color = _ball_color(balls, k, index, px, py, pz, texels, sizes, lamp)
                    elif cylinder < 0:
                        color = _panel_color(panels, k, panel, px, py, pz, texels, sizes, lamp)
                    else:
                        color = _cylinder_color(cylinders, k, cylinder, px, py, pz, texels, sizes, lamp)
                    red += color[0]
                    green += color[1]
                    blue += color[2]
            image[y, x, 0] = weight * red
            image[y, x, 1] = weight * green
            image[y, x, 2] = weight * blue


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def _wall(ox, oy, oz, dx, dy, dz, room, texels, h, w):  # type: ignore[no-untyped-def]
    """Colour of the room's box from inside: the photograph, centred on each wall."""
    tx = ((room[3] if dx > 0 else room[0]) - ox) / dx
    ty = ((room[4] if dy > 0 else room[1]) - oy) / dy
    t = ((room[5] if dz > 0 else room[2]) - oz) / dz
    u = ox + t * dx
    v = oy + t * dy
    if tx < min(t, ty):
        u = oz + tx * dz
        v = oy + tx * dy
    elif ty < t:
        u = ox + ty * dx
        v = oz + ty * dz
    return _texel(texels, 0, h, w, u / room[6] + 0.5 * w - 0.5, v / room[6] + 0.5 * h - 0.5)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _ball_color(balls, k, n, x, y, z, texels, sizes, lamp):  # type: ignore[no-untyped-def]
    """Lambert's shading of a ball's paint, which turns with it, at a point of its surface."""
    r = balls[k, n, 3]
    nx = (x - balls[k, n, 0]) / r
    ny = (y - balls[k, n, 1]) / r
    nz = (z - balls[k, n, 2]) / r
    shade = AMBIENT + (1 - AMBIENT) * max(nx * lamp[0] + ny * lamp[1] + nz * lamp[2], 0.0)
    px = balls[k, n, 13] * nx + balls[k, n, 14] * ny + balls[k, n, 15] * nz
    py = balls[k, n, 16] * nx + balls[k, n, 17] * ny + balls[k, n, 18] * nz
    pz = balls[k, n, 19] * nx + balls[k, n, 20] * ny + balls[k, n, 21] * nz
    u = 0.5 * (np.arctan2(py, px) / np.pi + 1)
    v = np.arcsin(min(max(pz, -1.0), 1.0)) / np.pi + 0.5
    if balls[k, n, 4] == 1:
        u = 0.5 * (px + 1)
    return _painted(balls, k, n, 4, u, v, 2.0, shade, texels, sizes)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _panel_color(panels, k, n, x, y, z, texels, sizes, lamp):  # type: ignore[no-untyped-def]
    """The same of a panel, either side."""
    nx = panels[k, n, 9]
    ny = panels[k, n, 10]
    nz = panels[k, n, 11]
    cosine = abs(nx * lamp[0] + ny * lamp[1] + nz * lamp[2]) / np.sqrt(nx * nx + ny * ny + nz * nz)
    u, v = panel_coordinates(panels[k], n, x, y, z)
    shade = AMBIENT + (1 - AMBIENT) * cosine
    return _painted(panels, k, n, 12, 0.5 * (u + 1), 0.5 * (v + 1), 1.0, shade, texels, sizes)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _cylinder_color(cylinders, k, n, x, y, z, texels, sizes, lamp):  # type: ignore[no-untyped-def]
    """The same of a cylinder; u runs along its axis, v around it."""
    ax = cylinders[k, n, 3]
    ay = cylinders[k, n, 4]
    az = cylinders[k, n, 5]
    half = cylinders[k, n, 7]
    x, y, z = difference(x, y, z, cylinders[k, n, 0], cylinders[k, n, 1], cylinders[k, n, 2])
    along = x * ax + y * ay + z * az
    nx, ny, nz = difference(x, y, z, along * ax, along * ay, along * az)
    if abs(along) > half * (1 - 1e-9):
        nx = along * ax
        ny = along * ay
        nz = along * az
    cosine = (nx * lamp[0] + ny * lamp[1] + nz * lamp[2]) / np.sqrt(nx * nx + ny * ny + nz * nz)
    shade = AMBIENT + (1 - AMBIENT) * max(cosine, 0.0)
    v = 0.5 * (np.arctan2(nx, nz) / np.pi + 1)
    return _painted(cylinders, k, n, 8, 0.5 * (along / half + 1), v, 1.0, shade, texels, sizes)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _painted(solids, k, n, start, u, v, aspect, shade, texels, sizes):  # type: ignore[no-untyped-def]
    """Colour of a surface at u, v (0 … 1): pattern, texture, two colours; `aspect` times as many squares along u."""
    if solids[k, n, start] == 3:
        texture = int(solids[k, n, start + 1])
        begin = 0
        for m in range(texture):
            begin += sizes[m, 0] * sizes[m, 1]
        h = sizes[texture, 0]
        w = sizes[texture, 1]
        color = _texel(texels, begin, h, w, u * w - 0.5, v * h - 0.5)
        return shade * color[0], shade * color[1], shade * color[2]
    is_second = False
    count = solids[k, n, start + 8]
    if solids[k, n, start] == 1:
        is_second = int(np.floor(u * 2 * count)) % 2 == 1
    elif solids[k, n, start] == 2:
        is_second = (int(np.floor(u * aspect * count)) + int(np.floor(v * count))) % 2 == 1
    first = start + (5 if is_second else 2)
    return shade * solids[k, n, first], shade * solids[k, n, first + 1], shade * solids[k, n, first + 2]
