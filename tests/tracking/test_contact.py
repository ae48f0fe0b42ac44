"""Distance and time to contact against sampling."""

import numpy as np
import pytest

from pps_vision.types import Status, Track3D
from tracking.contact import time_to_contact


def _track(p: tuple[float, ...], v: tuple[float, ...], std_p: float, std_v: float, radius: float = 0.03) -> Track3D:
    mean, cov = np.zeros((4, 3)), np.zeros((12, 12))
    mean[0], mean[1] = p, v
    cov[:3, :3], cov[3:6, 3:6] = std_p**2 * np.diag([1, 1, 4]), std_v**2 * np.diag([1, 1, 4])
    cov[:3, 3:6] = cov[3:6, :3] = 0.5 * std_p * std_v * np.diag([1, 1, 4])
    return Track3D(0.0, mean, cov, radius, (0.02 * radius) ** 2, Status.TRACKING)


def _sampled(track: Track3D, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Distance and closing speed of `n` states and sizes drawn as the track says."""
    state = rng.multivariate_normal(track.mean[:2].ravel(), track.cov[:6, :6], n)
    length = np.linalg.norm(state[:, :3], axis=1)
    radius = track.radius_m + np.sqrt(track.radius_var_m2) * rng.standard_normal(n)
    return length - radius, -np.einsum("ij,ij->i", state[:, :3], state[:, 3:]) / length


@pytest.mark.parametrize("v", [(-0.1, 0.02, 0.03), (-0.08, 0.05, -0.04)])
def test_mean_and_spread_are_those_of_samples(v: tuple[float, ...], rng: np.random.Generator) -> None:
    track = _track((0.10, 0.03, 0.02), v, 0.002, 0.004)
    distance, closing = _sampled(track, 200_000, rng)
    contact = time_to_contact(track, np.zeros(3))
    assert contact.distance_m == pytest.approx(distance.mean(), rel=3e-3)
    assert contact.distance_std_m == pytest.approx(distance.std(), rel=0.02)
    assert np.sqrt(contact.closing_var) == pytest.approx(closing.std(), rel=0.02)
    ttc = distance / closing
    assert contact.ttc_s == pytest.approx(np.median(ttc), rel=0.01)
    assert contact.ttc_std_s == pytest.approx(ttc.std(), rel=0.05)


@pytest.mark.parametrize("std_v", [0.004, 0.03, 0.1])
def test_intervals_hold_the_time_as_often_as_they_say(std_v: float, rng: np.random.Generator) -> None:
    """However uncertain the closing speed: the true time is that of the mean, tracks are drawn around it."""
    true = _track((0.10, 0.03, 0.02), (-0.1, 0.02, 0.03), 0.002, std_v, radius=0.0)
    ttc = time_to_contact(true, np.zeros(3)).ttc_s
    for sigmas, share in ((1.0, 0.683), (1.96, 0.95)):
        within = 0
        for state in rng.multivariate_normal(true.mean[:2].ravel(), true.cov[:6, :6], 2000):
            low, high = time_to_contact(
                Track3D(0.0, np.vstack([state.reshape(2, 3), np.zeros((2, 3))]), true.cov, 0.0, 0.0, true.status),
                np.zeros(3),
            ).ttc_interval_s(sigmas)
            within += low <= ttc <= high
        assert within / 2000 == pytest.approx(share, abs=0.04)


def test_what_moves_away_never_arrives() -> None:
    contact = time_to_contact(_track((0.1, 0, 0), (0.1, 0, 0), 0.001, 0.004), np.zeros(3))
    assert contact.ttc_s == contact.ttc_std_s == np.inf
    assert contact.ttc_interval_s() == (np.inf, np.inf)
    unsure = time_to_contact(_track((0.1, 0, 0), (0.1, 0, 0), 0.001, 0.1), np.zeros(3)).ttc_interval_s()
    assert 0 < unsure[0] < np.inf
    assert unsure[1] == np.inf


def test_the_point_may_move() -> None:
    track = _track((0.1, 0, 0), (0.0, 0, 0), 0.001, 0.004)
    contact = time_to_contact(track, np.zeros(3), point_velocity=(0.2, 0, 0))
    assert contact.closing_m_s == pytest.approx(0.2)
    assert contact.distance_m == pytest.approx(0.07)
    assert time_to_contact(track, np.zeros(3), subtract_radius=False).distance_m == pytest.approx(0.1)


def test_what_touches_already_may_touch_now() -> None:
    assert time_to_contact(_track((0.03, 0, 0), (-0.1, 0, 0), 0.001, 0.004), np.zeros(3)).ttc_interval_s()[0] == 0.0


def test_the_objects_own_centre_is_no_point_to_touch() -> None:
    with pytest.raises(ValueError, match="centre"):
        time_to_contact(_track((0.1, 0, 0), (0, 0, 0), 0.001, 0.004), (0.1, 0, 0))
