"""The room: a closed box with a table, and pictures on its walls that have colour and detail."""

import cv2
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


def test_six_walls_close_a_box_around_the_robot() -> None:
    corners, normals, _ = quads()
    walls = corners[:6].reshape(-1, 3).round(9)
    low, high = walls.min(axis=0), walls.max(axis=0)
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


def test_the_table_stands_before_the_robot_and_has_two_sides() -> None:
    corners, normals, _ = quads()
    top, below = corners[6:]
    walls = corners[:6].reshape(-1, 3)
    assert np.array_equal(np.unique(top, axis=0), np.unique(below, axis=0))
    assert normals[6:] == pytest.approx(np.array([[0, 0, 1], [0, 0, -1]]))
    assert (top > walls.min(axis=0)).all()
    assert (top < walls.max(axis=0)).all()
    assert top[:, 0].max() < 0
    assert top[:, 1] == pytest.approx(-top[::-1, 1])  # from left to right as far
    assert np.ptp(top[:, 2]) == 0


def test_faces_are_seen_from_the_side_that_their_normals_point_to() -> None:
    room = room_surface()
    a, b, c = np.moveaxis(room.positions[room.faces], 1, 0)
    across = np.cross(b - a, c - a)
    assert (np.einsum("ij,ij->i", across, room.normals[room.faces[:, 0]]) > 0).all()
    area = np.linalg.norm(across, axis=1).reshape(-1, 2).sum(axis=1) / 2  # two triangles a rectangle
    corners, _, _ = quads()
    sides = [np.linalg.norm(corners[:, k] - corners[:, 0], axis=1) for k in (1, 2)]
    np.testing.assert_allclose(area, sides[0] * sides[1])


def test_each_surface_shows_its_own_picture_upright() -> None:
    """Corners 0, 1, 2, 3: the picture's top left, top right, bottom left, bottom right, seen from inside."""
    corners, normals, uv = quads()
    for k, (one, normal, at) in enumerate(zip(corners, normals, uv, strict=True)):
        rightward, downward = one[1] - one[0], one[2] - one[0]
        assert np.cross(downward, rightward) @ normal > 0
        tile = min(k, 6)
        px = np.column_stack([at[:, 0] * atlas().shape[1], (1 - at[:, 1]) * atlas().shape[0]])
        expected = np.array([tile % 4, tile // 4]) * TILE + np.array([[0, 0], [TILE, 0], [0, TILE], [TILE, TILE]])
        assert np.abs(px - expected).max() < 0.02 * TILE  # its border is left out
        assert (np.abs(px - (expected.mean(axis=0))).max(axis=0) < TILE / 2).all()


def test_pictures_are_muted_and_have_detail_at_every_scale() -> None:
    """Contrast between neighbouring squares of 2 to 64 texels; what is clipped to black or white has none."""
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


def test_bricks_lie_in_24_rows_and_every_other_row_is_shifted_by_half_a_brick() -> None:
    wall = picture(0).mean(axis=2)
    height, width = TILE // 24, 2 * TILE // 24
    inside = wall[: 24 * height, : 12 * width].reshape(24, height, 12, width)
    joints = [abs(np.diff(inside[k::2, 4:-4].mean(axis=(0, 1, 2)))) for k in (0, 1)]
    even, odd = (np.where(one > 0.6 * one.max())[0] for one in joints)
    assert (np.minimum(even, width - even) <= 3).all()
    assert (abs(odd - width // 2) <= 3).all()
    rows = wall[: 24 * height].reshape(24, height, TILE)
    brick_of_row = rows[:, 4:-4].mean(axis=1)[:, width // 4 :: width]
    assert 0.1 < brick_of_row.std() / brick_of_row.mean() < 0.3  # each its own brightness


def test_mortar_is_three_texels_wide_and_greyer_than_the_bricks() -> None:
    red, _, blue = np.moveaxis(picture(0)[: 24 * 21], -1, 0).reshape(3, 24, 21, TILE)
    redness = red / blue
    of_lines = np.median(redness, axis=(0, 2))
    assert np.flatnonzero(of_lines < 1.2).tolist() == [0, 1, 20]
    for first, joint in ((0, [0, 1, 41]), (1, [20, 21, 22])):
        across = np.median(redness[first::2, 3:-2, : 12 * 42].reshape(12, 16, 12, 42), axis=(0, 1, 2))
        assert np.flatnonzero(across < 1.2).tolist() == joint


def test_the_floor_has_16_boards_with_dark_joints() -> None:
    floor = picture(4).mean(axis=2)
    width = TILE // 16
    across = floor.mean(axis=0).reshape(16, width)
    assert (across.argmin(axis=1) < 2).all()
    joint = across[:, :2].mean() / across[:, 2:].mean()
    assert joint == pytest.approx(0.5, abs=0.07)
    levels = floor.reshape(TILE, 16, width)[:, :, 2:].mean(axis=2)
    assert 0.08 < levels.std() / levels.mean() < 0.3
    assert np.abs(np.diff(floor, axis=1)).mean() > 2 * np.abs(np.diff(floor, axis=0)).mean()  # a grain along them


def test_each_board_is_cut_at_three_places() -> None:
    """Two dark texels at each cut; where cuts are close or at the border fewer are told apart."""
    boards = picture(4).mean(axis=2).reshape(TILE, 16, TILE // 16)[:, :, 3:-1].mean(axis=2)
    dark = boards[2:-2] < 0.65 * (boards[:-4] + boards[4:]) / 2
    cuts = dark.sum(axis=0)
    assert set(cuts.tolist()) <= {4, 6}
    assert np.mean(cuts == 6) > 0.8
    assert not (dark[2:] & dark[:-2]).any()


def test_the_table_has_a_cloth_checked_every_24_texels() -> None:
    cloth = picture(6).mean(axis=2)[72:432, 96:408]
    squares = cloth.reshape(15, 24, 13, 24).mean(axis=(1, 3))
    odd = np.indices(squares.shape).sum(axis=0) % 2 == 1
    levels = sorted((squares[odd].mean(), squares[~odd].mean()))
    assert levels[0] / levels[1] == pytest.approx(0.72, abs=0.05)


def test_framed_pictures_hang_on_three_walls() -> None:
    """Frames are of one dark colour; there is none on floor, ceiling, bricks and table."""
    framed = [(np.abs(picture(k) - (70, 60, 55)).max(axis=2) < 1).mean() for k in range(7)]
    assert [k for k in range(7) if framed[k] > 0.005] == [1, 2, 3]


@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_picture_that_overlaps_no_other_is_framed_all_around(k: int) -> None:
    """By 5 texels; a picture is 50 to 130 texels wide and high."""
    frames = np.all(np.abs(picture(k) - (70, 60, 55)) < 1, axis=2).astype(np.uint8)
    whole = 0
    for x, y, width, height, area in cv2.connectedComponentsWithStats(frames)[2][1:]:
        inside = frames[y + 5 : y + height - 5, x + 5 : x + width - 5]
        if area == width * height - inside.size:
            whole += 1
            assert not inside.any()
            assert 50 <= min(inside.shape) <= max(inside.shape) < 130
    assert whole > 0
