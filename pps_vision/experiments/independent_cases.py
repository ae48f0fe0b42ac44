"""The tracking table's cases on independent scenes: one name, one scene, one tracker, and what is asked of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from pps_vision.experiments.independent_films import IndependentScene
from pps_vision.experiments.independent_scenes import PHOTOS, Color
from pps_vision.experiments.sensor_chain import SensorChain
from tracking.marker import MarkerParams
from tracking.tracker import TrackerParams

GREEN: Color = (25.0, 200.0, 40.0)
BLUE: Color = (25.0, 60.0, 210.0)
DULL: dict[str, Any] = {
    "grey": (128.0, 128.0, 128.0),
    "white": (245.0, 245.0, 245.0),
    "black": (25.0, 25.0, 25.0),
    "background-coloured": "background",
}
WHOLE_SENSOR = SensorChain(bayer=True, shot=0.2, jpeg=85)
_VIVID = IndependentScene()
_MARKER_M = 0.012


class Goal(NamedTuple):
    """A score is to be at least, or at most, so much."""

    bound: float
    at_least: bool = False

    def missed(self, score: float) -> bool:
        """Whether a score, or its absence, misses the goal."""
        return not (score >= self.bound if self.at_least else score <= self.bound)

    def __str__(self) -> str:
        return f"{'≥' if self.at_least else '≤'} {self.bound:g}"


Goals = Mapping[str, tuple[Goal, ...]]
"""By score of `independent_score.summary`."""


@dataclass(frozen=True)
class Case:
    """`base` filmed over another photograph with every film; tracked as a marker of its hue, or as anything."""

    name: str
    base: IndependentScene
    marker: bool = False
    asked: Goals = field(default_factory=dict)
    """Goals of this case; it has those of `COMMON` too."""

    def scene(self, film: int) -> IndependentScene:
        """Of the film of that number; a textured object never wears the photograph behind it."""
        texture = (film + 2) % len(PHOTOS)
        return replace(self.base, background=film % len(PHOTOS), texture=texture)

    def tracker(self, hue_deg: float) -> TrackerParams:
        """What the object is looked for with."""
        if self.marker:
            return TrackerParams("marker", marker=MarkerParams(hue_deg))
        return TrackerParams()

    @property
    def goals(self) -> Goals:
        """Those of all cases, of the images' size, and its own; right in 90 % of the frames where it has no other."""
        ms = next(ms for width, ms in _MS_UP_TO if self.base.width <= width)
        usual = {} if {"right_percent", "least_right_percent", "most_found_s"} & self.asked.keys() else _right(90)
        return {**COMMON, "ms_per_pair": (Goal(ms),), **usual, **self.asked}


_MS_UP_TO = ((320, 4.5), (640, 5.0), (np.inf, 9.0))  # image width, ms a pair
COMMON: Goals = {"false_percent": (Goal(1.0),), "covered_percent": (Goal(90.0, True), Goal(98.0))}


def _right(percent: float, mm: float | None = None, **also: tuple[Goal, ...]) -> Goals:
    error: Goals = {} if mm is None else {"median_mm": (Goal(mm),)}
    return {"right_percent": (Goal(percent, True),), **error, **also}


_IN_EVERY_FILM: Goals = {
    "least_right_percent": (Goal(98.0, True),),
    "least_covered_percent": (Goal(90.0, True),),
    "most_covered_percent": (Goal(98.0),),
}
_DULL, _TWO_COLOURS = _right(95, 3.0), _right(95, 3.0, radius_percent=(Goal(10.0),))
_HEAD = replace(_VIVID, rig="head", start="moving", distance_m=0.45, extent_m=0.08, speed_m_s=0.15)
_STALE = {0: _right(90, 3.0), 10: _right(90, 5.0), 20: _right(90, 8.0)}  # by the age of the joints, ms


