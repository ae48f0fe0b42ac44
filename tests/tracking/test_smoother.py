"""Smoothing against least squares over the whole path, and through the tracker's own steps."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from linear_model import discretised
from numpy.random import Generator

from pps_vision.types import Array, Observation3D, Status, Track3D
from tracking.kalman import KalmanParams, predict, scaled, start, update
from tracking.smoother import LAG, Measurement, follow, smooth, smoothed_steps
from tracking.tracker import TrackerStep

R = np.diag([1e-5, 4e-6, 9e-6])


SHIFT_VAR_M2 = 4e-4


def _batch(
    params: KalmanParams, stamps: Array, z: Array, jump: int | None = None, shift: int | None = None
) -> tuple[Array, Array]:
    """Mean (n, order) and covariance (n, order, order) of one axis by one weighted least squares over all stamps; NaN:
    not measured.  On the step to the `jump` the derivatives may change by their prior covariance at any time, on that
    to the `shift` the position by `SHIFT_VAR_M2`."""
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
                D = np.diag([0.0, *params.prior_std[: order - 1]]) ** 2
                half = discretised(order, 0.5 * (stamps[k] - stamps[k - 1]), params.decay_s)[0]
                Q = Q + (D + 4 * half @ D @ half.T + F @ D @ F.T) / 6
            if k == shift:
                Q[0, 0] += SHIFT_VAR_M2
            add({k: np.eye(order), k - 1: -F}, np.zeros(order), Q)
    A = np.vstack(rows)
    cov = np.linalg.inv(A.T @ A).reshape(n, order, n, order)
    mean = np.linalg.lstsq(A, np.concatenate(targets))[0].reshape(n, order)
    return mean, np.array([cov[k, :, k] for k in range(n)])


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize(("jump", "shift"), [(None, None), (10, None), (None, 5)])
def test_it_is_least_squares_over_the_whole_path(order, jump, shift, rng):
    """A noisy path with a gap; a ball at rest that from the tenth measurement on moves at 0.6 m/s; or a path on which
    from the fifth measurement on a point 2 cm aside is measured."""
    params = replace(KalmanParams.of_order(order), adaptation_rate=0)
    if jump is None:
        params = replace(params, jump_probability=0, gate_chi2=1e9)
        stamps = np.cumsum(rng.uniform(0.03, 0.08, 15)).round(6)
        z = 0.05 * np.sin(3 * stamps)[:, None] + rng.standard_normal((15, 3)) * np.sqrt(np.diag(R))
        z[6:9] = np.nan
        z[shift if shift else len(z) :] += 0.02
    else:
        stamps = 0.05 * np.arange(15)
        z = 0.6 * np.maximum(stamps - stamps[9], 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
    shifts = [SHIFT_VAR_M2 * np.eye(3) if k == shift else None for k in range(15)]
    measurements = [
        Measurement(t) if np.isnan(p[0]) else Measurement(t, p, R, shift_cov=cov)
        for t, p, cov in zip(stamps, z, shifts, strict=True)
    ]
    path = smooth(follow(params, start(params, stamps[0], z[0], R), measurements[1:]))
    mean, cov = _batch(params, stamps, z[:, 0], jump, shift)
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


def _filtered(
    params: KalmanParams, places: Iterable[Array], is_measured: Callable[[int], bool], cov: Array, rng: Generator
) -> Iterator[TrackerStep]:
    """Steps of a tracker's filter every 50 ms on noisy measurements of some of these places."""
    belief = None
    for k, place in enumerate(places):
        t = 0.05 * k
        z = place + rng.standard_normal(3) * np.sqrt(np.diag(cov)) if is_measured(k) else None
        if belief is None:
            params = scaled(params, float(np.linalg.norm(z)))
            belief = start(params, t, z, cov)
        else:
            belief = predict(params, belief, t)
            belief = belief if z is None else update(params, belief, z, cov)
        n = len(belief.mean)
        mean = np.zeros((4, 3))
        mean[:n] = belief.mean
        P = np.zeros((12, 12))
        P[: 3 * n, : 3 * n] = belief.cov
        P[:3, :3] += belief.correlated_cov + 1e-6 * np.eye(3)  # an error of shape
        track = Track3D(t, mean, P, 0.03, 1e-6, Status.COASTING if z is None else Status.TRACKING)
        yield TrackerStep(track, (), None if z is None else Observation3D(t, z, cov, 0.03, 1e-6, 0.1), np.zeros((2, 3)))


