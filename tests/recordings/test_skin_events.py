"""Skin event logs: rows written by hand, read and written again; what cannot be read is skipped and named."""

from pathlib import Path

import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.problems import Problem
from pps_vision.recordings.skin_events import SkinContact, read_skin_events, touches_of, write_skin_events

ONE = "((12 3 4 2) (0.06 -0.029 0.00005) (-0.46 0.0 -0.0) (0.0 0.0 0.0) (0.06 -0.029 0.009) (1.0 0.0 0.0) (4 0 9) 9.3)"
OTHER = "((13 1 2 7) (0.08 0.1 0.0) (-3.6 -0.0 -0.0) (0.0 0.0 0.0) (0.08 0.1 0.0) (1.0 0.0 0.0) (1) 73.328253)"
ROWS = ["7 1412842922.482190 ", f"8 1412842922.502190 {ONE}", f"9 1412842922.522190 {ONE} {OTHER}"]


def log_of(tmp_path: Path, rows: list[str]) -> Path:
    log = tmp_path / "data.log"
    log.write_text("".join(f"{row}\n" for row in rows))
    return log


def test_rows_are_read_and_written_as_they_were(tmp_path: Path) -> None:
    problems: list[Problem] = []
    events = read_skin_events(log_of(tmp_path, ROWS), problems)
    assert problems == []
    assert [(e.index, e.stamp_s, len(e.contacts)) for e in events] == [
        (7, 1412842922.48219, 0),
        (8, 1412842922.50219, 1),
        (9, 1412842922.52219, 2),
    ]
    assert events[1].contacts[0] == SkinContact(
        *(12, 3, 4, 2, (0.06, -0.029, 5e-5), (-0.46, 0.0, 0.0), (0.0, 0.0, 0.0), (0.06, -0.029, 0.009)),
        *((1.0, 0.0, 0.0), (4, 0, 9), 9.3),
    )
    write_skin_events(tmp_path / "again.log", events)
    assert (tmp_path / "again.log").read_text() == (tmp_path / "data.log").read_text()  # to the character


@pytest.mark.parametrize(
    "bad",
    [
        "8",
        "eight 1.0",
        "8 later",
        "8 nan",
        f"8 1.0 {ONE[:-1]}",
        f"8 1.0 {ONE})",
        f"8 1.0 {ONE.replace('0.009', 'x')}",
        f"8 1.0 {ONE.replace('0.009', 'inf')}",
        f"8 1.0 {ONE.replace('(0.0 0.0 0.0) ', '')}",
        f"8 1.0 {ONE.replace('(12 3 4 2)', '(12 3 4)')}",
        f"8 1.0 {ONE.replace('(4 0 9)', '4')}",
        f"8 1.0 {ONE.replace('9.3', '(9.3)')}",
        f"8 1.0 {ONE.replace('0.46', '(1) 0.46')}",
        "8 1.0 word",
    ],
)
def test_a_row_that_cannot_be_read_is_skipped_and_named(tmp_path: Path, bad: str) -> None:
    problems: list[Problem] = []
    log = log_of(tmp_path, [ROWS[0], bad, ROWS[2]])
    assert [e.index for e in read_skin_events(log, problems)] == [7, 9]
    assert len(problems) == 1
    assert str(problems[0]).startswith(f"{log}:2: '{bad[:20].split()[0]}")
    with pytest.raises(InputError, match=r"data\.log:1: .*none of 2 rows"):
        read_skin_events(log_of(tmp_path, [bad, bad]), [])


def test_no_log(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.log: cannot be read"):
        read_skin_events(tmp_path / "gone.log", [])


def test_contacts_become_touches_of_virtual_taxels(tmp_path: Path) -> None:
    """Taxels 0 and 4 of the left forearm belong to 3, 9 is past the mapping; the torso has no taxels here."""
    events = read_skin_events(log_of(tmp_path, ROWS), [])
    touches = touches_of(events, {"left_forearm": (3, 15, -1, 3, 3)})
    assert [t.taxel_ids for t in touches] == [(), ("left_forearm:3",), ("left_forearm:3",)]
    assert [t.taxel_ids for t in touches_of(events, {"left_palm": (3,)})] == [(), (), ()]
    assert [t.taxel_ids for t in touches_of(events, {"left_forearm": (-1, 0, 0, 0, 27)})][1] == ("left_forearm:27",)
    below = read_skin_events(log_of(tmp_path, [ROWS[1].replace("(4 0 9)", "(-1 4)")]), [])
    assert touches_of(below, {"left_forearm": (3, 3, 3, 3, 15)})[0].taxel_ids == ("left_forearm:15",)
    assert touches_of(below, {"left_forearm": (3, 3, 3, 15)})[0].taxel_ids == ()
