"""Light of painted balls, panels and cylinders in a room whose walls show a photograph, by ray casting, and its sensor.

Shares no code with `rendering`. The lens is OpenCV's. Coordinates are in the stage frame (m): x to the right,
y down, z ahead, origin midway between the eyes at rest. Paints and photographs are given as the levels (0–255) that a
camera shows of them in full light. Light adds in proportion to itself, 255 at full scale; the camera's tone curve, that
of sRGB, turns it to levels.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.experiments.films.raycast import (
    BALL,
    COLUMNS,
    FAST,
    PANEL,
    ball_row,
    cylinder_row,
    dot,
    first_hit,
    first_hits,
    panel_coordinates,
    panel_row,
    unit_normal,
)
from pps_vision.jit import njit
from pps_vision.types import Array, Image, Mask

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
INSTANTS = 16  # in an exposure, one for each sample of a pixel
# Instant of each sample of a pixel: a magic square, so that time and place are uncorrelated.
_INSTANT_OF_SAMPLE = np.array([[15, 2, 1, 12], [4, 9, 10, 7], [8, 5, 6, 11], [3, 14, 13, 0]])
_COARSE_INSTANTS = (1, 5, 10, 14)  # while the background moves
_COARSE_INSTANT_OF_SAMPLE = np.array([[0, 2], [3, 1]])
_TAPE_LENGTH = 1 << 21  # normal deviates for the noise
_SIDES = tuple(np.linspace(-0.97, 0.97, 16))  # where the visible share of a panel is sampled
_SHADES = 4096  # of light, at which the tone curve is tabulated
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

    def outline(self, eye: Array) -> Array:
        """Return points (48, 3) of the rim that `eye` sees; NaN from within."""
        sight = self.center - eye
        distance = float(np.linalg.norm(sight))
        if distance <= self.radius_m:
            return np.full((1, 3), np.nan)
        sine = self.radius_m / distance
        across = np.linalg.svd(sight[None])[2][1:]
        angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        circle = np.column_stack([np.cos(angle), np.sin(angle)]) @ across
        return np.asarray(self.center - sight * sine**2 + self.radius_m * np.sqrt(1 - sine**2) * circle)

    def sample(self, eye: Array) -> Array:
        """Return points (256, 3) spread evenly over the disc that `eye` sees; none from within."""
        rim = self.outline(eye)
        middle = rim.mean(axis=0)
        if np.isnan(middle).any():
            return np.empty((0, 3))
        angle = 2.399963 * np.arange(256)[:, None]  # golden angle
        radius = np.sqrt((np.arange(256)[:, None] + 0.5) / 256)
        return middle + radius * (np.cos(angle) * (rim[0] - middle) + np.sin(angle) * (rim[12] - middle))


@dataclass(frozen=True)
class Panel:
    """A flat rectangle about `center`; `right` and `down` (3,) lead from there to the middle of two edges."""

    center: Array
    right: Array
    down: Array
    paint: Paint

    def outline(self, eye: Array) -> Array:
        """Return the corners (4, 3)."""
        return self.sample(eye, (-1, 1))

    def sample(self, _: Array, sides: ArrayLike = _SIDES) -> Array:
        """Return points (256, 3) spread evenly over the rectangle."""
        s, t = np.meshgrid(sides, sides)
        return np.asarray(self.center + s.reshape(-1, 1) * self.right + t.reshape(-1, 1) * self.down)


@dataclass(frozen=True)
class Cylinder:
    """A cylinder with flat ends; `half` (3,) leads from `center` to the middle of one end."""

    center: Array
    half: Array
    radius_m: float
    paint: Paint

    def outline(self, _: Array) -> Array:
        """Return the corners (8, 3) of a box around it."""
        across = self.radius_m * np.linalg.svd(self.half[None])[2][1:]
        signs = (-1, 1)
        corners = [self.half * c + a * across[0] + b * across[1] for a in signs for b in signs for c in signs]
        return np.asarray(self.center + corners)

    def sample(self, eye: Array) -> Array:
        """Return points (256, 3) spread evenly over its section across the line of sight."""
        across = np.cross(self.half, self.center - eye)
        return Panel(self.center, self.half, self.radius_m * across / np.linalg.norm(across), self.paint).sample(eye)


Solid = Ball | Panel | Cylinder
Solids = tuple[Solid, ...]  # the solids of a scene at one instant


def light_of(levels: ArrayLike) -> NDArray[np.float32]:
    """Return the light of levels, by the tone curve of sRGB (IEC 61966-2-1)."""
    share = np.asarray(levels, np.float32) / 255
    return np.float32(255) * np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def levels_of(light: ArrayLike) -> NDArray[np.float32]:
    """Return the levels of light, the inverse of `light_of`; levels above full scale saturate."""
    share = np.minimum(np.asarray(light, np.float32) / 255, 1)
    return np.float32(255) * np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)


@lru_cache(maxsize=32)
def photograph(data: Path, index: int, width: int) -> NDArray[np.float32]:
    """Return the light (h, width, 3) of a photograph, or of a procedural texture where its file is absent."""
    file = data / PHOTOS[index % len(PHOTOS)]
    image = cv2.imread(str(file), cv2.IMREAD_COLOR) if file.exists() else None
    picture = procedural(index) if image is None else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
    height = max(1, round(width * picture.shape[0] / picture.shape[1]))
    interpolation = cv2.INTER_AREA if width < picture.shape[1] else cv2.INTER_CUBIC
    scaled = cv2.resize(light_of(picture), (width, height), interpolation=interpolation)
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
    """Casts rays through one lens into a room, a box with a photograph on its walls whose front is `ahead_m` away.

    A static background is cast once for each pose.
    """

    def __init__(
        self, lens: FilmLens, photo: int, data: Path, ahead_m: float = 1.6, texel_m: float | None = None
    ) -> None:
        self.lens = lens
        self._data = data
        self._focal = float(lens.K[0, 0])
        # as sharp as a lens: half a pixel of blur, which also keeps one sample a pixel from aliasing
        self._walls = cv2.GaussianBlur(photograph(data, photo, lens.width), (0, 0), 0.5)
        self._texture_px: dict[int, int] = {}
        half = np.array([1.25 * ahead_m, 1.0 * ahead_m, ahead_m])
        self._room = np.array([*-half, *half, texel_m or ahead_m / self._focal])  # the last: size of a texel
        self._background: tuple[Array, Solids, NDArray[np.float32]] | None = None

    def light(self, poses: list[Array], moving: Sequence[Solids], static: Solids = ()) -> NDArray[np.float32]:
        """Return the mean light (h, w, 3) over the instants of an exposure: 1, or 16 in the order of time.

        Args:
            poses: T_stage_camera (4, 4) at each instant.
            moving: Moving solids at each instant.
            static: Solids that never move.
        """
        static_regions = self._regions(poses, static, static)
        image = self._static(poses, static, static_regions)
        scenes = [(*solids, *static) for solids in moving]
        instants = _INSTANT_OF_SAMPLE if len(poses) > 1 else np.zeros_like(_INSTANT_OF_SAMPLE)
        regions = self._regions(poses, moving[0], moving[-1])
        mask = np.zeros(image.shape[:2], bool)
        for x0, y0, x1, y1 in regions:
            mask[y0:y1, x0:x1] = True
        if mask.any():  # the first cast determines the size of a texture
            self._cast(poses, scenes, np.concatenate([regions, static_regions]), instants, mask, image)
        return image

    def _static(self, poses: list[Array], static: Solids, regions: NDArray[np.int64]) -> NDArray[np.float32]:
        image = np.empty((self.lens.height, self.lens.width, 3), np.float32)
        whole = np.ones(image.shape[:2], bool)
        if any(not np.array_equal(pose, poses[0]) for pose in poses):
            coarse = [poses[k] for k in _COARSE_INSTANTS]
            self._cast(coarse, [static] * len(coarse), regions, _COARSE_INSTANT_OF_SAMPLE, whole, image)
            return image
        samples = 3
        if self._background is not None and self._background[1] is static:
            if np.array_equal(self._background[0], poses[0]):
                return self._background[2].copy()
            samples = 1  # the eye moves from frame to frame
        self._cast(poses[:1], [static], regions, np.zeros((samples, samples), np.int64), whole, image)
        self._background = (poses[0], static, image.copy())
        return image

    def _regions(self, poses: list[Array], first: Solids, last: Solids) -> NDArray[np.int64]:
        """(n, 4) x0, y0, x1, y1 of the pixels that each solid may cover between the first and the last pose and
        place."""
        size = (self.lens.width, self.lens.height)
        regions = np.zeros((len(first), 4), np.int64)
        for region, *ends in zip(regions, first, last, strict=True):
            sides = [
                self.lens.project(pose, solid.outline(pose[:3, 3]))
                for pose, solid in zip((poses[0], poses[-1]), ends, strict=True)
            ]
            pixels = np.concatenate(sides)
            if np.isnan(pixels).all():
                continue
            if np.isnan(pixels).any():  # extends beyond the lens's range
                region[2:] = size
                continue
            region[:2] = np.maximum(np.floor(pixels.min(axis=0)) - 2, 0)
            region[2:] = np.clip(np.ceil(pixels.max(axis=0)) + 3, 0, size)
        return regions

    def _cast(
        self,
        poses: list[Array],
        scenes: Sequence[Solids],
        regions: NDArray[np.int64],
        instants: NDArray[np.int64],
        mask: Mask,
        image: NDArray[np.float32],
    ) -> None:
        textured = [solid for solid in scenes[0] if solid.paint.pattern == "textured"]
        textures = [self._walls, *(self._texture(solid, poses[0][:3, 3]) for solid in textured)]
        texels = np.concatenate([texture.reshape(-1, 3) for texture in textures])
        sizes = np.array([texture.shape[:2] for texture in textures])
        rows = np.array([np.concatenate([pose[:3, :3].ravel(), pose[:3, 3]]) for pose in poses])
        solids = np.array([_rows(scene) for scene in scenes])
        _cast(self.lens.rays, rows, solids, regions, self._room, texels, sizes, mask, instants, LIGHT, image)

    def _texture(self, solid: Solid, eye: Array) -> NDArray[np.float32]:
        """As wide as the solid's circumference or width is in the first image."""
        if solid.paint.photo not in self._texture_px:
            size_m = 2 * float(np.linalg.norm(solid.right)) if isinstance(solid, Panel) else 2 * np.pi * solid.radius_m
            width_px = size_m * self._focal / max(float(np.linalg.norm(solid.center - eye)), 0.1)
            self._texture_px[solid.paint.photo] = max(8, round(width_px))
        return photograph(self._data, solid.paint.photo, self._texture_px[solid.paint.photo])


