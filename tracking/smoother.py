"""Rauch–Tung–Striebel smoother: the path given all measurements, later ones too.

    x_k|n = x_k + G (x_k+1|n − x′_k+1)    P_k|n = P_k + G (P_k+1|n − P′_k+1) Gᵀ    G = P_k Fᵀ P′_k+1⁻¹

x′ and P′ are predicted by the filter, and P_k Fᵀ is their cross-covariance with the step before.
"""

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pps_vision.geometry.camera import sight
from pps_vision.types import Array, Track3D
from tracking import kalman
from tracking.kalman import Belief, KalmanParams
from tracking.stereo import shift_cov
from tracking.tracker import TrackerStep

LAG = 400
"""Steps after which measurements no longer change a track: by less than 1e-9 of its standard deviation."""


@dataclass(frozen=True)
class Measurement:
    """Position (3,) m with covariance (3, 3) m² at a stamp, None if nothing was measured, the part of the covariance
    that is known to be correlated from frame to frame (None: 0), and the covariance (3, 3) m² of the measured point's
    shift on the object since the last measurement (None: 0)."""

    stamp_s: float
    position: Array | None = None
    cov: Array | None = None
    correlated: Array | None = None
    shift_cov: Array | None = None


@dataclass(frozen=True)
class FilterStep:
    """The filter's belief after a stamp, and the prediction that led to it: the belief (inflated, if the motion jumped)
    and its cross-covariance with the step before; None where the filter started or restarted."""

    belief: Belief
    prediction: tuple[Belief, Array] | None


def follow(params: KalmanParams, first: Belief, measurements: Sequence[Measurement]) -> list[FilterStep]:
    """Run the filter from a first belief through later measurements in the order of their stamps."""
    steps = [FilterStep(first, None)]
    for measurement in measurements:
        predicted, cross = kalman.forecast(params, steps[-1].belief, measurement.stamp_s)
        if measurement.position is None or measurement.cov is None:
            steps.append(FilterStep(predicted, (predicted, cross)))
            continue
        if measurement.shift_cov is not None:
            predicted = kalman.shifted(predicted, measurement.shift_cov)
        arguments = (params, predicted, measurement.position, measurement.cov, measurement.correlated)
        gated = kalman.gate(*arguments)
        belief = kalman.update(*arguments)
        restarted = gated is None and belief.rejections == 0
        prior = gated.belief if gated else predicted
        steps.append(FilterStep(belief, None if restarted else (prior, cross)))
    return steps


def smooth(steps: Sequence[FilterStep]) -> list[Belief]:
    """Return each belief given all measurements, later ones too."""
    smoothed = [steps[-1].belief]
    for step, next_step in zip(reversed(steps[:-1]), reversed(steps[1:]), strict=True):
        belief = step.belief
        if next_step.prediction is not None:  # else the filter restarted, and later measurements tell nothing about it
            predicted, cross = next_step.prediction
            G = np.linalg.solve(predicted.cov, cross.T).T
            mean = belief.mean.ravel() + G @ (smoothed[-1].mean - predicted.mean).ravel()
            P = belief.cov + G @ (smoothed[-1].cov - predicted.cov) @ G.T
            belief = belief._replace(mean=mean.reshape(belief.mean.shape), cov=0.5 * (P + P.T))
        smoothed.append(belief)
    return smoothed[::-1]


def smoothed_steps(params: KalmanParams, steps: Iterable[TrackerStep]) -> Iterator[TrackerStep]:
    """Yield a tracker's steps (`params` of its filter) with each track smoothed by itself where it is known.

    The correlated error and its rate, which the track adds to the filter's covariance, stay.  A step is yielded when
    `LAG` more have been read or its tracks have ended, so that the memory does not grow with the recording.
    """
    segments: dict[int, _Segment] = {}
    smoothed: defaultdict[int, deque[TrackerStep]] = defaultdict(deque)  # by track, in the order of `waiting`
    waiting: deque[list[int]] = deque()  # tracks of each step that was not yielded, the attended one first
    for step in steps:
        objects = {item.track.track_id: item for item in (step, *step.others)}
        waiting.append(list(objects))
        for track_id in [*segments]:
            segment = segments[track_id]
            if track_id not in objects or not segment.continues_with(objects[track_id]):
                smoothed[track_id].extend(segments.pop(track_id).pop(len(segment.steps)))
        for track_id, item in objects.items():
            if track_id not in segments:
                segments[track_id] = _Segment(params, item)
                continue
            segments[track_id].steps.append(item)
            if len(segments[track_id].steps) == 2 * LAG:
                smoothed[track_id].extend(segments[track_id].pop(LAG))
        yield from _complete(waiting, smoothed)
    for track_id, segment in segments.items():
        smoothed[track_id].extend(segment.pop(len(segment.steps)))
    yield from _complete(waiting, smoothed)


