"""How soon, how quietly and at what cost a motion trigger finds what moves by itself."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure

from pps_vision.errors import InputError
from pps_vision.experiments.baselines.motion import TRIGGERS, BoxPx
from pps_vision.experiments.charts import PAGE_IN, panels, speed_error
from pps_vision.experiments.films.recordings import FPS, Footage, from_film
from pps_vision.experiments.films.scenes import Film, FilmScene
from pps_vision.experiments.films.sensor import SensorChain
from pps_vision.experiments.study import (
    DATA,
    NOISE_SIGMA,
    TURNS,
    Method,
    Metric,
    SampledStudy,
    Values,
    compare,
    mean,
    percent,
)
from pps_vision.experiments.tables import Table, estimate, median_first
from pps_vision.experiments.timing import timed
from pps_vision.geometry.camera import Camera, View
from pps_vision.types import Array, Image
from tracking.motion_trigger import MotionTrigger, TriggerParams

DEFAULT = "ours"
OURS = {DEFAULT: TriggerParams(), "ours, without flow": TriggerParams(flow=False)}
HEAD_DEG_S = 20.0
"""Fastest turn of the head."""
OBJECTS = {
    "nothing": (0.030, 0.0),
    "ball, 5 px": (0.035, 5.0),
    "marker, 5 px": (0.010, 5.0),
    "ball, 1 px": (0.035, 1.0),
}
"""What starts to move: radius in m, and px per frame."""
STARTS, AFTER = 20, 12
"""Frame at which the object starts to move, when every method has seen a second of images; and how many it moves."""
MISSED = AFTER + 1.0
"""Frames that count for what is not found."""
_NEAR_PX = 4.0  # how far beside the ball's path a region may lie
_OWN_SHARE = 0.3  # of a region on the robot itself, above which it is no alarm
_HEAD_RATE, _FOCAL = 3.9, 0.86  # of an independent film: fastest turn per amplitude (1/s); focal length per width
_METRICS = {
    "alarms_per_minute": Metric("alarm", lambda values: 60 * FPS * mean(values)),
    "found_in_3_percent": Metric("delay", lambda values: percent(values <= 3)),
    "delay_frames": Metric("delay", mean),
}


@dataclass(frozen=True)
class Trigger(SampledStudy):
    """A head that turns at up to 20°/s before photographs, with late joints and changing light.

    Each baseline gets the lowest level without a false alarm in another recording. Our alarms are counted over further
    recordings, since a minute shows none.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"watched": 1}

    n: int = 2
    """Recordings of each kind, each in both eyes."""
    watched: int = 30
    """Further recordings before photographs in which nothing moves, for our false alarms with and without flow."""
    seconds: float = 10.0
    """Length of the recordings in which nothing moves."""
    data: Path = DATA
    """Folder of the photographs (default: PPS_VISION_DATA, else ../shared/data)."""

    def run(self) -> dict[str, Any]:
        """Return by object and method: false alarms a minute, share detected within 3 images, delay, time."""
        if self.seconds * FPS <= STARTS:
            raise InputError("bench trigger", f"--seconds {self.seconds}; expected more than {STARTS / FPS:g}")
        calm = self._recording("nothing", self.seed + 10_000)
        scenarios = {name: partial(self._recording, name) for name in OBJECTS}
        cells = compare(scenarios, methods(calm), _METRICS, self.seeds, "DIS ultrafast − ego", TURNS)
        further = range(self.seed + 20_000, self.seed + 20_000 + self.watched)
        empty = {"nothing": partial(self._recording, "nothing")}
        for name, cell in compare(empty, ours(), _METRICS, further)["nothing"].items():
            cells["nothing"][name]["alarms_per_minute"] = cell["alarms_per_minute"]
        return {"cells": {"independent": cells}}

    def _recording(self, name: str, seed: int) -> Footage:
        radius_m, px = OBJECTS[name]
        seconds = self.seconds if px == 0 else (STARTS + AFTER) / FPS
        rng = np.random.default_rng((seed, *map(ord, "independent" + name)))
        scene = independent_scene(rng, seconds, radius_m, px, HEAD_DEG_S)
        return from_film(Film(scene, int(rng.integers(2**31)), self.data))

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time against what is missed before photographs at 5 px an image; false alarms stand beside the names."""
        of, shown = numbers["cells"]["independent"], {}
        for name, cell in of["nothing"].items():
            found = [of[o][name]["found_in_3_percent"][0] for o in ("ball, 5 px", "marker, 5 px")]
            alarms = cell["alarms_per_minute"][0]
            told = f"{name} ({alarms:.{1 if alarms < 10 else 0}f} alarms/min)" if alarms else name
            shown[told] = {"ms": cell["ms"], "missed_percent": 100 - float(np.mean(found))}
        default = next(name for name in shown if name.startswith(f"{DEFAULT} ") or name == DEFAULT)
        baselines = [told for told, name in zip(shown, of["nothing"], strict=True) if name in TRIGGERS]
        figure, (axis,) = panels(1, width=PAGE_IN)
        axis.set_ylim(0, 100)
        label = "not found within 3 images (%)"
        speed_error(axis, shown, "missed_percent", baselines, default, "time (ms per image)", label)
        axis.set_ylim(-8, 112)
        figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return alarms, detection and time ratio of every method, one table a setting."""
        header = ["trigger", "false alarms a minute", *(f"{o}: within 3 images (%)" for o in list(OBJECTS)[1:])]
        tables = {}
        for setting, of in numbers["cells"].items():
            rows = []
            for method, cell in of["nothing"].items():
                found = [estimate(of[name][method]["found_in_3_percent"][:1]) for name in list(OBJECTS)[1:]]
                times = median_first(cell["ms"]), estimate(cell["ratio"], 2)
                rows.append([method, estimate(cell["alarms_per_minute"]), *found, *times])
            tables[setting] = Table([*header, "ms per image, quartiles", "ratio to DIS ultrafast"], rows)
        return tables


