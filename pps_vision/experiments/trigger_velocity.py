"""The velocity with which the tracker begins, with and without optical flow, on the same films of two sources."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pps_vision.experiments.footage import Studio
from pps_vision.experiments.trigger_scenes import AFTER, FPS, STARTS, independent_film, starting_footage
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, StereoFrame, Track3D
from tracking.motion_trigger import TriggerParams
from tracking.search import OwnBody, SearchParams
from tracking.tracker import Tracker, TrackerParams

_WITHOUT = SearchParams(trigger=TriggerParams(flow=False))
_FOUND_M = 0.05  # farther from the truth a track is another thing's
_PX = 1.0, 12.0  # speeds, px a frame, drawn from a log-uniform distribution
_RADIUS_M = 0.012, 0.04


class First(NamedTuple):
    """The first track of an object: images since it started to move, and the errors of its velocity."""

    delay: int
    error_m_s: float
    error_px: float


@dataclass(frozen=True)
class _Film:
    frames: Iterable[StereoFrame]
    rig: StereoRig
    position: Array
    own_body: OwnBody | None


def first_velocities(studio: Studio, data: Path, n: int, noise: float, seed: int) -> dict[str, object]:
    """By source: paired errors of the first track's velocity, `n` films each, every other with a still head.

    `confirmed`: by default after three images; `at once`: by a tracker that confirms the first, whose velocity is what
    it begins with.
    """
    result: dict[str, object] = {}
    for kind in ("rendered", "independent"):
        rows: dict[str, list[First | None]] = {}
        for k in range(n):
            film = _film(
                studio, data, np.random.default_rng((seed, kind == "independent", k)), kind, 20.0 * (k % 2), noise
            )
            for name, first in _measure(film, k).items():
                rows.setdefault(name, []).append(first)
        result[kind] = {when: paired(rows[f"{when}, without"], rows[f"{when}, with"], seed) for when in _CONFIRM}
    return result


_CONFIRM = {"at once": 1, "confirmed": TrackerParams().confirm_frames}


def _film(studio: Studio, data: Path, rng: np.random.Generator, kind: str, deg_s: float, noise: float) -> _Film:
    radius, px = float(rng.uniform(*_RADIUS_M)), float(np.exp(rng.uniform(*np.log(_PX))))
    if kind == "rendered":
        footage = starting_footage(studio, rng, radius, px, np.deg2rad(deg_s), noise)
        return _Film(footage.frames, footage.rig, footage.position, Silhouette(studio.robot))
    film = independent_film(rng, data, (STARTS + AFTER) / FPS, radius, px, deg_s, noise)
    return _Film(film, film.rig, np.array([one.position for one in film.truth]), None)


def _measure(film: _Film, seed: int) -> dict[str, First | None]:
    """Every tracker's first right track, None where there is none."""
    trackers = {
        f"{when}, {flow}": Tracker(
            replace(params, confirm_frames=confirm), film.rig, np.random.default_rng(seed), film.own_body
        )
        for when, confirm in _CONFIRM.items()
        for flow, params in (("without", TrackerParams(search=_WITHOUT)), ("with", TrackerParams()))
    }
    first: dict[str, First | None] = dict.fromkeys(trackers)
    for k, frame in enumerate(film.frames):
        for name, tracker in trackers.items():
            track = tracker.step(frame).track
            if first[name] is None and k >= STARTS and track.is_known:
                first[name] = _first(film, frame, track, k)
    return first


def _first(film: _Film, frame: StereoFrame, track: Track3D, k: int) -> First | None:
    if np.linalg.norm(track.position - film.position[k]) > _FOUND_M:
        return None
    error = track.velocity - (film.position[k] - film.position[k - 1]) * FPS
    eyes = film.rig.view_of(frame)
    px = [eye.project_jacobian(film.position[k]) @ error / FPS for eye in (eyes.left, eyes.right)]
    return First(k - STARTS + 1, float(np.linalg.norm(error)), float(np.mean([np.linalg.norm(one) for one in px])))


def paired(without: list[First | None], with_flow: list[First | None], seed: int) -> dict[str, object]:
    """Medians on the films that both found, and the mean of the paired differences (with less without; negative: flow
    is better) with a 95 % interval by resampling films."""
    both = np.array([(a, b) for a, b in zip(without, with_flow, strict=True) if a and b]).reshape(-1, 2, 3)
    found = {"without": sum(map(bool, without)), "with": sum(map(bool, with_flow))}
    result: dict[str, object] = {"films": len(without), "found": found, "paired": len(both)}
    if len(both) == 0:
        return result
    rng = np.random.default_rng(seed)
    drawn = rng.integers(len(both), size=(2000, len(both)))
    for k, name in enumerate(First._fields):
        difference = both[:, 1, k] - both[:, 0, k]
        low, high = np.percentile(difference[drawn].mean(axis=1), (2.5, 97.5))
        result[name] = {
            "without": float(np.median(both[:, 0, k])),
            "with": float(np.median(both[:, 1, k])),
            "mean_difference": float(difference.mean()),
            "interval_95": [float(low), float(high)],
            "flow_better_in": int((difference < 0).sum()),
        }
    return result
