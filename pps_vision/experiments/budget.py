"""`track --max-error-mm`: time and error of its configurations, and whether it keeps what it promises."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.budget import CONFIGURATIONS, cheapest, configurations
from pps_vision.experiments.charts import panels, speed_errors
from pps_vision.experiments.independent_films import Film, IndependentScene
from pps_vision.experiments.independent_scenes import Color
from pps_vision.experiments.real_ball import baseball
from pps_vision.experiments.scenarios import Recording, from_film, moving
from pps_vision.experiments.score import METRICS, judge
from pps_vision.experiments.study import (
    DATA,
    TURNS,
    Method,
    Metric,
    SampledStudy,
    SceneSource,
    Values,
    compare,
    mean,
    median,
)
from pps_vision.experiments.tables import Table, estimate
from pps_vision.experiments.timing import timed_steps
from pps_vision.types import Status
from tracking.tracker import Tracker, TrackerParams

ASKED_MM = (0.3, 1.0, 3.0, 10.0)
DEFAULT = CONFIGURATIONS[-1].name
_SETTLED = 10  # frames with a track before the covariance counts
_MOVING: tuple[tuple[SceneSource, str], ...] = (
    ("rendered", "ball"),
    ("rendered", "marker"),
    ("rendered", "cube"),
    ("independent", "ball"),
    ("independent", "marker"),
)
_LARGE = ((640, 480), (1280, 720))
_COLORS: tuple[Color, ...] = ((205.0, 30.0, 25.0), (30.0, 60.0, 200.0), (235.0, 235.0, 235.0), (90.0, 90.0, 90.0))
_METRICS = {
    "rms_mm": METRICS["rms_mm"],
    "near_percent": METRICS["near_percent"],
    "true_over_reported": Metric("true_over_reported", median),
}
_REQUESTS = {
    "promised": Metric("promised", mean),
    "kept": Metric("kept", mean),
    "error_of_asked": Metric("error_of_asked", median),
    "cost": Metric("cost", median),
}


@dataclass(frozen=True)
class Budget(SampledStudy):
    """Objects tracked by each configuration of `track --max-error-mm`, then by the one that it chooses for a limit.

    Rendered and independent recordings of 320×240 pixels, independent ones of 640×480 and 1280×720, and the real
    `baseball`.  *Promised*: its expected error is within the limit. *Kept*: the 3D RMS error then is, of what was
    promised. Every recording is tracked three times by each configuration, by turns; the times are of all three.
    """

    seconds: float = 4.0
    """Length of a recording."""
    data: Path = DATA
    """Folder of the real data (default: PPS_VISION_DATA, else ../shared/data); without it nothing real."""
    only: str = ""
    """Only the kinds of scenes whose names contain this."""

    def run(self) -> dict[str, Any]:
        """Return by scenes and configuration time and errors; by limit the shares promised and kept, and the cost."""
        scenes = {name: make for name, make in self._scenes().items() if self.only in name}
        cells: dict[str, Any] = {}
        requests: dict[str, Any] = {}
        for name, make in scenes.items():
            real = name.startswith("real")
            seeds, later = self.seeds, range(self.seed + 100, self.seed + 100 + self.n)
            tried = configurations(make(self.seed).rig.left.width)
            methods = {c.name: partial(_values, c.params) for c in tried}
            limits: dict[str, Method] = {f"{mm:g} mm": partial(_request, mm) for mm in ASKED_MM}
            cells |= compare({name: make}, methods, _METRICS, seeds[:1] if real else seeds, DEFAULT, TURNS)
            requests |= compare({name: make}, limits, _REQUESTS, later[:1] if real else later)
        return {"cells": cells, "requests": requests}

    def _scenes(self) -> dict[str, Callable[[int], Recording]]:
        """What makes a recording of a seed, by kind of scene."""
        scenes: dict[str, Callable[[int], Recording]] = {
            f"{source}, {kind}": partial(self._moving, kind, source) for source, kind in _MOVING
        }
        scenes |= {f"independent, ball, {w}×{h}": partial(self._large, w, h) for w, h in _LARGE}
        if (self.data / "baseball").exists():
            scenes["real, ball, 640×480"] = lambda _: baseball(self.data / "baseball")
        else:
            print(f"{self.data / 'baseball'} is not there: nothing real")
        return scenes

    def _moving(self, name: str, source: SceneSource, seed: int) -> Recording:
        motion = ("circle", "linear", "jerk", "figure8")[seed % 4]
        return moving(name, motion, seed, self.seconds, source)

    def _large(self, width: int, height: int, seed: int) -> Recording:
        what = IndependentScene(
            width, height, seconds=self.seconds, color=_COLORS[seed % 4], background=seed % 5, start="moving"
        )
        return from_film(Film(what, seed, self.data))

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Time against error of the configurations, by kind of scene; what an asked-for error costs and gives."""
        return {
            "": speed_errors(numbers["cells"], {"rms_mm": "3D RMS error (mm)"}, (), DEFAULT),
            "requests": _draw_requests(numbers["requests"]),
        }

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the configurations' times and ratios of true to stated error, and the requests."""
        rows = [
            [
                f"{scene}: {name}",
                estimate([c["ms"][k] for k in (1, 0, 2)]),
                estimate(c["ratio"]),
                *(estimate(c[key]) for key in _METRICS),
            ]
            for scene, cell in numbers["cells"].items()
            for name, c in cell.items()
        ]
        requests = [
            [f"{scene}: {limit}", *(estimate(c[key], 2) for key in _REQUESTS)]
            for scene, cell in numbers["requests"].items()
            for limit, c in cell.items()
        ]
        header = ["scenes: configuration", "ms per pair, quartiles", "time, of the default's"]
        header += ["3D RMS (mm)", "near (%)", "true / stated error"]
        asked = ["scenes: limit", "promised", "kept, of the promised", "error, of the limit", "time, of the default's"]
        return {"": Table(header, rows), "requests": Table(asked, requests)}


