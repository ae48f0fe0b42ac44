"""How soon, how quietly and at what cost a motion trigger detects an object that starts to move.

The head turns at up to 20°/s before photographs, its joints are late, and the light changes. Each baseline gets the
lowest level without a false alarm in another recording. Our alarms are counted over further recordings, because a
minute shows none.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pps_vision.errors import InputError
from pps_vision.experiments.baselines.motion import TRIGGERS, BoxPx
from pps_vision.experiments.charts import speed_errors
from pps_vision.experiments.films.caster import SensorChain
from pps_vision.experiments.films.recordings import FPS, Footage, from_film
from pps_vision.experiments.films.scenes import FOCAL, Film, FilmScene
from pps_vision.experiments.study import NOISE_SIGMA, TURNS, Method, Metric, Values, compare, mean, percent
from pps_vision.experiments.timing import timed
from pps_vision.geometry.camera import Camera, View
from pps_vision.types import Image
from tracking.motion_trigger import MotionTrigger, TriggerParams

DEFAULT = "ours"
HEAD_DEG_S = 20.0  # fastest turn of the head
OBJECTS = {
    "nothing": (0.030, 0.0),
    "ball, 5 px": (0.035, 5.0),
    "marker, 5 px": (0.010, 5.0),
    "ball, 1 px": (0.035, 1.0),
}
"""Objects that start to move: radius in m, and px per frame."""
STARTS = 20  # frame at which the object starts to move, after every method has processed a second of images
AFTER = 12  # frames of motion
MISSED = AFTER + 1.0  # delay in frames that stands for a missed object
_CALM_S = 10.0
_NEAR_PX = 4.0  # largest distance between a region and the ball's path
_HEAD_RATE = 3.9  # fastest turn of a film's head per amplitude, 1/s
_METRICS = {
    "alarms_per_minute": Metric("alarm", lambda values: 60 * FPS * mean(values)),
    "found_in_3_percent": Metric("delay", lambda values: percent(values <= 3)),
}
Watcher = Callable[[Image, View, float], list[BoxPx]]  # an image, its view and stamp to the moving regions


def run(study: Any) -> dict[str, Any]:
    """Return by object and method: false alarms a minute, share detected within 3 images, time."""
    calm_s = min(_CALM_S, 4 * study.seconds)
    if calm_s * FPS <= STARTS:
        raise InputError("bench stages", f"--seconds {study.seconds}; expected more than {STARTS / FPS / 4:g}")

    def recording(name: str, seed: int) -> Footage:
        radius_m, px = OBJECTS[name]
        seconds = calm_s if px == 0 else (STARTS + AFTER) / FPS
        rng = np.random.default_rng((seed, *map(ord, f"independent{name}")))
        scene = film_scene(rng, seconds, radius_m, px)
        return from_film(Film(scene, int(rng.integers(2**31)), study.data))

    calm = recording("nothing", study.seed + 10_000)
    scenarios = {name: partial(recording, name) for name in OBJECTS}
    cells = compare(scenarios, methods(calm), _METRICS, study.seeds, repeated=TURNS)
    further = range(study.seed + 20_000, study.seed + 20_000 + study.n_calm)
    empty = {"nothing": scenarios["nothing"]}
    for name, cell in compare(empty, OURS, _METRICS, further)["nothing"].items():
        cells["nothing"][name]["alarms_per_minute"] = cell["alarms_per_minute"]
    return {"cells": cells}


def chart(numbers: dict[str, Any]) -> Figure:
    """Time against missed objects at 5 px an image; false alarms stand beside the names."""
    cells = numbers["cells"]
    labels = {}
    points = {}
    for name, cell in cells["nothing"].items():
        found = [cells[object_][name]["found_in_3_percent"][0] for object_ in ("ball, 5 px", "marker, 5 px")]
        alarms = cell["alarms_per_minute"][0]
        labels[name] = f"{name} ({alarms:.{1 if alarms < 10 else 0}f} alarms/min)" if alarms else name
        points[labels[name]] = {"ms": cell["ms"], "missed_percent": 100 - float(np.mean(found))}
    baselines = [labels[name] for name in TRIGGERS if name in labels]
    label = "not found within 3 images (%)"
    scenarios = {"head turns before photographs": points}
    figure = speed_errors(scenarios, "missed_percent", label, baselines, labels[DEFAULT], "time (ms per image)", 4.0)
    figure.axes[0].set_ylim(-8, 112)
    return figure


def film_scene(rng: np.random.Generator, seconds: float, radius_m: float, px_per_frame: float) -> FilmScene:
    """Return a ray-cast scene before photographs: the head sways, its joints are 0–20 ms late, the light drifts and
    flickers; a ball starts to move at frame `STARTS`, or (0 px) rests."""
    distance = float(rng.uniform(0.4, 0.7))
    return FilmScene(
        width=320,
        height=240,
        fps=FPS,
        seconds=seconds,
        rig="head",
        head_deg=HEAD_DEG_S / _HEAD_RATE,
        stale_s=float(rng.uniform(0, 0.02)),
        radius_m=radius_m,
        color=tuple(rng.uniform(20, 235, 3).tolist()),
        motion="straight" if px_per_frame else "still",
        start="rest",
        rest_s=(STARTS - 1) / FPS,
        speed_m_s=px_per_frame * FPS * distance / (FOCAL * 320),
        distance_m=distance,
        background=int(rng.integers(0, 100)),
        gain_drift=0.2,
        flicker=0.06,
        sensor=SensorChain(read_noise=NOISE_SIGMA, bayer=True),
    )


def watch(make: Callable[[Camera], Watcher], recording: Footage, seed: int) -> Values:
    """Return alarms frame by frame where nothing moves, delays where something starts to, and processor times."""
    moves = bool(np.any(np.linalg.norm(np.nan_to_num(recording.velocity), axis=1) > 0))
    values: dict[str, list[Any]] = {"ms": [], "alarm": [], "delay": []}
    for eye in ("left", "right"):
        watcher = make(getattr(recording.rig, eye))
        regions = []
        for frame in recording.frames:
            view = getattr(recording.rig.view_of(frame), eye)
            boxes, ms = timed(partial(watcher, getattr(frame, eye), view, frame.stamp_s))
            values["ms"].append(ms)
            regions.append(boxes)
        if moves:
            values["delay"].append(delay(regions, recording, eye))
        else:
            values["alarm"] += [bool(boxes) for boxes in regions[STARTS:]]
    return values


def _ours(params: TriggerParams, camera: Camera) -> Watcher:
    trigger = MotionTrigger(params, camera)
    return lambda image, view, stamp_s: [region.box_px for region in trigger.step(image, view, stamp_s)]


OURS: dict[str, Method] = {
    DEFAULT: partial(watch, partial(_ours, TriggerParams())),
    "ours, without flow": partial(watch, partial(_ours, TriggerParams(flow=False))),
}


def methods(calm: Footage) -> dict[str, Method]:
    """Return ours, and the baselines at their best levels, which `calm` determines without motion."""
    return OURS | {name: partial(watch, partial(_baseline, name, best_level(name, calm))) for name in TRIGGERS}


def _baseline(name: str, level: float, camera: Camera) -> Watcher:
    method = TRIGGERS[name].make(camera, level)
    return lambda image, view, _: method(image, view)


def best_level(name: str, calm: Footage) -> float:
    """Return the lowest level without a false alarm where nothing moves; the highest if there is none."""
    *levels, highest = TRIGGERS[name].levels
    short = replace(calm, frames=calm.frames[: STARTS + 40])
    for level in levels:
        if not np.any(watch(partial(_baseline, name, level), short, 0)["alarm"]):
            return level
    return highest


def delay(boxes: list[list[BoxPx]], recording: Footage, eye: str) -> float:
    """Return the frames from the start of the motion until a region meets the ball's path."""
    views = [getattr(recording.rig.view_of(frame), eye) for frame in recording.frames]
    pixels = np.array([view.project(p) for view, p in zip(views, recording.position, strict=True)])
    nearest = min(np.linalg.norm(p - v.center) for v, p in zip(views, recording.position, strict=True))
    margin = views[0].camera.focal_px * recording.radius_m / float(nearest) + _NEAR_PX
    for k in range(STARTS, len(boxes)):
        path = pixels[STARTS - 1 : k + 1]
        low = path.min(axis=0) - margin
        high = path.max(axis=0) + margin
        if any(x < high[0] and y < high[1] and x + w > low[0] and y + h > low[1] for x, y, w, h in boxes[k]):
            return float(k - STARTS + 1)
    return MISSED
