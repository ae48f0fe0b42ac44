"""The room: a closed box with a table, and pictures on its walls that have colour and detail."""

import numpy as np
import pytest

from pps_vision.types import Array
from rendering.room import atlas, room_surface

TILE = 512


def quads() -> tuple[Array, Array, Array]:
    """Corners (n, 4, 3), normals (n, 3) and texture coordinates (n, 4, 2) of the room's rectangles."""
    room = room_surface()
    assert room.texture_uv is not None
    corners, normals, uv = (a.reshape(-1, 4, a.shape[1]) for a in (room.positions, room.normals, room.texture_uv))
    assert (normals == normals[:, :1]).all()
    return corners, normals[:, 0], uv


def picture(k: int) -> Array:
    return np.asarray(atlas()[k // 4 * TILE :, k % 4 * TILE :][:TILE, :TILE], float)


def test_six_walls_close_a_box_around_the_robot():
    corners, normals, _ = quads()
    walls = corners[:6].reshape(-1, 3).round(9)
    low = walls.min(axis=0)
    high = walls.max(axis=0)
    assert ((walls == low) | (walls == high)).all()
    places, counts = np.unique(walls, axis=0, return_counts=True)
    assert len(places) == 8
    assert (counts == 3).all()  # three walls meet in every corner
    assert (low < [-1, -1, -0.4]).all()  # a robot of 1 m with its root at the origin
    assert (high > [0.5, 1, 0.6]).all()
    for wall, normal in zip(corners[:6], normals[:6], strict=True):
        assert normal @ ((low + high) / 2 - wall[0]) > 0  # inward
        assert np.linalg.norm(normal) == pytest.approx(1)
        assert np.abs((wall - wall[0]) @ normal).max() < 1e-9


def test_pictures_are_muted_and_have_detail_at_every_scale():
    """Contrast between neighbouring squares of 2 to 64 texels; clipped texels have none."""
    for k in range(7):
        tile = picture(k)
        mean = tile.mean(axis=(0, 1))
        assert 60 < mean.min() < mean.max() < 200
        assert mean.max() - mean.min() > 3  # not grey
        assert mean.max() < 1.5 * mean.min()
        assert ((tile == 0) | (tile == 255)).mean() < 0.01
        for side in (2, 4, 8, 16, 32, 64):
            squares = tile.mean(axis=2).reshape(TILE // side, side, TILE // side, side).mean(axis=(1, 3))
            assert np.abs(np.diff(squares, axis=0)).mean() > 0.01 * mean.mean(), (k, side)
            assert np.abs(np.diff(squares, axis=1)).mean() > 0.01 * mean.mean(), (k, side)
        assert np.abs(np.diff(tile.mean(axis=2), axis=0)).mean() < 0.12 * mean.mean()
