"""Trackers and baselines on films and recordings, and scores of their tracks against the truth."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from pps_vision.experiments.baselines.stereo_pipelines import FilteredPipeline, StereoPipelineName, available_pipelines
from pps_vision.experiments.films.recordings import EYES_M, Footage, tracker_params
from pps_vision.experiments.films.scenes import Film
from pps_vision.experiments.study import Method, Metric, Values, mean, percent, rms
from pps_vision.experiments.timing import timed, timed_steps
from pps_vision.types import Array, Status, StereoFrame, Track3D, Truth
from tracking.tracker import Tracker, TrackerParams, TrackerStep

NEAR = 1 / 6  # largest error of a track near the object, as a share of the object's distance
METRICS = {
    "near_percent": Metric("near", percent),
    "rms_mm": Metric("error_mm", rms),
    "worst_recording_mm": Metric("recording_rms_mm", lambda values: float(np.max(values)) if len(values) else np.nan),
    "mean_recording_mm": Metric("recording_rms_mm", mean),
}
"""Summaries of the values of `judge`."""
OURS = "ours"
_SETTLE_S = 0.5  # in a recording, from the first visible frame to the first judged frame
_FILM_SETTLE_S = 1.0  # the same in a film
_RIGHT_M = 0.03
_FALSE_M = 0.05
_FAR = 0.05  # largest error of a known track beyond 0.6 m, as a share of the distance from the root frame's origin
_KNOWN_S = 0.5  # latest, for `known_percent`
_CHI2_95 = 7.815  # of three degrees of freedom
_BY_FILM = ("right_percent", "covered_percent", "found_s")
Step = Callable[[StereoFrame], Track3D | TrackerStep]
Tracks = Sequence[Sequence[Track3D]]  # tracks of each frame; a place in it belongs to the same object throughout
Scores = dict[str, float]


def steps_of(recording: Footage, seed: int, mode: str | None = None) -> tuple[list[TrackerStep], list[float]]:
    """Return our tracker's steps on all frames, without any initialization, and their processor times (ms)."""
    rng = np.random.default_rng(seed)
    tracker = Tracker(tracker_params(recording, mode), recording.rig, rng, own_body=recording.own_body)
    return timed_steps(tracker.step, recording.frames)


def tracker(mode: str | None = None) -> Method:
    """Return our tracker as a study's method, in the mode for the recording's object or in the given one."""

    def run(recording: Footage, seed: int) -> Values:
        steps, ms = steps_of(recording, seed, mode)
        return judge(recording, [step.track for step in steps]) | {"ms": ms}

    return run


def baseline(name: StereoPipelineName) -> Method:
    """Return a baseline as a study's method; it gets the true boxes of the first frame with the object."""

    def run(recording: Footage, seed: int) -> Values:
        first, boxes = recording.first_boxes
        pipeline = FilteredPipeline(name, recording.rig, float(recording.stamps_s[first]), boxes)
        tracks, ms = timed_steps(pipeline.step, recording.frames)
        return judge(recording, tracks) | {"ms": ms[first + 1 :]}

    return run


def judge(recording: Footage, tracks: Sequence[Track3D]) -> dict[str, Array]:
    """Return the values that `METRICS` summarizes.

    Over the judged frames: whether the track is near the object, and the error of the known tracks.
    """
    judged = recording.judged(_SETTLE_S)
    known = np.array([track.is_known for track in tracks])
    path = np.array([track.position for track in tracks])
    truth = recording.position
    error = np.linalg.norm(path - truth, axis=1)
    near = known & (error <= NEAR * np.linalg.norm(truth - EYES_M, axis=1))
    error_mm = 1000 * error[judged & known]
    return {
        "near": near[judged],
        "error_mm": error_mm,
        "recording_rms_mm": np.array([rms(error_mm)]) if len(error_mm) else np.empty(0),
    }


def measure_film(
    film: Film,
    params: TrackerParams,
    baselines: bool = False,
    each: bool = False,
    variants: Mapping[str, TrackerParams] | None = None,
) -> dict[str, Scores]:
    """Track a film with our tracker, which gets its rig alone, its variants and the baselines; return scores by
    tracker.

    They are those of the first object; of two equal balls of either, or with `each` of the worse one. A baseline gets
    the true boxes of the first frame that shows the whole object to both eyes.
    """
    ours = {OURS: params, **(variants or {})}
    steps: dict[str, Step] = {
        name: Tracker(own, film.rig, np.random.default_rng(film.seed)).step for name, own in ours.items()
    }
    if baselines:
        first, boxes = film.first_boxes
        start = (film.rig, float(film.stamps_s[first]), boxes)
        steps |= {name: FilteredPipeline(name, *start).step for name in available_pipelines()}
    tracks: dict[str, list[Sequence[Track3D]]] = {name: [] for name in steps}
    ms: dict[str, list[float]] = {name: [] for name in steps}
    for frame in film:  # once for all trackers, since it is drawn anew each time
        for name, step in steps.items():
            result, step_ms = timed(partial(step, frame))
            if isinstance(result, Track3D):
                tracks[name].append((result,))
            else:
                tracks[name].append(result.tracks)
            ms[name].append(step_ms)
    scores = {}
    for name in steps:
        judged = film.truths if name in ours and film.scene.second_ball else film.truths[:1]
        scores[name] = score_of_film(tracks[name], judged, film.awaited_s, each)
        scores[name]["ms_per_pair"] = float(np.median(ms[name]))
        scores[name]["false_percent"] = _false_percent([row[:1] for row in tracks[name]], film.truths)
    return scores


