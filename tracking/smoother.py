"""Rauch–Tung–Striebel smoother: the path given all measurements, later ones too."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pps_vision.types import Array, Track3D
from tracking import kalman
from tracking.kalman import Belief, KalmanParams, gate, update
from tracking.tracker import TrackerStep

LAG = 400
"""Steps after which measurements no longer change a track: by less than 1e-9 of its standard deviation."""


@dataclass(frozen=True)
class Measurement:
    """A position (3,) m with its covariance (3, 3) m², or None where nothing was seen, at a stamp; and the part of the
    covariance that is known to last (None: 0)."""

    stamp_s: float
    position: Array | None = None
    cov: Array | None = None
    correlated: Array | None = None


@dataclass(frozen=True)
class Passage:
    """A filter's belief after a stamp; and the predicted belief (inflated, if the motion jumped) with the covariance of
    that state with the one before it, None where the filter started (again)."""

    belief: Belief
    expected: tuple[Belief, Array] | None


def follow(params: KalmanParams, begin: Belief, measured: Sequence[Measurement]) -> list[Passage]:
    """Run the filter from a first belief through later measurements in the order of their stamps."""
    passages = [Passage(begin, None)]
    for one in measured:
        expected, cross = kalman.forecast(params, passages[-1].belief, one.stamp_s)
        if one.position is None or one.cov is None:
            passages.append(Passage(expected, (expected, cross)))
            continue
        measurement = one.position, one.cov, one.correlated
        belief, gated = update(params, expected, *measurement), gate(params, expected, *measurement)
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


def smoothed_steps(params: KalmanParams, steps: Iterable[TrackerStep]) -> Iterator[TrackerStep]:
    """Yield a tracker's steps (`params` its filter's) with their tracks smoothed where they are known.

    The correlated error that the track adds to the filter's covariance stays.  A step comes once `LAG` more
    are there or its track has ended; how many are held does not depend on how many there are.
    """
    run: _Run | None = None
    for step in steps:
        if run is None or not run.continues_with(step):
            if run is not None:
                yield from run.pop(len(run.steps))
            run = _Run(params, step)
            continue
        run.steps.append(step)
        if len(run.steps) == 2 * LAG:
            yield from run.pop(LAG)
    if run is not None:
        yield from run.pop(len(run.steps))


class _Run:
    """Steps of one track, from the first of the unbroken observations that led to it, which later measurements may
    still change; a step without a track and an observation is one by itself."""

    def __init__(self, params: KalmanParams, first: TrackerStep) -> None:
        self.steps = [first]
        self._begin: Belief | None = None
        if first.observation is not None:
            distance_m = float(np.linalg.norm(first.observation.p_root - first.midpoint_root))
            self._params = kalman.scaled(params, distance_m)
            self._begin = kalman.start(
                *(self._params, first.track.stamp_s, first.observation.p_root, first.observation.cov_root),
                correlated=first.observation.correlated_cov_root,
            )

    def continues_with(self, step: TrackerStep) -> bool:
        """Whether the step is of this track, or one more observation that may lead to it."""
        last = self.steps[-1]
        if step.track.is_known:
            return last.track.is_known or _is_sighting(last)
        return _is_sighting(last) and _is_sighting(step)

    def pop(self, n: int) -> list[TrackerStep]:
        """Remove the first `n` steps and return them smoothed."""
        steps, self.steps = self.steps, self.steps[n:]
        if self._begin is None:
            return steps[:n]
        seen = [(step.track.stamp_s, step.observation) for step in steps[1:]]
        measured = [
            Measurement(t) if one is None else Measurement(t, one.p_root, one.cov_root, one.correlated_cov_root)
            for t, one in seen
        ]
        passages = follow(self._params, self._begin, measured)
        if self.steps:
            self._begin = passages[n].belief
        return [
            replace(step, track=_replaced(step.track, passage.belief, belief)) if step.track.is_known else step
            for step, passage, belief in zip(steps[:n], passages, smooth(passages), strict=False)
        ]


def _is_sighting(step: TrackerStep) -> bool:
    """Whether something was observed that is not yet tracked."""
    return not step.track.is_known and step.observation is not None


def _replaced(track: Track3D, filtered: Belief, smoothed: Belief) -> Track3D:
    mean, cov, n = track.mean.copy(), np.zeros((12, 12)), len(smoothed.mean)
    mean[:n], cov[: 3 * n, : 3 * n] = smoothed.mean, smoothed.cov
    beyond: Array = track.cov[:3, :3] - filtered.cov[:3, :3]
    if np.linalg.eigvalsh(beyond)[0] < 0:  # the tracker had restarted with another filter
        beyond = filtered.correlated_cov
    cov[:3, :3] += beyond
    return replace(track, mean=mean, cov=cov)
