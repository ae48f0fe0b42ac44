"""How many particles are enough: Fox's promise held against drawn samples, and what it makes of a filter."""

import numpy as np
import pytest

from tracking.compiled_masks import box_sums
from tracking.particles import ParticleParams, Prior, enough, propagate, spawn


def test_so_many_particles_keep_the_sample_close_to_what_it_samples(rng: np.random.Generator) -> None:
    """Kullback–Leibler distance of the histogram of n draws from the true one: below the error in 99 %."""
    params, cells, error = ParticleParams(kld_error=0.05), 30, 0.05
    places = np.column_stack([100 + 0.5 * 20 * np.arange(cells), np.full(cells, 50.0), np.full(cells, 20.0)])
    n = enough(params, places)
    true = rng.dirichlet(np.full(cells, 5.0))
    share = rng.multinomial(n, true, size=4000) / n
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(share > 0, share * np.log(share / true), 0.0).sum(axis=1)
    assert np.mean(distance <= error) >= 0.985
    fewer = rng.multinomial(n // 2, true, size=4000) / (n // 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(fewer > 0, fewer * np.log(fewer / true), 0.0).sum(axis=1)
    assert np.mean(distance <= error) < 0.9


def test_their_number_follows_what_is_known(rng: np.random.Generator) -> None:
    params = ParticleParams(count=400, kld_error=0.25)
    middle, used = np.array([160.0, 120.0]), []
    for std_px in (1.0, 10.0, 60.0):
        cloud = spawn(params, middle, 20.0, 0.5, rng)
        for _ in range(2):
            cloud = propagate(params, cloud, Prior(middle, std_px, 1.0), rng)
        used.append(len(cloud.now))
        assert np.linalg.norm(cloud.now[:, :2].mean(axis=0) - middle) < 6 * std_px / np.sqrt(used[-1])
    assert used[0] < 60 < used[1] < used[2] == 400


def test_impossible_numbers_are_named() -> None:
    with pytest.raises(ValueError, match="at least 2 particles"):
        ParticleParams(count=1)
    with pytest.raises(ValueError, match="KLD error"):
        ParticleParams(kld_error=-0.1)


def test_around_a_certain_prior_they_keep_some_spread(rng: np.random.Generator) -> None:
    """A twentieth of the object's size: what is predicted to a hair may still be beside it."""
    params, middle = ParticleParams(count=2000, std_scale=1e-6), np.array([160.0, 120.0])
    for std_px, expected in ((0.0, 2.0), (1.0, 2.0), (5.0, 5.0)):
        cloud = spawn(params, middle, 40.0, 0.0, rng)
        moved = propagate(params, cloud, Prior(middle, std_px, 1.0), rng).now[:, :2]
        np.testing.assert_allclose(moved.std(axis=0), expected, rtol=0.1)


def test_a_box_is_made_of_the_pixels_around_its_centre(rng: np.random.Generator) -> None:
    """Of an odd number of pixels a side around a pixel; a corner of the region and its border included."""
    image = rng.random((20, 30))
    integral = np.zeros((21, 31))
    integral[1:, 1:] = image.cumsum(axis=0).cumsum(axis=1)
    places = [(10, 8), (11, 9), (0, 0), (29, 19)]
    cloud = np.array([[100.0 + x, 50.0 + y, 2.0] for x, y in places])
    wanted = [image[max(y - 1, 0) : y + 2, max(x - 2, 0) : x + 3].sum() for x, y in places]
    np.testing.assert_allclose(box_sums(integral, cloud, 100, 50, 1.25, 0.75), wanted)
