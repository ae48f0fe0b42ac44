"""Errors drawn from the covariance that comes with them are found consistent; twice as large ones are not."""

import numpy as np
import pytest

from pps_vision.experiments.consistency import Consistency, consistency, coverage, ttc_errors
from pps_vision.experiments.filter_scenes import Sequence
from pps_vision.types import Status, Track3D
from tracking.tracker import TrackerStep

N = 200


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def _sequence(rng: np.random.Generator, factor: float) -> Sequence:
    """An approach whose every track errs by itself, `factor` times what it says."""
    stamps, v = 0.02 * np.arange(N), np.array([-0.1, 0.0, 0.0])
    path = np.outer(4.0 - stamps, -v) + np.array([0.03, 0.0, 0.0])
    A = rng.standard_normal((6, 6)) * np.repeat([2e-4, 2e-3], 3)[:, None]
    cov = np.zeros((12, 12))
    cov[:6, :6] = A @ A.T + np.diag(np.repeat([1e-8, 1e-6], 3))
    steps = []
    for stamp_s, p in zip(stamps, path, strict=True):
        mean = np.zeros((4, 3))
        mean[:2] = np.stack([p, v]) + factor * rng.multivariate_normal(np.zeros(6), cov[:6, :6]).reshape(2, 3)
        track = Track3D(float(stamp_s), mean, cov, 0.03, 0.0, Status.TRACKING)
        steps.append(TrackerStep(track, (), None, ([], []), np.zeros(3)))
    return Sequence(
        name="ball 10 cm/s",
        stamps_s=stamps,
        positions=path,
        covs=np.tile(1e-8 * np.eye(3), (N, 1, 1)),
        path=path,
        velocity=np.tile(v, (N, 1)),
        distance_m=0.4,
        jumped=np.zeros(N, bool),
        touched=np.zeros(3),
        ttc_s=4.0 - stamps,
        radius_m=0.03,
        steps=tuple(steps),
    )


def test_what_errs_as_it_says_is_consistent(rng: np.random.Generator) -> None:
    honest, vain = ([_sequence(rng, factor) for _ in range(4)] for factor in (1.0, 2.0))
    assert consistency(honest)["nees"] == pytest.approx(6, rel=0.1)
    found = consistency(vain)
    assert found["nees"] == pytest.approx(24, rel=0.1)
    assert found["nees"] > found["nees_band"][1]
    for quantity, inside in coverage([], honest).items():
        assert inside["68"] == pytest.approx(68, abs=5), quantity
        assert inside["95"] == pytest.approx(95, abs=2.5), quantity
    assert all(inside["95"] < 80 for inside in coverage([], vain).values())


def test_time_to_contact_errs_as_much_as_the_closing_speed(rng: np.random.Generator) -> None:
    sequence = _sequence(rng, 1e-6)
    assert ttc_errors([sequence])["median_percent"] < 1e-3
    assert ttc_errors([sequence])["samples"] == np.count_nonzero(sequence.late)


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="--seconds 0"):
        Consistency(seconds=0).run()
