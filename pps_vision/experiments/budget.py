"""`track --max-error-mm`: time and error of its configurations, and whether it keeps what it promises."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from pps_vision.app.budget import CONFIGURATIONS, cheapest, configurations
from pps_vision.experiments.charts import PAGE_IN, panels
from pps_vision.experiments.independent_films import Film, IndependentScene
from pps_vision.experiments.independent_scenes import Color
from pps_vision.experiments.real_ball import baseball
from pps_vision.experiments.scenarios import Footage, from_film, moving
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
    measure,
    median,
    summarize,
)
from pps_vision.experiments.tables import Table, estimate, median_first
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
_MARKS = dict(zip((c.name for c in CONFIGURATIONS), ("tab:green", "tab:purple", "tab:orange", "tab:blue"), strict=True))


@dataclass(frozen=True)
class Budget(SampledStudy):
    """Objects tracked by each configuration of `track --max-error-mm`, then by the one that it chooses for a limit.

    Rendered and independent recordings of 320×240 pixels, independent ones of 640×480 and 1280×720, and the real
    `baseball`.  *Promised*: its expected error is within the limit. *Kept*: the 3D RMS error then is, of what was
    promised. *Refused needlessly*: not promised, but the error of what is chosen then is within the limit all the same.
    Every recording is tracked three times by each configuration, by turns; the times are of all three.
    """

    seconds: float = 4.0
    """Length of a recording."""
    data: Path = DATA
    """Folder of the real data (default: PPS_VISION_DATA, else ../shared/data); without it nothing real."""
    only: str = ""
    """Only the kinds of scenes whose names contain this."""

    def run(self) -> dict[str, Any]:
        """Return by scenes and configuration time and errors; by limit the shares promised and kept, and the cost; and
        of each request which configuration was chosen, whether it was promised, its error and its time."""
        scenes = {name: make for name, make in self._scenes().items() if self.only in name}
        cells: dict[str, Any] = {}
        requests: dict[str, Any] = {}
        choices: dict[str, Any] = {}
        for name, make in scenes.items():
            real = name.startswith("real")
            seeds, later = self.seeds, range(self.seed + 100, self.seed + 100 + self.n)
            tried = configurations(make(self.seed).rig.left.width)
            methods = {c.name: partial(_values, c.params) for c in tried}
            limits: dict[str, Method] = {f"{mm:g} mm": partial(_request, mm) for mm in ASKED_MM}
            cells |= compare({name: make}, methods, _METRICS, seeds[:1] if real else seeds, DEFAULT, TURNS)
            measured = measure({name: make}, limits, later[:1] if real else later)[name]
            requests[name] = summarize(measured, _REQUESTS)
            choices[name] = {limit: [_choice(values) for values in of] for limit, of in measured.items()}
        return {"cells": cells, "requests": requests, "choices": choices}

    def _scenes(self) -> dict[str, Callable[[int], Footage]]:
        """What makes a recording of a seed, by kind of scene."""
        scenes: dict[str, Callable[[int], Footage]] = {
            f"{source}, {kind}": partial(self._moving, kind, source) for source, kind in _MOVING
        }
        scenes |= {f"independent, ball, {w}×{h}": partial(self._large, w, h) for w, h in _LARGE}
        if (self.data / "baseball").exists():
            scenes["real, ball, 640×480"] = lambda _: baseball(self.data / "baseball")
        else:
            print(f"{self.data / 'baseball'} is not there: nothing real")
        return scenes

    def _moving(self, name: str, source: SceneSource, seed: int) -> Footage:
        motion = ("circle", "linear", "jerk", "figure8")[seed % 4]
        return moving(name, motion, seed, self.seconds, source)

    def _large(self, width: int, height: int, seed: int) -> Footage:
        what = IndependentScene(
            width, height, seconds=self.seconds, color=_COLORS[seed % 4], background=seed % 5, start="moving"
        )
        return from_film(Film(what, seed, self.data))

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Asked-for error against time, coloured by the configuration that is chosen, one panel a source of scenes."""
        return _draw_choices(numbers["choices"])

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the configurations' times and ratios of true to stated error, and the requests."""
        rows = [
            [
                f"{scene}: {name}",
                median_first(c["ms"]),
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
        return {"": Table(header, rows), "requests": Table(asked, requests), "tally": _tally(numbers["choices"])}


def _tally(choices: Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]]) -> Table:
    """What became of the requests of each source: promised, kept, refused, needlessly; whether the limit mattered."""
    rows = []
    for source in (*dict.fromkeys(name.split(",")[0] for name in choices), "all"):
        of = [by for name, by in choices.items() if source in (name.split(",")[0], "all")]
        asked = [(float(limit.split()[0]), one) for by in of for limit, ones in by.items() for one in ones]
        within: dict[bool, list[bool]] = {True: [], False: []}
        for mm, one in asked:
            within[one["promised"]].append(one["error_mm"] is not None and one["error_mm"] <= mm)
        recordings = [recording for by in of for recording in zip(*by.values(), strict=True)]
        same = [len({one["configuration"] for one in recording}) == 1 for recording in recordings]
        counts = [f"{sum(some)} of {len(some)}" for some in (within[True], within[False], same)]
        rows.append([source, str(len(asked)), *counts])
    header = ["scenes", "requests", "kept, of promised", "needless, of refused"]
    return Table([*header, "recordings with one choice for all limits"], rows)


