"""Cases of the tracking table: name, scene, tracker and goals of each."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from pps_vision.experiments.films.caster import PHOTOS, Levels
from pps_vision.experiments.films.scenes import FilmScene
from pps_vision.experiments.films.sensor import SensorChain
from tracking.marker import MarkerParams
from tracking.tracker import TrackerParams

GREEN: Levels = (25.0, 200.0, 40.0)
BLUE: Levels = (25.0, 60.0, 210.0)
UNSATURATED: dict[str, Any] = {
    "grey": (128.0, 128.0, 128.0),
    "white": (245.0, 245.0, 245.0),
    "black": (25.0, 25.0, 25.0),
    "background-coloured": "background",
}
_MARKER_M = 0.012
_MS_UP_TO_WIDTH = ((320, 4.5), (640, 5.0), (np.inf, 9.0))


class Goal(NamedTuple):
    """Bound of a score: the largest value, or the least."""

    bound: float
    at_least: bool = False

    def missed(self, score: float) -> bool:
        """Whether a score misses the goal; NaN does."""
        return not (score >= self.bound if self.at_least else score <= self.bound)

    def __str__(self) -> str:
        return f"{'≥' if self.at_least else '≤'} {self.bound:g}"


Goals = Mapping[str, tuple[Goal, ...]]  # by score of `films.score.summary`
COMMON: Goals = {"false_percent": (Goal(1.0),), "covered_percent": (Goal(90.0, True), Goal(98.0))}


@dataclass(frozen=True)
class Case:
    """A scene, filmed before another photograph with every film, tracked as a marker of its hue or as any object."""

    name: str
    base: FilmScene
    marker: bool = False
    own_goals: Goals = field(default_factory=dict)

    def scene(self, film: int) -> FilmScene:
        """Return the scene of the film of that number; a textured object never shows the photograph behind it."""
        return replace(self.base, background=film % len(PHOTOS), texture=(film + 2) % len(PHOTOS))

    def tracker(self, hue_deg: float) -> TrackerParams:
        """Return the tracker's parameters."""
        return TrackerParams("marker", marker=MarkerParams(hue_deg)) if self.marker else TrackerParams()

    @property
    def goals(self) -> Goals:
        """Goals of all cases, of the images' size, and its own; right in 90 % of the frames unless it has its own."""
        ms = next(ms for width, ms in _MS_UP_TO_WIDTH if self.base.width <= width)
        has_own = {"right_percent", "least_right_percent", "most_found_s"} & self.own_goals.keys()
        return {**COMMON, "ms_per_pair": (Goal(ms),), **({} if has_own else _right(90)), **self.own_goals}


def _right(percent: float, mm: float | None = None, **further: tuple[Goal, ...]) -> Goals:
    error: Goals = {} if mm is None else {"median_mm": (Goal(mm),)}
    return {"right_percent": (Goal(percent, True),), **error, **further}


_VIVID = FilmScene()
_GREY_CAMERA = SensorChain(grey=True)
_HEAD = replace(_VIVID, rig="head", start="moving", distance_m=0.45, extent_m=0.08, speed_m_s=0.15)
_IN_EVERY_FILM: Goals = {
    "least_right_percent": (Goal(98.0, True),),
    "least_covered_percent": (Goal(90.0, True),),
    "most_covered_percent": (Goal(98.0),),
}
_UNSATURATED_GOALS = _right(95, 3.0)
_PATTERN_GOALS = _right(95, 3.0, radius_percent=(Goal(10.0),))
_STALE_GOALS = {0: _right(90, 3.0), 10: _right(90, 5.0), 20: _right(90, 8.0)}  # by the age of the joints, ms


def _for_generic_tracker() -> dict[str, tuple[FilmScene, Goals]]:
    """Cases for the generic tracker alone."""
    rest = replace(_VIVID, start="rest")
    square = replace(_VIVID, shape="square", pattern="textured", radius_m=0.04, spin_rad_s=0.3)
    grey_head = replace(_HEAD, color=UNSATURATED["grey"])
    return {
        "vivid, blue": (replace(_VIVID, color=BLUE), _IN_EVERY_FILM),
        **{
            f"{name}, entering": (replace(_VIVID, color=color), _UNSATURATED_GOALS)
            for name, color in UNSATURATED.items()
        },
        **{
            f"{name}, in view from the start": (replace(rest, color=color), _UNSATURATED_GOALS)
            for name, color in UNSATURATED.items()
        },
        **{
            f"grey image, {name}, in view from the start": (
                replace(rest, color=color, sensor=_GREY_CAMERA),
                _UNSATURATED_GOALS,
            )
            for name, color in UNSATURATED.items()
        },
        "striped, spinning": (replace(_VIVID, pattern="striped", spin_rad_s=3.0), _PATTERN_GOALS),
        "chequered, spinning": (replace(_VIVID, pattern="chequered", spin_rad_s=3.0), _PATTERN_GOALS),
        "textured square": (square, _right(95, 6.0)),
        "two balls of one colour": (replace(_VIVID, second_ball=True), {}),
        "head moves, grey": (grey_head, _STALE_GOALS[0]),
        **{
            f"head moves, grey, {ms} ms stale": (replace(grey_head, stale_s=ms / 1000), _STALE_GOALS[ms])
            for ms in (10, 20)
        },
    }


def _for_both_trackers() -> dict[str, tuple[FilmScene, Goals]]:
    """Cases of a vivid ball for the generic tracker, and of a small one for the marker tracker."""
    board = replace(_VIVID, motion="straight", start="moving", seconds=6.0, speed_m_s=0.1, hidden_s=1.0)
    slow = replace(_VIVID, speed_m_s=0.02, start="rest", rest_s=0.5, extent_m=0.04)
    stops = replace(_VIVID, motion="stop_and_go", start="moving", seconds=5.0)
    whole_chain = SensorChain(bayer=True, shot=0.2, jpeg=85)
    return {
        "vivid, red": (_VIVID, _IN_EVERY_FILM),
        "vivid, whole sensor chain": (replace(_VIVID, sensor=whole_chain, gain_drift=0.1), _IN_EVERY_FILM),
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
        **{
            f"head moves, {ms} ms stale": (replace(_HEAD, stale_s=ms / 1000), goals)
            for ms, goals in _STALE_GOALS.items()
        },
    }


def _cases() -> tuple[Case, ...]:
    generic = [Case(name, scene, own_goals=goals) for name, (scene, goals) in _for_generic_tracker().items()]
    shared = [Case(name, scene, own_goals=goals) for name, (scene, goals) in _for_both_trackers().items()]
    markers = [
        replace(
            case,
            name="marker" if case.name == "vivid, red" else f"marker, {case.name.removeprefix('vivid, ')}",
            base=replace(case.base, radius_m=_MARKER_M, color=GREEN),
            marker=True,
        )
        for case in shared
    ]
    return (*shared, *generic, *markers)


CASES = _cases()
