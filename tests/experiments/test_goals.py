"""What misses its goal is bold in a study's table, and what just meets it is not: published results with one number
changed."""

from pathlib import Path
from typing import Any

import pytest

from pps_vision.experiments.claims import CLAIMS
from pps_vision.experiments.study import catalogue
from pps_vision.experiments.tables import markdown, read_numbers

RESULTS = Path(__file__).parents[2] / "docs" / "results"
KNOWN = catalogue()
Place = tuple[str | int, ...]


def bold(text: str) -> int:
    return text.count("**") // 2


def changed(study: str, place: Place, value: object) -> dict[str, Any]:
    """The results of a study with another number at a place; a number is its own interval."""
    numbers: dict[str, Any] = read_numbers(RESULTS / f"{study}.json")
    *way, last = place
    of: Any = numbers
    for key in way:
        of = of[key]
    of[last] = [value] * len(of[last]) if isinstance(of[last], list) else value
    return numbers


OURS, TRUE = ("controllers", "ours"), ("controllers", "true positions")
GOALS: list[tuple[str, str, Place, float, float]] = [
    ("fixation", "static", ("static", "six joints", "eyes_s"), 0.75, 0.76),
    ("fixation", "static", ("static", "J IV.1", "neck_s"), 0.75, 0.76),
    ("fixation", "motions", ("motions", "linear", "six joints", "near_percent"), 95, 94.9),
    ("fixation", "search", ("search", "covering", "30 s"), 100, 99.9),
    ("loop", "", ("avoidance on", "ms", 0), 8.0, 8.1),
    ("loop", "", ("avoidance on", "ms", 1), 20.0, 20.1),
    ("pipeline", "rendered_ball", ("cells", "rendered, ball", "ours, generic", "ms"), 4.5, 4.51),
    ("pipeline", "rendered_marker", ("cells", "rendered, marker", "ours, marker", "ms"), 0.8, 0.81),
    ("encounters", "goals", (*OURS, "stop, slow"), 99, 98.9),
    ("encounters", "goals", (*OURS, "stop, slow, distance_mm"), 20, 19.9),
    ("encounters", "goals", (*OURS, "stop, slow, lead_s"), 0.4, 0.39),
    ("encounters", "goals", (*OURS, "still, all"), 99, 98.9),
    ("encounters", "goals", (*TRUE, "press and through, beyond ours"), 3, 3.1),
    ("encounters", "goals", (*TRUE, "fast, beyond ours"), 5, 5.1),
    ("encounters", "goals", ("controllers", "distance only", "press and through, beyond ours"), -15, -14.9),
    ("encounters", "goals", ("controllers", "taxel constraints", "press and through, beyond ours"), -0.1, 0),
    ("encounters", "goals", ("reaching", "ours", "reachable: by the part aimed at"), 98, 97.9),
    ("encounters", "goals", ("reaching", "ours, asking the map", "out of reach: attempted"), 0, 1),
    ("encounters", "goals", ("limits", "smallest_self_distance_mm"), 20, 19.9),
    ("encounters", "goals", ("limits", "left"), 0, 1),
    ("encounters_rendered", "goals", ("rates", "all approaching", "difference"), 10, 10.1),
    ("encounters_rendered", "goals", ("rates", "all approaching", "difference"), -10, -10.1),
    ("encounters_rendered", "goals", ("stop, slow", "untouched"), 99, 98.9),
    ("encounters_rendered", "goals", ("limits", "smallest_self_distance_mm"), 20, 19.9),
    ("encounters_rendered", "goals", ("limits", "left"), 0, 1),
    ("consistency", "", ("cells", "rendered", "all", "position 68"), 63, 62.9),
    ("consistency", "", ("cells", "rendered", "all", "position 95"), 98, 98.1),
]


@pytest.mark.parametrize(("study", "table", "place", "met", "missed"), GOALS)
def test_a_table_marks_what_misses_its_goal(study: str, table: str, place: Place, met: float, missed: float) -> None:
    make = KNOWN[study]().tables
    kept, lost = (bold(markdown(make(changed(study, place, value))[table])) for value in (met, missed))
    assert lost == kept + 1


