"""Independent scene source: the light of painted balls, panels and cylinders in a room of photographs, by ray casting.

Shares no code with `rendering`.  The lens is OpenCV's (`cv2.undistortPointsIter`, `cv2.projectPoints`).  Everything is
in the stage frame: x to the right, y down, z ahead, metres, origin midway between the eyes at rest.  Levels are grey
levels of 255, proportional to light.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.raycast import FAST, ball_row, cylinder_row, first_hit, first_hits, on_panel, panel_row
from pps_vision.jit import njit
from pps_vision.types import Array, Image

Pattern = Literal["plain", "striped", "chequered", "textured"]
Color = tuple[float, float, float]  # RGB, 0–255
PATTERNS: tuple[Pattern, ...] = ("plain", "striped", "chequered", "textured")
PHOTOS = (
    "rubberwhale/frame10.png",
    "motorcycle/motorcycle_left.png",
    "vot_ball1/frames/00000001.jpg",
    "otb_crossing/img/0001.jpg",
    "segtrack2_girl/img/0000.png",
    "chessboards/left01.jpg",
)
LIGHT = np.array([-0.3, -0.8, -0.52]) / np.linalg.norm([-0.3, -0.8, -0.52])  # towards the lamp
AMBIENT = 0.45  # share of the light that has no direction
EDGE_SAMPLES = 4  # samples a side of a pixel where something moves or has an edge
# Which of the exposure's instants each of a pixel's samples shows: a magic square, so that time and place are
# uncorrelated and a blur keeps its centre.
_ORDER = np.array([[15, 2, 1, 12], [4, 9, 10, 7], [8, 5, 6, 11], [3, 14, 13, 0]])
_ORDER_COARSE = np.array([[0, 2], [3, 1]])
_WIDEST_RAD = np.deg2rad(55.0)  # from the optical axis: beyond it the lens model may fold back


@dataclass(frozen=True)
class Surface:
    """What something is painted with; `count` stripes or squares across, `photo` the texture of `textured`."""

    color: Color
    pattern: Pattern = "plain"
    color2: Color = (235.0, 235.0, 235.0)
    count: int = 3
    photo: int = 1


@dataclass(frozen=True)
class Ball:
    """A sphere; `R_stage_body` (3, 3) turns its pattern."""

    center: Array
    radius_m: float
    surface: Surface
    R_stage_body: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Panel:
    """A flat rectangle about `center`; `right` and `down` (3,) lead from there to the middle of two edges."""

    center: Array
    right: Array
    down: Array
    surface: Surface


@dataclass(frozen=True)
class Cylinder:
    """A cylinder with flat ends; `half` (3,) leads from `center` to the middle of one of them."""

    center: Array
    half: Array
    radius_m: float
    surface: Surface


Thing = Ball | Panel | Cylinder


@dataclass(frozen=True)
class Arrangement:
    """What is where at one instant; `panels` that never move may be drawn once."""

    balls: tuple[Ball, ...] = ()
    panels: tuple[Panel, ...] = ()
    cylinders: tuple[Cylinder, ...] = ()

    @property
    def things(self) -> tuple[Thing, ...]:
        """All of them, the balls first."""
        return (*self.balls, *self.panels, *self.cylinders)


@dataclass(frozen=True)
class Room:
    """A box whose walls show a photograph; the one ahead is `ahead_m` away."""

    photo: int = 0
    ahead_m: float = 1.6


@lru_cache(maxsize=32)
def photograph(data: Path, index: int, width: int) -> NDArray[np.float32]:
    """(h, width, 3) RGB, levels; a procedural texture where the photograph is absent."""
    file = data / PHOTOS[index % len(PHOTOS)]
    image = cv2.imread(str(file), cv2.IMREAD_COLOR) if file.exists() else None
    picture = procedural(index) if image is None else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
    height = max(1, round(width * picture.shape[0] / picture.shape[1]))
    how = cv2.INTER_AREA if width < picture.shape[1] else cv2.INTER_CUBIC
    scaled = cv2.resize(picture.astype(np.float32), (width, height), interpolation=how)
    return np.clip(np.asarray(scaled, dtype=np.float32), 0, 255)


def procedural(index: int) -> Image:
    """(480, 640, 3) coloured noise of many scales; another for every `index`."""
    rng = np.random.default_rng((7, index))
    total: Any = np.zeros((480, 640, 3), np.float32)
    for cells in (4, 8, 16, 32, 64, 128, 256):
        noise = rng.standard_normal((cells * 3 // 4, cells, 3)) + 2 * rng.standard_normal((cells * 3 // 4, cells, 1))
        total += cv2.resize(noise.astype(np.float32), (640, 480), interpolation=cv2.INTER_CUBIC) * cells**-0.4
    level = rng.uniform(80, 140, 3) + 45 * total / total.std()
    return np.clip(level, 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Lens:
    """A camera by its numbers: image size, K (3, 3) and OpenCV's distortion (k1, k2, p1, p2, k3)."""

    width: int
    height: int
    K: Array
    distortion: Array

    @cached_property
    def rays(self) -> NDArray[np.float32]:
        """(h + 2, w + 2, 2) x and y, for z = 1, of the direction of each pixel centre and of one more all around."""
        v, u = np.mgrid[-1 : self.height + 1, -1 : self.width + 1].astype(np.float64)
        pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-10)
        xy = cv2.undistortPointsIter(pixels, self.K, self.distortion, np.eye(3), np.eye(3), stop)
        return np.asarray(xy, dtype=np.float32).reshape(*u.shape, 2)

    def project(self, T_stage_camera: Array, points: Array) -> Array:
        """(n, 2) px of points (n, 3); NaN behind the camera or too far from its axis."""
        R, o = T_stage_camera[:3, :3], T_stage_camera[:3, 3]
        p = (np.atleast_2d(points) - o) @ R
        pixels = np.asarray(
            cv2.projectPoints(p.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), self.K, self.distortion)[0]
        )
        beside = np.arctan2(np.hypot(p[:, 0], p[:, 1]), p[:, 2]) > _WIDEST_RAD
        found: Array = np.where(beside[:, None], np.nan, pixels.reshape(-1, 2))
        return found