def score_of_film(
    tracks: Tracks, truths: Sequence[Sequence[Truth]], moves_at_s: float = 0.0, each: bool = False
) -> Scores:
    """Return the score by the object with the most right frames, or with `each` the fewest.

    Of several tracks the nearest counts.
    """
    best = []
    for truth in truths:
        nearest = [
            min(known, key=lambda track: float(np.linalg.norm(track.position - at.position)))
            if (known := [track for track in row if track.is_known])
            else Track3D.unknown(at.stamp_s)
            for row, at in zip(tracks, truth, strict=True)
        ]
        best.append(score(nearest, truth, moves_at_s))
    return (min if each else max)(best, key=lambda values: values["right_percent"])


def _false_percent(tracks: Tracks, truths: Sequence[Sequence[Truth]]) -> float:
    """Share of the frames in which a track claims a position more than 5 cm from every object."""
    worst = []
    for row, objects in zip(tracks, zip(*truths, strict=True), strict=True):
        claims = [track.position for track in row if track.status == Status.TRACKING]
        worst.append(max((min(np.linalg.norm(p - at.position) for at in objects) for p in claims), default=0.0))
    return percent(np.array(worst) > _FALSE_M)


def score(tracks: Sequence[Track3D], truth: Sequence[Truth], moves_at_s: float = 0.0) -> Scores:
    """Return percentages and medians of one film, as the study `independent` defines them; NaN without a frame."""
    error = np.array([np.linalg.norm(t.position - row.position) for t, row in zip(tracks, truth, strict=True)])
    claimed = np.array([track.status == Status.TRACKING for track in tracks])
    near_m = np.array([max(_RIGHT_M, _FAR * float(np.linalg.norm(row.position))) for row in truth])
    known = np.array([track.is_known for track in tracks]) & (error <= near_m)
    visible = np.array([row.visible_left and row.visible_right for row in truth])
    stamps_s = np.array([row.stamp_s for row in truth])
    moving = visible & (stamps_s >= moves_at_s)
    judged = visible & (stamps_s >= moves_at_s + _FILM_SETTLE_S)
    tracked = judged & claimed
    right = moving & claimed & (error < _RIGHT_M)
    known_s = float(stamps_s[moving & known][0] - stamps_s[moving][0]) if (moving & known).any() else np.nan
    radius_error = np.array([abs(t.radius_m / row.radius_m - 1) for t, row in zip(tracks, truth, strict=True)])
    covered = [_is_covered(t, row.position) for t, row, k in zip(tracks, truth, tracked, strict=True) if k]
    return {
        "judged": int(judged.sum()),
        "right_percent": percent((claimed & (error < _RIGHT_M))[judged]),
        "false_percent": percent(claimed & (error > _FALSE_M)),
        "found_s": float(stamps_s[right][0] - stamps_s[moving][0]) if right.any() else np.nan,
        "known_s": known_s,
        "known_percent": 100.0 * (known_s <= _KNOWN_S),
        "median_mm": 1000 * float(np.median(error[tracked])) if tracked.any() else np.nan,
        "radius_percent": 100 * float(np.median(radius_error[tracked])) if tracked.any() else np.nan,
        "covered_percent": percent(np.array(covered, dtype=bool)),
    }


def _is_covered(track: Track3D, position: Array) -> bool:
    """Whether the truth lies in the stated 95 % ellipsoid."""
    error = track.position - position
    return bool(error @ np.linalg.solve(track.cov[:3, :3], error) <= _CHI2_95)


def summary(films: Sequence[Scores]) -> Scores:
    """Return the mean of each score over the films, and of some the least and the most; NaN where a film has none."""
    columns = {key: np.array([film[key] for film in films], dtype=float) for key in films[0]}
    by_film = {key: columns[key] for key in _BY_FILM}
    return {
        **{key: float(np.nanmean(x)) if np.isfinite(x).any() else np.nan for key, x in columns.items()},
        **{f"least_{key}": float(x.min()) for key, x in by_film.items()},
        **{f"most_{key}": float(x.max()) for key, x in by_film.items()},
    }
