"""The filter against matrix exponentials, least squares, other implementations and its own promised statistics."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from linear_model import corrected, discretised, matrices
from ranges import check_range
from scipy.stats import chi2, multivariate_normal

from pps_vision.types import Status, Track3D
from tracking import kalman
from tracking.kalman import Belief, KalmanParams, discretise, predict, start, update

# Tests against an exact model set `adaptation_rate=0`: the model's process noise is known there and constant, while a
# filter that follows its innovations is by design another one than theirs.
EXACT = {"adaptation_rate": 0, "jump_probability": 0, "gate_chi2": 1e9}


def _close(result: Belief, x: np.ndarray, P: np.ndarray, tolerance: float) -> None:
    """Means within a share of the standard deviations, covariances within a share of their products."""
    std = np.sqrt(np.diag(P))
    np.testing.assert_allclose(result.mean.ravel() / std, x / std, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(result.cov / np.outer(std, std), P / np.outer(std, std), atol=tolerance)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_without_decay_it_is_white_noise_on_the_next_derivative(order):
    F, Q = discretise(order, 0.37, (math.inf, math.inf))
    np.testing.assert_allclose(Q, Q_continuous_white_noise(order, 0.37), rtol=1e-12)
    powers = [0.37**k / math.factorial(k) for k in range(order)]
    np.testing.assert_allclose(F[0], powers, rtol=1e-12)  # R: A_ij = dt^(j−i)/(j−i)!
    np.testing.assert_allclose(F, [[0.0] * i + powers[: order - i] for i in range(order)], rtol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_steps_are_those_of_the_textbook(order, rng):
    params = replace(KalmanParams.of_order(order), **EXACT)
    belief = start(params, 0.0, np.zeros(3), 1e-6 * np.eye(3))
    x = belief.mean.ravel()
    P = belief.cov
    for t in np.cumsum(rng.uniform(0.02, 0.1, 60)).round(6).tolist():
        root = rng.uniform(-1e-3, 1e-3, (3, 3))
        R = root @ root.T + 1e-7 * np.eye(3)
        z = 0.02 * rng.standard_normal(3)
        F, Q = matrices(params, t - belief.stamp_s)
        x, P, nis = corrected(F @ x, F @ P @ F.T + Q, z, R)
        belief = update(params, predict(params, belief, t), z, R)
        _close(belief, x, P, 1e-9)
        assert belief.nis == pytest.approx(nis, rel=1e-9)
        assert np.array_equal(belief.cov, belief.cov.T)
    with pytest.raises(ValueError, match=r"0\.0.*before"):
        predict(params, belief, 0.0)


def _drawn(
    params: KalmanParams, n: int, R: np.ndarray, share: float, rng: np.random.Generator, scale: float = 1.0
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """A path drawn from the model, n states (order, 3) every 50 ms, and its measurements, of whose covariance R only
    a `share` is new each time and the rest always the same."""
    F, Q = discretised(params.order, 0.05, params.decay_s)
    root = np.linalg.cholesky(scale * params.noise_density * Q)
    std = np.sqrt(np.diag(R))
    prior = np.array([0.0, *params.prior_std[: params.order - 1]])
    true = [prior[:, None] * rng.standard_normal((params.order, 3))]
    for _ in range(n - 1):
        true.append(F @ true[-1] + root @ rng.standard_normal((params.order, 3)))
    constant = np.sqrt(1 - share) * std * rng.standard_normal(3)
    return true, [x[0] + constant + np.sqrt(share) * std * rng.standard_normal(3) for x in true]


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("lasting", [0.0, 0.7])
def test_errors_have_the_covariance_it_claims(order, lasting, rng):
    """NEES of the whole state and of the first position (with the share of the error that stays, `lasting` of it known
    to), and NIS."""
    params = replace(KalmanParams.of_order(order), adaptation_rate=0, gate_chi2=1e9)
    R = np.diag([4e-6, 1e-6, 9e-6])
    first = []
    nees = []
    nis = []
    for _ in range(150):
        true, z = _drawn(params, 12, R, 1 - lasting, rng)
        belief = start(params, 0.0, z[0], R, correlated=lasting * R)
        for k in range(12):
            if k:
                belief = update(params, predict(params, belief, 0.05 * k), z[k], R, lasting * R)
                nis.append(belief.nis)
            error = (belief.mean - true[k]).ravel()
            P = belief.cov.copy()
            P[:3, :3] += belief.correlated_cov
            (nees if k else first).append(error @ np.linalg.solve(P, error) / (len(error) if k else 1))
    # of one path the errors go on from step to step: the last of each is independent
    low, high = chi2.ppf([0.001, 0.999], 3 * order * 150) / (3 * order * 150)
    assert low < np.mean(nees[10::11]) < high
    low, high = chi2.ppf([0.001, 0.999], 3 * order * 150) / 150
    assert low < np.mean(first) < high
    low, high = chi2.ppf([0.001, 0.999], 3 * len(nis)) / len(nis)
    assert low < np.mean(nis) < high


@pytest.mark.parametrize("scale", [0.1, 8.0])
def test_process_noise_follows_the_motion(scale, rng):
    """Paths drawn with another density than the parameters': over time the filter takes theirs, on average."""
    params = KalmanParams(gate_chi2=1e9)
    R = 1e-8 * np.eye(3)
    _, z = _drawn(params, 500, R, 1.0, rng, scale)
    belief = start(params, 0.0, z[0], R)
    settled = []
    for k in range(1, 500):
        belief = update(params, predict(params, belief, 0.05 * k), z[k], R)
        settled.append(math.log(belief.noise_scale))
    assert math.exp(np.mean(settled[50:])) == pytest.approx(scale, rel=0.35)


