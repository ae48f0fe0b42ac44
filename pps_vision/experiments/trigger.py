"""How soon, how quietly and at what cost a motion trigger says that something moves by itself."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.chart import Variant, legend, speed_against_error
from pps_vision.experiments.footage import Studio, open_studio
from pps_vision.experiments.motion_peers import PEERS
from pps_vision.experiments.study import DATA, Study
from pps_vision.experiments.trigger_scenes import (
    AFTER,
    FPS,
    STARTS,
    Scene,
    independent,
    independent_film,
    quiet,
    starting,
)
from pps_vision.experiments.trigger_trial import (
    MISSED,
    Watcher,
    best_level,
    delay,
    flow_errors,
    ours,
    peer,
    quartiles,
    references,
    watch,
)
from pps_vision.experiments.trigger_velocity import first_velocities
from pps_vision.geometry.camera import Camera
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array
from tracking.motion_trigger import TriggerParams

DEFAULT = "ours"
OURS = {
    DEFAULT: TriggerParams(),
    "ours, without flow": TriggerParams(flow=False),
}
HEADS = {"still": 0.0, "moving": 20.0, "independent": 20.0}
"""By setting, degrees a second, at most; the last on films of the other source, its joints 0–20 ms late."""
BALLS = {"ball, 5 px a frame": (0.035, 5.0), "marker, 5 px a frame": (0.010, 5.0), "ball, 1 px a frame": (0.035, 1.0)}
_CALIBRATION_S = 3.0
_FLOOR = 0.3  # where the chart draws no alarm at all


@dataclass(frozen=True)
class Trigger(Study):
    """Head still or turning at up to 20°/s, the arms in view, and turning before photographs, with late joints and
    changing light: time per image, false alarms, images until a ball or marker that starts to move is found; flow
    error on RubberWhale; the velocity with which the tracker begins, with and without flow.  Ours has one setting;
    each peer gets, for either setting, its best level: the lowest without a false alarm in another scene."""

    n: int = 2
    """Scenes of each kind, each in both eyes."""
    seconds: float = 10.0
    """How long nothing moves, in each of `n` scenes of the last setting and in one of the others."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of places, motions and noise."""
    peers: bool = True
    """With --no-peers only ours, for long runs."""
    films: int = 20
    """Films of either source on which the tracker's first velocity is measured."""
    data: Path = DATA
    """Folder that holds rubberwhale and the photographs (default: PPS_VISION_DATA, else ../shared/data)."""

    def run(self) -> dict[str, object]:
        """Numbers by setting and variant."""
        if self.n < 1 or self.seconds * FPS <= STARTS:
            raise ValueError(f"bench trigger: --n {self.n}, --seconds {self.seconds}; expected 1 or more, over 1 s")
        with open_studio({}) as studio:
            heads = {name: self._measure(studio, k, name) for k, name in enumerate(HEADS)}
            first = first_velocities(studio, self.data, self.films, self.noise, self.seed)
        flow = flow_errors(self.data / "rubberwhale") if self.peers else "not asked for"
        return {"heads": heads, "first_velocity": first, "flow": flow}

    def _quiet(self, studio: Studio, rng: np.random.Generator, setting: str, seconds: float) -> list[Scene]:
        if setting == "independent":
            return independent(independent_film(rng, self.data, seconds, 0.03, 0.0, HEADS[setting], self.noise))
        return quiet(studio, rng, seconds, np.deg2rad(HEADS[setting]), self.noise)

    def _starting(
        self, studio: Studio, rng: np.random.Generator, setting: str, radius_m: float, px: float
    ) -> list[Scene]:
        if setting == "independent":
            seconds = (STARTS + AFTER) / FPS
            return independent(independent_film(rng, self.data, seconds, radius_m, px, HEADS[setting], self.noise))
        return starting(studio, rng, radius_m, px, np.deg2rad(HEADS[setting]), self.noise)

    def _measure(self, studio: Studio, k: int, setting: str) -> dict[str, object]:
        """What each variant is worth in one setting."""
        rng, silhouette = np.random.default_rng((self.seed, k)), Silhouette(studio.robot)
        body = None if setting == "independent" else silhouette
        levels = {}
        if self.peers:
            calm = self._quiet(studio, rng, setting, _CALIBRATION_S)[0]
            levels = {name: best_level(name, calm) for name in PEERS}
        ms: dict[str, list[float]] = {name: [] for name in (*OURS, *levels, *references())}
        alarms, frames = dict.fromkeys((*OURS, *levels), 0), 0
        delays: dict[str, dict[str, list[float]]] = {name: {ball: [] for ball in BALLS} for name in alarms}
        for _ in range(self.n if setting == "independent" else 1):
            for scene in self._quiet(studio, rng, setting, self.seconds):
                frames += len(scene.glimpses) - STARTS
                watchers = {**_watchers(scene.camera, body, levels), **references()}
                for name, (boxes, times) in watch(watchers, scene).items():
                    ms[name] += times[STARTS:]
                    if name in alarms:
                        alarms[name] += sum(bool(found) for found in boxes[STARTS:])
        for ball, (radius_m, px) in BALLS.items():
            for _ in range(self.n):
                for scene in self._starting(studio, rng, setting, radius_m, px):
                    for name, (boxes, _) in watch(_watchers(scene.camera, body, levels), scene).items():
                        delays[name][ball].append(delay(boxes, scene))
        rows = {name: _row(ms[name], 60 * FPS * alarms[name] / frames, delays[name]) for name in alarms}
        reference = {name: quartiles(ms[name]) for name in references()}
        return {"seconds_watched": frames / FPS, "levels": levels, "variants": rows, "reference_ms": reference}

    def chart(self, numbers: Mapping[str, Any]) -> Figure:
        """False alarms before photographs against time, and what was found in time."""
        figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
        rows = numbers["heads"]["independent"]["variants"]
        points = [
            Variant(name, _times(row), max(row["alarms_per_minute"], _FLOOR), name in OURS, name == DEFAULT)
            for name, row in rows.items()
        ]
        speed_against_error(left, points, "image", f"false alarms a minute (0 is drawn at {_FLOOR:g})")
        left.axhline(1.0, color="0.25", ls="--", lw=1)
        left.set_title("only the head moves, ≤ 20°/s, before photographs", fontsize=10)
        legend(left)
        names, colors = list(rows), ["tab:blue" if name in OURS else "tab:orange" for name in rows]
        right.barh(names, [100 * _in_time(row) for row in rows.values()], color=colors)
        right.invert_yaxis()
        right.set_xlabel("found within 3 images at 5 px an image (%)")
        right.set_title("a ball or marker that starts to move", fontsize=10)
        return figure