class Caster:
    """Casts rays through one lens into a room; what does not move, seen from the same place, is cast once."""

    def __init__(self, lens: Lens, room: Room, data: Path) -> None:
        self.lens, self._data = lens, data
        focal = float(lens.K[0, 0])
        self._focal = focal
        # as sharp as a lens: half a pixel of blur, which also keeps one sample a pixel from aliasing
        self._walls = cv2.GaussianBlur(photograph(data, room.photo, lens.width), (0, 0), 0.5)
        self._widths: dict[int, int] = {}
        texel_m = room.ahead_m / focal
        sides = (1.25 * room.ahead_m, 1.0 * room.ahead_m)
        self._room = np.array([-sides[0], -sides[1], -room.ahead_m, sides[0], sides[1], room.ahead_m, texel_m])
        self._still: tuple[Array, tuple[Panel, ...], NDArray[np.float32]] | None = None

    def light(
        self, poses: list[Array], arrangements: list[Arrangement], still: tuple[Panel, ...] = ()
    ) -> NDArray[np.float32]:
        """(h, w, 3) mean light over the instants of an exposure: 1, or 16 in the order of time.

        `poses` are T_stage_camera (4, 4) and `arrangements` what moves, one an instant; `still` never moves.
        """
        if len(poses) not in (1, EDGE_SAMPLES**2) or len(arrangements) != len(poses):
            raise ValueError(
                f"{len(poses)} poses, {len(arrangements)} arrangements; expected 1 or {EDGE_SAMPLES**2} of both"
            )
        image = self._background(poses, still)
        everything = [replace(arrangement, panels=(*arrangement.panels, *still)) for arrangement in arrangements]
        order = _ORDER if len(poses) > 1 else np.zeros_like(_ORDER)
        for region in self._regions(poses, arrangements):
            self._cast(poses, everything, order, region, image)
        return image

    def _background(self, poses: list[Array], still: tuple[Panel, ...]) -> NDArray[np.float32]:
        h, w = self.lens.height, self.lens.width
        moves = any(not np.array_equal(pose, poses[0]) for pose in poses)
        if not moves and self._still is not None and self._still[1] is still:
            if np.array_equal(self._still[0], poses[0]):
                return self._still[2].copy()
            finer = 1  # the eye moves from frame to frame
        else:
            finer = 3
        image = np.empty((h, w, 3), np.float32)
        arrangement = Arrangement((), still)
        if moves:
            some = [poses[k] for k in (1, 5, 10, 14)]
            self._cast(some, [arrangement] * 4, _ORDER_COARSE, (0, 0, w, h), image)
        else:
            self._cast(poses[:1], [arrangement], np.zeros((finer, finer), np.int64), (0, 0, w, h), image)
            self._still = poses[0], still, image.copy()
        return image

    def _regions(self, poses: list[Array], arrangements: list[Arrangement]) -> list[tuple[int, int, int, int]]:
        """x0, y0, x1, y1 of the pixels that may see each of the things that move."""
        w, h = self.lens.width, self.lens.height
        regions = []
        for begin, end in zip(arrangements[0].things, arrangements[-1].things, strict=True):
            ends = ((poses[0], begin), (poses[-1], end))
            pixels = np.concatenate([self.lens.project(pose, outline(one, pose[:3, 3])) for pose, one in ends])
            if np.isnan(pixels).all():
                continue
            if np.isnan(pixels).any():  # reaches beside the lens's range
                regions.append((0, 0, w, h))
                continue
            low, high = np.floor(pixels.min(axis=0)).astype(int) - 2, np.ceil(pixels.max(axis=0)).astype(int) + 3
            x0, y0, x1, y1 = max(low[0], 0), max(low[1], 0), min(high[0], w), min(high[1], h)
            if x0 < x1 and y0 < y1:
                regions.append((int(x0), int(y0), int(x1), int(y1)))
        return regions

    def _cast(
        self,
        poses: list[Array],
        arrangements: list[Arrangement],
        order: NDArray[np.int64],
        region: tuple[int, int, int, int],
        image: NDArray[np.float32],
    ) -> None:
        painted = [one for one in arrangements[0].things if one.surface.pattern == "textured"]
        textures = [self._walls, *(self._texture(one, poses[0][:3, 3]) for one in painted)]
        flat = np.concatenate([t.reshape(-1, 3) for t in textures])
        sizes = np.array([t.shape[:2] for t in textures])
        places = np.array([np.concatenate([p[:3, :3].ravel(), p[:3, 3]]) for p in poses])
        solids = _packed(arrangements)
        _cast(self.lens.rays, places, *solids, self._room, flat, sizes, np.array(region), order, LIGHT, image)

    def _texture(self, one: Thing, eye: Array) -> NDArray[np.float32]:
        """As wide as the object's circumference or width is in the image where it is seen first."""
        if one.surface.photo not in self._widths:
            size_m = 2 * float(np.linalg.norm(one.right)) if isinstance(one, Panel) else 2 * np.pi * one.radius_m
            width_px = size_m * self._focal / max(float(np.linalg.norm(one.center - eye)), 0.1)
            self._widths[one.surface.photo] = max(8, round(width_px))
        return photograph(self._data, one.surface.photo, self._widths[one.surface.photo])


