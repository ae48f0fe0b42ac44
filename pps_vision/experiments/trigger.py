"""How soon, how quietly and at what cost a motion trigger says that something moves by itself."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.chart import Variant, legend, speed_against_error
from pps_vision.experiments.experiment import DATA
from pps_vision.experiments.footage import Studio, open_studio
from pps_vision.experiments.motion_peers import PEERS
from pps_vision.experiments.trigger_scenes import FPS, STARTS, quiet, starting
from pps_vision.experiments.trigger_trial import (
    MISSED,
    Watcher,
    best_level,
    delay,
    flow_errors,
    ours,
    peer,
    quartiles,
    watch,
)
from pps_vision.geometry.camera import Camera
from pps_vision.robot.silhouette import Silhouette
from tracking.trigger import TriggerParams

OURS = {
    "ours": TriggerParams(),
    "ours, all pixels": TriggerParams(coarse=1, coarse_contrast=8.0),
    "ours, tolerance 2 px": TriggerParams(tolerance_px=2.0),
}
HEADS = {"still": 0.0, "moving": 20.0}  # degrees a second, at most
BALLS = {"ball, 5 px a frame": (0.035, 5.0), "marker, 5 px a frame": (0.010, 5.0), "ball, 1 px a frame": (0.035, 1.0)}
_CALIBRATION_S = 3.0
_TOO_MANY = 60.0  # frames with a false alarm per minute, above which a delay says nothing


@dataclass(frozen=True)
class Trigger:
    """Head still or turning at up to 20°/s, arms in view: time per image, frames until a ball or marker that
    starts to move is found, false alarms; flow error on rubberwhale.  Ours has one setting; each peer gets, for
    either head, its best level: the lowest without a false alarm in another scene."""

    n: int = 3
    """Scenes of each kind, each in both eyes."""
    seconds: float = 10.0
    """How long nothing moves, with the head still and again with the head moving."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of places, motions and noise."""
    peers: bool = True
    """With --no-peers only ours, for long runs."""
    data: Path = DATA
    """Folder that holds rubberwhale (default: PPS_VISION_DATA, else ../shared/data)."""

    def run(self) -> dict[str, object]:
        """Numbers by head and variant."""
        if self.n < 1 or self.seconds * FPS <= STARTS:
            raise ValueError(f"bench trigger: --n {self.n}, --seconds {self.seconds}; expected 1 or more, over 1 s")
        with open_studio({}) as studio:
            heads = {name: self._measure(studio, k, np.deg2rad(v)) for k, (name, v) in enumerate(HEADS.items())}
        return {"heads": heads, "flow": flow_errors(self.data / "rubberwhale") if self.peers else "not asked for"}

    def _measure(self, studio: Studio, head: int, speed_rad_s: float) -> dict[str, object]:
        """What each variant is worth with one kind of head."""
        rng, silhouette = np.random.default_rng((self.seed, head)), Silhouette(studio.robot)
        levels = {}
        if self.peers:
            calm = quiet(studio, rng, _CALIBRATION_S, speed_rad_s, self.noise)[0]
            levels = {name: best_level(name, calm) for name in PEERS}
        ms: dict[str, list[float]] = {name: [] for name in (*OURS, *levels)}
        alarms, frames = dict.fromkeys(ms, 0), 0
        delays: dict[str, dict[str, list[float]]] = {name: {ball: [] for ball in BALLS} for name in ms}
        for scene in quiet(studio, rng, self.seconds, speed_rad_s, self.noise):
            frames += len(scene.glimpses) - STARTS
            for name, (boxes, times) in watch(_watchers(scene.camera, silhouette, levels), scene).items():
                ms[name] += times[STARTS:]
                alarms[name] += sum(bool(found) for found in boxes[STARTS:])
        for ball, (radius_m, px) in BALLS.items():
            for _ in range(self.n):
                for scene in starting(studio, rng, radius_m, px, speed_rad_s, self.noise):
                    for name, (boxes, _) in watch(_watchers(scene.camera, silhouette, levels), scene).items():
                        delays[name][ball].append(delay(boxes, scene))
        rows = {name: _row(ms[name], 60 * FPS * alarms[name] / frames, delays[name]) for name in ms}
        return {"seconds_watched": frames / FPS, "levels": levels, "variants": rows}

    def chart(self, numbers: Mapping[str, Any]) -> Figure:
        """Delay with the head still and moving, false alarms, flow error; all against time."""
        figure, axes = plt.subplots(2, 2, figsize=(12, 9.5), layout="constrained")
        for axis, head in zip(axes[0], HEADS, strict=True):
            rows = numbers["heads"][head]["variants"]
            points = [_point(name, row, _delay(row)) for name, row in rows.items()]
            speed_against_error(axis, points, "image", "frames until found (mean)")
            axis.set_title("head still" if head == "still" else f"head {head}, up to {HEADS[head]:g}°/s")
        legend(axes[0, 0])
        rows = numbers["heads"]["moving"]["variants"]
        colors = ["tab:blue" if name in OURS else "tab:orange" for name in rows]
        axes[1, 0].barh(list(rows), [row["alarms_per_minute"] for row in rows.values()], color=colors)
        axes[1, 0].axvline(1.0, color="0.25", ls="--", lw=1)
        axes[1, 0].annotate(" goal: below 1", (1.0, 0.01), xycoords=("data", "axes fraction"), fontsize=7)
        axes[1, 0].invert_yaxis()
        axes[1, 0].set_xscale("symlog", linthresh=1.0)
        axes[1, 0].set_xlabel("frames with a false alarm (per minute, of 1200)")
        axes[1, 0].set_title("head moving, and nothing else")
        if isinstance(numbers["flow"], Mapping):
            flows = [_point(name, row, row["endpoint_px"]) for name, row in numbers["flow"].items()]
            speed_against_error(axes[1, 1], flows, "pair of images, 584×388", "mean end-point error (px)")
        axes[1, 1].set_title("flow alone: RubberWhale")
        return figure


def _watchers(camera: Camera, silhouette: Silhouette, levels: Mapping[str, float]) -> dict[str, Watcher]:
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


def _delay(row: Mapping[str, Any]) -> float:
    """Mean delay; NaN for what fires all the time, which finds everything at once."""
    return float(row["mean_delay_frames"]) if row["alarms_per_minute"] < _TOO_MANY else np.nan


def _point(name: str, row: Mapping[str, Any], error: float) -> Variant:
    ms = np.array([row["q25_ms"], row["median_ms"], row["q75_ms"]])
    return Variant(name, ms, error, ours=name in OURS, default=name == "ours")
