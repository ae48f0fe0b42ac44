"""Errors drawn from the covariance that comes with them are found consistent; twice as large ones are not."""

import numpy as np
import pytest

from pps_vision.experiments.films.recordings import Footage
from pps_vision.experiments.study import Values
from pps_vision.experiments.tracking.consistency import QUANTITIES, judge_covariances
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.types import Status, StereoFrame, Track3D
from tracking.tracker import TrackerStep

pytestmark = pytest.mark.long
N = 200


def _values(rng: np.random.Generator, factor: float) -> Values:
    """An approach that ends in a touch, whose every track errs independently, `factor` times what it states."""
    stamps, v = 0.02 * np.arange(N + 1), np.array([-0.1, 0.0, 0.0])
    path = np.outer(4.0 - stamps, -v) + np.array([0.03, 0.0, 0.0])
    velocity = np.tile(v, (N + 1, 1))
    velocity[-1] = 0.0  # it has touched the origin
    A = rng.standard_normal((6, 6)) * np.repeat([2e-4, 2e-3], 3)[:, None]
    cov = np.zeros((12, 12))
    cov[:6, :6] = A @ A.T + np.diag(np.repeat([1e-8, 1e-6], 3))
    steps = []
    for stamp_s, p in zip(stamps, path, strict=True):
        mean = np.zeros((4, 3))
        mean[:2] = np.stack([p, v]) + factor * rng.multivariate_normal(np.zeros(6), cov[:6, :6]).reshape(2, 3)
        track = Track3D(float(stamp_s), mean, cov, 0.03, 0.0, Status.TRACKING)
        steps.append(TrackerStep(track, (), None, np.zeros(3)))
    image, q = np.zeros((2, 2, 3), np.uint8), np.zeros(1)
    frames = tuple(StereoFrame(image, image, float(s), float(s), q, q) for s in stamps)
    seen, boxes = np.ones(N + 1, bool), ((None, None),) * (N + 1)
    recording = Footage(frames, path, velocity, seen, boxes, 0.03, icub_rig(load_icub()), None)
    return judge_covariances(recording, [step.track for step in steps])


def test_what_errs_as_it_states_is_consistent(rng):
    honest, vain = ([_values(rng, factor) for _ in range(4)] for factor in (1.0, 2.0))
    for quantity in QUANTITIES:
        found = {s: 100 * np.mean(np.concatenate([one[f"{quantity} {s}"] for one in honest])) for s in (68, 95)}
        assert found[68] == pytest.approx(68, abs=5), quantity
        assert found[95] == pytest.approx(95, abs=2.5), quantity
        assert np.mean(np.concatenate([one[f"{quantity} 95"] for one in vain])) < 0.8