def outline(one: Thing, eye: Array) -> Array:
    """(n, 3) points whose image encloses that of a thing: a ball's rim seen from `eye`, or corners around it."""
    if isinstance(one, Panel):
        return one.center + np.array([a * one.right + b * one.down for a in (-1, 1) for b in (-1, 1)])
    if isinstance(one, Cylinder):
        across = one.radius_m * np.linalg.svd(one.half[None])[2][1:]
        corners = [one.half * c + a * across[0] + b * across[1] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
        return np.asarray(one.center + corners)
    away = one.center - eye
    distance = float(np.linalg.norm(away))
    if distance <= one.radius_m:
        return np.full((1, 3), np.nan)
    sine = one.radius_m / distance
    first = np.cross(away, np.eye(3)[np.argmin(np.abs(away))])
    first /= np.linalg.norm(first)
    second = np.cross(away / distance, first)
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)[:, None]
    rim_radius = one.radius_m * np.sqrt(1 - sine**2)
    return one.center - away * sine**2 + rim_radius * (np.cos(angle) * first + np.sin(angle) * second)


def visible_share(
    lens: Lens, T_stage_camera: Array, arrangement: Arrangement, one: Ball | Panel, still: tuple[Panel, ...]
) -> float:
    """Share of the object's image that lies in the picture with nothing before it."""
    eye = T_stage_camera[:3, 3]
    a, r = 2.399963 * np.arange(256), np.sqrt((np.arange(256) + 0.5) / 256)  # a sunflower's seeds: even over a disc
    if isinstance(one, Ball):
        rim = outline(one, eye)
        if np.isnan(rim).any():
            return 0.0
        middle = rim.mean(axis=0)
        points = middle + r[:, None] * (
            np.cos(a)[:, None] * (rim[0] - middle) + np.sin(a)[:, None] * (rim[12] - middle)
        )
    else:
        s, t = np.meshgrid(np.linspace(-0.97, 0.97, 16), np.linspace(-0.97, 0.97, 16))
        points = one.center + s.reshape(-1, 1) * one.right + t.reshape(-1, 1) * one.down
    pixels = lens.project(T_stage_camera, points)
    inside = np.all((pixels > -0.5) & (pixels < np.array([lens.width, lens.height]) - 0.5), axis=1)
    balls = tuple(ball for ball in arrangement.balls if ball is not one)
    panels = (*(panel for panel in arrangement.panels if panel is not one), *still)
    others = _packed([Arrangement(balls, panels, arrangement.cylinders)])
    distance, _ = first_hits(eye, points - eye, *(rows[0] for rows in others))
    return float(np.mean(inside & (distance >= 1)))


