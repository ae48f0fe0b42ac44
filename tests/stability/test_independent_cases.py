"""The cases of the tracking table, small: found, near the truth, not claimed elsewhere, and inside the ellipsoid.

Procedural backgrounds at 320×240, but for the object of 200 px. `make test-all` films every case.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from data import SEED

from pps_vision.experiments.films.cases import CASES, NEW_CASES, Case
from pps_vision.experiments.films.scenes import Film, FilmScene
from pps_vision.experiments.films.score import OURS, measure_film
from tracking.tracker import TrackerParams

BY_NAME = {case.name: case for case in (*CASES, *NEW_CASES)}
LARGE = Case("object of 200 px", FilmScene(radius_m=0.109, extent_m=0.08, seconds=2.5))
USUAL = (
    "moves, stops for 2 s, moves on",
    "1 m/s, instant reversal",
    "flicker and gain drift",  # gain of the learned background
    "grey, in view from the start",  # ghost of an object learned as background
    "head moves, grey",  # background of a moving camera
)
NEW = ("hand takes", "hand holds", "turning stick")
FURTHER = (*(case.name for case in CASES if case.name not in USUAL), *NEW, LARGE.name)


@dataclass(frozen=True)
class Limits:
    """Of a film: least share of frames that are right (%), most false claims (%), largest median error (mm), and least
    coverage of the 95 % ellipsoid (%)."""

    right: float = 90.0
    false: float = 1.0
    median_mm: float = 8.0
    covered: float = 70.0


LIMITS = {  # of cases that miss the usual ones at this size; `bench independent` has the goals at full size
    "held by a finger": Limits(right=80),  # found 1.4 s after it moves
    # joined with the place that it leaves, and so it stays with seed 2016 (before photographs it is right)
    "1280x960, 60 fps": Limits(right=0, median_mm=45),
    "grey image, grey, in view from the start": Limits(right=70, false=3),
    "grey image, black, in view from the start": Limits(right=75, false=4),
    "grey image, background-coloured, in view from the start": Limits(right=75),
    "marker, defocus, sigma 3 px": Limits(right=30, median_mm=10),  # its blurred edge lies 18 % too far out
    "marker, 1 m/s, instant reversal": Limits(right=80),  # coasts past each reversal
    # 100 % with four seeds; its first frames show a part: up to four of 120 are false
    "1 m/s, instant reversal": Limits(right=95, median_mm=3, false=4),
    "hand takes": Limits(right=95, median_mm=3),
    "hand holds": Limits(right=95, median_mm=3, covered=30),  # at this size its edge is off by 0.6 px in both eyes
    "turning stick": Limits(right=90, median_mm=15),
    "2 cm/s": Limits(right=80, median_mm=30),  # at first joined with the place that it leaves
    # with seed 2016 it passes dark red, its own hue and saturation; with 2017 to 2020 nothing is false
    "flicker and gain drift": Limits(false=5),
    "head moves, 10 ms stale": Limits(false=8),
    "head moves, 20 ms stale": Limits(false=13),
    LARGE.name: Limits(right=70, false=15),  # cut by the image's border as it enters
}


def small(case: Case) -> FilmScene:
    """The case's first film, at 320×240 if it is of the usual size."""
    scene = case.scene(0)
    return replace(scene, width=320, height=240) if scene.width == 640 and case is not LARGE else scene


@pytest.mark.parametrize("name", [*USUAL, *(pytest.param(name, marks=pytest.mark.long) for name in FURTHER)])
def test_a_case_is_tracked_within_its_limits(name):
    case = BY_NAME.get(name, LARGE)
    limits = LIMITS.get(name, Limits())
    film = Film(small(case), SEED, Path("absent"))
    scores = measure_film(film, case.tracker(film.hue_deg))[OURS]
    print(name, {key: round(value, 1) for key, value in scores.items()})
    assert scores["judged"] > 25
    assert scores["right_percent"] >= limits.right
    assert scores["false_percent"] <= limits.false
    assert scores["median_mm"] <= limits.median_mm
    assert scores["covered_percent"] >= limits.covered


@pytest.mark.parametrize(("max_objects", "is_known"), [(2, True), pytest.param(1, False, marks=pytest.mark.long)])
def test_what_comes_while_another_object_is_followed_is_known_within_half_a_second(max_objects, is_known):
    film = Film(small(BY_NAME["first rests"]), SEED, Path("absent"))
    scores = measure_film(film, TrackerParams(max_objects=max_objects))[OURS]
    print({key: round(value, 1) for key, value in scores.items()})
    assert (scores["known_percent"] == 100) == is_known
    assert (scores["right_percent"] > 90) == is_known