def _complete(waiting: deque[list[int]], smoothed: dict[int, deque[TrackerStep]]) -> Iterator[TrackerStep]:
    """Remove and yield the first steps whose tracks are all smoothed."""
    while waiting and all(smoothed[track_id] for track_id in waiting[0]):
        attended, *others = (smoothed[track_id].popleft() for track_id in waiting.popleft())
        yield replace(attended, others=tuple(others)) if others else attended


class _Segment:
    """Unfinished steps of one track, from the first of the unbroken observations that led to it.

    A step without a track and an observation is its own segment.
    """

    def __init__(self, params: KalmanParams, first: TrackerStep) -> None:
        self.steps = [first]
        self._start: Belief | None = None
        if (observation := first.observation) is not None:
            self._params = kalman.scaled(params, float(np.linalg.norm(sight(first.centers_root, observation.p_root))))
            self._start = kalman.start(
                self._params,
                first.track.stamp_s,
                observation.p_root,
                observation.cov_root,
                observation.correlated_cov_root,
            )

    def continues_with(self, step: TrackerStep) -> bool:
        """Whether the step is of this track, or one more observation that may lead to it."""
        last = self.steps[-1]
        if step.track.track_id != last.track.track_id:
            return False
        if step.track.is_known:
            return last.track.is_known or _is_unconfirmed(last)
        return _is_unconfirmed(last) and _is_unconfirmed(step)

    def pop(self, n: int) -> list[TrackerStep]:
        """Remove the first `n` steps and return them smoothed."""
        steps = self.steps
        self.steps = steps[n:]
        if self._start is None:
            return steps[:n]
        filtered = follow(self._params, self._start, _measurements(steps))
        smoothed = smooth(filtered)
        if self.steps:
            self._start = filtered[n].belief
        return [
            replace(steps[k], track=_smoothed_track(steps[k].track, filtered[k].belief, smoothed[k]))
            if steps[k].track.is_known
            else steps[k]
            for k in range(n)
        ]


def _measurements(steps: Sequence[TrackerStep]) -> list[Measurement]:
    """Measurements of all steps but the first."""
    measurements = []
    last = steps[0].observation
    for step in steps[1:]:
        stamp_s, observation = step.track.stamp_s, step.observation
        if observation is None:
            measurements.append(Measurement(stamp_s))
            continue
        measured = observation.p_root, observation.cov_root, observation.correlated_cov_root
        measurements.append(Measurement(stamp_s, *measured, shift_cov(last, observation)))
        last = observation
    return measurements


def _is_unconfirmed(step: TrackerStep) -> bool:
    """Whether an object was observed that is not tracked yet."""
    return not step.track.is_known and step.observation is not None


def _smoothed_track(track: Track3D, filtered: Belief, smoothed: Belief) -> Track3D:
    n = len(smoothed.mean)
    mean = track.mean.copy()
    mean[:n] = smoothed.mean
    cov = np.zeros((12, 12))
    cov[: 3 * n, : 3 * n] = smoothed.cov
    added = track.cov[: 3 * n, : 3 * n] - filtered.cov
    if np.linalg.eigvalsh(added[:3, :3])[0] < 0:  # the tracker had restarted with another filter
        added = np.zeros_like(filtered.cov)
        added[:3, :3] = filtered.correlated_cov
    cov[: 3 * n, : 3 * n] += added
    return replace(track, mean=mean, cov=cov)
