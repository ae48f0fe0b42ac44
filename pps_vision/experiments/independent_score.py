"""Track films of the independent scenes, with our tracker and with baselines, and score the tracks."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import get_args

import numpy as np

from pps_vision.experiments.baselines.stereo_pipelines import FilteredPipeline, StereoPipelineName, stereo_pipeline
from pps_vision.experiments.independent_cases import Case
from pps_vision.experiments.independent_films import Film
from pps_vision.experiments.study import percent
from pps_vision.experiments.timing import timed
from pps_vision.types import Array, Status, StereoFrame, Track3D, Truth
from tracking.tracker import Tracker, TrackerParams

OURS = "ours"
BASELINES: tuple[StereoPipelineName, ...] = tuple(name for name in get_args(StereoPipelineName) if "SGBM" not in name)
RIGHT_M = 0.03
FALSE_M = 0.05
SETTLE_S = 1.0
_CHI2_95 = 7.815  # of three degrees of freedom
_BY_FILM = ("right_percent", "covered_percent", "found_s")
Step = Callable[[StereoFrame], Track3D]
Scores = dict[str, float]


def measure(case: Case, film: Film, baselines: bool) -> dict[str, Scores]:
    """Track one film with nothing but its rig known, and with the baselines; scores by tracker."""
    steps: dict[str, Step] = {OURS: _ours(film, case.tracker(film.hue_deg))}
    if baselines:
        steps |= {name: Told(name, film).step for name in BASELINES}
    return _scored(case, film, film, steps)


def scored(case: Case, film: Film, frames: Iterable[StereoFrame], params: TrackerParams) -> Scores:
    """Track a film's frames with our tracker and score the tracks."""
    return _scored(case, film, frames, {OURS: _ours(film, params)})[OURS]


def _ours(film: Film, params: TrackerParams) -> Step:
    tracker = Tracker(params, film.rig, np.random.default_rng(film.seed))
    return lambda frame: tracker.step(frame).track


class Told:
    """A baseline that is told the object's true boxes in the first frame of which both eyes see all of it."""

    def __init__(self, name: StereoPipelineName, film: Film) -> None:
        self._pipeline = FilteredPipeline(stereo_pipeline(name, film.rig), film.rig)
        self._ahead, self._boxes = film.first_boxes

    def step(self, frame: StereoFrame) -> Track3D:
        """The track after the next frame; unknown before the first boxes."""
        self._ahead -= 1
        if self._ahead >= 0:
            return Track3D.unknown(frame.stamp_s)
        return self._pipeline.start(frame, self._boxes) if self._ahead == -1 else self._pipeline.step(frame)


def _scored(case: Case, film: Film, frames: Iterable[StereoFrame], steps: Mapping[str, Step]) -> dict[str, Scores]:
    """All trackers take each frame by turns, as films are drawn anew for whoever asks."""
    tracks: dict[str, list[Track3D]] = {name: [] for name in steps}
    ms: dict[str, list[float]] = {name: [] for name in steps}
    for frame in frames:
        for name, step in steps.items():
            track, took_ms = timed(partial(step, frame))
            tracks[name].append(track)
            ms[name].append(took_ms)
    moves_at_s = film.scene.rest_s if film.scene.start == "rest" else 0.0
    found = {}
    for name, of in tracks.items():
        told_which = (case.marker and film.scene.second != "same") or name != OURS
        truths = film.truths[: 1 if told_which else None]
        found[name] = {**score_of_either(of, truths, moves_at_s), "ms_per_pair": float(np.median(ms[name]))}
    return found


def score_of_either(tracks: Sequence[Track3D], truths: Sequence[Sequence[Truth]], moves_at_s: float = 0.0) -> Scores:
    """`score` by the one of several objects for which most frames are right: a track that changes from one to another
    is wrong for a part of the film."""
    return max((score(tracks, truth, moves_at_s) for truth in truths), key=lambda one: one["right_percent"])


def score(tracks: Sequence[Track3D], truth: Sequence[Truth], moves_at_s: float = 0.0) -> Scores:
    """Percentages and median error of one film, as `Independent` defines them; NaN where nothing counts."""
    error = np.array([np.linalg.norm(t.position - row.position) for t, row in zip(tracks, truth, strict=True)])
    claimed = np.array([track.status == Status.TRACKING for track in tracks])
    both = np.array([row.visible_left and row.visible_right for row in truth])
    stamps_s = np.array([row.stamp_s for row in truth])
    moving, judged = both & (stamps_s >= moves_at_s), both & (stamps_s >= moves_at_s + SETTLE_S)
    known, right = judged & claimed, moving & claimed & (error < RIGHT_M)
    off_radius = np.array([abs(t.radius_m / row.radius_m - 1) for t, row in zip(tracks, truth, strict=True)])
    covered = [_is_covered(t, row.position) for t, row, k in zip(tracks, truth, known, strict=True) if k]
    stated_m = [np.linalg.det(track.cov[:3, :3]) ** (1 / 6) for track, k in zip(tracks, known, strict=True) if k]
    return {
        "judged": int(judged.sum()),
        "right_percent": percent((claimed & (error < RIGHT_M))[judged]),
        "false_percent": percent(claimed & (error > FALSE_M)),
        "found_s": float(stamps_s[right][0] - stamps_s[moving][0]) if right.any() else np.nan,
        "median_mm": 1000 * float(np.median(error[known])) if known.any() else np.nan,
        "radius_percent": 100 * float(np.median(off_radius[known])) if known.any() else np.nan,
        "covered_percent": percent(np.array(covered, dtype=bool)),
        "stated_mm": 1000 * float(np.median(stated_m)) if stated_m else np.nan,
    }


def _is_covered(track: Track3D, position: Array) -> bool:
    """Whether the truth lies in the ellipsoid that should hold it 95 times of 100."""
    away = track.position - position
    return bool(away @ np.linalg.solve(track.cov[:3, :3], away) <= _CHI2_95)


def mean_score(films: Sequence[Scores]) -> Scores:
    """Mean over the films in which there is a value; NaN where there is none."""
    return {key: float(np.nanmean(x)) if np.isfinite(x).any() else np.nan for key, x in _columns(films).items()}


def summary(films: Sequence[Scores]) -> Scores:
    """Means, and of some scores the least and the most of a film; NaN where a film has none."""
    some = {key: x for key, x in _columns(films).items() if key in _BY_FILM}
    return {
        **mean_score(films),
        **{f"least_{key}": float(x.min()) for key, x in some.items()},
        **{f"most_{key}": float(x.max()) for key, x in some.items()},
    }


def _columns(films: Sequence[Scores]) -> dict[str, Array]:
    return {key: np.array([film[key] for film in films], dtype=float) for key in films[0]}
