"""Bounded least squares by its conditions of optimality, and limits that hold."""

import numpy as np
import pytest
from scipy.optimize import minimize

from control.differential_kinematics import rate_limits, solve_rates


def test_rows_hold_where_they_can_and_limits_everywhere(rng):
    """Against SciPy's general solver; where a row excludes the limits, it is left by as little as possible."""
    for _ in range(30):
        J = rng.normal(size=(3, 7))
        wanted = 0.1 * rng.normal(size=3)
        preferred = 0.1 * rng.normal(size=7)
        rows = 0.3 * rng.normal(size=(2, 7))
        most = rng.uniform(0, 0.01, 2)
        limits = (-np.ones(7), np.ones(7))
        x = solve_rates(J, wanted, preferred, 0.1, limits, rows, most)
        cost = lambda y, J=J, w=wanted, p=preferred: np.sum((J @ y - w) ** 2) + 0.01 * np.sum((y - p) ** 2)  # noqa: E731
        constraint = {"type": "ineq", "fun": lambda y, rows=rows, most=most: most - rows @ y}
        best = minimize(cost, np.zeros(7), bounds=[(-1, 1)] * 7, constraints=constraint, tol=1e-12)
        assert np.all(rows @ x <= most + 1e-6)
        np.testing.assert_allclose(x, best.x, atol=1e-4)
    x = solve_rates(np.eye(2), np.ones(2), np.zeros(2), 0.1, (-np.ones(2), np.ones(2)), np.array([[1.0, 0.0]]), [-3.0])
    np.testing.assert_allclose(x, [-1.0, 1 / 1.01], atol=1e-5)


def test_bounds_slow_a_joint_before_its_limit_and_drive_it_back_behind():
    q = np.array([0.0, 0.98, 1.5])
    slowest, fastest = rate_limits(q, -np.ones(3), np.ones(3), 2.0, approach_per_s=5.0)
    np.testing.assert_allclose(slowest, [-2.0, -2.0, -2.0])
    np.testing.assert_allclose(fastest, [2.0, 0.1, -2.0])
    assert fastest[2] == pytest.approx(slowest[2])  # beyond its limit there is one way: back
