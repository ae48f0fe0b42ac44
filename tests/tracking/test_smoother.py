"""Smoothing against least squares over the whole path, and through the tracker's own steps."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from linear_model import discretised

from pps_vision.types import Array, Observation3D, Status, Track3D
from tracking.kalman import Belief, KalmanParams, predict, scaled, start, update
from tracking.smoother import LAG, Measurement, follow, smooth, smoothed_steps
from tracking.tracker import TrackerStep

R = np.diag([1e-5, 4e-6, 9e-6])


def _batch(params: KalmanParams, stamps: Array, z: Array, jump: int | None = None) -> tuple[Array, Array]:
    """Mean (n, order) and covariance (n, order, order) of one axis by one weighted least squares over all stamps; NaN:
    not measured.  On the step to the `jump` the derivatives may change by their prior covariance."""
    n = len(stamps)
    order = params.order
    rows = []
    targets = []

    def add(blocks: dict[int, Array], target: Array, cov: Array) -> None:
        whitening = np.linalg.inv(np.linalg.cholesky(cov))
        row = np.zeros((len(target), n * order))
        for k, block in blocks.items():
            row[:, k * order : (k + 1) * order] = block
        rows.append(whitening @ row)
        targets.append(whitening @ target)

    add({0: np.eye(order)[1:]}, np.zeros(order - 1), np.diag(np.square(params.prior_std[: order - 1])))
    for k in range(n):
        if np.isfinite(z[k]):
            add({k: np.eye(order)[:1]}, z[k : k + 1], R[:1, :1])
        if k:
            F, Q = discretised(order, stamps[k] - stamps[k - 1], params.decay_s)
            Q = params.noise_density * Q
            if k == jump:
                Q = Q + F @ np.diag([0.0, *params.prior_std[: order - 1]]) ** 2 @ F.T
            add({k: np.eye(order), k - 1: -F}, np.zeros(order), Q)
    A = np.vstack(rows)
    cov = np.linalg.inv(A.T @ A).reshape(n, order, n, order)
    mean = np.linalg.lstsq(A, np.concatenate(targets))[0].reshape(n, order)
    return mean, np.array([cov[k, :, k] for k in range(n)])


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("jump", [None, 10])
def test_it_is_least_squares_over_the_whole_path(order, jump, rng):
    """A noisy path with a gap; or a ball at rest that from the tenth measurement on moves at 0.6 m/s."""
    params = replace(KalmanParams.of_order(order), white_share=1.0, adaptation_rate=0)
    if jump is None:
        params = replace(params, gate_chi2=1e9)
        stamps = np.cumsum(rng.uniform(0.03, 0.08, 15)).round(6)
        z = 0.05 * np.sin(3 * stamps)[:, None] + rng.standard_normal((15, 3)) * np.sqrt(np.diag(R))
        z[6:9] = np.nan
    else:
        stamps = 0.05 * np.arange(15)
        z = 0.6 * np.maximum(stamps - stamps[9], 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
    measurements = [Measurement(t) if np.isnan(p[0]) else Measurement(t, p, R) for t, p in zip(stamps, z, strict=True)]
    path = smooth(follow(params, start(params, stamps[0], z[0], R), measurements[1:]))
    mean, cov = _batch(params, stamps, z[:, 0], jump)
    np.testing.assert_allclose([belief.mean[:, 0] for belief in path], mean, rtol=1e-5, atol=1e-6)
    std = np.sqrt(np.einsum("kii->ki", cov))
    relative = np.array([belief.cov[::3, ::3] for belief in path]) / (std[:, :, None] * std[:, None])
    np.testing.assert_allclose(relative, cov / (std[:, :, None] * std[:, None]), atol=1e-4)


def test_a_filter_that_began_again_is_smoothed_in_two_parts():
    params = KalmanParams(max_rejections=2)
    z = [np.array([0.001 * k, 0, 0]) if k < 10 else np.array([0.8 + 0.001 * k, 0, 0]) for k in range(20)]
    small = 1e-7 * np.eye(3)
    measured = [Measurement(0.05 * k, p, small) for k, p in enumerate(z)]
    path = smooth(follow(params, start(params, 0.0, z[0], small), measured[1:]))
    for k in (0, 5, 9, 12, 19):
        np.testing.assert_allclose(path[k].mean[0], z[k], atol=2e-3)


def _steps(rng: np.random.Generator) -> tuple[list[TrackerStep], list[np.ndarray]]:
    """As a tracker would return them: two sightings unconfirmed, a gap, lost at last; and the truth."""
    params = KalmanParams()
    cov = np.diag([4e-6, 4e-6, 1e-5])
    steps = []
    truth = []
    belief = None
    for k in range(40):
        t = 0.05 * k
        true = np.array([0.4 + 0.004 * k, 0.1 * np.sin(k / 10), 0.0])
        is_measured = not (15 <= k < 18 or k >= 38)
        z = true + rng.standard_normal(3) * np.sqrt(np.diag(cov)) if is_measured else None
        if belief is None:
            params = scaled(params, float(np.linalg.norm(z)))
        belief, track = _tracked(params, belief, t, z, cov)
        if k < 2:
            track = Track3D.unknown(t)
        if k == 39:
            track = Track3D.unknown(t, Status.LOST)
        observation = None if z is None else Observation3D(t, z, cov, 0.03, 1e-6, 0.1)
        steps.append(TrackerStep(track, (), observation, np.zeros(3)))
        truth.append(true)
    return steps, truth


def _tracked(
    params: KalmanParams, belief: Belief | None, t: float, z: np.ndarray | None, cov: np.ndarray
) -> tuple[Belief, Track3D]:
    if belief is None:
        belief = start(params, t, z, cov)
    else:
        belief = predict(params, belief, t)
        belief = belief if z is None else update(params, belief, z, cov)
    mean = np.zeros((4, 3))
    P = np.zeros((12, 12))
    n = len(belief.mean)
    mean[:n] = belief.mean
    P[: 3 * n, : 3 * n] = belief.cov
    P[:3, :3] += belief.correlated_cov + 1e-6 * np.eye(3)
    return belief, Track3D(t, mean, P, 0.03, 1e-6, Status.COASTING if z is None else Status.TRACKING)


def test_a_trackers_path_is_smoothed_where_it_is_known(rng):
    steps, truth = _steps(rng)
    tracks = [step.track for step in smoothed_steps(KalmanParams(), steps)]
    assert [t.status for t in tracks] == [s.track.status for s in steps]
    tracked = [k for k, track in enumerate(tracks) if track.is_known]
    earlier = np.array([steps[k].track.position - truth[k] for k in tracked])
    after = np.array([tracks[k].position - truth[k] for k in tracked])
    assert np.sqrt(np.mean(after**2)) < 0.8 * np.sqrt(np.mean(earlier**2))
    for k in tracked:
        assert np.trace(tracks[k].cov[:3, :3]) <= np.trace(steps[k].track.cov[:3, :3]) * (1 + 1e-9)
        assert np.linalg.eigvalsh(tracks[k].cov).min() > 0
    last = tracked[-2]
    np.testing.assert_allclose(tracks[tracked[-1]].mean, steps[tracked[-1]].track.mean, rtol=1e-9)
    assert np.linalg.eigvalsh(tracks[last].cov[:3, :3]).min() > 1e-6  # the error of a shape stays


def test_a_sighting_before_a_gap_is_no_part_of_a_later_track(rng):
    """One elsewhere, then nothing for one step: the track is smoothed as if neither had been; nor is a track joined
    with the one before it."""
    steps, _ = _steps(rng)
    elsewhere = Observation3D(-0.1, np.array([0.2, 0.3, 0.1]), np.diag([4e-6, 4e-6, 1e-5]), 0.03, 1e-6, 0.1)
    earlier = [
        TrackerStep(Track3D.unknown(t), (), observation, np.zeros(3))
        for t, observation in ((-0.1, elsewhere), (-0.05, None))
    ]
    alone = list(smoothed_steps(KalmanParams(), steps))
    later = [replace(step, track=replace(step.track, stamp_s=step.track.stamp_s + 2.0)) for step in steps]
    for more, part in (([*earlier, *steps], slice(2, None)), ([*steps, *later], slice(0, len(steps)))):
        smoothed = list(smoothed_steps(KalmanParams(), more))
        assert len(smoothed) == len(more)
        for step, expected in zip(smoothed[part], alone, strict=True):
            assert step.track.status == expected.track.status
            np.testing.assert_array_equal(step.track.mean, expected.track.mean)
            np.testing.assert_array_equal(step.track.cov, expected.track.cov)


def test_what_a_track_says_beyond_its_filter_is_still_said(rng):
    """Added to every track's position it is added to every smoothed one's; where a track says less than the filter
    that is run again (its own had begun anew), only the error that its measurements share comes on top."""
    steps, _ = _steps(rng)

    def smoothed(change: np.ndarray, factor: float = 1.0) -> list[np.ndarray]:
        changed = []
        for step in steps:
            cov = factor * step.track.cov
            cov[:3, :3] += change
            changed.append(replace(step, track=replace(step.track, cov=cov)))
        return [s.track.cov[:3, :3] for s in smoothed_steps(KalmanParams(), changed) if s.track.is_known]

    more = np.diag([5e-6, 6e-6, 7e-6])
    for plain, wider, narrow in zip(
        smoothed(np.zeros((3, 3))), smoothed(more), smoothed(np.zeros((3, 3)), 0.01), strict=True
    ):
        np.testing.assert_allclose(wider - plain, more, atol=1e-12)
        np.testing.assert_allclose(plain - narrow, 1e-6 * np.eye(3), atol=1e-12)  # an error of shape, in `_tracked`


def _long(params: KalmanParams, n: int, rng: np.random.Generator) -> Iterator[TrackerStep]:
    """A track without an end, whose path bends all the time; every seventh pair shows nothing."""
    cov = np.diag([1e-7, 1e-7, 1e-6])
    belief = None
    for k in range(n):
        t = 0.05 * k
        at = np.array([0.4 + 0.05 * np.sin(k / 25), 0.1 * np.cos(k / 17), 0.01 * np.sin(k / 3)])
        z = at + rng.standard_normal(3) * np.sqrt(np.diag(cov)) if k % 7 or not k else None
        if belief is None:
            params = scaled(params, float(np.linalg.norm(z)))
        belief, track = _tracked(params, belief, t, z, cov)
        observation = None if z is None else Observation3D(t, z, cov, 0.03, 1e-6, 0.1)
        yield TrackerStep(track, (), observation, np.zeros(3))


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_long_track_is_smoothed_as_by_all_later_measurements(order):
    params = KalmanParams.of_order(order)
    steps = list(_long(params, 3 * LAG + 50, np.random.default_rng(4)))
    own = scaled(params, float(np.linalg.norm(steps[0].observation.p_root)))
    observations = [(step.track.stamp_s, step.observation) for step in steps]
    measured = [
        Measurement(t, observation and observation.p_root, observation and observation.cov_root)
        for t, observation in observations
    ]
    whole = smooth(follow(own, start(own, 0.0, measured[0].position, measured[0].cov), measured[1:]))
    tracks = [step.track for step in smoothed_steps(params, steps)]
    for track, belief, step in zip(tracks, whole, steps, strict=True):
        std = np.sqrt(np.diag(belief.cov)).reshape(belief.mean.shape)
        assert np.all(np.abs(track.mean[:order] - belief.mean) < 1e-9 * std)
        assert track.stamp_s == step.track.stamp_s


def test_a_long_track_comes_while_it_goes_on():
    """The number of buffered steps is bounded."""
    taken = 0

    def steps() -> Iterator[TrackerStep]:
        nonlocal taken
        for step in _long(KalmanParams(), 4 * LAG, np.random.default_rng(4)):
            taken += 1
            yield step

    assert max(taken - k for k, _ in enumerate(smoothed_steps(KalmanParams(), steps()))) <= 2 * LAG