def _packed(arrangements: list[Arrangement]) -> tuple[Array, Array, Array]:
    """Balls (k, n, 22), panels (k, m, 21) and cylinders (k, l, 17): rows of `raycast`, then paint; textured ones have
    the textures after the walls'."""
    balls = np.zeros((len(arrangements), len(arrangements[0].balls), 22))
    panels = np.zeros((len(arrangements), len(arrangements[0].panels), 21))
    cylinders = np.zeros((len(arrangements), len(arrangements[0].cylinders), 17))
    for k, arrangement in enumerate(arrangements):
        texture = 0
        for row, ball in zip(balls[k], arrangement.balls, strict=True):
            texture += ball.surface.pattern == "textured"
            row[:4], row[4:13] = ball_row(ball.center, ball.radius_m), _paint(ball.surface, texture)
            row[13:22] = ball.R_stage_body.T.ravel()
        for row, panel in zip(panels[k], arrangement.panels, strict=True):
            texture += panel.surface.pattern == "textured"
            row[:12], row[12:21] = panel_row(panel.center, panel.right, panel.down), _paint(panel.surface, texture)
        for row, one in zip(cylinders[k], arrangement.cylinders, strict=True):
            texture += one.surface.pattern == "textured"
            half_m = float(np.linalg.norm(one.half))
            row[:8] = cylinder_row(one.center, one.half / half_m, one.radius_m, 2 * half_m)
            row[8:17] = _paint(one.surface, texture)
    return balls, panels, cylinders


