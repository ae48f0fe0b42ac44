"""The filter against matrix exponentials, least squares and its own promised statistics."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm
from scipy.stats import chi2

from rendering.motions import make_motion
from tracking.kalman import KalmanParams, predict, process_noise, scaled, start, transition, update

# Tests against an exact model set `unrest_rate=0`: the model's process noise is known there and constant, while a
# filter that follows its innovations is by design another one than theirs.
SHIFT = np.diag(np.ones(3), 1)  # d/dt of (position, velocity, acceleration, jerk)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_transition_is_the_exponential_of_the_derivative(order: int) -> None:
    np.testing.assert_allclose(transition(order, 0.37), expm(0.37 * SHIFT[:order, :order]), atol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_process_noise_is_the_integral_of_what_white_noise_leaves(order: int) -> None:
    last = np.eye(order)[:, -1:]

    def rate(t: float) -> np.ndarray:
        through = expm(t * SHIFT[:order, :order]) @ last
        return 2.5 * through @ through.T

    np.testing.assert_allclose(process_noise(order, 0.8, 2.5), quad_vec(rate, 0, 0.8)[0], rtol=1e-9)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_without_process_noise_it_is_weighted_least_squares(order: int, rng: np.random.Generator) -> None:
    params = KalmanParams(order, 1e-14, white_share=1.0, unrest_rate=0, gate_chi2=1e9)
    stamps = np.cumsum(rng.uniform(0.02, 0.1, 25)).round(6)  # in whole steps of the clock
    cov = np.diag([1e-5, 4e-6, 9e-6])
    measured = rng.normal(0, 0.003, (25, 3)) + np.outer(stamps, [0.1, -0.05, 0.02])
    belief = start(params, stamps[0], measured[0], cov)
    for t, p in zip(stamps[1:], measured[1:], strict=True):
        belief = update(params, predict(params, belief, t), p, cov)
    for axis in range(3):  # unknowns: the derivatives at the first stamp; the prior is a row for each
        rows = np.array([transition(order, t - stamps[0])[0] for t in stamps]) / np.sqrt(cov[axis, axis])
        prior = np.diag([0.0, *(1 / s for s in params.prior_std[: order - 1])])
        design = np.vstack([rows, prior])
        target = np.concatenate([measured[:, axis] / np.sqrt(cov[axis, axis]), np.zeros(order)])
        fitted = np.linalg.lstsq(design, target)[0]
        at_end = transition(order, stamps[-1] - stamps[0]) @ fitted
        np.testing.assert_allclose(belief.mean[:, axis], at_end, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_steps_are_those_of_the_textbook(order: int, rng: np.random.Generator) -> None:
    """P ← F P Fᵀ + Q; K = P Hᵀ (H P Hᵀ + R)⁻¹, x ← x + K (z − H x), P ← P − K H P."""
    params = replace(KalmanParams.of_order(order), white_share=1.0, unrest_rate=0, gate_chi2=1e9)
    H = np.eye(3, 3 * order)
    belief = start(params, 0.0, np.zeros(3), 1e-6 * np.eye(3))
    x, P = belief.mean.ravel(), belief.cov
    for t in np.cumsum(rng.uniform(0.02, 0.1, 60)).round(6).tolist():
        root = rng.uniform(-1e-3, 1e-3, (3, 3))
        R, z = root @ root.T + 1e-7 * np.eye(3), 0.02 * rng.standard_normal(3)
        F = np.kron(transition(order, t - belief.stamp_s), np.eye(3))
        Q = np.kron(process_noise(order, t - belief.stamp_s, params.noise_density), np.eye(3))
        x, P = F @ x, F @ P @ F.T + Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        nis = (z - x[:3]) @ np.linalg.inv(H @ P @ H.T + R) @ (z - x[:3])
        x, P = x + K @ (z - x[:3]), P - K @ H @ P
        belief = update(params, predict(params, belief, t), z, R)
        std = np.sqrt(np.diag(P))
        np.testing.assert_allclose(belief.mean.ravel() / std, x / std, rtol=1e-12, atol=1e-10)
        np.testing.assert_allclose(belief.cov / np.outer(std, std), P / np.outer(std, std), atol=1e-12)
        assert belief.nis == pytest.approx(nis, rel=1e-10)
        assert np.array_equal(belief.cov, belief.cov.T)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_measured_velocity_counts_as_a_measurement_of_it(order: int) -> None:
    """The next position against Gauss's combination of what the start predicts and what is measured."""
    params = replace(KalmanParams.of_order(order), white_share=1.0, unrest_rate=0, gate_chi2=1e9)
    R, V = np.diag([1e-6, 4e-6, 9e-6]), np.array([[4e-4, 1e-4, 0], [1e-4, 9e-4, 2e-4], [0, 2e-4, 1e-4]])
    p, v, dt = np.array([0.1, 0.2, 0.3]), np.array([0.2, -0.1, 0.05]), 0.05
    belief = predict(params, start(params, 1.0, p, R, v, V), 1.0 + dt)
    P = R + process_noise(order, dt, params.noise_density)[0, 0] * np.eye(3)
    if order > 1:
        P += dt**2 * V
    for k, std in enumerate(params.prior_std[1 : order - 1], start=2):
        P += (transition(order, dt)[0, k] * std) ** 2 * np.eye(3)
    ahead = p + (order > 1) * dt * v
    np.testing.assert_allclose(belief.mean[0], ahead, rtol=1e-12)
    np.testing.assert_allclose(belief.cov[:3, :3], P, rtol=1e-9, atol=1e-15)
    z = np.array([0.111, 0.194, 0.304])
    expected = np.linalg.solve(np.linalg.inv(P) + np.linalg.inv(R), np.linalg.solve(P, ahead) + np.linalg.solve(R, z))
    np.testing.assert_allclose(update(params, belief, z, R).mean[0], expected, rtol=1e-9)
    with pytest.raises(ValueError, match="velocity_cov: one is missing"):
        start(params, 1.0, p, R, v)


