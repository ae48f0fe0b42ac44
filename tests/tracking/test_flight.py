"""A thrown ball's motion against a fine integration of its equations, and its bounce against energy and sampling."""

from typing import Any

import numpy as np
import pytest
from ranges import check_range
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from throw import DRAG_PER_M, FPS, HIDDEN, RIG, UP, thrown

from pps_vision.types import Array, Status, Track3D
from tracking.flight import FlightParams, derivatives, forecast, start
from tracking.kalman import Belief, update
from tracking.smoother import smoothed_steps
from tracking.tracker import Tracker, TrackerParams, TrackerStep

STILL_AIR = FlightParams(drag_per_m=0.0, noise_density=1e-9, floor_m=-np.inf)


def _belief(p: tuple[float, ...], v: tuple[float, ...], lift: tuple[float, ...], std: float = 1e-6) -> Belief:
    return Belief(0.0, np.array([p, v, lift]), std**2 * np.eye(9), np.zeros((3, 3)), 0.0)


def test_flight_is_the_solution_of_its_equations() -> None:
    params = FlightParams(floor_m=-np.inf)
    p, v, lift = (0.0, 0.0, 1.0), (3.0, -6.0, 1.5), (0.3, 0.2, -0.1)

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        speed = np.linalg.norm(x[3:])
        a = np.array([0, 0, -9.81]) - params.drag_per_m * speed * x[3:] + np.cross(lift, x[3:])
        return np.concatenate([x[3:], a])

    exact = solve_ivp(rate, (0, 0.04), [*p, *v], rtol=1e-10).y[:, -1]
    ahead = forecast(params, _belief(p, v, lift), 0.04)[0]
    np.testing.assert_allclose(ahead.mean[0], exact[:3], atol=2e-4)
    np.testing.assert_allclose(ahead.mean[1], exact[3:], atol=1e-2)


def test_a_ball_that_loses_nothing_rises_as_high_as_it_fell() -> None:
    params = FlightParams(drag_per_m=0.0, restitution=1.0, grip=1.0, drive_m=0.0, floor_m=0.02, noise_density=1e-9)
    belief = _belief((0, 0, 0.3), (1.0, 0.5, 0.0), (0, 0, 0), std=1e-7)
    fall = np.sqrt(2 * 0.28 / 9.81)
    for t in np.arange(0.03, 2 * fall, 0.03):
        belief = forecast(params, belief, float(t))[0]
    belief = forecast(params, belief, 2 * fall)[0]
    np.testing.assert_allclose(belief.mean[0], [2 * fall, fall, 0.3], atol=1e-3)
    np.testing.assert_allclose(belief.mean[1], [1.0, 0.5, 0.0], atol=1e-2)


def test_topspin_drives_a_ball_down_and_then_on() -> None:
    forward = _belief((0, 0, 0.05), (5.0, 0, -2.0), (0, 0.4, 0))  # spins about the axis to its left
    none = _belief((0, 0, 0.05), (5.0, 0, -2.0), (0, 0, 0))
    params = FlightParams(floor_m=-np.inf)
    assert forecast(params, forward, 0.04)[0].mean[1, 2] < forecast(params, none, 0.04)[0].mean[1, 2] - 0.05
    bounced, plain = (forecast(FlightParams(), b, 0.04)[0] for b in (forward, none))
    assert bounced.mean[1, 0] > plain.mean[1, 0] + 0.1
    impact = np.sqrt(2.0**2 + 2 * 9.81 * (0.05 - 0.016))
    assert plain.mean[1, 2] == pytest.approx(
        0.935 * impact - 9.81 * (0.04 - (impact - 2.0) / 9.81), abs=0.1
    )  # up again


@pytest.mark.parametrize("height", [0.5, 0.06])
def test_the_predicted_spread_is_that_of_samples(height: float, rng: np.random.Generator) -> None:
    """In the air and over a sure bounce."""
    params = FlightParams(noise_density=1e-9, bounce_std=(1e-9, 1e-9, 1e-9), bounce_lift_std=1e-9)
    mean = np.array([[0, 0, height], [1.0, -5.0, -2.5], [0.3, 0.1, 0.0]])
    std = np.array([0.003] * 3 + [0.1] * 3 + [0.05] * 3)
    ahead, cross = forecast(params, Belief(0.0, mean, np.diag(std**2), np.zeros((3, 3)), 0.0), 0.04)
    states = mean.ravel() + std * rng.standard_normal((700, 9))
    one = [
        forecast(params, Belief(0.0, s.reshape(3, 3), 1e-16 * np.eye(9), np.zeros((3, 3)), 0.0), 0.04) for s in states
    ]
    then = np.array([belief.mean.ravel() for belief, _ in one])
    np.testing.assert_allclose(ahead.mean.ravel(), then.mean(axis=0), atol=4 * np.max(then.std(axis=0)) / np.sqrt(700))
    np.testing.assert_allclose(np.sqrt(np.diag(ahead.cov)), then.std(axis=0), rtol=0.12)
    sampled = (states - mean.ravel()).T @ (then - then.mean(axis=0)) / 700
    scale = np.outer(std, then.std(axis=0))
    np.testing.assert_allclose(cross / scale, sampled / scale, atol=0.12)