def _paint(surface: Surface, texture: int) -> list[float]:
    return [float(PATTERNS.index(surface.pattern)), float(texture), *surface.color, *surface.color2, surface.count]


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def _texel(flat, start, h, w, u, v):  # type: ignore[no-untyped-def]
    """Bilinear colour of a texture at texels u, v; beyond its edges it goes on mirrored."""
    left, top = np.floor(u), np.floor(v)
    i0, j0, p, q = int(left), int(top), u - left, v - top
    i1, j1 = i0 + 1, j0 + 1
    if i0 < 0 or j0 < 0 or i1 >= w or j1 >= h:
        i0, i1, j0, j1 = i0 % (2 * w), i1 % (2 * w), j0 % (2 * h), j1 % (2 * h)
        i0, i1 = min(i0, 2 * w - 1 - i0), min(i1, 2 * w - 1 - i1)
        j0, j1 = min(j0, 2 * h - 1 - j0), min(j1, 2 * h - 1 - j1)
    a, b, c, d = (1 - p) * (1 - q), p * (1 - q), (1 - p) * q, p * q
    j0, j1 = start + j0 * w, start + j1 * w
    return (
        a * flat[j0 + i0, 0] + b * flat[j0 + i1, 0] + c * flat[j1 + i0, 0] + d * flat[j1 + i1, 0],
        a * flat[j0 + i0, 1] + b * flat[j0 + i1, 1] + c * flat[j1 + i0, 1] + d * flat[j1 + i1, 1],
        a * flat[j0 + i0, 2] + b * flat[j0 + i1, 2] + c * flat[j1 + i0, 2] + d * flat[j1 + i1, 2],
    )


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _cast(rays, poses, balls, panels, cylinders, room, flat, sizes, region, order, lamp, image):  # type: ignore[no-untyped-def]
    """Mean colour of a region's pixels over their samples."""
    side = order.shape[0]
    share = 1 / (side * side)
    for y in range(region[1], region[3]):
        for x in range(region[0], region[2]):
            red, green, blue = 0.0, 0.0, 0.0
            ax, ay = (
                0.5 * (rays[y + 1, x + 2, 0] - rays[y + 1, x, 0]),
                0.5 * (rays[y + 1, x + 2, 1] - rays[y + 1, x, 1]),
            )
            bx, by = (
                0.5 * (rays[y + 2, x + 1, 0] - rays[y, x + 1, 0]),
                0.5 * (rays[y + 2, x + 1, 1] - rays[y, x + 1, 1]),
            )
            for j in range(side):
                for i in range(side):
                    k = order[j, i]
                    su, sv = (i + 0.5) / side - 0.5, (j + 0.5) / side - 0.5
                    a, b = rays[y + 1, x + 1, 0] + su * ax + sv * bx, rays[y + 1, x + 1, 1] + su * ay + sv * by
                    ox, oy, oz = poses[k, 9], poses[k, 10], poses[k, 11]
                    dx = poses[k, 0] * a + poses[k, 1] * b + poses[k, 2]
                    dy = poses[k, 3] * a + poses[k, 4] * b + poses[k, 5]
                    dz = poses[k, 6] * a + poses[k, 7] * b + poses[k, 8]
                    t, which = first_hit(ox, oy, oz, dx, dy, dz, balls[k], panels[k], cylinders[k])
                    if which < 0:
                        color = _wall(ox, oy, oz, dx, dy, dz, room, flat, sizes[0, 0], sizes[0, 1])
                    elif which < balls.shape[1]:
                        color = _ball_color(balls, k, which, ox + t * dx, oy + t * dy, oz + t * dz, flat, sizes, lamp)
                    elif which < balls.shape[1] + panels.shape[1]:
                        n = which - balls.shape[1]
                        color = _panel_color(panels, k, n, ox + t * dx, oy + t * dy, oz + t * dz, flat, sizes, lamp)
                    else:
                        n, a, b, c = which - balls.shape[1] - panels.shape[1], ox + t * dx, oy + t * dy, oz + t * dz
                        color = _cylinder_color(cylinders, k, n, a, b, c, flat, sizes, lamp)
                    red, green, blue = red + color[0], green + color[1], blue + color[2]
            image[y, x, 0], image[y, x, 1], image[y, x, 2] = share * red, share * green, share * blue


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def _wall(ox, oy, oz, dx, dy, dz, room, flat, h, w):  # type: ignore[no-untyped-def]
    """Colour of the room's box, seen from inside: the photograph, its middle in the middle of each wall."""
    tx = ((room[3] if dx > 0 else room[0]) - ox) / dx
    ty = ((room[4] if dy > 0 else room[1]) - oy) / dy
    t = ((room[5] if dz > 0 else room[2]) - oz) / dz
    u, v = ox + t * dx, oy + t * dy
    if tx < min(t, ty):
        u, v = oz + tx * dz, oy + tx * dy
    elif ty < t:
        u, v = ox + ty * dx, oz + ty * dz
    return _texel(flat, 0, h, w, u / room[6] + 0.5 * w - 0.5, v / room[6] + 0.5 * h - 0.5)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _ball_color(balls, k, n, x, y, z, flat, sizes, lamp):  # type: ignore[no-untyped-def]
    """Lambert's shading of a ball's paint, which turns with it, at a point of its surface."""
    r = balls[k, n, 3]
    nx, ny, nz = (x - balls[k, n, 0]) / r, (y - balls[k, n, 1]) / r, (z - balls[k, n, 2]) / r
    shade = AMBIENT + (1 - AMBIENT) * max(nx * lamp[0] + ny * lamp[1] + nz * lamp[2], 0.0)
    px = balls[k, n, 13] * nx + balls[k, n, 14] * ny + balls[k, n, 15] * nz
    py = balls[k, n, 16] * nx + balls[k, n, 17] * ny + balls[k, n, 18] * nz
    pz = balls[k, n, 19] * nx + balls[k, n, 20] * ny + balls[k, n, 21] * nz
    u, v = 0.5 * (np.arctan2(py, px) / np.pi + 1), np.arcsin(min(max(pz, -1.0), 1.0)) / np.pi + 0.5
    if balls[k, n, 4] == 1:
        u = 0.5 * (px + 1)
    return _painted(balls, k, n, 4, u, v, 2.0, shade, flat, sizes)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _panel_color(panels, k, n, x, y, z, flat, sizes, lamp):  # type: ignore[no-untyped-def]
    """The same of a panel, either side."""
    nx, ny, nz = panels[k, n, 9], panels[k, n, 10], panels[k, n, 11]
    along = abs(nx * lamp[0] + ny * lamp[1] + nz * lamp[2]) / np.sqrt(nx * nx + ny * ny + nz * nz)
    u, v = on_panel(panels[k], n, x, y, z)
    shade = AMBIENT + (1 - AMBIENT) * along
    return _painted(panels, k, n, 12, 0.5 * (u + 1), 0.5 * (v + 1), 1.0, shade, flat, sizes)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _cylinder_color(cylinders, k, n, x, y, z, flat, sizes, lamp):  # type: ignore[no-untyped-def]
    """The same of a cylinder; u goes along its axis, v around it."""
    ax, ay, az, half = cylinders[k, n, 3], cylinders[k, n, 4], cylinders[k, n, 5], cylinders[k, n, 7]
    x, y, z = x - cylinders[k, n, 0], y - cylinders[k, n, 1], z - cylinders[k, n, 2]
    along = x * ax + y * ay + z * az
    nx, ny, nz = x - along * ax, y - along * ay, z - along * az
    if abs(along) > half * (1 - 1e-9):
        nx, ny, nz = along * ax, along * ay, along * az
    lit = (nx * lamp[0] + ny * lamp[1] + nz * lamp[2]) / np.sqrt(nx * nx + ny * ny + nz * nz)
    shade = AMBIENT + (1 - AMBIENT) * max(lit, 0.0)
    v = 0.5 * (np.arctan2(nx, nz) / np.pi + 1)
    return _painted(cylinders, k, n, 8, 0.5 * (along / half + 1), v, 1.0, shade, flat, sizes)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _painted(things, k, n, start, u, v, aspect, shade, flat, sizes):  # type: ignore[no-untyped-def]
    """Colour of a surface at u, v (0 … 1): pattern, texture, two colours; `aspect` times as many squares along u."""
    if things[k, n, start] == 3:
        texture, begin = int(things[k, n, start + 1]), 0
        for m in range(texture):
            begin += sizes[m, 0] * sizes[m, 1]
        h, w = sizes[texture, 0], sizes[texture, 1]
        c = _texel(flat, begin, h, w, u * w - 0.5, v * h - 0.5)
        return shade * c[0], shade * c[1], shade * c[2]
    is_second, count = False, things[k, n, start + 8]
    if things[k, n, start] == 1:
        is_second = int(np.floor(u * 2 * count)) % 2 == 1
    elif things[k, n, start] == 2:
        is_second = (int(np.floor(u * aspect * count)) + int(np.floor(v * count))) % 2 == 1
    first = start + (5 if is_second else 2)
    return shade * things[k, n, first], shade * things[k, n, first + 1], shade * things[k, n, first + 2]
