"""Cases of the tracking table: name, scene, tracker and goals of each."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from pps_vision.experiments.films.caster import PHOTOS, Levels, SensorChain
from pps_vision.experiments.films.scenes import FilmObject, FilmScene
from tracking import DEFAULT_OBJECTS
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


Goals = Mapping[str, tuple[Goal, ...]]  # by score of `films.score.summary`
COMMON: Goals = {"false_percent": (Goal(1.0),), "covered_percent": (Goal(90.0, True), Goal(98.0))}


@dataclass(frozen=True)
class Case:
    """A scene, filmed before another photograph with every film, tracked as a marker of its hue or as any object."""

    name: str
    base: FilmScene
    marker: bool = False
    own_goals: Goals = field(default_factory=dict)
    each: bool = False  # both of two equal balls are to be followed, not either

    def scene(self, film: int) -> FilmScene:
        """Return the scene of the film of that number; a textured object never shows the photograph behind it."""
        return replace(self.base, background=film % len(PHOTOS), texture=(film + 2) % len(PHOTOS))

    def tracker(self, hue_deg: float) -> TrackerParams:
        """Return the tracker's parameters, as in `track`."""
        if self.marker:
            return TrackerParams("marker", marker=MarkerParams(hue_deg))
        return TrackerParams(max_objects=DEFAULT_OBJECTS)

    @property
    def goals(self) -> Goals:
        """Goals of all cases, of the images' size, and its own; right in 90 % of the frames unless it has its own."""
        ms = next(ms for width, ms in _MS_UP_TO_WIDTH if self.base.width <= width)
        has_own = {"right_percent", "least_right_percent", "most_found_s"} & self.own_goals.keys()
        return {**COMMON, "ms_per_pair": (Goal(ms),), **({} if has_own else _right(90)), **self.own_goals}


def _right(percent: float, mm: float | None = None, **further: tuple[Goal, ...]) -> Goals:
    error: Goals = {} if mm is None else {"median_mm": (Goal(mm),)}
    return {"right_percent": (Goal(percent, True),), **error, **further}


_IN_EVERY_FILM: Goals = {
    "least_right_percent": (Goal(98.0, True),),
    "least_covered_percent": (Goal(90.0, True),),
    "most_covered_percent": (Goal(98.0),),
}
_UNSATURATED_GOALS = _right(95, 3.0)
_PATTERN_GOALS = _right(95, 3.0, radius_percent=(Goal(10.0),))
_STALE_GOALS = {0: _right(90, 3.0), 10: _right(90, 5.0), 20: _right(90, 8.0)}  # by the age of the joints, ms
_HEAD = {"rig": "head", "start": "moving", "distance_m": 0.45, "extent_m": 0.08, "speed_m_s": 0.15}
_GREY_HEAD = {**_HEAD, "color": UNSATURATED["grey"]}
_SLOW = {"speed_m_s": 0.02, "start": "rest", "rest_s": 0.5, "extent_m": 0.04}
_BOARD = {"motion": "straight", "start": "moving", "seconds": 6.0, "speed_m_s": 0.1, "hidden_s": 1.0}
_STOPS = {"motion": "stop_and_go", "start": "moving", "seconds": 5.0}
_SQUARE = {"shape": "square", "pattern": "textured", "radius_m": 0.04, "spin_rad_s": 0.3}
_WHOLE_CHAIN = {"sensor": SensorChain(bayer=True, shot=0.2, jpeg=85), "gain_drift": 0.2}
_LARGE = {"width": 1280, "height": 960, "fps": 60.0, "seconds": 2.0, "start": "moving"}
_IN_VIEW: dict[str, Any] = {"start": "rest"}
_GREY_IN_VIEW: dict[str, Any] = {**_IN_VIEW, "sensor": SensorChain(grey=True)}
Options = Mapping[str, Any]  # fields of a `FilmScene`
_STARTS: dict[str, Options] = {
    "{}, entering": {},
    "{}, in view from the start": _IN_VIEW,
    "grey image, {}, in view from the start": _GREY_IN_VIEW,
}
_SHARED: dict[str, tuple[Options, Goals]] = {
    "vivid, red": ({}, _IN_EVERY_FILM),
    "vivid, whole sensor chain": (_WHOLE_CHAIN, _IN_EVERY_FILM),
    "rig rotates, declared fixed": ({"rig": "rotating"}, {}),
    "rig shakes, declared fixed": ({"rig": "shaking"}, {}),
    "rig rotates, pose known": ({"rig": "rotating", "rig_known": True}, {}),
    "behind a board for 1 s": (_BOARD, {}),
    "defocus, sigma 3 px": ({"sensor": SensorChain(defocus_px=3.0)}, {}),
    "motion blur, 20 ms": ({"shutter_s": 0.02}, {}),
    "flicker and gain drift": ({"flicker": 0.3, "gain_drift": 0.4}, {}),
    "noise 10": ({"sensor": SensorChain(read_noise=10.0)}, {}),
    "2 cm/s": (_SLOW, {"most_found_s": (Goal(2.0),)}),
    "1 m/s, instant reversal": ({"speed_m_s": 1.0, "motion": "reversal", "start": "moving"}, {}),
    "moves, stops for 2 s, moves on": (_STOPS, _right(98, 2.0)),
    "held by a finger": ({"finger": True, "start": "moving"}, {}),
    "320x240, 10 fps": ({"width": 320, "height": 240, "fps": 10.0}, {}),
    "1280x960, 60 fps": (_LARGE, {}),
    **{f"head moves, {ms} ms stale": ({**_HEAD, "stale_s": ms / 1000}, goals) for ms, goals in _STALE_GOALS.items()},
}
"""Cases of a vivid ball for the generic tracker, and of a small one for the marker tracker."""
_GENERIC: dict[str, tuple[Options, Goals]] = {
    "vivid, blue": ({"color": BLUE}, _IN_EVERY_FILM),
    **{
        template.format(name): ({**options, "color": color}, _UNSATURATED_GOALS)
        for template, options in _STARTS.items()
        for name, color in UNSATURATED.items()
    },
    "striped, spinning": ({"pattern": "striped", "spin_rad_s": 3.0}, _PATTERN_GOALS),
    "chequered, spinning": ({"pattern": "chequered", "spin_rad_s": 3.0}, _PATTERN_GOALS),
    "textured square": (_SQUARE, _right(95, 6.0)),
    "two balls of one colour": ({"second_ball": True}, {}),
    "head moves, grey": (_GREY_HEAD, _STALE_GOALS[0]),
    **{f"head moves, grey, {ms} ms stale": ({**_GREY_HEAD, "stale_s": ms / 1000}, _STALE_GOALS[ms]) for ms in (10, 20)},
}
"""Cases for the generic tracker alone."""


