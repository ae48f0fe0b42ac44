"""LWPR against the figures of its authors' library and linear least squares."""

import numpy as np
import pytest

from pps_vision.experiments.baselines.lwpr import LWPR, LWPRParams

pytestmark = pytest.mark.long


def trained(params, x, y):
    model = LWPR(x.shape[1], y.shape[1], params)
    model.update(x, y)
    return model


def cross(x):
    """The cross function of points (N, 2) (Schaal, Atkeson & Vijayakumar 2002)."""
    ridges = (np.exp(-10 * x[:, 0] ** 2), np.exp(-50 * x[:, 1] ** 2), 1.25 * np.exp(-5 * np.sum(x**2, axis=1)))
    return np.max(ridges, axis=0)


def test_the_cross_function(rng):
    """Normalized error after 20 000 samples: five seeds of the authors' C library leave .058–.065."""
    x = rng.uniform(-1, 1, (20_000, 2))
    y = cross(x) + rng.uniform(-0.05, 0.05, len(x))
    model = trained(LWPRParams(init_D=50, w_gen=0.2), x, y[:, None])
    assert 44 <= model.n_fields <= 64
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 41)] * 2), axis=-1).reshape(-1, 2)
    assert 0.054 <= np.mean((model.predict(grid)[:, 0] - cross(grid)) ** 2) / cross(grid).var() <= 0.065


def test_a_field_with_all_projections_is_weighted_least_squares(rng):
    """The first sample creates the field and is not part of its regression."""
    x = rng.uniform(-0.5, 0.5, (60, 3))
    y = np.sin(3 * x[:, 0]) + x[:, 1] * x[:, 2] + x[:, 2]
    params = LWPRParams(init_D=2.0, first_forgetting=1 - 1e-9, last_forgetting=1 - 1e-9, first_projections=3)
    model = trained(params, np.concatenate([[[0.0, 0.0, 0.0]], x]), np.concatenate([[0.0], y])[:, None])
    assert model.n_fields == 1
    root_w = np.exp(-0.5 * np.sum(x**2, axis=1))[:, None]  # the root of exp(−½ 2 |x|²)
    design = np.column_stack([np.ones(60), x])
    line = np.linalg.lstsq(root_w * design, root_w[:, 0] * y, rcond=None)[0]
    np.testing.assert_allclose(model.predict(x)[:, 0], design @ line, atol=1e-6)


def test_it_answers_only_near_its_samples(rng):
    x = rng.uniform(-1, 1, (600, 3))
    model = trained(LWPRParams(init_D=8), x, x[:, :2])
    assert np.isfinite(model.predict(0.7 * x)).all()
    assert np.isnan(model.predict(np.full((1, 3), 9.0))).all()
    assert np.isnan(LWPR(3, 2, LWPRParams()).predict(x)).all()
