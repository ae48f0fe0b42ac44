"""Bounded least squares by its conditions of optimality, and limits that hold."""

import numpy as np
import pytest
from scipy.optimize import minimize

from control import differential_kinematics
from control.differential_kinematics import rate_limits, solve_rates


def test_rates_are_the_bounded_minimum(rng: np.random.Generator) -> None:
    """The gradient is zero where a rate is free and points outwards where it is at a bound (Karush–Kuhn–Tucker)."""
    for _ in range(200):
        J, wanted, preferred = rng.normal(size=(4, 7)), rng.choice([1, 30]) * rng.normal(size=4), rng.normal(size=7)
        lower, upper, weights = -rng.uniform(0, 1, 7), rng.uniform(0, 1, 7), rng.choice([0.003, 0.3], 7)
        x = solve_rates(J, wanted, preferred, weights, (lower, upper))
        assert np.all((x >= lower - 1e-8) & (x <= upper + 1e-8))
        gradient = J.T @ (J @ x - wanted) + weights**2 * (x - preferred)
        low, high = np.isclose(x, lower, atol=1e-7), np.isclose(x, upper, atol=1e-7)
        assert np.abs(gradient[~low & ~high]).max(initial=0.0) < 1e-4
        assert gradient[low].min(initial=0.0) > -1e-4
        assert gradient[high].max(initial=0.0) < 1e-4


def test_a_singular_task_gives_finite_rates() -> None:
    rates = solve_rates(np.zeros((3, 4)), np.ones(3), np.array([0.1, 0.2, 0.3, 5.0]), 0.01, (-np.ones(4), np.ones(4)))
    np.testing.assert_allclose(rates, [0.1, 0.2, 0.3, 1.0], atol=1e-9)


def test_rows_hold_where_they_can_and_limits_everywhere(rng: np.random.Generator) -> None:
    """Against SciPy's general solver; where a row excludes the limits, it is left by as little as possible."""
    for _ in range(30):
        J, wanted, preferred = rng.normal(size=(3, 7)), 0.1 * rng.normal(size=3), 0.1 * rng.normal(size=7)
        rows, most, limits = 0.3 * rng.normal(size=(2, 7)), rng.uniform(0, 0.01, 2), (-np.ones(7), np.ones(7))
        x = solve_rates(J, wanted, preferred, 0.1, limits, rows, most)
        cost = lambda y, J=J, w=wanted, p=preferred: np.sum((J @ y - w) ** 2) + 0.01 * np.sum((y - p) ** 2)  # noqa: E731
        constraint = {"type": "ineq", "fun": lambda y, rows=rows, most=most: most - rows @ y}
        best = minimize(cost, np.zeros(7), bounds=[(-1, 1)] * 7, constraints=constraint, tol=1e-12)
        assert np.all(rows @ x <= most + 1e-6)
        np.testing.assert_allclose(x, best.x, atol=1e-4)
    x = solve_rates(np.eye(2), np.ones(2), np.zeros(2), 0.1, (-np.ones(2), np.ones(2)), np.array([[1.0, 0.0]]), [-3.0])
    np.testing.assert_allclose(x, [-1.0, 1 / 1.01], atol=1e-5)


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


HARD_J = [
    [-0.042, 0.009689, 0.01894, 0, 0, 0, 0],
    [0.01126, 0.04247, -0.005083, 0, 0, 0, 0],
    [-0.001987, 0.03591, 0.0008894, 0, 0, 0, 0],
    [-0.004569, 0.0001814, 0.02017, 0, 0, 0, 0],
    [0.001224, 0.004853, -0.005413, 0, 0, 0, 0],
    [-0.0002246, 0.02376, 0.000947, 0, 0, 0, 0],
    [-0.06597, 0.01572, 0.01937, 0.008061, 0, 0, 0],
    [0.01768, 0.06688, -0.01155, 0.001131, 0, 0, 0],
    [-0.009619, 0.04676, -0.001154, -0.002335, 0, 0, 0],
]
HARD_ROWS = [
    [-0.1833, 0.09824, -0.09303, -0.09258, -0.008637, -0.02281, -0.007944],
    [3.875e-05, -0.09168, -1.626e-18, 0, 0, 0, 0],
    [2.927e-18, -1.735e-18, -1.372e-17, 0, 0, 0, 0],
    [-0.003043, -0.1424, 0.0137, 4.337e-19, 0, 0, 0],
]


def test_rates_are_found_where_three_joints_are_at_their_limits_and_a_row_is_empty(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    """A posture of the attack on the control, at which DAQP's own tolerance finds none for one task in twenty."""
    limits = np.array([-1.047] * 7), np.array([0.209, 5e-9, 1.047, 5e-9, 1.047, 5e-9, 1.047])
    most, solve, found = np.array([-0.009757, 0, 0, 0]), differential_kinematics.solve_qp, []

    def watched(*problem, **options):  # type: ignore[no-untyped-def]
        found.append(solve(*problem, **options))
        return found[-1]

    monkeypatch.setattr(differential_kinematics, "solve_qp", watched)
    for _ in range(300):
        task = 0.1 * rng.standard_normal(9), rng.standard_normal(7)
        x = solve_rates(np.array(HARD_J), *task, 0.003, limits, np.array(HARD_ROWS), most)
        assert np.all((x >= limits[0]) & (x <= limits[1]))
        assert np.all(np.array(HARD_ROWS) @ x <= most + 2e-5)
    assert not any(x is None for x in found)


def test_the_robot_rests_as_far_as_limits_allow_where_there_are_no_rates(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(differential_kinematics, "solve_qp", lambda *_, **__: None)
    x = solve_rates(np.eye(2), np.ones(2), np.zeros(2), 0.1, (np.array([-1.0, 0.2]), np.array([1.0, 1.0])))
    assert x.tolist() == [0.0, 0.2]