CLAIMED: list[tuple[str, Place, float, float]] = [
    ("tracking", ("cells", "rendered, marker", "tracker", "mean_recording_mm"), 1.0, 1.01),
    ("tracking", ("cells", "rendered, ball", "tracker", "near_percent"), 99, 98.9),
    ("consistency", ("cells", "rendered", "all", "velocity 68"), 73, 73.1),
    ("pipeline", ("cells", "rendered, ball", "ours, generic", "ms"), 4.5, 4.51),
    ("pipeline", ("cells", "rendered, marker", "ours, marker", "ms"), 0.8, 0.81),
    ("trigger", ("cells", "independent", "nothing", "ours", "alarms_per_minute"), 0.99, 1),
    ("trigger", ("cells", "independent", "nothing", "ours", "ms"), 1, 1.01),
    ("imagetracker", ("cells", "vot_ball1", "120 particles", "lost_overlap"), 0.19, 0.21),
    ("loop", ("avoidance on", "touched"), 0, 1),
    ("loop", ("avoidance off", "touched"), 20, 19),
    ("loop", ("own arm", "commanded"), 0, 1),
    ("reach_whole_paper", ("maps", "ours", "learned", "je"), 0.2, 0.21),
]


@pytest.mark.parametrize(("study", "place", "met", "missed"), CLAIMED)
def test_a_claim_marks_what_misses_its_goal(study: str, place: Place, met: float, missed: float) -> None:
    (claim,) = (claim for claim in CLAIMS if claim.study == study)
    kept, lost = (bold(claim.measured(changed(study, place, value))) for value in (met, missed))
    assert lost == kept + 1


@pytest.mark.parametrize(("auroc", "error", "meets"), [(0.95, 0.05, "yes"), (0.94, 0.05, "no"), (0.95, 0.06, "no")])
def test_a_calibration_meets_both_goals_or_not(auroc: float, error: float, meets: str) -> None:
    numbers = changed("pps_calibration", ("methods", "fine map, corrected", "scores", "auroc"), auroc)
    numbers["methods"]["fine map, corrected"]["scores"]["calibration_error"] = [error] * 3
    rows = KNOWN["pps_calibration"]().tables(numbers)[""].rows
    assert {row[0]: row[-1] for row in rows}["fine map, corrected"] == meets


@pytest.mark.parametrize(("word", "limit"), [("right", 1.0), ("false claims", 1.0), ("95 % ellipsoid", 3.0)])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_constant_that_matters_more_than_a_limit_has_a_row(word: str, limit: float, sign: int) -> None:
    """On its own that constant does not matter."""
    place, make = ("constants", "acquisition._MARGIN", "0.7", word), KNOWN["constants"]().tables
    few, more = (len(make(changed("constants", place, sign * value))[""].rows) for value in (limit, limit + 0.1))
    assert more == few + 1


def test_bounds_of_maps_are_counted_where_they_hold_and_where_they_are_what_was_requested() -> None:
    maps = [
        {"requested": 0.01, "arm": arm, "labels": labels, "stated": stated, "measured": measured}
        for arm, labels, stated, measured in (
            ("left", 1000, 0.01, 0.01),
            ("left", 3000, 0.02, 0.01),
            ("left", 2000, 0.006, 0.01),
            ("right", 1000, 0.004, 0.002),
        )
    ]
    study = KNOWN["reach_error_bound"]()
    rows = study.tables({"maps": maps, "hold_percent": [75.0, 30.1, 95.4]})[""].rows
    assert [list(row) for row in rows] == [
        ["1 %, left", "3", "2", "2", "1.2", "1", "2000"],
        ["1 %, right", "1", "1", "1", "0.4", "0.2", "1000"],
        ["all", "4", "3; 75 (30.1–95.4) %", "–", "–", "–", "–"],
    ]
