"""First hits against distances and normals that follow from the geometry without a formula for intersections."""

import numpy as np
import pytest

from pps_vision.experiments.films.raycast import ball_row, cylinder_row, first_hits, panel_row
from pps_vision.types import Array

EYE = np.array([0.1, -0.2, 0.3])


def turned(rng: np.random.Generator) -> Array:
    """A random rotation."""
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.linalg.det(q)


@pytest.mark.parametrize("stretch", [1.0, 3.0])
def test_a_ray_through_a_point_of_a_cylinders_surface_hits_there_or_before(stretch):
    """Points of side and ends, the cylinder in a random pose: what faces the eye is met at the point, with the normal
    that it was made with; what does not is hidden. Distances are in lengths of the ray."""
    rng = np.random.default_rng(3)
    R, center, radius, length = turned(rng), np.array([1.0, 0.5, -0.4]), 0.3, 0.5
    angle, along = rng.uniform(0, 2 * np.pi, 200), rng.uniform(-0.5, 0.5, 200) * length
    side = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    end = np.stack([0 * angle, 0 * angle, np.sign(along)], axis=1)
    on_side = radius * side + along[:, None] * [0, 0, 1]
    on_end = 0.9 * radius * side * rng.random((200, 1)) + length / 2 * end
    points, normals = center + np.vstack([on_side, on_end]) @ R.T, np.vstack([side, end]) @ R.T
    row = cylinder_row(center, R[:, 2], radius, length)
    distance, which, met = first_hits(EYE, stretch * (points - EYE), row[None])
    assert np.all(which == 0)
    faces = np.einsum("ij,ij->i", normals, EYE - points) > 1e-6
    assert 50 < faces.sum() < 350
    np.testing.assert_allclose(distance[faces], 1 / stretch, atol=1e-9)
    assert np.all(distance[~faces] < 1 / stretch - 1e-9)
    np.testing.assert_allclose(met[faces], normals[faces], atol=1e-9)


def test_rays_beside_behind_and_from_within_a_cylinder_miss_it():
    row = cylinder_row([0, 0, 1.0], [0, 0, 1.0], 0.1, 0.4)[None]
    rays = np.array([[0, 0, 1.0], [0, 0, -1], [0.099, 0, 0.8], [0.13, 0, 0.8], [1.0, 0, 0]])
    distance, which, _ = first_hits(np.zeros(3), rays, row)
    np.testing.assert_array_equal(which, [0, -1, 0, -1, -1])
    assert distance[0] == pytest.approx(0.8)
    assert first_hits(np.array([0.05, 0, 1.0]), rays, row)[1].max() == -1


def test_the_nearest_of_all_kinds_is_met_and_counted_in_their_order():
    """A ball, a panel and a cylinder on one line, moved so that each is the first in turn; the next kind follows."""
    ahead = np.array([0, 0, 1.0])
    for first in range(3):
        at = [3.0 if k != first else 1.0 for k in range(3)]
        solids = [
            ball_row(at[0] * ahead, 0.1),
            panel_row(at[1] * ahead, np.array([0.2, 0, 0]), np.array([0, 0.3, 0])),
            cylinder_row(at[2] * ahead, [1.0, 0, 0], 0.1, 0.5),
        ]
        distance, which, normals = first_hits(np.zeros(3), ahead[None], np.array(solids))
        np.testing.assert_allclose(np.abs(normals), ahead[None], atol=1e-12)
        assert (which[0], distance[0]) == (first, pytest.approx([0.9, 1.0, 0.9][first]))