def independent_scene(
    rng: np.random.Generator, seconds: float, radius_m: float, px_per_frame: float, speed_deg_s: float
) -> FilmScene:
    """Return a ray-cast scene before photographs: the head sways, its joints are 0–20 ms late, the light drifts and
    flickers; a ball starts to move at frame `STARTS`, or (0 px) rests."""
    distance = float(rng.uniform(0.4, 0.7))
    return FilmScene(
        width=320,
        height=240,
        fps=FPS,
        seconds=seconds,
        rig="head",
        head_deg=speed_deg_s / _HEAD_RATE,
        stale_s=float(rng.uniform(0, 0.02)),
        radius_m=radius_m,
        color=tuple(rng.uniform(20, 235, 3).tolist()),
        motion="straight" if px_per_frame else "still",
        start="rest",
        rest_s=(STARTS - 1) / FPS,
        speed_m_s=px_per_frame * FPS * distance / (_FOCAL * 320),
        distance_m=distance,
        background=int(rng.integers(0, 100)),
        gain_drift=0.1,
        flicker=0.03,
        sensor=SensorChain(read_noise=NOISE_SIGMA, bayer=True),
    )


Watcher = Callable[[Image, View, float, Array | None], list[BoxPx]]
"""Takes an image, its view, stamp and joints; returns the regions that move."""


def ours() -> dict[str, Method]:
    """Return our trigger with and without flow."""
    return {name: partial(watch, partial(_ours, params)) for name, params in OURS.items()}


def methods(calm: Footage) -> dict[str, Method]:
    """Return ours, and the baselines at their best levels for a setting, which `calm` shows without motion."""
    return ours() | {name: partial(watch, partial(_baseline, name, best_level(name, calm))) for name in TRIGGERS}


def _ours(params: TriggerParams, camera: Camera, recording: Footage) -> Watcher:
    trigger = MotionTrigger(params, camera)

    def look(image: Image, view: View, stamp_s: float, joints_rad: Array | None) -> list[BoxPx]:
        own = None if joints_rad is None else partial(recording.own_body, joints_rad, view)
        return [region.box_px for region in trigger.step(image, view, stamp_s, own)]

    return look


def _baseline(name: str, level: float, camera: Camera, recording: Footage) -> Watcher:
    method = TRIGGERS[name].make(camera, level)
    return lambda image, view, _stamp_s, _joints_rad: method.step(image, view)


def watch(make: Callable[[Camera, Footage], Watcher], recording: Footage, seed: int) -> Values:
    """Return alarms frame by frame where nothing moves, delays where something starts to, and processor times."""
    moves = bool(np.any(np.linalg.norm(np.nan_to_num(recording.velocity), axis=1) > 0))
    ms, alarm, delays = [], [], []
    for eye in ("left", "right"):
        look, found = make(getattr(recording.rig, eye), recording), []
        for frame in recording.frames:
            view = getattr(recording.rig.view_of(frame), eye)
            joints = getattr(frame, f"joints_{eye}_rad")
            boxes, spent = timed(partial(look, getattr(frame, eye), view, frame.stamp_s, joints))
            ms.append(spent)
            own = None if joints is None else recording.own_body(joints, view)
            found.append([box for box in boxes if own is None or not _is_own(box, own)])
        if moves:
            delays.append(delay(found, recording, eye))
        else:
            alarm += [bool(boxes) for boxes in found[STARTS:]]
    return {"ms": ms, "alarm": alarm, "delay": delays}


def best_level(name: str, calm: Footage) -> float:
    """Return the lowest level without a false alarm where nothing moves; the highest if there is none."""
    levels = TRIGGERS[name].levels
    short = replace(calm, frames=calm.frames[: STARTS + 40])
    low, high = 0, len(levels) - 1
    while low < high:  # the higher, the calmer
        middle = (low + high) // 2
        is_calm = not np.any(watch(partial(_baseline, name, levels[middle]), short, 0)["alarm"])
        low, high = (low, middle) if is_calm else (middle + 1, high)
    return levels[low]


def delay(boxes: list[list[BoxPx]], recording: Footage, eye: str) -> float:
    """Return the frames until a region meets the path that the ball has come, from the first that shows it moved."""
    views = [getattr(recording.rig.view_of(frame), eye) for frame in recording.frames]
    pixels = np.array([view.project(p) for view, p in zip(views, recording.position, strict=True)])
    nearest = min(np.linalg.norm(p - v.center) for v, p in zip(views, recording.position, strict=True))
    margin = views[0].camera.focal_px * recording.radius_m / float(nearest) + _NEAR_PX
    for k in range(STARTS, len(boxes)):
        path = pixels[STARTS - 1 : k + 1]
        low, high = path.min(axis=0) - margin, path.max(axis=0) + margin
        if any(x < high[0] and y < high[1] and x + w > low[0] and y + h > low[1] for x, y, w, h in boxes[k]):
            return float(k - STARTS + 1)
    return MISSED


def _is_own(box: BoxPx, own: Any) -> bool:
    x, y, w, h = box
    return bool(own[y : y + h, x : x + w].mean() > _OWN_SHARE)