def _moving(params: KalmanParams, k: int, R: np.ndarray) -> Belief:
    """After k + 1 measurements of something that moves steadily."""
    belief = start(params, 0.0, np.zeros(3), R)
    for i in range(1, k + 1):
        belief = update(params, predict(params, belief, 0.05 * i), np.array([0.005 * i, 0, 0]), R)
    return belief


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("missed", [0, 3])
def test_the_most_probable_change_of_motion_is_taken_and_an_outlier_beyond_the_gate(order, missed):
    """At growing distances: no change; the most unsteady motion; a jump (with the prior spread and a reversal at any
    time since the last update).  Each change has the prior 1 %."""
    params = replace(KalmanParams.of_order(order), gate_chi2=60.0)
    R = np.diag([1e-6, 2e-6, 3e-6])
    correlated = 0.5 * R
    initial = _moving(params, 12, 0.5 * R)
    dt = 0.05 * (1 + missed)
    ahead = predict(params, initial, initial.stamp_s + dt)
    assert ahead.noise_scale < 1
    std = [0.0, *params.prior_std[: order - 1]]
    if order > 1:
        std[1] = math.hypot(std[1], 2 * float(np.linalg.norm(ahead.mean[1])))
    at_times = [matrices(params, (k + 0.5) / 500 * dt)[0] for k in range(500)]
    jumped = ahead.cov + np.mean([F @ np.kron(np.diag(std) ** 2, np.eye(3)) @ F.T for F in at_times], axis=0)
    turned = ahead.cov + matrices(params, dt, 30.0 - ahead.noise_scale)[1]
    x = ahead.mean.ravel()
    away = np.array([0.6, 0.0, 0.8])
    taken = []
    for chi in np.geomspace(1.0, 1e5, 60):
        z = x[:3] + away * math.sqrt(chi / (away @ np.linalg.solve(ahead.cov[:3, :3] + 0.5 * R, away)))
        results = [corrected(x, P, z, 0.5 * R) for P in (ahead.cov, turned, jumped)]
        priors = math.log(0.99), math.log(0.01), math.log(0.01)
        evidence = [
            prior + multivariate_normal(x[:3], P[:3, :3] + 0.5 * R).logpdf(z)
            for prior, P in zip(priors, (ahead.cov, turned, jumped), strict=True)
        ]
        best = int(np.argmax(evidence))
        mean, cov, nis = results[best]
        second, first = sorted(evidence)[1:]
        if first - second < 0.05 or abs(nis - 60.0) < 0.6:  # where Simpson's rule may decide
            continue
        after = update(params, ahead, z, R, correlated)
        if nis > 60.0:
            assert after.rejections == 1
            _close(after, x, ahead.cov, 1e-12)
            assert (after.updated_s, after.noise_scale) == (initial.updated_s, ahead.noise_scale)
            taken.append("outlier")
            continue
        taken.append(("same", "turned", "jumped")[best])
        _close(after, mean, cov, {2: 1e-4, 3: 0.01, 4: 0.3}[order] if best == 2 else 1e-8)
        assert (after.nis, after.rejections) == (pytest.approx(nis, rel=1e-2), 0)
        scale = 1.0 if best else ahead.noise_scale
        assert after.noise_scale == pytest.approx(np.clip(scale * math.exp(0.2 * (nis / 3 - 1)), 0.008, 30.0), 1e-2)
        assert (after.updated_s, after.stamp_s) == (ahead.stamp_s, ahead.stamp_s)
        np.testing.assert_allclose(after.correlated_cov, 0.5 * R)
    assert taken[0] == "same"
    assert set(taken) >= ({"turned", "outlier"} if order == 1 else {"jumped", "outlier"})


