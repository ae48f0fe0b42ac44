"""Balls in a room with another texture on every wall, filmed by two cameras far apart: rays met with planes and a
sphere in NumPy, OpenCV's lens, and nothing of the package but the messages that a tracker takes."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Literal

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.types import Array, Image, StereoFrame

Kind = Literal["90°", "150°", "180°", "vertical", "rolled", "1 m"]
KINDS: tuple[Kind, ...] = ("90°", "150°", "180°", "vertical", "rolled", "1 m")
SIZE = (640, 480)
FPS = 30.0
_K = (
    np.array([[552.0, 0, 322.7], [0, 551.0, 237.1], [0, 0, 1]]),
    np.array([[548.0, 0, 317.3], [0, 549.0, 240.9], [0, 0, 1]]),
)
_DISTORTION = np.array([-0.1, 0.04, 0.0005, -0.0004, 0.0])
_LAMP = np.array([0.3, -0.9, -0.3]) / np.linalg.norm([0.3, -0.9, -0.3])
_COLORS = ((205, 30, 25), (25, 150, 45), (30, 60, 190), (220, 130, 20), (170, 30, 150))
_OFF_BASELINE = 0.15  # least distance of a ball's path from the line through both cameras, relative to that from them


@dataclass(frozen=True)
class WideFilm:
    """A ball that circles in view of two cameras, whose axes cross at about `distance_m`; the world's y points down."""

    kind: Kind
    seed: int
    frames: int = 45

    @cached_property
    def _drawn(self) -> tuple[float, tuple[Array, Array], Array, Array, Array, float]:
        """Distance (m), poses (4, 4) of the cameras, centre (3,) and axes (2, 3) of the circle (m), rate (rad/s)."""
        rng = np.random.default_rng((self.seed, KINDS.index(self.kind)))
        while True:
            distance_m = rng.uniform(0.6, 1.0)
            poses = _poses(self.kind, distance_m, rng)
            center = 0.3 * distance_m * rng.uniform(-1, 1, 3) * (1, 0.8, 1)
            axes = 0.13 * distance_m * np.linalg.qr(rng.standard_normal((3, 2)))[0].T
            rate = rng.choice([-1, 1]) * rng.uniform(0.25, 0.6) / 0.13
            film = distance_m, poses, center, axes, rate
            path = center + _turned(axes, np.linspace(0, 2 * np.pi, 60))
            if all(_in_view(pose, path) for pose in poses) and _off(poses, path) > _OFF_BASELINE * distance_m:
                return (*film[:4], np.array(_COLORS[rng.integers(len(_COLORS))], float), rate)

    @property
    def radius_m(self) -> float:
        """Radius of the ball."""
        return 0.05 * self._drawn[0]

    def position(self, t_s: float) -> Array:
        """(3,) m, in the left camera's frame."""
        T_left = self._drawn[1][0]
        return np.asarray((self._at(t_s) - T_left[:3, 3]) @ T_left[:3, :3])

    def _at(self, t_s: float) -> Array:
        _, _, center, axes, _, rate = self._drawn
        return np.asarray(center + _turned(axes, np.array([rate * t_s]))[0])

    @cached_property
    def rig(self) -> StereoRig:
        """The cameras as a calibration has them."""
        lens = tuple(_DISTORTION.tolist())
        left, right = (Camera(*SIZE, K[0, 0], K[1, 1], K[0, 2], K[1, 2], lens) for K in _K)
        T_left, T_right = self._drawn[1]
        return StereoRig.fixed(left, right, np.linalg.inv(T_left) @ T_right)

    @cached_property
    def stereo_frames(self) -> list[StereoFrame]:
        """The film."""
        rng = np.random.default_rng((self.seed, 99))
        walls = [_texture(np.random.default_rng((self.seed, wall, 5))) for wall in range(6)]
        sides = []
        for side, T in enumerate(self._drawn[1]):
            empty = _room(T[:3, 3], _rays(side, 1) @ T[:3, :3].T, walls)[:, 0, :, 0]
            sides.append([self._image(k / FPS, side, T, empty, rng) for k in range(self.frames)])
        return [StereoFrame(a, b, k / FPS, k / FPS) for k, (a, b) in enumerate(zip(*sides, strict=True))]

    def _image(self, t_s: float, side: int, T: Array, empty: Array, rng: np.random.Generator) -> Image:
        """The ball before the empty room, of 4 × 4 rays a pixel, with noise."""
        ball = self._at(t_s)
        image = empty.copy()
        center = _project(_K[side], T, ball[None])[0]
        reach = 1.2 * self.radius_m / np.linalg.norm(ball - T[:3, 3]) * _K[side][0, 0] + 4
        x0, y0 = np.maximum(center - reach, 0).astype(int).tolist()
        x1, y1 = (np.minimum(center + reach, np.array(SIZE) - 1).astype(int) + 1).tolist()
        rays = _rays(side, 4, (x0, y0, x1, y1)) @ T[:3, :3].T
        away = T[:3, 3] - ball
        along = rays @ away
        inside = along**2 - away @ away + self.radius_m**2
        hit = (inside > 0)[..., None]
        normals = (away + (-along - np.sqrt(np.maximum(inside, 0)))[..., None] * rays) / self.radius_m
        light = (0.5 + 0.5 * np.maximum(normals @ _LAMP, 0))[..., None] * self._drawn[4]
        behind = image[y0:y1, None, x0:x1, None]
        image[y0:y1, x0:x1] = np.where(hit, light, behind).mean(axis=(1, 3))
        image += 2 * rng.standard_normal(image.shape, np.float32) + np.float32(0.5)
        return np.clip(image, 0, 255, out=image).astype(np.uint8)


