"""Demands on a tracker before, during and after a disturbance, asserted in one place."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pps_vision.types import Array, Mask, Status, Track3D

BEFORE_S, HONEST = 0.4, 30.0  # χ² with 3 degrees of freedom exceeds 30 once in 700 000 frames
WIDER = 1.5  # standard deviation of position or velocity, relative to before


@dataclass(frozen=True)
class Demand:
    """From `from_s` to `to_s` the object is `lost`: it cannot be measured, the track coasts with a growing covariance
    and is given up once, within `lost_s`; or it is `degraded`: sometimes not measured, or stated to be less certain.
    What is stated holds the truth, but for `excused_s` after the beginning.  `recovered_s` after the end, as before the
    beginning, it is tracked to `accuracy_m`, and stated to be."""

    during: Literal["lost", "degraded"] = "lost"
    from_s: float = 1.0
    to_s: float = 1.8
    lost_s: float = 0.55
    excused_s: float = 0.0
    recovered_s: float = 0.4
    accuracy_m: float = 0.004


def check(demand: Demand, tracks: Sequence[Track3D], truth: Array) -> None:
    """AssertionError where a run's tracks do not show what is demanded; `truth` (n, 3) m."""
    whole(tracks)
    stamps = np.array([t.stamp_s for t in tracks])
    status = np.array([t.status for t in tracks])
    is_known = np.array([t.is_known for t in tracks])
    error = np.array([t.position - p for t, p in zip(tracks, truth, strict=True)])
    std, std_of_velocity = (
        np.array([np.sqrt(np.linalg.eigvalsh(t.cov[k, k])[-1]) if t.is_known else np.nan for t in tracks])
        for k in (slice(0, 3), slice(3, 6))
    )
    nees = np.full(len(tracks), np.nan)
    for k in np.flatnonzero(is_known):
        nees[k] = error[k] @ np.linalg.solve(tracks[k].cov[:3, :3], error[k])
    earlier = (stamps > demand.from_s - BEFORE_S) & (stamps < demand.from_s - 1e-6)
    inside = (stamps > demand.from_s - 1e-6) & (stamps < demand.to_s - 1e-6)
    after = stamps > demand.to_s + demand.recovered_s - 1e-6
    _tracked("before", earlier, status, error, std, nees, demand.accuracy_m)
    judged = is_known & inside & (stamps > demand.from_s + demand.excused_s - 1e-6)
    worst = max(nees[judged], default=0.0)
    assert worst < HONEST, f"χ² {worst:.0f}, {1e3 * np.linalg.norm(error[judged], axis=1).max():.0f} mm off"
    if demand.during == "lost":
        assert not (status[inside] == Status.TRACKING).any(), "tracked what cannot be measured"
        lost = stamps[inside][status[inside] == Status.LOST]
        assert len(lost) == 1, f"lost {len(lost)} times"
        assert lost[0] <= demand.from_s + demand.lost_s + 1e-6, f"lost only after {lost[0] - demand.from_s:.2f} s"
        assert not is_known[inside & (stamps > lost[0])].any(), "known again while it cannot be measured"
    else:
        wider = [(values[inside] > WIDER * np.median(values[earlier])).any() for values in (std, std_of_velocity)]
        assert any(wider) or (status[inside] != Status.TRACKING).any(), "as sure as ever"
    _tracked("after", after, status, error, std, nees, demand.accuracy_m)


def _tracked(name: str, when: Mask, status: Array, error: Array, std: Array, nees: Array, accuracy_m: float) -> None:
    """In all frames, as accurately as is asked, and as is stated."""
    assert when.sum() >= 4
    assert (status[when] == Status.TRACKING).all(), f"not tracked {name} it: {', '.join(status[when])}"
    off_m = np.linalg.norm(error[when], axis=1).max()
    stated_m = std[when].max()
    assert max(off_m, stated_m) < accuracy_m, f"{name} it {off_m:.4f} m off, {stated_m:.4f} m stated"
    assert nees[when].max() < HONEST, f"{name} it χ² {nees[when].max():.0f}"


def whole(tracks: Sequence[Track3D]) -> None:
    """No NaN in a known track, positive definite covariances, which grow while nothing is seen."""
    for earlier, track in zip([tracks[0], *tracks], tracks, strict=False):
        if not track.is_known:
            assert np.isnan(track.mean).all()
            continue
        assert np.all(np.isfinite(track.mean))
        assert np.all(np.isfinite(track.cov))
        np.testing.assert_allclose(track.cov, track.cov.T, atol=1e-12)
        std = np.linalg.eigvalsh(track.cov[:3, :3])
        assert std[0] > 0
        if track is not earlier and track.status == earlier.status == Status.COASTING:
            assert std[-1] > np.linalg.eigvalsh(earlier.cov[:3, :3])[-1]