def _draw_choices(choices: Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]]) -> Figure:
    """Time over the error that is asked for, one mark a request: its colour the configuration, open if not promised."""
    sources = list(dict.fromkeys(name.split(",")[0] for name in choices))
    figure, axes = panels(len(sources), width=PAGE_IN / len(sources), height=3.6)
    for axis in axes[1:]:
        axis.sharey(axes[0])
    for axis, source in zip(axes, sources, strict=True):
        for scene, by_limit in choices.items():
            for limit, ones in by_limit.items() if scene.startswith(source) else ():
                for k, one in enumerate(ones):
                    aside = 1.12 ** (k - (len(ones) - 1) / 2)
                    color = _MARKS[one["configuration"]]
                    face = color if one["promised"] else "white"
                    axis.plot(float(limit.split()[0]) * aside, one["median_ms"], "o", ms=5, color=color, mfc=face)
        axis.set(xscale="log", yscale="log", xlabel="asked-for error (mm)")
        axis.set_xticks(ASKED_MM, [f"{mm:g}" for mm in ASKED_MM])
        axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
        axis.yaxis.set_minor_formatter(NullFormatter())
        axis.xaxis.set_minor_locator(NullLocator())
        axis.set_title(f"{source} scenes", fontsize=10)
        axis.grid(alpha=0.25, which="both")
    axes[0].set_ylabel("time of what is chosen (ms per pair)")
    for name, color in _MARKS.items():
        axes[0].plot([], [], "o", color=color, label=name)
    axes[0].plot([], [], "o", color="0.25", mfc="white", label="not promised")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8)
    return figure


def _values(params: TrackerParams, recording: Footage, seed: int) -> Values:
    """Errors, times, and the ratio of the true RMS error to the stated one, of the frames with a settled track."""
    tracker = Tracker(params, recording.rig, np.random.default_rng(seed), own_body=recording.own_body)
    steps, ms = timed_steps(tracker.step, recording.frames)
    tracks = [step.track for step in steps]
    settled = [k for k, track in enumerate(tracks) if track.status == Status.TRACKING][_SETTLED:]
    true = [np.sum((tracks[k].position - recording.position[k]) ** 2) for k in settled]
    stated = [np.trace(tracks[k].cov[:3, :3]) for k in settled]
    ratio = [float(np.sqrt(np.mean(true) / np.mean(stated)))] if settled else []
    return judge(recording, tracks) | {"ms": ms, "true_over_reported": ratio}


def _request(limit_mm: float, recording: Footage, seed: int) -> Values:
    """Whether the choice promises the limit, whether it keeps it, and its time relative to the default's."""

    def tracker_for(params: TrackerParams) -> Tracker:
        return Tracker(params, recording.rig, np.random.default_rng(seed), own_body=recording.own_body)

    chosen: Callable[..., Values] = partial(_values, seed=seed, recording=recording)
    choice = cheapest(recording.frames, limit_mm, tracker_for, configurations(recording.rig.left.width))
    turns = [(chosen(choice.configuration.params), chosen(TrackerParams())) for _ in range(TURNS)]
    ms, default_ms = (np.concatenate([np.asarray(turn[k]["ms"]) for turn in turns]) for k in (0, 1))
    error_mm = METRICS["rms_mm"].summary(np.asarray(turns[0][0]["error_mm"]))
    return {
        "promised": [choice.meets],
        "kept": [error_mm <= limit_mm] if choice.meets else [],
        "error_of_asked": [error_mm / limit_mm] if choice.meets else [],
        "cost": [float(np.median(ms) / np.median(default_ms))],
        "ms": ms,
        "configuration": [[c.name for c in CONFIGURATIONS].index(choice.configuration.name)],
        "error_mm": [error_mm],
    }


def _choice(request: Values) -> dict[str, Any]:
    """What is kept of one request: configuration, whether it was promised, 3D RMS error and median time."""
    chosen, promised, error_mm = (np.asarray(request[key])[0] for key in ("configuration", "promised", "error_mm"))
    name, ms = CONFIGURATIONS[int(chosen)].name, float(np.median(np.asarray(request["ms"])))
    return {"configuration": name, "promised": bool(promised), "error_mm": float(error_mm), "median_ms": ms}
