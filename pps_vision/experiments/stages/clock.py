"""Delay of a camera, from points that both follow (`triangulate --clock auto`), over noise, frame rate and speed.

A point wanders irregularly about 0.6 m before two cameras, 12 cm apart; the right stamps are late by up to 80 ms either
way.  One axis varies, the others are 0.3 px, 30 frames a second and 0.6 m/s (2 cm a frame).  It breaks where fewer than
90 % of the delays are found within 1 ms; a delay that is called unobservable is not found.
"""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.stamp_delay import ClockParams, PointPath, estimate_delay
from pps_vision.experiments.charts import severities
from pps_vision.experiments.study import Axis, Break, Metric, Values, compare_severities, mean, median
from pps_vision.experiments.tables import Table, estimate
from pps_vision.experiments.timing import timed
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.geometry.se3 import transform
from pps_vision.types import Array

_CAMERA = Camera(640, 480, 500, 500, 320, 240, (-0.1, 0.02, 0.0, 0.0, 0.0))
_VIEW = StereoRig.fixed(_CAMERA, _CAMERA, transform(None, np.array([0.12, 0.0, 0.0]))).view()
_CENTER_M = np.array([0.06, 0.0, 0.6])
_LATE_S = 0.08
_WAVES = 3
_SECONDS = 4.0
_WITHIN_MS = 1.0


class Setting(NamedTuple):
    """One recording, but for its length."""

    seed: int
    noise_px: float = 0.3
    fps: float = 30.0
    speed_m_s: float = 0.6


AXES = {
    "noise_px": Axis("noise (px)", (0.05, 0.1, 0.3, 1.0, 3.0)),
    "fps": Axis("frames a second", (60.0, 30.0, 15.0, 8.0)),
    "speed_m_s": Axis("speed (m/s)", (1.2, 0.6, 0.3, 0.1, 0.05)),
}
_METRICS = {
    "found": Metric("found", lambda x: 100 * mean(x)),
    "answered": Metric("answered", lambda x: 100 * mean(x)),
    "holds": Metric("holds", lambda x: 100 * mean(x)),
    "median_ms": Metric("error_ms", median),
}


def run(study: Any) -> dict[str, Any]:
    """Return by axis the shares found and answered, that of the intervals that hold, and the median error."""
    seeds = range(study.seed, study.seed + 5 * study.n)

    def setting(name: str, seed: int, value: float) -> Setting:
        values: dict[str, Any] = {name: value}
        return Setting(seed)._replace(**values)

    breaks = Break("found", 90.0, above=False)
    axes = {
        name: compare_severities(partial(setting, name), axis, {f"{_SECONDS:g} s": _measured}, _METRICS, seeds, breaks)
        for name, axis in AXES.items()
    }
    return {"axes": axes}


def _measured(setting: Setting, seed: int) -> Values:
    """The delay of one recording against the true one."""
    rng = np.random.default_rng((seed, 44))
    size, rate = rng.uniform(0.03, 0.1, (_WAVES, 3)), rng.uniform(0.3, 1.0, (_WAVES, 3))
    phase = 7 * rng.random((_WAVES, 3))
    rate *= setting.speed_m_s / np.sqrt(0.5 * np.sum((size * rate) ** 2))  # RMS speed
    late_s = rng.uniform(-_LATE_S, _LATE_S)
    stamps_s = np.arange(round(_SECONDS * setting.fps)) / setting.fps

    def seen(side: int, at_s: Array) -> PointPath:
        points = _CENTER_M + np.sum(size * np.sin(rate * at_s[:, None, None] + phase), axis=1)
        pixels = (_VIEW.left, _VIEW.right)[side].project(points)
        return PointPath(stamps_s, pixels + setting.noise_px * rng.standard_normal(pixels.shape))

    paths = seen(0, stamps_s), seen(1, stamps_s - late_s)
    found, ms = timed(partial(estimate_delay, ClockParams(), _VIEW, [paths]))
    if not found.is_known:
        return {"found": [False], "answered": [False], "holds": [], "error_ms": [], "ms": [ms]}
    error_s = found.delay_s - late_s
    return {
        "found": [abs(1000 * error_s) <= _WITHIN_MS],
        "answered": [True],
        "holds": [abs(error_s) <= 1.96 * found.std_s],
        "error_ms": [abs(1000 * error_s)],
        "ms": [ms],
    }


def chart(numbers: dict[str, Any]) -> Figure:
    """Draw the share of delays found within 1 ms over each axis."""
    return severities(numbers["axes"], "found", "found within 1 ms (%)", 90.0, len(AXES))


def table(numbers: dict[str, Any]) -> Table:
    """One row for each value of an axis."""
    shares = "found within 1 ms (%)", "answered (%)", "95 % holds (%)"
    rows = [
        [
            f"{study['axis']} {value:g}",
            *(estimate(cell[metric][k]) for metric in _METRICS),
            "–" if cell["breaks_at"] is None else f"{cell['breaks_at']:g}",
        ]
        for study in numbers["axes"].values()
        for cell in study["methods"].values()
        for k, value in enumerate(study["severities"])
    ]
    return Table(["delay of a camera", *shares, "median error (ms)", "breaks at"], rows)
