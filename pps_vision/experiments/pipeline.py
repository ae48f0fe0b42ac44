"""The whole pipeline, from stereo pairs to a path and a time to contact: ours, and what people would pick instead."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from tqdm import tqdm

from pps_vision.app.render import Render
from pps_vision.experiments.chart import Variant, legend, panels, speed_against_error, timed
from pps_vision.experiments.rendered import Rendered, rendered
from pps_vision.experiments.scene_sources import by_source
from pps_vision.experiments.stereo_peers import FilteredPeer, StereoPeerName, stereo_peer
from pps_vision.experiments.study import Scenes, SceneSource, Study
from pps_vision.types import Array, StereoFrame, Track3D
from rendering.names import StimulusName
from tracking.marker import MarkerParams
from tracking.tracker import Tracker, TrackerParams

_HUES_DEG: dict[StimulusName, float] = {"ball": 0.0, "marker": 120.0}
_SPEEDS_M_S = (0.05, 0.30)
_FARTHEST_M = 0.30  # an approach starts no farther from where it ends
_WARM_UP_S = 0.5  # before it, no position counts: ours first has to see that something moves
_LAST_S = 0.5  # before the touch a time to contact counts
_OURS = ("ours, generic", "ours, marker")


@dataclass(frozen=True)
class Pipeline(Study):
    """Balls and markers that approach the skin at 5–30 cm/s while the head moves, through our pipelines and the
    peers', which are told the true boxes in the first frame and get our filter.

    Time a stereo pair, 3D error, and error of the time to contact in the last half second.
    """

    n: int = 4
    """Approaches of a ball, and as many of a marker, their speeds spread over the range."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the approaches, the noise and the particles."""
    scenes: Scenes = "both"
    """Rendered scenes, independent ones, or both."""

    def run(self) -> dict[str, object]:
        """By pipeline: ms a pair, 3D RMS in mm, median relative TTC error, share of pairs with a track."""
        if self.n < 1:
            raise ValueError(f"bench pipeline: --n {self.n}; expected at least 1")
        return by_source(self.scenes, self._measure)

    def _measure(self, source: SceneSource) -> dict[str, Any]:
        of: dict[StimulusName, dict[str, _Log]] = {"ball": {}, "marker": {}}
        speeds = np.geomspace(*_SPEEDS_M_S, self.n) if self.n > 1 else np.array([0.15])
        for k in tqdm(range(2 * self.n), desc="pipeline", unit="approach", disable=None):
            stimulus: StimulusName = "marker" if k % 2 else "ball"
            speed = float(speeds[k // 2])
            length_s = _FARTHEST_M / speed + 0.1
            what = Render(
                stimulus, "approach", Path(), seconds=length_s, speed=speed, noise=self.noise, seed=self.seed + k
            )
            compare(rendered(what, source), _HUES_DEG[stimulus], self.seed, of[stimulus])
        logs = {name: log + of["marker"][name] for name, log in of["ball"].items()}
        numbers = {name: log.summary(name) for name, log in logs.items()}
        csrt = float(np.median(logs["two CSRT"].ms))
        return {
            "pipelines": numbers,
            "faster_than_two_csrt": {name: csrt / float(np.median(logs[name].ms)) for name in _OURS},
            "median_ms_by_stimulus": {
                stimulus: {name: round(float(np.median(log.ms)), 3) for name, log in own.items()}
                for stimulus, own in of.items()
            },
        }

    def chart(self, numbers: Mapping[str, Any]) -> Figure:
        """Time against 3D error and against the error of the time to contact."""
        figure, axes = panels(2)
        for axis, key, label in (
            (axes[0], "position_rms_mm", "3D RMS error (mm)"),
            (axes[1], "ttc_median_percent", f"time to contact, last {_LAST_S:g} s: median error (%)"),
        ):
            variants = [
                Variant.of(name, {**one, "error": one[key]}, name in _OURS, name == _OURS[0])
                for name, one in numbers["pipelines"].items()
            ]
            speed_against_error(axis, variants, "stereo pair", label)
            axis.set_yscale("log")
            axis.autoscale(axis="y")  # the chart's own limits, where they begin at 0, are none on a log axis
            axis.margins(0.14)
            top = axis.secondary_xaxis("top", functions=(_reciprocal, _reciprocal))
            top.set_xlabel("stereo pairs per second")
        legend(axes[0])
        return figure


def _reciprocal(value: ArrayLike) -> Array:
    """ms a pair to pairs a second, and back."""
    return 1000 / np.maximum(np.asarray(value, dtype=float), 1e-9)


@dataclass
class _Log:
    """What one pipeline did: ms of every pair; errors where they count; whether there was a track there."""

    ms: list[float] = field(default_factory=list)
    off_m: list[float] = field(default_factory=list)
    known: list[bool] = field(default_factory=list)
    ttc: list[float] = field(default_factory=list)

    def __add__(self, other: "_Log") -> "_Log":
        return _Log(self.ms + other.ms, self.off_m + other.off_m, self.known + other.known, self.ttc + other.ttc)

    def summary(self, name: str) -> dict[str, object]:
        """Errors over the pairs with a track; a time to contact that is missing is wholly wrong."""
        rms_mm = 1000 * float(np.sqrt(np.mean(np.square(self.off_m)))) if self.off_m else np.nan
        return {
            **Variant(name, np.array(self.ms), rms_mm).summary(),
            "position_rms_mm": rms_mm,
            "position_median_mm": 1000 * float(np.median(self.off_m)) if self.off_m else np.nan,
            "known_share": float(np.mean(self.known)),
            "ttc_median_percent": 100 * float(np.median(self.ttc)),
        }


def pipelines(film: Rendered, hue_deg: float, seed: int) -> tuple[int, dict[str, Callable[[StereoFrame], Track3D]]]:
    """The first frame in which both eyes see the object, which all have been shown, and what takes those after
    it, by name."""
    first = next((k for k, (left, right) in enumerate(film.boxes) if left and right), None)
    left, right = film.boxes[first or 0]
    if first is None or left is None or right is None:
        raise ValueError("the object is never in view of both eyes; expected boxes to start with")
    ours = {"ours, generic": TrackerParams(), "ours, marker": TrackerParams("marker", marker=MarkerParams(hue_deg))}
    found: dict[str, Callable[[StereoFrame], Track3D]] = {}
    for name, params in ours.items():
        tracker = Tracker(params, film.rig, np.random.default_rng(seed), own_body=film.own_body)
        tracker.step(film.frames[first])
        found[name] = lambda frame, tracker=tracker: tracker.step(frame).track  # type: ignore[misc]
    for peer in get_args(StereoPeerName):
        filtered = FilteredPeer(stereo_peer(peer, film.rig), film.rig)
        filtered.start(film.frames[first], (left, right))
        found[peer] = filtered.step
    return first, found


def compare(film: Rendered, hue_deg: float, seed: int, logs: dict[str, _Log]) -> None:
    """All pipelines on every pair in turn, until the object arrives; adds to `logs`."""
    speed = float(np.linalg.norm(film.truth[0].velocity))
    way = film.truth[0].velocity / speed
    last = next((k for k, row in enumerate(film.truth) if np.linalg.norm(row.velocity) < 0.5 * speed), None)
    if last is None:
        raise ValueError("the object does not arrive; expected a recording of a whole approach")
    end = film.truth[last].position
    first, steps = pipelines(film, hue_deg, seed)
    for frame, row in zip(film.frames[first + 1 : last], film.truth[first + 1 : last], strict=True):
        true_ttc = float((end - row.position) @ way) / speed
        counts = row.stamp_s - film.truth[first].stamp_s >= _WARM_UP_S and row.visible_left and row.visible_right
        for name, step in steps.items():
            track, ms = timed(lambda s=step, f=frame: s(f))  # type: ignore[misc]
            log = logs.setdefault(name, _Log())
            log.ms.append(ms)
            if counts:
                log.known.append(track.is_known)
                if track.is_known:
                    log.off_m.append(float(np.linalg.norm(track.position - row.position)))
            if 0.04 < true_ttc <= _LAST_S:
                log.ttc.append(ttc_error(track, end, way, true_ttc))


def ttc_error(track: Track3D, end: Array, way: Array, true_s: float) -> float:
    """|estimate − truth| / truth of the time until the plane through `end` (3,) across the `way` (3,) is met; 1
    where the track does not say that it will be."""
    closing = float(track.velocity @ way)
    if not (track.is_known and closing > 0):
        return 1.0
    return abs(float((end - track.position) @ way) / closing - true_s) / true_s