def _poses(kind: Kind, distance_m: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """(4, 4) each, in a world whose origin both cameras look at, within a few degrees."""
    apart = {"90°": 90.0, "150°": 150.0, "180°": 180.0}.get(kind)
    if apart is None:
        baseline_m = 1.0 if kind == "1 m" else rng.uniform(0.1, 0.3)
        apart = 2 * np.rad2deg(np.arcsin(baseline_m / 2 / distance_m))
    elif rng.random() < 0.5:
        apart = -apart  # either is called the left one
    first = rng.uniform(0, 360)
    poses = []
    for turn in (0.0, -apart):
        angle = np.deg2rad(first + turn)
        place = distance_m * np.array([np.sin(angle), 0, -np.cos(angle)])
        ahead = -place / distance_m + rng.normal(0, 0.01, 3)
        ahead /= np.linalg.norm(ahead)
        across = np.cross([0, 1, 0], ahead)
        across /= np.linalg.norm(across)
        roll = np.deg2rad(rng.normal(0, 2)) + (np.deg2rad(rng.choice([90, 180])) if kind == "rolled" else 0)
        R = np.stack([across, np.cross(ahead, across), ahead], axis=1)
        T = np.eye(4)
        T[:3, :3] = R @ cv2.Rodrigues(np.array([0, 0, roll]))[0]
        T[:3, 3] = place
        poses.append(T)
    if kind == "vertical":  # lie the whole rig on its side, the cameras stay upright
        side = cv2.Rodrigues(np.pi / 2 * poses[0][:3, 2])[0]
        upright = cv2.Rodrigues(np.array([0, 0, -np.pi / 2]))[0]
        for T in poses:
            T[:3, :3], T[:3, 3] = side @ T[:3, :3] @ upright, side @ T[:3, 3]
    return poses[0], poses[1]


def _turned(axes: Array, angles: Array) -> Array:
    return np.asarray(np.cos(angles)[:, None] * axes[0] + np.sin(angles)[:, None] * axes[1])


def _project(K: Array, T: Array, points: Array) -> Array:
    in_camera = (points - T[:3, 3]) @ T[:3, :3]
    return np.asarray(cv2.projectPoints(in_camera[:, None], np.zeros(3), np.zeros(3), K, _DISTORTION)[0]).reshape(-1, 2)


def _in_view(T: Array, path: Array) -> bool:
    """Whether the whole ball stays in the picture, a few pixels from the border."""
    depth = (path - T[:3, 3]) @ T[:3, 2]
    px = _project(_K[0], T, path)
    return bool((depth > 0.3).all() and (px > 50).all() and (px < np.array(SIZE) - 50).all())


def _off(poses: tuple[Array, Array], path: Array) -> float:
    """Least distance of a path (n, 3) from the line through both cameras, m."""
    a, b = (T[:3, 3] for T in poses)
    return float(np.linalg.norm(np.cross(path - a, (b - a) / np.linalg.norm(b - a)), axis=1).min())


def _rays(side: int, samples: int, box: tuple[int, int, int, int] = (0, 0, *SIZE)) -> Array:
    """(rows, samples, columns, samples, 3) unit vectors through samples² places of every pixel of a box."""
    x0, y0, x1, y1 = box
    xy, by_u, by_v = (part[y0:y1, None, x0:x1, None] for part in _lens(side))
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    xy = xy + offsets[:, None, None, None] * by_v + offsets[:, None] * by_u
    rays = np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


@cache
def _lens(side: int) -> tuple[Array, Array, Array]:
    """x and y for z = 1 of a camera's pixel centres (h, w, 2), and how they change by column and row."""
    px = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).reshape(-1, 1, 2).astype(float)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-10)
    xy = cv2.undistortPointsIter(px, _K[side], _DISTORTION, np.eye(3), np.eye(3), stop).reshape(*SIZE[::-1], 2)
    by_v, by_u = np.gradient(xy, axis=(0, 1))
    return xy, by_u, by_v


