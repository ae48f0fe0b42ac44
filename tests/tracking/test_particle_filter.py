"""Particles: their spread around a prior, and the pixels in their boxes."""

import numpy as np
import pytest

from tracking.particle_filter import SHARPNESS, Particles, box_sums, likelihoods, resample


def test_a_box_is_made_of_the_pixels_around_its_centre(rng):
    """An odd number of pixels a side around a pixel; a corner of the region and its border included."""
    image = rng.random((20, 30))
    integral = np.zeros((21, 31))
    integral[1:, 1:] = image.cumsum(axis=0).cumsum(axis=1)
    places = [(10, 8), (11, 9), (0, 0), (29, 19)]
    particles = np.array([[100.0 + x, 50.0 + y, 2.0] for x, y in places])
    wanted = [image[max(y - 1, 0) : y + 2, max(x - 2, 0) : x + 3].sum() for x, y in places]
    np.testing.assert_allclose(box_sums(integral, particles, (100, 50), (1.25, 0.75)), wanted)


def test_a_box_of_the_objects_size_outweighs_a_larger_one():
    """40 × 10 px on a background of as many pixels as one likes: 400 px gained, or 400 less the other 1200."""
    score = np.full((120, 160), -1.0)
    score[55:65, 70:110] = 1.0
    integral = np.zeros((121, 161))
    integral[1:, 1:] = score.cumsum(axis=0).cumsum(axis=1)
    current = np.array([[89.5, 59.5, 20.0], [89.5, 59.5, 40.0]])
    small, large = likelihoods(Particles(current, current), integral, (0, 0), (2.0, 0.5))
    assert np.log(small / large) == pytest.approx(SHARPNESS * (400 + 800) / 30**2)


def test_weights_add_up_to_one_even_where_no_box_holds_the_object():
    """Boxes far larger than expected lose by every pixel: of their gains alone none would have a weight."""
    integral = np.zeros((121, 161))
    integral[1:, 1:] = -np.ones((120, 160)).cumsum(axis=0).cumsum(axis=1)
    current = np.array([[80.0, 60.0, 1.0]] * 3 + [[80.0, 60.0, 100.0]] * 2)
    weights = likelihoods(Particles(current, current), integral, (0, 0), (0.5, 0.5))
    assert weights.sum() == pytest.approx(1)
    np.testing.assert_allclose(weights[:3], 1 / 3)
    shifted = likelihoods(Particles(current[3:], current[3:]), 1e3 * integral, (0, 0), (0.01, 0.01))
    np.testing.assert_allclose(shifted, 0.5)


def test_resampled_particles_keep_their_past(rng):
    current = rng.random((50, 3))
    chosen = resample(Particles(current, current - 1.0), rng.dirichlet(np.ones(50)), rng)
    np.testing.assert_allclose(chosen.current - chosen.previous, 1.0)
    last = np.zeros(50)
    last[-1] = 0.3  # of rounding no sum of weights need reach one
    np.testing.assert_array_equal(
        resample(Particles(current, current), last, rng).current, np.tile(current[-1], (50, 1))
    )