@pytest.mark.parametrize(
    ("most", "places", "rejections"),
    [
        (1, [0.5], [0]),
        (2, [0.5, 0.5], [1, 0]),
        (3, [0.5, 0.5, 0.5], [1, 2, 0]),
        (3, [0.5, 0.5, 0.075, 0.5, 0.5, 0.5], [1, 2, 0, 1, 2, 0]),  # forgotten when it is seen where predicted
    ],
)
def test_after_so_many_outliers_it_begins_again(most, places, rejections):
    params = KalmanParams(max_rejections=most)
    R = 1e-6 * np.eye(3)
    belief = _moving(params, 12, R)
    for k, (x, expected) in enumerate(zip(places, rejections, strict=True), start=13):
        assert belief.mean[0, 0] < 0.2
        belief = update(params, predict(params, belief, 0.05 * k), np.array([x, 0, 0]), R)
        assert belief.rejections == expected
    afresh = start(params, belief.stamp_s, np.array([0.5, 0, 0]), R)
    for result, expected in zip(belief, afresh, strict=True):
        np.testing.assert_array_equal(result, expected)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_thousands_of_steps_leave_the_covariance_sound(order, rng):
    """Nearly exact measurements and rare gaps: symmetric, positive, and converged."""
    params = replace(KalmanParams.of_order(order), adaptation_rate=0)
    R = np.diag([1e-12, 1e-10, 1e-6])
    belief = start(params, 0.0, np.zeros(3), R)
    covs = []
    for k in range(1, 5001):
        belief = predict(params, belief, 0.05 * k)
        if k % 50:
            belief = update(params, belief, 1e-6 * rng.standard_normal(3), R)
        if k % 50 == 49:
            covs.append(belief.cov)
    assert np.array_equal(covs[-1], covs[-1].T)
    size = np.sqrt(np.diag(covs[-1]))
    assert np.linalg.eigvalsh(covs[-1] / np.outer(size, size)).min() > 0
    np.testing.assert_allclose(covs[-1], covs[20], rtol=1e-3, atol=1e-3 * np.outer(size, size).min())


@pytest.mark.parametrize(
    ("name", "refused", "taken"),
    [
        ("order", (0, 5), (1, 4)),
        ("noise_density", (0.0, -1.0, math.nan), (1e-9,)),
        ("gate_chi2", (0.0, math.nan), (0.5,)),
        ("jump_probability", (-0.01, 1.0, math.nan), (0.0, 0.5)),
        ("max_rejections", (0,), (1,)),
        ("decay_s", ((0.0, 0.1), (0.1, 0.0)), ((0.5, 0.01), (math.inf, math.inf))),
        ("adaptation_rate", (-0.01, 1.01), (0.0, 1.0)),
    ],
)
def test_parameters_outside_their_range_are_refused(name, refused, taken):
    check_range(KalmanParams, name, refused, taken, lambda value: f"{re.escape(str(value))}.*expected")


def test_a_motion_is_followed_ahead_by_how_certain_it_is():
    """As predict has it where the velocity is certain, not at all where it is not told from rest; half at twice the χ²
    that rest has in 99 % of cases.  A filter of order 1 states no uncertainty of the velocity: not at all."""
    mean = np.array([[0.3, -0.1, 0.2], [0.1, 0.2, -0.1], [0.5, -1.0, 0.3], [2.0, 1.0, -3.0]])
    belief = start(KalmanParams(), 0.0, mean[0], 1e-6 * np.eye(3))._replace(mean=mean)
    later, midway = (predict(KalmanParams(), belief, t).mean for t in (0.1, 0.125))
    half_std = float(np.linalg.norm(mean[1])) / math.sqrt(2 * chi2.isf(0.01, 3))
    for std, share, tolerance in ((1e-6, 1.0, 1e-6), (0.2, 0.0, 1e-6), (half_std, 0.5, 1e-3)):
        track = Track3D(0.0, mean, std**2 * np.eye(12), 0.03, 0.0, Status.TRACKING)
        p, v = kalman.extrapolate(KalmanParams(), track, 0.1, 0.05)
        np.testing.assert_allclose(p, mean[0] + share * (later[0] - mean[0]), atol=tolerance)
        if share != 0.5:
            np.testing.assert_allclose(v, share * midway[1], atol=1e-6)
    v = kalman.extrapolate(KalmanParams(), replace(track, cov=1e-12 * np.eye(12)), 0.125)[1]
    np.testing.assert_allclose(v, midway[1], atol=1e-6)
    cov = np.diag([1e-6] * 3 + [0.0] * 9)
    at_rest = Track3D(0.0, np.array([mean[0], *np.zeros((3, 3))]), cov, 0.03, 0.0, Status.TRACKING)
    np.testing.assert_array_equal(kalman.extrapolate(KalmanParams(), at_rest, 0.1), [mean[0], np.zeros(3)])