TRUTH = np.array([[0.4 + 0.004 * k, 0.1 * np.sin(k / 10), 0.0] for k in range(40)])


def _steps(rng: Generator) -> list[TrackerStep]:
    """As a tracker would return them: two sightings unconfirmed, a gap, lost at last."""
    cov = np.diag([4e-6, 4e-6, 1e-5])
    steps = list(_filtered(KalmanParams(), TRUTH, lambda k: not (15 <= k < 18 or k >= 38), cov, rng))
    for k, status in ((0, Status.SEARCHING), (1, Status.SEARCHING), (39, Status.LOST)):
        steps[k] = replace(steps[k], track=Track3D.unknown(0.05 * k, status))
    return steps


def _long(params: KalmanParams, n: int) -> Iterator[TrackerStep]:
    """A track without an end, whose path bends all the time; every seventh pair shows nothing."""
    places = (np.array([0.4 + 0.05 * np.sin(k / 25), 0.1 * np.cos(k / 17), 0.01 * np.sin(k / 3)]) for k in range(n))
    rng = np.random.default_rng(4)
    return _filtered(params, places, lambda k: k % 7 > 0 or k == 0, np.diag([1e-7, 1e-7, 1e-6]), rng)


def test_a_trackers_path_is_smoothed_where_it_is_known(rng):
    steps = _steps(rng)
    tracks = [step.track for step in smoothed_steps(KalmanParams(), steps)]
    assert [t.status for t in tracks] == [s.track.status for s in steps]
    tracked = [k for k, track in enumerate(tracks) if track.is_known]
    earlier, after = (
        np.mean([(path[k].position - TRUTH[k]) ** 2 for k in tracked]) for path in ([s.track for s in steps], tracks)
    )
    assert after < 0.64 * earlier
    for k in tracked:
        assert np.trace(tracks[k].cov[:3, :3]) <= np.trace(steps[k].track.cov[:3, :3]) * (1 + 1e-9)
        assert np.linalg.eigvalsh(tracks[k].cov).min() > 0
    np.testing.assert_allclose(tracks[tracked[-1]].mean, steps[tracked[-1]].track.mean, rtol=1e-9)
    assert np.linalg.eigvalsh(tracks[tracked[-2]].cov[:3, :3]).min() > 1e-6  # the error of a shape stays


def test_a_sighting_before_a_gap_is_no_part_of_a_later_track(rng):
    """One elsewhere, then nothing for one step: the track is smoothed as if neither had been; nor is a track joined
    with the one before it."""
    steps = _steps(rng)
    elsewhere = Observation3D(-0.1, np.array([0.2, 0.3, 0.1]), np.diag([4e-6, 4e-6, 1e-5]), 0.03, 1e-6, 0.1)
    nothing = TrackerStep(Track3D.unknown(-0.05), (), None, np.zeros((2, 3)))
    earlier = [replace(nothing, track=Track3D.unknown(-0.1), observation=elsewhere), nothing]
    alone = list(smoothed_steps(KalmanParams(), steps))
    later = [replace(step, track=replace(step.track, stamp_s=step.track.stamp_s + 2.0)) for step in steps]
    for more, part in (([*earlier, *steps], slice(2, None)), ([*steps, *later], slice(0, len(steps)))):
        smoothed = list(smoothed_steps(KalmanParams(), more))
        assert len(smoothed) == len(more)
        for step, expected in zip(smoothed[part], alone, strict=True):
            assert step.track.status == expected.track.status
            np.testing.assert_array_equal(step.track.mean, expected.track.mean)
            np.testing.assert_array_equal(step.track.cov, expected.track.cov)


