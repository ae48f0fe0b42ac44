"""Composite films with true boxes: a textured object over photographs, filmed by one camera that moves.

The object is a piece of one photograph, cut out with limbs that swing; it moves, turns, changes size and is bent.  What
is hard about real films comes on top: surroundings of its colours, a second piece of its photograph, an occluder, light
that changes, blur, noise and JPEG.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.baselines.image_trackers import BoxPx
from pps_vision.experiments.films.caster import photograph
from pps_vision.types import Array, Image

Difficulty = Literal["plain", "alike", "clutter", "occluded", "light", "bent", "fast", "vivid"]
DIFFICULTIES: tuple[Difficulty, ...] = get_args(Difficulty)
_SIDE = 96  # px of the object's texture
_VIVID = ((225, 40, 30), (40, 90, 220), (240, 200, 20), (30, 170, 70), (240, 240, 240), (20, 20, 20))


@dataclass(frozen=True)
class Composite:
    """Images (n), the box around the whole object in each, and the share of the object that no occluder hides."""

    images: tuple[Image, ...]
    boxes: tuple[BoxPx, ...]
    visible: Array


def composite(
    difficulty: Difficulty,
    photos: tuple[int, ...],
    data: Path,
    rng: np.random.Generator,
    n: int = 100,
    shape: tuple[int, int] = (240, 360),
) -> Composite:
    """A film of n images of a height and a width, from the photographs of these indices."""
    behind, within = rng.choice(photos, 2, replace=len(photos) < 2)
    scene = photograph(data, int(behind), 2 * shape[1])
    texture, mask = _object(photograph(data, int(behind if difficulty == "alike" else within), shape[1]), rng)
    if difficulty == "vivid":
        texture = 0.15 * texture + 0.85 * np.array(_VIVID[rng.integers(len(_VIVID))], np.float32)
    other, other_mask = _object(photograph(data, int(within), shape[1]), rng)
    size = np.sqrt(shape[0] * shape[1]) * rng.uniform(0.1, 0.3)
    fast = 2.5 if difficulty == "fast" else 1.0
    place = np.cumsum(_smooth(rng, n, 8, (2,)) * 0.06 * fast * size, axis=0)
    place = _within(place + rng.uniform(0.3, 0.7, 2) * shape[::-1], np.array(shape[::-1]), 0.6 * size)
    growth = np.exp(0.25 * (_smooth(rng, n, 30, (1,)) - _smooth(rng, n, 30, (1,))[:1])[:, 0])
    turn = np.deg2rad(8) * _smooth(rng, n, 20, (1,))[:, 0]
    camera = np.cumsum(_smooth(rng, n, 15, (2,)), axis=0) * 0.6
    light = (
        np.exp(0.35 * _smooth(rng, n, 25, (1,)) + 0.1 * _smooth(rng, n, 25, (3,)))
        if difficulty == "light"
        else np.ones((n, 3))
    )
    swing, wave = rng.uniform(0.1, 0.35), rng.uniform(0, 2 * np.pi, 2)
    bend = {"bent": 9.0, "vivid": 1.0}.get(difficulty, 3.0)
    near = place + (_smooth(rng, n, 20, (2,)) + rng.standard_normal(2)) * 1.2 * size
    hidden = (rng.uniform(0.35, 0.6) * n, rng.uniform(1.2, 3.0))  # frame of the occluder's passage and its width
    pace = max(0.12, (0.5 * hidden[1] + 1) / hidden[0])  # of the occluder, in sizes a frame
    board = photograph(data, int(rng.choice(photos)), shape[1])
    images, boxes, visible = [], [], []
    for k in range(n):
        image = _background(scene, camera[k], shape)
        if difficulty == "clutter":
            _paste(image, other, other_mask, near[k], 0.9 * size * growth[k] / _SIDE, -turn[k])
        bent, bent_mask = _bend(texture, mask, bend, swing, 2 * np.pi * k / 14 + wave[0], 2 * np.pi * k / 31 + wave[1])
        alpha = _paste(image, bent, bent_mask, place[k], size * growth[k] / _SIDE, turn[k])
        ys, xs = np.nonzero(alpha > 0.5)
        share = 1.0
        if difficulty == "occluded":
            left = place[k, 0] + (k - hidden[0]) * size * pace - hidden[1] * size / 2
            x0, x1 = (int(np.clip(x, 0, shape[1])) for x in (left, left + hidden[1] * size))
            image[:, x0:x1] = board[: shape[0], :][: image.shape[0], x0:x1] if board.shape[0] >= shape[0] else 90.0
            share = 1 - float(alpha[:, x0:x1].sum() / alpha.sum())
        images.append(_filmed(image * light[k], place, k, rng))
        x0, y0 = int(xs.min()), int(ys.min())
        boxes.append((float(x0), float(y0), float(xs.max() - x0 + 1), float(ys.max() - y0 + 1)))
        visible.append(share)
    return Composite(tuple(images), tuple(boxes), np.array(visible))


def _smooth(rng: np.random.Generator, n: int, frames: float, shape: tuple[int, ...]) -> Array:
    """(n, *shape) noise of unit variance, correlated over so many frames."""
    noise = rng.standard_normal((n + 8 * int(frames), *shape)).reshape(n + 8 * int(frames), -1)
    blurred = np.asarray(cv2.GaussianBlur(noise, (0, 0), sigmaX=0.01, sigmaY=frames))
    part = blurred[4 * int(frames) : 4 * int(frames) + n]
    return np.asarray(part * np.sqrt(2 * np.sqrt(np.pi) * frames)).reshape(n, *shape)


def _within(path: Array, size: Array, margin: float) -> Array:
    """A path (n, 2) folded back at the borders of an image."""
    span = size - 2 * margin
    folded: Array = margin + span - np.abs((path - margin) % (2 * span) - span)
    return folded


def _object(photo: NDArray[np.float32], rng: np.random.Generator) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(side, side, 3) texture and (side, side) mask: a body, and up to four limbs or a head."""
    side = int(rng.uniform(0.25, 0.6) * min(photo.shape[:2]))
    y, x = (int(rng.integers(0, photo.shape[k] - side + 1)) for k in (0, 1))
    texture = cv2.resize(photo[y : y + side, x : x + side], (_SIDE, _SIDE), interpolation=cv2.INTER_AREA)
    mask, c = np.zeros((_SIDE, _SIDE), np.float32), _SIDE // 2
    wide = rng.uniform(0.14, 0.42)
    if rng.random() < 0.5:
        cv2.ellipse(mask, (c, c), (round(wide * _SIDE), round(0.42 * _SIDE)), 0, 0, 360, (1.0,), cv2.FILLED)
    else:
        half = round(wide * _SIDE)
        cv2.rectangle(mask, (c - half, round(0.1 * _SIDE)), (c + half, round(0.9 * _SIDE)), (1.0,), cv2.FILLED)
    for _ in range(rng.integers(0, 4)):
        angle, length = rng.uniform(0, 2 * np.pi), rng.uniform(0.25, 0.45) * _SIDE
        end = round(c + length * np.cos(angle)), round(c + length * np.sin(angle))
        cv2.line(mask, (c, c), end, (1.0,), int(rng.uniform(0.06, 0.2) * _SIDE))
    level = rng.uniform(0.6, 1.3) * rng.uniform(0.8, 1.2, 3)
    return np.clip(np.asarray(texture) * level, 0, 255).astype(np.float32), mask


