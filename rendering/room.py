"""The room around the robot: walls, floor, ceiling and a table.

Colours are muted but not grey.  Textures have detail at every scale from a wall to a pixel, so that optical flow is
defined everywhere.
"""

from collections.abc import Callable
from functools import cache, partial
from itertools import pairwise, product

import cv2
import numpy as np

from pps_vision.types import Array, Image
from rendering.shapes import Surface

_TILE = 512  # texels along each side of a surface's picture
_PER_ROW = 4

_CORNERS = np.array(list(product((-1.9, 0.9), (-1.5, 1.5), (-0.65, 1.45))))
"""Of the room, m, root frame: front and back, right and left, floor and ceiling."""


def _noise(rng: np.random.Generator, coarsest: int, finest: int, stretch: tuple[int, int] = (1, 1)) -> Array:
    """Fractal noise (tile, tile) in [−1, 1]: octaves of `coarsest` to `finest` cells a side."""
    total = np.zeros((_TILE, _TILE), np.float32)
    cells = coarsest
    while cells <= finest:
        shape = (cells // stretch[0], cells // stretch[1])
        octave = rng.uniform(-1, 1, shape).astype(np.float32)
        total += cv2.resize(octave, (_TILE, _TILE), interpolation=cv2.INTER_CUBIC)
        cells *= 2
    return total / np.abs(total).max()


def _painted(rng: np.random.Generator, color: tuple[int, int, int], noise: Array, depth: float) -> Array:
    """Colour modulated by noise in brightness and slightly in hue: (tile, tile, 3) levels of 255."""
    tint = np.stack([_noise(rng, 4, 32) for _ in range(3)], axis=-1)
    return np.array(color, np.float32) * (1 + depth * noise[..., None] + 0.08 * tint)


def _bricks(rng: np.random.Generator, color: tuple[int, int, int], mortar: tuple[int, int, int], rows: int) -> Array:
    """Rows of bricks of different brightness."""
    picture = _painted(rng, mortar, _noise(rng, 16, 256), 0.25)
    bricks = _painted(rng, color, _noise(rng, 8, 256), 0.30)
    height = _TILE // rows
    width = 2 * _TILE // rows
    for row in range(rows):
        for left in range(-(row % 2) * width // 2, _TILE, width):
            box = np.s_[row * height + 2 : (row + 1) * height - 1, max(left + 2, 0) : max(left + width - 1, 0)]
            picture[box] = bricks[box] * rng.uniform(0.65, 1.25)
    return picture


def _planks(rng: np.random.Generator, color: tuple[int, int, int], columns: int) -> Array:
    """Boards with a grain along them, of different brightness and length."""
    grain = 0.7 * _noise(rng, 32, 256, stretch=(8, 1)) + 0.5 * _noise(rng, 32, 256)
    picture = _painted(rng, color, grain, 0.45)
    width = _TILE // columns
    for column in range(columns):
        stripe = picture[:, column * width : (column + 1) * width]
        cuts = [0, *sorted(rng.integers(0, _TILE, 3)), _TILE]
        for top, bottom in pairwise(cuts):
            stripe[top:bottom] *= rng.uniform(0.7, 1.2)
            stripe[top : top + 2] *= 0.5
        stripe[:, :2] *= 0.5
    return picture


def _plaster(rng: np.random.Generator, color: tuple[int, int, int], pictures: int) -> Array:
    """A rough wall with framed pictures."""
    wall = _painted(rng, color, _noise(rng, 4, 256), 0.45)
    for _ in range(pictures):
        height, width = rng.integers(50, 130, 2)
        top, left = rng.integers(20, _TILE - 150, 2)
        wall[top - 5 : top + height + 5, left - 5 : left + width + 5] = (70, 60, 55)
        motif = tuple(int(c) for c in rng.integers(105, 150, 3))
        detail = _painted(rng, (motif[0], motif[1], motif[2]), _noise(rng, 8, 128), 0.7)
        wall[top : top + height, left : left + width] = detail[top : top + height, left : left + width]
    return wall


def _tabletop(rng: np.random.Generator) -> Array:
    """Boards under a checked cloth, with stains and specks."""
    table = _planks(rng, (150, 125, 100), 8)
    cloth = _painted(rng, (140, 140, 125), _noise(rng, 32, 256), 0.40)
    checks = (np.indices((_TILE, _TILE)) // 24).sum(axis=0) % 2
    cloth *= np.where(checks, 1.0, 0.72)[..., None]
    table[70:440, 90:420] = cloth[70:440, 90:420]
    return table


# How each picture is painted, and its corners at the top left, top right and bottom left, seen from inside.
_SURFACES: tuple[tuple[Callable[[np.random.Generator], Array], Array], ...] = (
    (partial(_bricks, color=(165, 135, 118), mortar=(150, 148, 140), rows=24), _CORNERS[[1, 3, 0]]),
    (partial(_plaster, color=(150, 158, 150), pictures=5), _CORNERS[[5, 1, 4]]),
    (partial(_plaster, color=(160, 152, 138), pictures=6), _CORNERS[[3, 7, 2]]),
    (partial(_plaster, color=(150, 150, 160), pictures=4), _CORNERS[[7, 5, 6]]),
    (partial(_planks, color=(120, 105, 92), columns=16), _CORNERS[[0, 2, 4]]),
    (partial(_plaster, color=(185, 185, 178), pictures=0), _CORNERS[[5, 7, 1]]),
    (_tabletop, np.array([[-1.15, -0.75, -0.22], [-1.15, 0.75, -0.22], [-0.12, -0.75, -0.22]])),
)
_ROWS = -(-len(_SURFACES) // _PER_ROW)


@cache
def atlas() -> Image:
    """Return the pictures of all surfaces in one image; always the same."""
    rng = np.random.default_rng(2013)
    atlas = np.zeros((_ROWS * _TILE, _PER_ROW * _TILE, 3), np.uint8)
    for i, (paint, _) in enumerate(_SURFACES):
        row, column = divmod(i, _PER_ROW)
        atlas[row * _TILE : (row + 1) * _TILE, column * _TILE : (column + 1) * _TILE] = np.clip(paint(rng), 0, 255)
    return atlas


@cache
def room_surface() -> Surface:
    """Return walls and table, facing inward; the table has two sides."""
    corners = [corners for _, corners in _SURFACES]
    quads = [_quad(k, c) for k, c in enumerate(corners)]
    below = corners[-1][[1, 0]]  # mirrored, to face down
    quads.append(_quad(len(corners) - 1, np.vstack([below, below[0] + corners[-1][2] - corners[-1][0]])))
    positions, normals, texture_uv = (np.vstack(some) for some in zip(*quads, strict=True))
    faces = np.array([[0, 3, 1], [0, 2, 3]]) + 4 * np.arange(len(quads))[:, None, None]
    return Surface(positions, normals, faces.reshape(-1, 3), np.ones_like(positions), texture_uv)


def _quad(picture: int, corners: Array) -> tuple[Array, Array, Array]:
    """Return corners and normals (4, 3) and texture coordinates (4, 2) of a rectangle with picture number `picture`."""
    top_left, top_right, bottom_left = corners
    along = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    sides = np.stack([top_right - top_left, bottom_left - top_left])
    inward = np.cross(sides[1], sides[0])
    row, column = divmod(picture, _PER_ROW)
    inset = 4 / _TILE  # texels; keeps coarse mipmap levels from mixing neighbouring pictures
    in_atlas = np.array([column, row]) + inset + along * (1 - 2 * inset)
    u, v = (in_atlas / [_PER_ROW, _ROWS]).T
    normals = np.tile(inward / np.linalg.norm(inward), (4, 1))
    return top_left + along @ sides, normals, np.column_stack([u, 1 - v])  # texture coordinates count from the bottom