def visible_share(lens: FilmLens, T_stage_camera: Array, solids: Solids, solid: Solid) -> float:
    """Return the share of the image of one of the solids that is inside the picture and not occluded."""
    eye = T_stage_camera[:3, 3]
    points = solid.sample(eye)
    if not len(points):
        return 0.0
    pixels = lens.project(T_stage_camera, points)
    inside = np.all((pixels > -0.5) & (pixels < np.array([lens.width, lens.height]) - 0.5), axis=1)
    occluders = tuple(occluder for occluder in solids if occluder is not solid)
    return float(np.mean(inside & (first_hits(eye, points - eye, _rows(occluders))[0] >= 1)))


def _row(solid: Solid) -> Array:
    """The row of `raycast`."""
    if isinstance(solid, Ball):
        return ball_row(solid.center, solid.radius_m)
    if isinstance(solid, Panel):
        return panel_row(solid.center, solid.right, solid.down)
    half_m = float(np.linalg.norm(solid.half))
    return cylinder_row(solid.center, solid.half / half_m, solid.radius_m, 2 * half_m)


def _rows(solids: Solids) -> Array:
    """(n, 31) rows of `raycast`, paint (9) and rotation (9); the walls have texture 0, solids count from 1."""
    rows = np.empty((len(solids), COLUMNS + 18))
    texture = 0
    for row, solid in zip(rows, solids, strict=True):
        paint = solid.paint
        texture += paint.pattern == "textured"
        rotation = solid.R_stage_body.T if isinstance(solid, Ball) else np.eye(3)
        pattern = PATTERNS.index(paint.pattern)
        colors = light_of([*paint.color, *paint.color2])
        row[:] = [*_row(solid), pattern, texture, *colors, paint.count, *rotation.ravel()]
    return rows


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
def _cast(rays, poses, solids, regions, room, texels, sizes, mask, instants, lamp, image):  # type: ignore[no-untyped-def]
    """Write the mean colour of the samples of each pixel of a mask into the image.

    `regions` (n, 4) are the x0, y0, x1, y1 of the pixels that each solid may cover.
    """
    indices = np.empty(len(regions), np.int64)
    side = instants.shape[0]
    weight = 1 / (side * side)
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if not mask[y, x]:
                continue
            n = 0
            for m in range(len(regions)):
                if regions[m, 0] <= x < regions[m, 2] and regions[m, 1] <= y < regions[m, 3]:
                    indices[n] = m
                    n += 1
            near = indices[:n]
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
                    R = poses[k]
                    su = (i + 0.5) / side - 0.5
                    sv = (j + 0.5) / side - 0.5
                    a = rays[y + 1, x + 1, 0] + su * ax + sv * bx
                    b = rays[y + 1, x + 1, 1] + su * ay + sv * by
                    dx = R[0] * a + R[1] * b + R[2]
                    dy = R[3] * a + R[4] * b + R[5]
                    dz = R[6] * a + R[7] * b + R[8]
                    t, m = first_hit(R[9], R[10], R[11], dx, dy, dz, solids[k], near)
                    if m < 0:
                        color = _wall(R[9], R[10], R[11], dx, dy, dz, room, texels, sizes[0, 0], sizes[0, 1])
                    else:
                        px = R[9] + t * dx - solids[k, m, 1]
                        py = R[10] + t * dy - solids[k, m, 2]
                        pz = R[11] + t * dz - solids[k, m, 3]
                        color = _color(solids[k, m], px, py, pz, texels, sizes, lamp)
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
def _color(solid, x, y, z, texels, sizes, lamp):  # type: ignore[no-untyped-def]
    """Colour of a solid's paint, with Lambert's shading, at a point of its surface given from its centre."""
    kind = solid[0]
    nx, ny, nz = unit_normal(solid, x, y, z)
    cosine = dot(nx, ny, nz, lamp[0], lamp[1], lamp[2])
    aspect = 1.0  # squares along u for each along v
    if kind == BALL:
        px = dot(solid[22], solid[23], solid[24], nx, ny, nz)
        py = dot(solid[25], solid[26], solid[27], nx, ny, nz)
        pz = dot(solid[28], solid[29], solid[30], nx, ny, nz)
        u = 0.5 * (px + 1) if solid[13] == 1 else 0.5 * (np.arctan2(py, px) / np.pi + 1)
        v = np.arcsin(min(max(pz, -1.0), 1.0)) / np.pi + 0.5
        aspect = 2.0
    elif kind == PANEL:  # the same on both sides
        cosine = abs(cosine)
        right, down = panel_coordinates(solid, x, y, z)
        u = 0.5 * (right + 1)
        v = 0.5 * (down + 1)
    else:  # u along the axis, v around it
        u = 0.5 * (dot(x, y, z, solid[4], solid[5], solid[6]) / solid[8] + 1)
        v = 0.5 * (np.arctan2(nx, nz) / np.pi + 1)
    shade = AMBIENT + (1 - AMBIENT) * max(cosine, 0.0)
    if solid[13] == 3:
        texture = int(solid[14])
        begin = 0
        for m in range(texture):
            begin += sizes[m, 0] * sizes[m, 1]
        h = sizes[texture, 0]
        w = sizes[texture, 1]
        color = _texel(texels, begin, h, w, u * w - 0.5, v * h - 0.5)
        return shade * color[0], shade * color[1], shade * color[2]
    first = 15
    count = solid[21]
    if solid[13] == 1:
        first += 3 * (int(np.floor(u * 2 * count)) % 2)
    elif solid[13] == 2:
        first += 3 * ((int(np.floor(u * aspect * count)) + int(np.floor(v * count))) % 2)
    return shade * solid[first], shade * solid[first + 1], shade * solid[first + 2]