def test_errors_have_the_covariance_it_claims(rng: np.random.Generator) -> None:
    params = KalmanParams(3, 2.0, (0.3, 0.5, 2.0), white_share=1.0, unrest_rate=0, gate_chi2=1e9)
    R = np.diag([4e-6, 1e-6, 9e-6])
    A, Q = transition(3, 0.05), process_noise(3, 0.05, 2.0)
    root = np.linalg.cholesky(Q + 1e-18 * np.eye(3))
    nees, nis = [], []
    for _ in range(60):
        true = np.vstack([np.zeros(3), 0.3 * rng.standard_normal(3), 0.5 * rng.standard_normal(3)])
        belief = start(params, 0.0, true[0] + np.sqrt(np.diag(R)) * rng.standard_normal(3), R)
        for k in range(1, 21):
            true = A @ true + root @ rng.standard_normal((3, 3))
            z = true[0] + np.sqrt(np.diag(R)) * rng.standard_normal(3)
            belief = update(params, predict(params, belief, 0.05 * k), z, R)
            nis.append(belief.nis)
        error = (belief.mean - true).ravel()
        nees.append(error @ np.linalg.solve(belief.cov, error))
    low, high = chi2.ppf([0.001, 0.999], 9 * len(nees)) / len(nees)
    assert low < np.mean(nees) < high
    low, high = chi2.ppf([0.001, 0.999], 3 * len(nis)) / len(nis)
    assert low < np.mean(nis) < high


