"""Bounded least squares against a general optimiser, and limits that hold."""

import numpy as np
import pytest
from scipy.optimize import minimize

from control.differential_kinematics import rate_limits, solve_rates
from pps_vision.types import Array


def test_rates_are_the_bounded_minimum_a_general_optimiser_finds(rng: np.random.Generator) -> None:
    for _ in range(20):
        J, wanted, preferred = rng.normal(size=(3, 5)), 3 * rng.normal(size=3), rng.normal(size=5)
        weights, bound = rng.uniform(0.05, 0.5, 5), rng.uniform(0.2, 2.0, 5)

        def cost(x: Array, *problem: Array) -> float:
            J, wanted, preferred, weights = problem
            return float(np.sum((J @ x - wanted) ** 2) + np.sum((weights * (x - preferred)) ** 2))

        problem = (J, wanted, preferred, weights)
        rates = solve_rates(J, wanted, preferred, weights, (-bound, bound))
        reference = minimize(cost, np.zeros(5), problem, bounds=list(zip(-bound, bound, strict=True)), tol=1e-14)
        assert np.all(np.abs(rates) <= bound + 1e-8)
        assert cost(rates, *problem) <= reference.fun + 1e-6


def test_a_singular_task_gives_finite_rates() -> None:
    rates = solve_rates(np.zeros((3, 4)), np.ones(3), np.array([0.1, 0.2, 0.3, 5.0]), 0.01, (-np.ones(4), np.ones(4)))
    np.testing.assert_allclose(rates, [0.1, 0.2, 0.3, 1.0], atol=1e-9)


def test_a_joint_without_room_stands_still() -> None:
    fixed = np.zeros(2)
    rates = solve_rates(np.eye(2), np.ones(2), np.zeros(2), 0.01, (fixed, fixed))
    np.testing.assert_allclose(rates, 0.0, atol=1e-8)


def test_bounds_slow_a_joint_before_its_limit_and_drive_it_back_behind() -> None:
    q = np.array([0.0, 0.98, 1.5])
    slowest, fastest = rate_limits(q, -np.ones(3), np.ones(3), 2.0, approach_per_s=5.0)
    np.testing.assert_allclose(slowest, [-2.0, -2.0, -2.0])
    np.testing.assert_allclose(fastest, [2.0, 0.1, -2.0])
    assert fastest[2] == pytest.approx(slowest[2])  # beyond its limit there is one way: back


def test_a_joint_beyond_its_limit_is_driven_back() -> None:
    slowest, fastest = rate_limits(np.array([-1.1, 1.1, 0.0]), -np.ones(3), np.ones(3), 0.3, 2.0)
    np.testing.assert_allclose(slowest, [0.2, -0.3, -0.3])
    np.testing.assert_allclose(fastest, [0.3, -0.2, 0.3])
