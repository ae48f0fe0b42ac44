"""The disturbances of the failure map, each with its severities, mildest first."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pps_vision.experiments import disturbances as d
from pps_vision.experiments.failure_scenes import FINE, HIDDEN_S, Scenes
from pps_vision.experiments.footage import Footage

Group = Literal["light", "scene", "time", "eyes"]
_FAILS_S = 1.0  # when what fails for a time begins to


@dataclass(frozen=True)
class Case:
    """`show` films a severity; the first of `severities` is (nearly) undisturbed."""

    name: str
    group: Group
    axis: str
    severities: tuple[float, ...]
    show: Callable[[Scenes, float], Footage]


def _swing(s: Scenes, stops: float) -> Footage:
    return s.sensed(d.exposed(s.light, lambda t: stops * float(np.sin(np.pi * t))))


def _flicker(s: Scenes, stops: float) -> Footage:
    return s.sensed(d.exposed(s.light, lambda t: float(np.random.default_rng(round(1000 * t)).uniform(-stops, stops))))


def _eye_fails(kind: d.EyeFault, both: bool) -> Callable[[Scenes, float], Footage]:
    return lambda s, seconds: d.eyes_fail(s.plain, kind, _FAILS_S, _FAILS_S + seconds, both)


_OUT_S = (0, 0.1, 0.25, 0.5, 1)
_DELAYS_MS = (0, 10, 20, 50, 100)
_GAPS = (4, 2, 1, 0)

CASES: tuple[Case, ...] = (
    Case("pixel noise", "light", "σ (grey levels)", (2, 10, 20, 40, 80), lambda s, v: d.noisy(s.light, v, s.rng())),
    Case("exposure ramp", "light", "up and down by (stops), 2 s period", (0, 1, 2, 3, 4), _swing),
    Case("exposure flicker", "light", "frame by frame ± (stops)", (0, 0.25, 0.5, 1, 2), _flicker),
    Case(
        "motion blur",
        "light",
        "shutter open (ms), 40 cm/s",
        (10, 20, 50, 100),
        lambda s, v: s.sensed(d.blurred(s.swift, FINE, round(v / 10))),
    ),
    Case(
        "loss of colour",
        "light",
        "saturation kept (%)",
        (100, 25, 10, 5, 0),
        lambda s, v: s.sensed(d.desaturated(s.light, v / 100)),
    ),
    Case(
        "colour of the background",
        "light",
        "contrast kept (%)",
        (100, 50, 30, 20, 10),
        lambda s, v: s.sensed(d.faded(s.light, s.empty, v / 100)),
    ),
    Case("hidden", "scene", "by a board for (s)", (0.0, *HIDDEN_S), lambda s, v: s.hidden(v)),
    Case("partly hidden", "scene", "share, for 1 s (%)", (0, 25, 50, 75, 90), lambda s, v: s.partly_hidden(v / 100)),
    Case("twin behind", "scene", "passes at (radii)", _GAPS, lambda s, v: s.crossed(v, "twin", 1.25)),
    Case("twin before", "scene", "passes at (radii)", _GAPS, lambda s, v: s.crossed(v, "twin", 0.75)),
    Case("blue ball before", "scene", "passes at (radii)", _GAPS, lambda s, v: s.crossed(v, "other", 0.75)),
    Case("two that move", "scene", "apart by (radii)", (6, 4, 2, 0), lambda s, v: s.two(v)),
    Case("speed", "scene", "frames to cross the view", (40, 20, 10, 5, 3), lambda s, v: s.dash(v)),
    Case("leaves and returns", "scene", "out of view for (s)", (0, 0.1, 0.5, 2), lambda s, v: s.leaves(v)),
    Case("small", "scene", "diameter (px)", (40, 16, 8, 6, 4), lambda s, v: s.sized(v)),
    Case("large", "scene", "diameter (px)", (80, 120, 160, 200), lambda s, v: s.sized(v)),
    Case("far", "scene", "distance (m)", (0.4, 0.8, 1.6), lambda s, v: s.far(v)),
    Case("no texture", "scene", "texture's contrast (%)", (100, 20, 0), lambda s, v: s.textured(v / 100)),
    Case(
        "own arm moves",
        "scene",
        "joints at up to (°/s)",
        (0, 30, 120),
        lambda s, v: s.arm_moves(np.deg2rad(v)),
    ),
    Case("missing pairs", "time", "share (%)", (0, 25, 50, 75), lambda s, v: d.dropped(s.plain, v / 100, s.rng())),
    Case(
        "repeated pairs", "time", "share (%)", (0, 25, 50, 75, 90), lambda s, v: d.repeated(s.plain, v / 100, s.rng())
    ),
    Case(
        "stamp jitter",
        "time",
        "σ (ms)",
        (0, 5, 10, 20),
        lambda s, v: s.sensed(d.jittered(s.fine, FINE, v / 1000, s.rng())),
    ),
    Case(
        "right eye late, stamped",
        "time",
        "by (ms)",
        _DELAYS_MS,
        lambda s, v: s.sensed(d.right_late(s.fine, FINE, v / 1000, True)),
    ),
    Case(
        "right eye late, not stamped",
        "time",
        "by (ms)",
        _DELAYS_MS,
        lambda s, v: s.sensed(d.right_late(s.fine, FINE, v / 1000, False)),
    ),
    Case(
        "head pose stale", "time", "by (ms)", _DELAYS_MS, lambda s, v: s.sensed(d.stale_joints(s.fine, FINE, v / 1000))
    ),
    Case("right eye black", "eyes", "for (s)", _OUT_S, _eye_fails("black", both=False)),
    Case("right eye frozen", "eyes", "for (s)", _OUT_S, _eye_fails("frozen", both=False)),
    Case("both eyes frozen", "eyes", "for (s)", _OUT_S, _eye_fails("frozen", both=True)),
    Case(
        "right eye flickers",
        "eyes",
        "black in (%)",
        (0, 25, 50, 75, 90),
        lambda s, v: d.right_flickers(s.plain, v / 100, s.rng()),
    ),
    Case("intrinsics off", "eyes", "by (%)", (0, 1, 2, 3, 5), lambda s, v: d.miscalibrated(s.plain, v / 100, s.rng())),
)