def test_coasting_lets_the_covariance_grow_and_stay_positive() -> None:
    params = KalmanParams()
    belief = start(params, 0.0, np.zeros(3), 1e-6 * np.eye(3))
    for k in range(1, 10):
        belief = update(params, predict(params, belief, 0.05 * k), np.array([0.005 * k, 0, 0]), 1e-6 * np.eye(3))
    spread = []
    for k in range(1, 40):
        ahead = predict(params, belief, 0.45 + 0.05 * k)
        spread.append(np.trace(ahead.cov[:3, :3]))
        assert np.linalg.eigvalsh(ahead.cov).min() > -1e-12 * np.linalg.eigvalsh(ahead.cov).max()
    assert np.all(np.diff(spread) > 0)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_thousands_of_steps_leave_the_covariance_sound(order: int, rng: np.random.Generator) -> None:
    """Nearly exact measurements and rare gaps: symmetric, positive, and settled to what it was long before."""
    params = replace(KalmanParams.of_order(order), unrest_rate=0)
    R = np.diag([1e-12, 1e-10, 1e-6])
    belief, seen = start(params, 0.0, np.zeros(3), R), []
    for k in range(1, 5001):
        belief = predict(params, belief, 0.05 * k)
        if k % 50:
            belief = update(params, belief, 1e-6 * rng.standard_normal(3), R)
        if k % 50 == 49:
            seen.append(belief.cov)
    assert np.array_equal(seen[-1], seen[-1].T)
    size = np.sqrt(np.diag(seen[-1]))
    assert np.linalg.eigvalsh(seen[-1] / np.outer(size, size)).min() > 0
    np.testing.assert_allclose(seen[-1], seen[20], rtol=1e-3, atol=1e-3 * np.outer(size, size).min())


def test_one_wild_measurement_is_ignored_and_many_are_believed() -> None:
    params = KalmanParams(max_rejections=3)
    R = 1e-6 * np.eye(3)
    belief = start(params, 0.0, np.zeros(3), R)
    for k in range(1, 20):
        belief = update(params, predict(params, belief, 0.05 * k), np.zeros(3), R)
    away = np.array([0.5, 0, 0])
    belief = update(params, predict(params, belief, 1.0), away, R)
    assert belief.rejections == 1
    assert np.linalg.norm(belief.mean[0]) < 1e-3
    for k in (1, 2):
        belief = update(params, predict(params, belief, 1.0 + 0.05 * k), away, R)
    np.testing.assert_allclose(belief.mean[0], away)


def test_a_dash_is_a_change_of_motion_and_a_jump_is_an_outlier() -> None:
    """At rest for two seconds and so taken to be quiet; then 1.3 m/s at once, or 10 cm in one frame."""
    params, R = KalmanParams(), 1e-8 * np.eye(3)
    belief = start(params, 0.0, np.zeros(3), R)
    for k in range(1, 41):
        belief = update(params, predict(params, belief, 0.05 * k), np.zeros(3), R)
    assert belief.unrest < 0.1
    dashed, jumped = (update(params, predict(params, belief, 2.05), np.array([x, 0, 0]), R) for x in (0.065, 0.1))
    assert dashed.mean[0, 0] == pytest.approx(0.065, abs=1e-4)
    assert dashed.mean[1, 0] == pytest.approx(1.3, abs=0.05)
    assert (jumped.rejections, jumped.mean[0, 0]) == (1, pytest.approx(0.0, abs=1e-4))


def test_a_reversal_is_followed_at_once() -> None:
    params = KalmanParams()
    R = 1e-7 * np.eye(3)
    belief = start(params, 0.0, np.zeros(3), R)
    for k in range(1, 80):
        x = 0.15 * 0.05 * (k if k <= 40 else 80 - k)
        belief = update(params, predict(params, belief, 0.05 * k), np.array([x, 0, 0]), R)
        assert abs(belief.mean[0, 0] - x) < 2e-3
    assert belief.mean[1, 0] == pytest.approx(-0.15, abs=0.01)


def test_a_quiet_motion_is_predicted_the_better_and_a_lively_one_no_worse(rng: np.random.Generator) -> None:
    """Straight on, then round a circle of 6 cm radius at 20 cm/s, against a filter whose process noise stays."""
    t = 0.05 * np.arange(160)
    angle = np.maximum(t - 4.0, 0) * 0.2 / 0.06
    turning = np.stack([np.sin(angle), 1 - np.cos(angle), 0 * t], axis=1) * 0.06
    path = turning + np.outer(np.minimum(t - 4.0, 0), [0.2, 0, 0])
    velocity = 0.2 * np.stack([np.cos(angle), np.sin(angle), 0 * t], axis=1)
    params = KalmanParams(white_share=1.0)
    R = np.diag(np.square([1e-4, 1e-4, 3e-4]))
    error = {0.0: np.zeros((5, 160)), params.unrest_rate: np.zeros((5, 160))}
    for k in range(5):
        z = path + rng.standard_normal((160, 3)) @ np.sqrt(R)
        for rate, squared in error.items():
            own = replace(params, unrest_rate=rate)
            belief = start(own, 0.0, z[0], R)
            for i in range(1, 160):
                belief = update(own, predict(own, belief, t[i]), z[i], R)
                squared[k, i] = np.sum((belief.mean[1] - velocity[i]) ** 2)
    (straight, bent), (straight_still, bent_still) = (
        (squared[:, 40:80].mean() ** 0.5, squared[:, 100:].mean() ** 0.5)
        for squared in (error[params.unrest_rate], error[0.0])
    )
    assert straight < 0.75 * straight_still
    assert bent < 1.15 * bent_still


