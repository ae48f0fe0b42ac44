"""Ten thousand frames: does the tracker grow, slow down or drift?"""

import gc
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any, Literal, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from control.fixation import gaze_at
from pps_vision.experiments.chart import panels
from pps_vision.experiments.study import Study
from pps_vision.robot.icub import home, icub_rig, load_icub
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, StereoFrame
from rendering.eyes import Eyes
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus
from tracking.tracker import Tracker, TrackerParams

Case = Literal["generic", "marker", "idle"]
_LAP = 80  # frames of the loop, after which everything is as at its start
_DT_S = 0.05
_MIDDLE_M = np.array([-0.42, 0.0, 0.27])
_TURN = np.array([[0.0, 0.05, 0.0], [0.02, 0.0, 0.04]])  # axes of the object's round, m
_SWAY_RAD = np.deg2rad([4.0, 2.5])  # of the head: yaw once a lap, pitch twice


@dataclass(frozen=True, slots=True)
class _Loop:
    """One lap of frames, and where the object is in each (n, 3)."""

    frames: tuple[StereoFrame, ...]
    position: Array

    def laps(self, count: int) -> Iterator[tuple[int, StereoFrame]]:
        """`count` frames with ever rising stamps, and which of the lap each is."""
        for k in range(count):
            stamp = _DT_S * k
            yield k % _LAP, replace(self.frames[k % _LAP], stamp_left_s=stamp, stamp_right_s=stamp)