def _median_first(quartiles: list[float]) -> str:
    """Quartiles as "median (first–third)"."""
    first, median_ms, third = quartiles
    return estimate([median_ms, first, third])


def _draw_requests(requests: dict[str, Any]) -> Figure:
    """The time of the chosen configuration over the error that is asked for; open where it is not promised."""
    figure, axes = panels(len(requests), 4, width=3.2, height=2.6)
    for (scene, of_limit), axis in zip(requests.items(), axes, strict=True):
        cost = [c["cost"][0] for c in of_limit.values()]
        axis.plot(ASKED_MM, cost, "-", color="tab:blue", lw=1)
        for mm, c in zip(ASKED_MM, of_limit.values(), strict=True):
            kept = c["promised"][0] > 0.5
            axis.plot(mm, c["cost"][0], "o", color="tab:blue", mfc="tab:blue" if kept else "white")
        axis.set_xscale("log")
        axis.set_ylim(0, 1.25)
        axis.axhline(1, color="0.25", lw=1, ls="--")
        axis.set_title(scene, fontsize=9)
        axis.set(xlabel="asked-for error (mm)", ylabel="time, of the default's")
        axis.grid(alpha=0.25)
    return figure


def _values(params: TrackerParams, recording: Recording, seed: int) -> Values:
    """Errors, times, and the ratio of the true RMS error to the stated one, of the frames with a settled track."""
    tracker = Tracker(params, recording.rig, np.random.default_rng(seed), own_body=recording.own_body)
    steps, ms = timed_steps(tracker.step, recording.frames)
    tracks = [step.track for step in steps]
    settled = [k for k, track in enumerate(tracks) if track.status == Status.TRACKING][_SETTLED:]
    true = [np.sum((tracks[k].position - recording.position[k]) ** 2) for k in settled]
    stated = [np.trace(tracks[k].cov[:3, :3]) for k in settled]
    ratio = [float(np.sqrt(np.mean(true) / np.mean(stated)))] if settled else []
    return judge(recording, tracks) | {"ms": ms, "true_over_reported": ratio}


def _request(limit_mm: float, recording: Recording, seed: int) -> Values:
    """Whether the choice promises the limit, whether it keeps it, and its time relative to the default's."""

    def tracker_for(params: TrackerParams) -> Tracker:
        return Tracker(params, recording.rig, np.random.default_rng(seed), own_body=recording.own_body)

    chosen: Callable[..., Values] = partial(_values, seed=seed, recording=recording)
    choice = cheapest(recording.frames, limit_mm, tracker_for, configurations(recording.rig.left.width))
    ours, default = chosen(choice.configuration.params), chosen(TrackerParams())
    error_mm = METRICS["rms_mm"].summary(np.asarray(ours["error_mm"]))
    cost = float(np.median(np.asarray(ours["ms"])) / np.median(np.asarray(default["ms"])))
    return {
        "promised": [choice.meets],
        "kept": [error_mm <= limit_mm] if choice.meets else [],
        "error_of_asked": [error_mm / limit_mm] if choice.meets else [],
        "cost": [cost],
        "ms": ours["ms"],
    }