def _simulated(params: FlightParams, states: np.ndarray, dt: float, rng: np.random.Generator) -> np.ndarray:
    """States (n, 9) after `dt`, every one with its own noise, in small steps."""
    p, v, lift = (states[:, 3 * k : 3 * k + 3].copy() for k in range(3))
    h = dt / 200
    for _ in range(200):
        a = np.array([0, 0, -9.81]) - params.drag_per_m * np.linalg.norm(v, axis=1)[:, None] * v + np.cross(lift, v)
        v += h * a + np.sqrt(params.noise_density * h) * rng.standard_normal(v.shape)
        p += h * v
        hit = (p[:, 2] < params.floor_m) & (v[:, 2] < 0)
        x, y, z = v[hit].T
        spin = lift[hit]
        out = np.stack([params.grip * x, params.grip * y, -params.restitution * z], axis=1)
        out[:, 0] += params.drive_m * spin[:, 1]  # what turns about y drives along x
        out[:, 1] -= params.drive_m * spin[:, 0]
        along = out[:, :2] / np.linalg.norm(out[:, :2], axis=1)[:, None]
        noise = rng.standard_normal(out.shape) * params.bounce_std
        out[:, :2] += noise[:, :1] * along + noise[:, 1:2] * np.stack([-along[:, 1], along[:, 0]], axis=1)
        out[:, 2] += noise[:, 2]
        v[hit] = out
        lift[hit] = params.spin_kept * spin + params.bounce_lift_std * rng.standard_normal(spin.shape)
    return np.hstack([p, v, lift])


@pytest.mark.parametrize("height", [0.5, 0.06])
def test_the_predicted_noise_is_that_of_samples(height: float, rng: np.random.Generator) -> None:
    """Of the air, and of a bounce: mean, spread and correlations of balls that each have their own."""
    params = FlightParams(noise_density=0.5, bounce_std=(0.3, 0.1, 0.2), bounce_lift_std=0.12, floor_m=0.016)
    mean = np.array([[0, 0, height], [4.0, -3.0, -2.5], [0.3, 0.2, -0.1]])
    std = np.array([0.001] * 3 + [0.02] * 3 + [0.05] * 3)
    ahead, _ = forecast(params, Belief(0.0, mean, np.diag(std**2), np.zeros((3, 3)), 0.0), 0.04)
    then = _simulated(params, mean.ravel() + std * rng.standard_normal((4000, 9)), 0.04, rng)
    spread = then.std(axis=0)
    np.testing.assert_allclose(ahead.mean.ravel() / spread, then.mean(axis=0) / spread, atol=0.12)
    np.testing.assert_allclose(np.sqrt(np.diag(ahead.cov)), spread, rtol=0.06)
    scale = np.outer(spread, spread)
    np.testing.assert_allclose(ahead.cov / scale, np.cov(then.T) / scale, atol=0.12)


