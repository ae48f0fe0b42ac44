"""Batched inverse kinematics: targets that are known to be reachable, and optima known in closed form."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from pps_vision.robot.inverse_kinematics import IKParams, solve_ik


def planar(q):
    """Two links of 1 m in a plane."""
    a = q[:, 0]
    b = q[:, 0] + q[:, 1]
    x = np.stack([np.cos(a) + np.cos(b), np.sin(a) + np.sin(b)], 1)
    J = np.stack([-x[:, 1], -np.sin(b), x[:, 0], np.cos(b)], 1).reshape(-1, 2, 2)
    return x, J


def test_stops_at_the_limits_where_a_bounded_least_squares_stops():
    """Targets in front of the arm, where the limits leave one local optimum."""
    rng = np.random.default_rng(1)
    lower = np.array([-0.5, 0.2])
    upper = np.array([0.6, 1.4])
    targets = rng.uniform([0.8, -1.5], [2.5, 2.0], (40, 2))
    start = np.array([0.05, 0.8])
    solution = solve_ik(planar, targets, np.tile(start, (1, 40, 1)), lower, upper, IKParams(max_steps=200))
    best = [
        np.linalg.norm(least_squares(lambda q, t=t: planar(q[None])[0][0] - t, start, bounds=(lower, upper)).fun)
        for t in targets
    ]
    assert (solution.error > 0.1).sum() > 10  # many are out of reach
    np.testing.assert_allclose(solution.error, best, atol=1e-4)
    assert np.all((solution.q_rad >= lower) & (solution.q_rad <= upper))


def test_another_start_is_tried_only_where_one_failed():
    """From the mirrored elbow the lower limit forbids the solution; the second start finds it."""
    target, _ = planar(np.array([[0.2, 1.0]]))
    calls = []

    def counting(q):
        calls.append(len(q))
        return planar(q)

    targets = np.tile(target, (2, 1))
    starts = np.array([[[0.2, 1.0], [1.2, -1.0]], [[9.9, 9.9], [0.3, 0.9]]])
    solution = solve_ik(counting, targets, starts, [-2, -3], [2, 3])
    assert solution.converged.all()
    assert calls == [2]  # both starts solve their target at once: the elbow up and the elbow down
    assert solution.q_rad == pytest.approx(np.array([[0.2, 1.0], [1.2, -1.0]]))
    solution = solve_ik(planar, targets, starts, [-2, 0.5], [2, 3])
    assert solution.q_rad == pytest.approx(np.array([[0.2, 1.0], [0.2, 1.0]]), abs=1e-5)


@pytest.mark.parametrize(
    ("targets", "starts", "lower", "upper", "message"),
    [
        (np.zeros(2), np.zeros((1, 1, 2)), [-1, -1], [1, 1], r"expected \(N, m\) and \(S, N, k\)"),
        (np.zeros((2, 2)), np.zeros((1, 1, 2)), [-1, -1], [1, 1], r"expected \(N, m\) and \(S, N, k\)"),
        (np.zeros((1, 2)), np.zeros((1, 1, 2)), [-1], [1], "expected 2 of each"),
        (np.zeros((1, 2)), np.zeros((1, 1, 2)), [1, 1], [-1, -1], "lower below upper"),
    ],
)
def test_inputs_that_do_not_fit_are_refused(targets, starts, lower, upper, message):
    with pytest.raises(ValueError, match=message):
        solve_ik(planar, targets, starts, lower, upper)