@dataclass(frozen=True)
class SensorChain:
    """Stages in this order: defocus, gain, tone curve, mosaic, noise, eight bits, grey, JPEG."""

    defocus_px: float = 0.0
    """Standard deviation of the defocus blur."""
    read_noise: float = 2.0  # standard deviation of the noise that does not depend on the light, levels
    shot: float = 0.0  # variance of the shot noise per level
    bayer: bool = False  # one colour a pixel (RGGB), the others interpolated by OpenCV
    grey: bool = False  # A grey camera: three equal channels
    jpeg: int = 0  # JPEG quality, 1–100; 0: not compressed

    def expose(self, light: NDArray[np.float32], gain: float, rng: np.random.Generator, tape: Array) -> Image:
        """Return the image (h, w, 3) of light; the noise of each row is cut from the tape where `rng` says."""
        if self.defocus_px > 0:
            light = np.asarray(cv2.GaussianBlur(light, (0, 0), self.defocus_px), dtype=np.float32)
        shade = np.minimum(light, 255 / gain) * np.float32((_SHADES - 1) * gain / 255)
        levels = np.take(_tone_curve(), np.rint(shade).astype(np.uint16))
        if self.bayer:
            mosaic = levels[..., 1].copy()
            mosaic[::2, ::2] = levels[::2, ::2, 0]
            mosaic[1::2, 1::2] = levels[1::2, 1::2, 2]
            levels = mosaic
        h, w = levels.shape[:2]
        rows = levels.reshape(h, -1)
        image: Image = np.empty(rows.shape, np.uint8)
        starts = rng.integers(0, len(tape) - rows.shape[1], h)
        _add_noise(rows, self.read_noise**2, self.shot, tape, starts, image)
        if self.bayer:
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BayerRGGB2RGB), dtype=np.uint8)
        image = image.reshape(h, w, 3)
        if self.grey:
            image = np.asarray(cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB), np.uint8)
        if self.jpeg:
            coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self.jpeg])[1]
            image = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), dtype=np.uint8)
        return image


@cache
def _tone_curve() -> NDArray[np.float32]:
    """(_SHADES,) levels of light from none to full scale."""
    return levels_of(np.linspace(0, 255, _SHADES))


def noise_tape(rng: np.random.Generator) -> Array:
    """Return normal deviates (n,) for `SensorChain.expose`."""
    return rng.standard_normal(_TAPE_LENGTH, dtype=np.float32)


@njit(cache=True, error_model="numpy")
def _add_noise(levels, read_var, shot, tape, starts, image):  # type: ignore[no-untyped-def]
    for y in range(levels.shape[0]):
        start = starts[y]
        for x in range(levels.shape[1]):
            level = levels[y, x]
            level += tape[start + x] * np.sqrt(read_var + shot * level)
            image[y, x] = np.uint8(min(max(level + 0.5, 0.0), 255.0))