def _room(place: Array, rays: Array, walls: list[Image]) -> Array:
    """Levels (…, 3) where rays (…, 3) meet the walls of a room 4.4 m wide and 2.8 m high."""
    half = np.array([2.2, 1.4, 2.2])
    lengths = (np.sign(rays) * half - place) / rays
    axis = lengths.argmin(axis=-1)
    points = place + lengths.min(axis=-1)[..., None] * rays
    level = np.empty(rays.shape, np.float32)
    for wall in range(6):
        k = wall // 2
        here = (axis == k) & ((rays[..., k] > 0) == wall % 2)
        uv = (0.5 + 0.5 * np.delete(points[here] / half, k, axis=1)) * (np.array(walls[wall].shape[1::-1]) - 1)
        for channel in range(3):
            level[here, channel] = map_coordinates(walls[wall][..., channel], uv.T[::-1], np.float32, order=1)
    return level


def _texture(rng: np.random.Generator) -> Image:
    """Panels, posters and grain (900, 1400, 3), of levels that no other wall has."""
    image = np.full((900, 1400, 3), rng.uniform(70, 190, 3))
    for _ in range(60):
        corner = rng.integers(0, (1400, 900))
        size = rng.integers(30, 260, 2)
        level = np.clip(rng.uniform(40, 210) + rng.normal(0, 18, 3), 0, 255)
        shape = rng.integers(3)
        if shape == 0:
            cv2.rectangle(image, corner, corner + size, level.tolist(), -1)
        elif shape == 1:
            cv2.ellipse(image, corner, size // 2, rng.uniform(0, 180), 0, 360, level.tolist(), -1)
        else:
            cv2.line(image, corner, corner + 2 * size - 150, level.tolist(), int(rng.integers(2, 12)))
    grain = sum(
        cv2.resize(rng.standard_normal((9 * n, 14 * n)), (1400, 900), interpolation=cv2.INTER_CUBIC) for n in (1, 4, 16)
    )
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.8) + 6 * grain[..., None], 0, 255).astype(np.uint8)