def _case(name: str, options: Options, goals: Goals, marker: bool = False) -> Case:
    if marker:
        name = "marker" if name == "vivid, red" else f"marker, {name.removeprefix('vivid, ')}"
        options = {**options, "radius_m": _MARKER_M, "color": GREEN}
    return Case(name, FilmScene(**options), marker, goals)


CASES = (
    *(_case(name, *case) for name, case in {**_SHARED, **_GENERIC}.items()),
    *(_case(name, *case, marker=True) for name, case in _SHARED.items()),
)

_KNOWN = {**_right(90), "known_percent": (Goal(95.0, True),)}
_APPROACH: dict[str, Any] = {"motion": "approach", "color": BLUE, "appears_s": 1.5}
_RESTS = FilmObject(motion="stop_and_go", start="moving", stop_s=np.inf, extent_m=0.06)
_FIRST_RESTS = {**_APPROACH, "start": "moving", "distance_m": 1.4, "radius_m": 0.04, "appears_s": 2.0, "seconds": 5.5}
_WALKER = {**_APPROACH, "distance_m": 1.0, "radius_m": 0.04, "seconds": 5.0, "walker": True, "room_m": 4.5}
_FARTHER = FilmObject(start="moving", distance_m=1.0, radius_m=0.04)
_TAKES = {"hand": "takes", "motion": "stop_and_go", "moves_s": 1.8, "stop_s": 1.0, "start": "moving", "seconds": 5.0}
_CROSS = {"second_ball": True, "motion": "straight", "start": "moving", "seconds": 3.0}
_ROD = {"shape": "rod", "radius_m": 0.1}
_THROWN = {"motion": "throws", "start": "rest", "rest_s": 0.5, "speed_m_s": 3.0, "distance_m": 0.8, "fps": 60.0}
_NEW: dict[str, tuple[Options, Goals]] = {
    "hand holds": ({"hand": "holds", "start": "moving"}, _right(95, 3.0)),
    "hand takes": (_TAKES, _right(95, 3.0)),
    "first rests": ({**_FIRST_RESTS, "others": (_RESTS,)}, _KNOWN),
    "walker": (_WALKER, {**_KNOWN, "false_percent": ()}),
    "nearer comes later": ({**_APPROACH, "distance_m": 0.7, "seconds": 4.5, "others": (_FARTHER,)}, _KNOWN),
    "two of one colour cross": (_CROSS, {}),
    "rod at 45°": (_ROD, _right(95)),
    "turning stick": ({**_ROD, "spin_rad_s": 1.5}, _right(95)),
    "light off and on": ({"dark_from_s": 2.0}, {**_right(90), "most_found_s": (Goal(0.3),)}),
    "thrown at 3 m/s": (_THROWN, _right(80)),
}
NEW_CASES = tuple(replace(_case(name, *case), each=name == "two of one colour cross") for name, case in _NEW.items())
"""Cases after the first 58, counted apart."""