@dataclass(frozen=True)
class Soak(Study):
    """A rendered lap of 4 s again and again while the head sways: a ball (generic), a marker, and nothing (idle:
    the trigger only).  Memory, time and covariance at the start and at the end."""

    frames: int = 10_000
    """Stereo pairs of each."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the noise and the particles."""

    def run(self) -> dict[str, object]:
        """By case: memory's slope, what the tracker holds, medians of processor time, deviations and errors."""
        if self.frames < 5 * _LAP:
            raise ValueError(f"bench soak: --frames {self.frames}; expected at least {5 * _LAP}")
        cases: tuple[Case, ...] = get_args(Case)
        return {case: self._soak(case) for case in cases}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time, memory and standard deviation over the frames."""
        figure, axes = panels(3, width=4.4, height=3.4)
        for case, of in numbers.items():
            for axis, what in zip(axes, ("ms", "rss_mb", "position_std_mm"), strict=True):
                if what in of["over_time"]:
                    axis.plot(np.array(of["over_time"]["frame"]) / 1000, of["over_time"][what], label=case)
        _label(axes[0], "processor time (ms per pair)", "No slower")
        _label(axes[1], "memory (MB resident)", "No larger")
        _label(axes[2], "standard deviation of position (mm)", "No drift of the covariance")
        return figure

    def _soak(self, case: Case) -> dict[str, Any]:
        rng = np.random.default_rng(self.seed)
        loop = _film(case, self.noise, rng)
        robot = load_icub()
        params = TrackerParams(mode="marker" if case == "marker" else "generic")
        tracker = Tracker(params, icub_rig(robot), rng, own_body=Silhouette(robot))
        ms, rss, held = np.empty(self.frames), [], []
        std, error = np.full(self.frames, np.nan), np.full(self.frames, np.nan)
        frames = tqdm(loop.laps(self.frames), total=self.frames, desc=f"soak, {case}", unit="pair", disable=None)
        for k, (phase, frame) in enumerate(frames):
            start = process_time()
            track = tracker.step(frame).track
            ms[k] = 1000 * (process_time() - start)
            if track.is_known:
                std[k] = 1000 * np.sqrt(np.trace(track.cov[:3, :3]))
                error[k] = 1000 * np.linalg.norm(track.position - loop.position[phase])
            if phase == _LAP - 1:
                rss.append(_resident_mb())
                held.append(_held(tracker) if k < 3 * _LAP or k >= self.frames - _LAP else (0, 0))
        return _summary(ms, std, error, np.array(rss), (held[1], held[-1]))


def _film(case: Case, noise: float, rng: np.random.Generator) -> _Loop:
    """The lap; for idle without the object."""
    robot = load_icub()
    stimulus = make_stimulus("marker" if case == "marker" else "ball")
    base = gaze_at(robot, home(robot), _MIDDLE_M)
    yaw_pitch = robot.indices(robot.names.gaze_joints)[:2]
    frames, path = [], []
    with Eyes(robot, icub_rig(robot), stimulus, sensor=Sensor(noise_sigma=noise)) as eyes:
        for k in range(_LAP):
            turn = 2 * np.pi * k / _LAP
            p = _MIDDLE_M + np.array([np.cos(turn), np.sin(turn)]) @ _TURN
            q = base.copy()
            q[yaw_pitch] += _SWAY_RAD * np.sin([turn, 2 * turn])
            frames.append(eyes.render(SceneState(q, None if case == "idle" else p), 0.0, rng))
            path.append(p)
    return _Loop(tuple(frames), np.array(path))


def _summary(
    ms: Array, std: Array, error: Array, rss: Array, held: tuple[tuple[int, int], tuple[int, int]]
) -> dict[str, Any]:
    """First and last tenth; what is started up in the first laps is not counted."""
    laps = len(rss)
    tenth = _LAP * max(laps // 10, 1)  # whole laps, which are alike
    first, last = slice(_LAP, _LAP + tenth), slice(_LAP * laps - tenth, _LAP * laps)
    half = np.arange(laps // 4, laps)
    over_time: dict[str, Any] = {
        "frame": (_LAP * np.arange(1, laps + 1)).tolist(),
        "ms": _by_lap(ms, laps),
        "rss_mb": rss.round(2).tolist(),
    }
    known = np.isfinite(std)
    tracked: dict[str, float] = {}
    if known.any():
        over_time["position_std_mm"] = _by_lap(std, laps)
        for name, values in (("position_std_mm", std), ("position_error_mm", error)):
            tracked[f"{name}_first"] = float(np.nanmedian(values[first]))
            tracked[f"{name}_last"] = float(np.nanmedian(values[last]))
    return {
        "known_share": float(known[_LAP:].mean()),
        "ms_first": float(np.median(ms[first])),
        "ms_last": float(np.median(ms[last])),
        "rss_mb_per_10000_frames": float(np.polyfit(_LAP * half, rss[half], 1)[0] * 10_000),
        "objects_held_first_last": [held[0][0], held[1][0]],
        "array_bytes_held_first_last": [held[0][1], held[1][1]],
        **tracked,
        "over_time": over_time,
    }


def _by_lap(values: Array, laps: int) -> list[float]:
    """Median of each lap, NaN where nothing is known."""
    rows = values[: laps * _LAP].reshape(laps, _LAP)
    return [float(np.median(row[np.isfinite(row)])) if np.isfinite(row).any() else np.nan for row in rows]


def _resident_mb() -> float:
    """What the process holds in memory (Linux; elsewhere NaN)."""
    statm = Path("/proc/self/statm")
    return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20 if statm.exists() else np.nan


def _held(root: object) -> tuple[int, int]:
    """How many Python objects are reachable from one (code and modules aside), and bytes of its arrays."""
    seen, todo, size = {id(root)}, [root], 0
    while todo:
        thing = todo.pop()
        size += thing.nbytes if isinstance(thing, np.ndarray) else 0
        for other in gc.get_referents(thing):
            code = isinstance(other, type | ModuleType | FunctionType | BuiltinFunctionType)
            if id(other) not in seen and not code:
                seen.add(id(other))
                todo.append(other)
    return len(seen), size


def _label(axis: Axes, what: str, title: str) -> None:
    axis.set(xlabel="stereo pairs (thousands)", ylabel=what, title=title)
    axis.set_ylim(0, 1.3 * axis.get_ylim()[1])
    axis.grid(alpha=0.25)
    axis.legend(fontsize=7)