def _watchers(camera: Camera, silhouette: Silhouette | None, levels: Mapping[str, float]) -> dict[str, Watcher]:
    """Every variant, knowing nothing yet."""
    own = {name: ours(params, camera, silhouette) for name, params in OURS.items()}
    return {**own, **{name: peer(name, camera, level) for name, level in levels.items()}}


def _row(ms: list[float], alarms_per_minute: float, delays: Mapping[str, list[float]]) -> dict[str, object]:
    return {
        **quartiles(ms),
        "alarms_per_minute": alarms_per_minute,
        "mean_delay_frames": float(np.mean([one for of_ball in delays.values() for one in of_ball])),
        "by_ball": {
            ball: {
                "mean": float(np.mean(one)),
                "within_3": float(np.mean(np.array(one) <= 3)),
                "missed": float(np.mean(np.array(one) >= MISSED)),
                "scenes": len(one),
            }
            for ball, one in delays.items()
        },
    }


def _times(row: Mapping[str, Any]) -> Array:
    return np.array([row["q25_ms"], row["median_ms"], row["q75_ms"]])


def _in_time(row: Mapping[str, Any]) -> float:
    """Share of what moved 5 px an image that was found within 3 images."""
    fast = [one for name, one in row["by_ball"].items() if "5 px" in name]
    return float(np.average([one["within_3"] for one in fast], weights=[one["scenes"] for one in fast]))
