"""Learned maps give the same results on a torch device, in portions of any size."""

import numpy as np
import pytest
import torch
from scipy.interpolate import RegularGridInterpolator

from learning.reach import map as reach_map
from learning.reach.labels import Labels
from learning.reach.map import ReachableMap
from pps_vision.robot.gaze import GazeLimits

DEVICES = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]


@pytest.fixture(params=[1 << 18, 7])
def rows(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Cases at a time: all, and few."""
    monkeypatch.setattr(reach_map, "_TORCH_ROWS", request.param)
    return int(request.param)


@pytest.mark.parametrize("device", [None, *DEVICES])
def test_reachability(device, rows, rng):
    """Against SciPy's interpolation in yaw, pitch and ln tan(vergence/2)."""
    limits = GazeLimits()
    shape = (5, 6, 7)
    values = rng.uniform(-0.3, 0.3, shape), rng.uniform(0, 1, shape), rng.uniform(0, 0.2, shape)
    none = Labels(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0), np.zeros(0), np.zeros((0, 3)))
    reachable_map = ReachableMap("left", limits, *values, 0.2, 0.05, 0.01, none, 0)
    gaze = rng.uniform(limits.lower, limits.upper, (40, 3))
    gaze[0] = limits.lower
    gaze[1] = limits.upper
    gaze[2, 0] = limits.upper[0] + 0.01
    prediction = reachable_map.query(gaze, 0.4, device)
    to_log = np.array([gaze[:, 0], gaze[:, 1], np.log(np.tan(gaze[:, 2] / 2))]).T
    ends = [np.r_[end[:2], np.log(np.tan(end[2] / 2))] for end in (limits.lower, limits.upper)]
    axes = [np.linspace(low, high, n) for low, high, n in zip(*ends, shape, strict=True)]
    signed, good, bad = (RegularGridInterpolator(axes, field, bounds_error=False)(to_log) for field in values)
    inside = np.arange(40) != 2
    expected = 1 / (1 + np.exp(-signed / 0.05))
    assert np.allclose(prediction.probability[inside], expected[inside], atol=1e-9)
    degree = np.where(signed > 0, 0.5 + 0.5 * good, 0.5 - 0.5 * bad / 0.2)
    assert np.allclose(prediction.degree[inside], degree[inside], atol=1e-9)
    assert np.array_equal(prediction.within_limits, inside)
    assert np.array_equal(prediction.reachable, inside & (expected > 0.4))
    assert np.isnan(prediction.probability[2])
    assert np.isnan(prediction.degree[2])
    assert len(reachable_map.query(np.zeros((0, 3)), device=device).reachable) == 0
    assert reachable_map.query(gaze[4:5], device=device).degree == pytest.approx(degree[4:5], abs=1e-9)