def test_a_static_thing_near_by_does_not_seem_to_move(rng: np.random.Generator) -> None:
    params = KalmanParams()
    std = np.array([1e-4, 1e-4, 3e-4])  # 0.1 px at 0.2 m
    belief = start(params, 0.0, np.zeros(3), np.diag(std**2))
    speed = []
    for k in range(1, 200):
        z = std * rng.standard_normal(3)
        belief = update(params, predict(params, belief, 0.05 * k), z, np.diag(std**2))
        speed.append(np.linalg.norm(belief.mean[1]))
    assert np.percentile(speed[20:], 95) < 0.02


def test_lengths_in_another_unit_give_the_same_track(rng: np.random.Generator) -> None:
    inch = 1 / 0.0254
    metres, inches = scaled(KalmanParams(), 0.5), scaled(KalmanParams(), 0.5 * inch)
    R = 1e-6 * np.eye(3)
    a, b = start(metres, 0.0, np.zeros(3), R), start(inches, 0.0, np.zeros(3), R * inch**2)
    for k in range(1, 30):
        z = np.array([0.01 * k, 0.02 * np.sin(k / 4), 0.0]) + 1e-3 * rng.standard_normal(3)
        a = update(metres, predict(metres, a, 0.05 * k), z, R)
        b = update(inches, predict(inches, b, 0.05 * k), z * inch, R * inch**2)
    np.testing.assert_allclose(b.mean, a.mean * inch, rtol=1e-6)


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="order 5"):
        KalmanParams(order=5)
    with pytest.raises(ValueError, match="gate -1"):
        replace(KalmanParams(), gate_chi2=-1.0)
    with pytest.raises(ValueError, match="jumps 0"):
        KalmanParams(jump_chi2=0.0)
    with pytest.raises(ValueError, match="unrest rate 2"):
        KalmanParams(unrest_rate=2.0)
    with pytest.raises(ValueError, match="rest after 0"):
        KalmanParams(rest_s=0.0)
    belief = start(KalmanParams(), 1.0, np.zeros(3), np.eye(3))
    with pytest.raises(ValueError, match=r"0\.5.*before 1\.0"):
        predict(KalmanParams(), belief, 0.5)


def test_what_is_unseen_is_not_taken_to_accelerate_for_ever(rng: np.random.Generator) -> None:
    """Turning hands, lost from sight for half a second: nearer than where their acceleration would take them."""
    off_m: dict[float, list[float]] = {KalmanParams().rest_s: [], 1e9: []}
    for _ in range(40):
        motion = make_motion("jerk", rng, (-0.3, 0.0, 0.1), rng.uniform(0.1, 0.3))
        for rest_s, errors in off_m.items():
            params = scaled(KalmanParams(rest_s=rest_s), 0.35)
            belief = start(params, 0.0, motion(0.0)[0], 1e-7 * np.eye(3))
            for k in range(1, 26):
                belief = predict(params, belief, 0.05 * k)
                if k <= 15:
                    belief = update(params, belief, motion(0.05 * k)[0], 1e-7 * np.eye(3))
            errors.append(float(np.linalg.norm(belief.mean[0] - motion(1.25)[0])))
    rests, goes_on = (np.sqrt(np.mean(np.square(errors))) for errors in off_m.values())
    assert rests < 0.85 * goes_on