def test_each_of_several_tracks_is_smoothed_by_itself(rng):
    """The second begins later and is attended in between; both are as if they had been alone."""
    paths = {1: _steps(rng), 2: _steps(rng)}
    for track_id, steps in paths.items():
        paths[track_id] = [replace(step, track=replace(step.track, track_id=track_id)) for step in steps]
    late = 7
    together = paths[1][:late]
    for k, (first, second) in enumerate(zip(paths[1][late:], paths[2], strict=False)):
        attended, other = (second, first) if 10 <= k < 20 else (first, second)
        together.append(replace(attended, others=(other,)))
    together += paths[2][len(paths[1]) - late :]
    smoothed = list(smoothed_steps(KalmanParams(), together))
    assert [[t.track_id for t in s.tracks] for s in smoothed] == [[t.track_id for t in s.tracks] for s in together]
    for track_id, steps in paths.items():
        of_track = [track for step in smoothed for track in step.tracks if track.track_id == track_id]
        for track, alone in zip(of_track, smoothed_steps(KalmanParams(), steps), strict=True):
            np.testing.assert_array_equal(track.mean, alone.track.mean)
            np.testing.assert_array_equal(track.cov, alone.track.cov)


def test_what_a_track_says_beyond_its_filter_is_still_said(rng):
    """Added to every track's position it is added to every smoothed one's; where a track says less than the filter
    that is run again (its own had begun anew), only the error that its measurements share comes on top."""
    steps = _steps(rng)

    def smoothed(change: Array, factor: float = 1.0) -> Array:
        covs = [factor * step.track.cov + np.pad(change, (0, 9)) for step in steps]
        changed = [replace(step, track=replace(step.track, cov=cov)) for step, cov in zip(steps, covs, strict=True)]
        return np.array([s.track.cov[:3, :3] for s in smoothed_steps(KalmanParams(), changed) if s.track.is_known])

    more = np.diag([5e-6, 6e-6, 7e-6])
    nothing = np.zeros((3, 3))
    plain = smoothed(nothing)
    np.testing.assert_allclose(smoothed(more) - plain, np.broadcast_to(more, plain.shape), atol=1e-12)
    shape_error = np.broadcast_to(1e-6 * np.eye(3), plain.shape)
    np.testing.assert_allclose(plain - smoothed(nothing, 0.01), shape_error, atol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_long_track_is_smoothed_as_by_all_later_measurements(order):
    params = KalmanParams.of_order(order)
    steps = list(_long(params, 3 * LAG + 50))
    own = scaled(params, float(np.linalg.norm(steps[0].observation.p_root)))
    measured = [
        Measurement(s.track.stamp_s, *((s.observation.p_root, s.observation.cov_root) if s.observation else ()))
        for s in steps
    ]
    whole = smooth(follow(own, start(own, 0.0, measured[0].position, measured[0].cov), measured[1:]))
    for smoothed, belief, step in zip(smoothed_steps(params, steps), whole, steps, strict=True):
        std = np.sqrt(np.diag(belief.cov)).reshape(belief.mean.shape)
        assert np.all(np.abs(smoothed.track.mean[:order] - belief.mean) < 1e-9 * std)
        assert smoothed.track.stamp_s == step.track.stamp_s


def test_a_long_track_comes_while_it_goes_on():
    """The number of buffered steps is bounded."""
    taken = []
    steps = (taken.append(step) or step for step in _long(KalmanParams(), 4 * LAG))
    buffered = [len(taken) - k for k, _ in enumerate(smoothed_steps(KalmanParams(), steps))]
    assert max(buffered) <= 2 * LAG