def _of_any_kind() -> dict[str, tuple[IndependentScene, Goals]]:
    """Cases of which a marker's hue is no part: what the generic tracker alone is tried on."""
    rest, grey = replace(_VIVID, start="rest"), SensorChain(grey=True)
    square = replace(_VIVID, shape="square", pattern="textured", radius_m=0.04, spin_rad_s=0.3)
    return {
        "vivid, blue": (replace(_VIVID, color=BLUE), _IN_EVERY_FILM),
        **{f"{name}, entering": (replace(_VIVID, color=color), _DULL) for name, color in DULL.items()},
        **{f"{name}, in view from the start": (replace(rest, color=color), _DULL) for name, color in DULL.items()},
        **{
            f"grey image, {name}, in view from the start": (replace(rest, color=color, sensor=grey), _DULL)
            for name, color in DULL.items()
        },
        "striped, spinning": (replace(_VIVID, pattern="striped", spin_rad_s=3.0), _TWO_COLOURS),
        "chequered, spinning": (replace(_VIVID, pattern="chequered", spin_rad_s=3.0), _TWO_COLOURS),
        "textured square": (square, _right(95, 6.0)),
        "two balls of one colour": (replace(_VIVID, second="same"), {}),
        "head moves, grey": (replace(_HEAD, color=DULL["grey"]), _STALE[0]),
        **{
            f"head moves, grey, {ms} ms stale": (replace(_HEAD, color=DULL["grey"], stale_s=ms / 1000), _STALE[ms])
            for ms in (10, 20)
        },
    }


def _of_one_hue() -> dict[str, tuple[IndependentScene, Goals]]:
    """Cases of a vivid ball: the generic tracker is tried on them, and with a small one the marker tracker."""
    board = replace(_VIVID, motion="straight", start="moving", seconds=6.0, speed_m_s=0.1, hidden_s=1.0)
    slow = replace(_VIVID, speed_m_s=0.02, start="rest", rest_s=0.5, extent_m=0.04)
    stops = replace(_VIVID, motion="stop_and_go", start="moving", seconds=5.0)
    return {
        "vivid, red": (_VIVID, _IN_EVERY_FILM),
        "vivid, whole sensor chain": (replace(_VIVID, sensor=WHOLE_SENSOR, gain_drift=0.1), _IN_EVERY_FILM),
        "rig rotates, declared fixed": (replace(_VIVID, rig="rotating"), {}),
        "rig shakes, declared fixed": (replace(_VIVID, rig="shaking"), {}),
        "rig rotates, pose known": (replace(_VIVID, rig="rotating", rig_known=True), {}),
        "behind a board for 1 s": (board, {}),
        "defocus, sigma 3 px": (replace(_VIVID, sensor=SensorChain(defocus_px=3.0)), {}),
        "motion blur, 20 ms": (replace(_VIVID, shutter_s=0.02), {}),
        "flicker and gain drift": (replace(_VIVID, flicker=0.15, gain_drift=0.2), {}),
        "noise 10": (replace(_VIVID, sensor=SensorChain(read_noise=10.0)), {}),
        "2 cm/s": (slow, {"most_found_s": (Goal(2.0),)}),
        "1 m/s, instant reversal": (replace(_VIVID, speed_m_s=1.0, motion="reversal", start="moving"), {}),
        "moves, stops for 2 s, moves on": (stops, _right(98, 2.0)),
        "held by a finger": (replace(_VIVID, finger=True, start="moving"), {}),
        "320x240, 10 fps": (replace(_VIVID, width=320, height=240, fps=10.0), {}),
        "1280x960, 60 fps": (replace(_VIVID, width=1280, height=960, fps=60.0, seconds=2.0, start="moving"), {}),
        **{f"head moves, {ms} ms stale": (replace(_HEAD, stale_s=ms / 1000), goals) for ms, goals in _STALE.items()},
    }


def _cases() -> tuple[Case, ...]:
    any_kind = [Case(name, scene, asked=goals) for name, (scene, goals) in _of_any_kind().items()]
    one_hue = [Case(name, scene, asked=goals) for name, (scene, goals) in _of_one_hue().items()]
    markers = [
        replace(
            case,
            name="marker" if case.name == "vivid, red" else f"marker, {case.name.removeprefix('vivid, ')}",
            base=replace(case.base, radius_m=_MARKER_M, color=GREEN),
            marker=True,
        )
        for case in one_hue
    ]
    return (*one_hue, *any_kind, *markers)


CASES = _cases()