def _background(scene: NDArray[np.float32], shift: Array, shape: tuple[int, int]) -> NDArray[np.float32]:
    """What the camera sees of a photograph, mirrored beyond its borders."""
    height, width = scene.shape[:2]
    M = np.array([[1.0, 0, width / 2 - shape[1] / 2 + shift[0]], [0, 1, height / 2 - shape[0] / 2 + shift[1]]])
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(scene, M, shape[::-1], flags=how, borderMode=cv2.BORDER_REFLECT), np.float32)


def _bend(
    texture: NDArray[np.float32], mask: NDArray[np.float32], px: float, swing: float, phase: float, slow: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The object bent by waves of so many px; its lower half swings."""
    y, x = np.mgrid[:_SIDE, :_SIDE].astype(np.float32)
    lower = np.maximum(y / _SIDE - 0.5, 0) * swing * px / 3
    u = x + px * np.sin(2 * np.pi * y / _SIDE + slow) * 0.5 + (x - _SIDE / 2) * lower * np.sin(phase) * 2
    v = y + px * np.sin(2 * np.pi * x / _SIDE + 2 * slow) * 0.5
    u, v = u.astype(np.float32), v.astype(np.float32)
    return (
        np.asarray(cv2.remap(texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT), np.float32),
        np.asarray(cv2.remap(mask, u, v, cv2.INTER_LINEAR), np.float32),
    )


def _paste(
    image: NDArray[np.float32],
    texture: NDArray[np.float32],
    mask: NDArray[np.float32],
    center: Array,
    scale: float,
    turn: float,
) -> NDArray[np.float32]:
    """Draw the object into the image; (h, w) its share of every pixel."""
    c, s, half = scale * np.cos(turn), scale * np.sin(turn), (_SIDE - 1) / 2
    M = np.array([[c, -s, center[0] - c * half + s * half], [s, c, center[1] - s * half - c * half]])
    blur = 0.4 / scale if scale < 1 else 0.0
    soft = (cv2.GaussianBlur(one, (0, 0), blur) if blur > 0.3 else one for one in (texture, mask))
    size = image.shape[1::-1]
    drawn, alpha = (np.asarray(cv2.warpAffine(one, M, size, flags=cv2.INTER_LINEAR), np.float32) for one in soft)
    whole = np.asarray(cv2.warpAffine(np.ones_like(mask), M, size, flags=cv2.INTER_LINEAR), np.float32)
    colors = drawn / np.maximum(whole, 1e-3)[..., None]
    image += alpha[..., None] * (colors - image)
    return alpha


def _filmed(light: Array, place: Array, k: int, rng: np.random.Generator) -> Image:
    """Blurred by half the motion, with noise and JPEG."""
    step = float(np.linalg.norm(place[k] - place[max(k - 1, 0)]))
    soft = np.asarray(cv2.GaussianBlur(light, (0, 0), 0.5 + min(step, 12) / 12))
    noisy = np.clip(soft + 3 * rng.standard_normal(light.shape), 0, 255).astype(np.uint8)
    _, coded = cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, 85])
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), dtype=np.uint8)
