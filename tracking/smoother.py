"""Rauch–Tung–Striebel smoother: the path given all measurements, later ones too."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pps_vision.types import Array, Status, Track3D
from tracking import kalman
from tracking.kalman import Belief, KalmanParams, gate, scaled, start, update
from tracking.tracker import TrackerStep

Forecast = Callable[[Belief, float], tuple[Belief, Array]]


@dataclass(frozen=True)
class Measured:
    """A position (3,) m with its covariance (3, 3) m², or None where nothing was seen, at a stamp."""

    stamp_s: float
    position: Array | None
    cov: Array | None


@dataclass(frozen=True)
class Passage:
    """A filter's belief after a stamp; and the predicted belief (inflated, if the motion jumped) with the covariance of
    that state with the one before it, None where the filter started (again)."""

    belief: Belief
    expected: tuple[Belief, Array] | None


def follow(
    params: KalmanParams, begin: Belief, measured: Sequence[Measured], forecast: Forecast | None = None
) -> list[Passage]:
    """Run the filter from a first belief through later measurements in the order of their stamps.

    `forecast` predicts the state (default: the Kalman filter's).
    """
    ahead = forecast or (lambda belief, stamp_s: kalman.forecast(params, belief, stamp_s))
    passages = [Passage(begin, None)]
    for one in measured:
        expected, cross = ahead(passages[-1].belief, one.stamp_s)
        if one.position is None or one.cov is None:
            passages.append(Passage(expected, (expected, cross)))
            continue
        belief = update(params, expected, one.position, one.cov)
        gated = gate(params, expected, one.position, one.cov)
        restarted = gated is None and belief.rejections == 0
        before = gated.belief if gated else expected
        passages.append(Passage(belief, None if restarted else (before, cross)))
    return passages


def smooth(passages: Sequence[Passage]) -> list[Belief]:
    """Each belief given all measurements, later ones too."""
    smoothed = [passages[-1].belief]
    for here, after in zip(reversed(passages[:-1]), reversed(passages[1:]), strict=True):
        belief = here.belief
        if after.expected is None:  # restarted: later measurements say nothing of it
            smoothed.append(belief)
            continue
        expected, cross = after.expected
        gain = np.linalg.solve(expected.cov, cross.T).T
        change = gain @ (smoothed[-1].mean - expected.mean).ravel()
        P = belief.cov + gain @ (smoothed[-1].cov - expected.cov) @ gain.T
        smoothed.append(belief._replace(mean=belief.mean + change.reshape(belief.mean.shape), cov=0.5 * (P + P.T)))
    return smoothed[::-1]


def smoothed_tracks(params: KalmanParams, steps: Sequence[TrackerStep]) -> list[Track3D]:
    """The tracks of a tracker's steps (`params` its filter's), smoothed where they are known.

    The correlated error that the track adds to the filter's covariance stays.
    """
    tracks = [step.track for step in steps]
    for first, end in _runs(tracks, [step.observation is not None for step in steps]):
        seen = [step.observation for step in steps[first:end]]
        if seen[0] is None:
            continue
        own = scaled(params, float(np.linalg.norm(seen[0].p_root - steps[first].head)))
        begin = start(own, tracks[first].stamp_s, seen[0].p_root, seen[0].cov_root)
        measured = [
            Measured(track.stamp_s, *((None, None) if one is None else (one.p_root, one.cov_root)))
            for track, one in zip(tracks[first + 1 : end], seen[1:], strict=True)
        ]
        passages = follow(own, begin, measured)
        for k, (passage, belief) in enumerate(zip(passages, smooth(passages), strict=True), start=first):
            if tracks[k].is_known:
                tracks[k] = _replaced(tracks[k], passage.belief, belief)
    return tracks


def _runs(tracks: Sequence[Track3D], seen: Sequence[bool]) -> list[tuple[int, int]]:
    """First and end of every tracked stretch, from the first of the unbroken observations that led to it."""
    known = np.array([False, *(track.is_known for track in tracks), False])
    changes = np.flatnonzero(known[1:] != known[:-1])
    runs = []
    for first, end in zip(changes[::2].tolist(), changes[1::2].tolist(), strict=True):
        while first > 0 and seen[first - 1] and tracks[first - 1].status == Status.SEARCHING:
            first -= 1
        runs.append((first, end))
    return runs


def _replaced(track: Track3D, filtered: Belief, smoothed: Belief) -> Track3D:
    mean, cov, n = track.mean.copy(), np.zeros((12, 12)), len(smoothed.mean)
    mean[:n] = smoothed.mean
    beyond: Array = track.cov[:3, :3] - filtered.cov[:3, :3]
    if np.linalg.eigvalsh(beyond)[0] < 0:  # the tracker had restarted with another filter
        beyond = filtered.correlated_cov
    cov[: 3 * n, : 3 * n] = smoothed.cov
    cov[:3, :3] += beyond
    return replace(track, mean=mean, cov=cov)