def test_a_bounce_adds_noise_along_across_and_up() -> None:
    """Sure to bounce: the covariance that `bounce_std` adds, in the directions of the ball's way on."""
    mean, tiny = np.array([[0, 0, 0.03], [4.0, -3.0, -2.5], [0.3, 0.2, -0.1]]), 1e-12 * np.eye(9)
    with_noise, without = (
        forecast(FlightParams(bounce_std=std), Belief(0.0, mean, tiny, np.zeros((3, 3)), 0.0), 0.04)[0]
        for std in ((0.3, 0.1, 0.2), (0.0, 0.0, 0.0))
    )
    added = (with_noise.cov - without.cov)[3:6, 3:6]
    along = np.array([*with_noise.mean[1, :2], 0.0]) / np.linalg.norm(with_noise.mean[1, :2])
    axes = np.array([along, [-along[1], along[0], 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(axes @ added @ axes.T, np.diag([0.09, 0.01, 0.04]), atol=1e-9)


def test_a_bounce_that_may_come_too_late_counts_for_its_share(rng: np.random.Generator) -> None:
    """So slow that few of the balls reach the floor in time: of their sidespin, which only a bounce unsettles,
    as much must be in doubt as among samples, within a factor of 4."""
    params = FlightParams(drag_per_m=0.0, noise_density=1e-9, bounce_std=(1e-9, 1e-9, 1e-9), bounce_lift_std=0.12)
    std = np.array([1e-5] * 3 + [1e-5, 1e-5, 0.1] + [1e-5] * 3)
    above = params.floor_m + 0.04 * 1.0 + 0.5 * 9.81 * 0.04**2 + 0.04 * 0.09
    mean = np.array([[0, 0, above], [4.0, 0.0, -1.0], [0, 0, 0]])
    ahead, _ = forecast(params, Belief(0.0, mean, np.diag(std**2), np.zeros((3, 3)), 0.0), 0.04)
    then = _simulated(params, mean.ravel() + std * rng.standard_normal((2000, 9)), 0.04, rng)
    sampled = then[:, 8].var()
    assert 0.1 < sampled / 0.12**2 < 0.25, "few bounce"
    assert sampled / 4 < ahead.cov[8, 8] < 4 * sampled


def test_where_spin_and_speed_go_together_the_mean_is_pushed() -> None:
    """E[lift × v] = E[lift] × E[v] + the covariance of the two, here of what turns about y with what falls."""
    P = np.diag([1e-12] * 3 + [9.0] * 3 + [0.25] * 3)
    P[5, 7] = P[7, 5] = 0.9 * 3.0 * 0.5
    ahead = forecast(STILL_AIR, Belief(0.0, np.zeros((3, 3)), P, np.zeros((3, 3)), 0.0), 0.02)[0]
    assert ahead.mean[1, 0] == pytest.approx(0.02 * P[5, 7], rel=0.03)
    assert ahead.mean[1, 1] == pytest.approx(0.0, abs=1e-3)


def test_flight_begins_with_the_spread_of_what_is_thrown() -> None:
    params, cov = FlightParams(speed_std=5.0, lift_std=(0.4, 0.2), white_share=1.0), np.diag([1e-4, 2e-4, 3e-4])
    belief = start(params, 1.5, np.array([1.0, 2.0, 3.0]), cov)
    np.testing.assert_array_equal(belief.mean, [[1, 2, 3], [0, 0, 0], [0, 0, 0]])
    np.testing.assert_allclose(belief.cov, np.diag([1e-4, 2e-4, 3e-4, 25, 25, 25, 0.16, 0.16, 0.04]))
    assert np.array_equal(belief.correlated_cov, np.zeros((3, 3)))


def test_a_bouncing_ball_is_followed(rng: np.random.Generator) -> None:
    """Truth from fine steps of a model with other constants than the filter's; measured with 15 mm."""
    cov, dt, x = np.diag([15e-3] * 3) ** 2, 1e-4, np.array([0, 1.3, 0.3, 0.2, -6.0, 0.5])
    errors, raw, belief = [], [], None
    params = FlightParams(white_share=1.0)
    for k in range(6000):
        if k % 400 == 0:
            z = x[:3] + 15e-3 * rng.standard_normal(3)
            belief = start(params, k * dt, z, cov) if belief is None else forecast(params, belief, k * dt)[0]
            belief = update(params.filter, belief, z, cov) if k else belief
            errors.append(belief.mean[0] - x[:3])
            raw.append(z - x[:3])
        x[3:] += dt * (np.array([0, 0, -9.81]) - 0.12 * np.linalg.norm(x[3:]) * x[3:])
        x[:3] += dt * x[3:]
        if x[2] < 0.018 and x[5] < 0:
            x[3:] *= (0.9, 0.9, -0.92)
    assert np.sqrt(np.mean(np.square(errors[3:]))) < 0.75 * np.sqrt(np.mean(np.square(raw[3:])))


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match=r"restitution 1\.2"):
        FlightParams(restitution=1.2)
    with pytest.raises(ValueError, match=r"upward direction \(0\.0, 0\.0, 0\.0\)"):
        FlightParams(up=(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"-0\.1.*before 0\.0"):
        forecast(STILL_AIR, _belief((0, 0, 1), (0, 0, 0), (0, 0, 0)), -0.1)


def test_in_no_time_nothing_changes() -> None:
    rng, params = np.random.default_rng(0), FlightParams()
    root = rng.normal(size=(9, 9))
    belief = start(params, 1.0, np.array([0.1, 0.2, 0.3]), 1e-4 * np.eye(3))._replace(cov=0.01 * root @ root.T)
    after, cross = forecast(params, belief, 1.0)
    np.testing.assert_allclose(after.mean, belief.mean, atol=1e-12)
    np.testing.assert_allclose(after.cov, belief.cov, atol=1e-12)
    np.testing.assert_allclose(cross, belief.cov, atol=1e-12)


def test_what_is_up_in_another_frame_flies_and_bounces_as_in_the_own() -> None:
    """Everything turned together: the belief, the prediction over a bounce and the first belief."""
    R = Rotation.from_rotvec([0.4, -1.9, 0.7]).as_matrix()
    T, params = np.kron(np.eye(3), R), FlightParams()
    turned = FlightParams(up=tuple(2.5 * R[:, 2]))
    mean, cov = np.array([[0, 0, 0.06], [1.0, -5.0, -2.5], [0.3, 0.1, 0.0]]), 1e-12 * np.eye(9)
    one, cross = forecast(params, Belief(0.0, mean, cov, np.zeros((3, 3)), 0.0), 0.04)
    belief = Belief(0.0, mean @ R.T, T @ cov @ T.T, np.zeros((3, 3)), 0.0)
    other, turned_cross = forecast(turned, belief, 0.04)
    assert one.mean[1, 2] > 0, "it has bounced"
    np.testing.assert_allclose(other.mean, one.mean @ R.T, atol=1e-9)
    np.testing.assert_allclose(other.cov, T @ one.cov @ T.T, atol=1e-9)
    np.testing.assert_allclose(turned_cross, T @ cross @ T.T, atol=1e-16)
    first, other = (start(p, 0.0, np.zeros(3), 1e-4 * np.eye(3)) for p in (params, turned))
    np.testing.assert_allclose(other.cov, T @ first.cov @ T.T, atol=1e-12)


def test_the_acceleration_and_its_spread_are_those_of_samples(rng: np.random.Generator) -> None:
    """Of the velocity's change in a short flight."""
    params = FlightParams(up=(0.0, -1.0, 0.0), floor_m=-np.inf)
    root = rng.normal(size=(9, 9)) * np.array([0.01] * 3 + [0.1] * 3 + [0.02] * 3)[:, None]
    belief = Belief(0.0, np.array([[0, 0, 1.0], [3.0, -6.0, 1.5], [0.3, 0.2, -0.1]]), root @ root.T, np.eye(3), 0.0)
    mean, cov = derivatives(params, belief)
    states = rng.multivariate_normal(belief.mean.ravel(), belief.cov, 400)
    tiny, h = 1e-18 * np.eye(9), 1e-4
    each = [Belief(0.0, one.reshape(3, 3), tiny, np.eye(3), 0.0) for one in (belief.mean.ravel(), *states)]
    rates = np.array([(forecast(params, one, h)[0].mean[1] - one.mean[1]) / h for one in each])
    np.testing.assert_array_equal(mean[:2], belief.mean[:2])
    np.testing.assert_allclose(mean[2], rates[0], atol=0.01)
    sampled = np.cov(np.hstack([states[:, :6], rates[1:]]).T)
    scale = np.outer(np.sqrt(np.diag(cov)), np.sqrt(np.diag(cov)))
    np.testing.assert_allclose(cov / scale, sampled / scale, atol=0.2)


FLIGHT = FlightParams(up=UP, drag_per_m=DRAG_PER_M, floor_m=-np.inf)


def _thrown_steps(flight: FlightParams | None) -> list[TrackerStep]:
    tracker = Tracker(TrackerParams(flight=flight), RIG, np.random.default_rng(0))
    return [tracker.step(frame) for frame in thrown()[0]]


def _errors(tracks: list[Track3D], path: Array, row: int) -> Array:
    """(n,) errors of position (0) or velocity (1)."""
    return np.array(
        [np.linalg.norm(t.mean[row] - x) for t, x in zip(tracks, path.reshape(-1, 2, 3)[:, row], strict=True)]
    )


def test_the_tracker_follows_and_predicts_a_thrown_ball_better_by_its_flight() -> None:
    frames, path = thrown()
    plain, ballistic = ([step.track for step in _thrown_steps(model)] for model in (None, FLIGHT))
    for tracks in (plain, ballistic):
        assert [t.status for t in tracks[5:]] == [
            Status.COASTING if k in HIDDEN else Status.TRACKING for k in range(5, len(frames))
        ]
    new, old = (_errors(tracks, path, 1)[5:15] for tracks in (ballistic, plain))
    assert np.sqrt(np.mean(new**2)) < 0.7 * np.sqrt(np.mean(old**2))
    hidden = slice(HIDDEN.start, HIDDEN.stop)
    assert _errors(ballistic, path, 0)[hidden][-1] < 0.7 * _errors(plain, path, 0)[hidden][-1]
    for track, x in zip(ballistic[5:], path[5:], strict=True):
        error = track.mean[:2].ravel() - x
        assert error @ np.linalg.solve(track.cov[:6, :6], error) < 30
    acceleration = np.gradient(path[:, 3:], 1 / FPS, axis=0)[14]
    np.testing.assert_allclose(ballistic[14].mean[2], acceleration, atol=0.5)
    assert not ballistic[14].mean[3].any()


def test_a_flight_is_smoothed_by_its_own_model() -> None:
    frames, path = thrown()
    steps = _thrown_steps(FLIGHT)
    before, after = ([step.track for step in some] for some in (steps, smoothed_steps(FLIGHT, steps)))
    known = slice(5, len(frames))
    for row in (0, 1):
        assert _errors(after, path, row)[known].max() < 0.5 * _errors(before, path, row)[known].max()
    accelerations = np.gradient(path[:, 3:], 1 / FPS, axis=0)
    np.testing.assert_allclose([t.mean[2] for t in after[known]], accelerations[known], atol=1.0)


@pytest.mark.parametrize(
    ("name", "refused", "taken"),
    [
        ("drag_per_m", (-0.01, np.nan), (0.0,)),
        ("noise_density", (0.0, np.nan), (1e-9,)),
        ("restitution", (-0.01, 1.01), (0.0, 1.0)),
        ("up", ((0.0, 0.0, 0.0), (np.inf, 0.0, 0.0), (np.nan, 0.0, 1.0)), ((0.0, 0.0, -1e-3),)),
    ],
)
def test_parameters_outside_their_range_are_refused(
    name: str, refused: tuple[Any, ...], taken: tuple[Any, ...]
) -> None:
    check_range(FlightParams, name, refused, taken, lambda _: "expected")


def test_what_is_below_the_floor_bounces_at_once_if_it_falls_and_else_rises() -> None:
    """By a ball's radius below it: errors of measurement put it there."""
    params, dt = FlightParams(drag_per_m=0.0, noise_density=1e-9, drive_m=0.0), 0.01
    for speed, after in ((-2.0, 0.935 * 2.0 - 9.81 * dt), (2.0, 2.0 - 9.81 * dt)):
        ahead = forecast(params, _belief((0, 0, 0.006), (0, 0, speed), (0, 0, 0)), dt)[0]
        assert ahead.mean[1, 2] == pytest.approx(after, abs=1e-4)
        assert ahead.mean[0, 2] == pytest.approx(0.006 + dt * (after + 0.5 * 9.81 * dt), abs=1e-5)


def test_what_rests_in_the_air_or_falls_straight_has_a_motion_too() -> None:
    """Nothing is divided by its speed, or by that along the floor."""
    mean, cov = derivatives(FlightParams(), _belief((0, 0, 1), (0, 0, 0), (0.1, 0, 0)))
    np.testing.assert_allclose(mean[2], [0, 0, -9.81])
    assert np.isfinite(cov).all()
    params = FlightParams(noise_density=1e-9)
    ahead = forecast(params, _belief((0, 0, 0.03), (0, 0, -2.0), (0, 0, 0)), 0.02)[0]
    assert ahead.mean[1, 2] > 0
    assert np.linalg.eigvalsh(ahead.cov).min() > 0
    assert ahead.cov[5, 5] == pytest.approx(0.08**2, rel=0.01)


def test_a_forecast_keeps_what_the_filter_counts_but_its_noise_is_its_own() -> None:
    belief = _belief((0, 0, 1), (1, 0, 0), (0, 0, 0))._replace(rejections=2, nis=4.0, noise_scale=3.0, updated_s=-1.0)
    ahead = forecast(STILL_AIR, belief, 0.1)[0]
    assert (ahead.stamp_s, ahead.rejections, ahead.nis, ahead.updated_s, ahead.noise_scale) == (0.1, 2, 4.0, -1.0, 1.0)
