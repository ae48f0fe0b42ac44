"""Tables and charts of the tracking table: scores by case, which goals are met, and ours beside the baselines."""

from collections.abc import Iterator, Mapping, Sequence
from textwrap import fill
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.charts import panels
from pps_vision.experiments.independent_cases import CASES, COMMON, Goal
from pps_vision.experiments.independent_score import BASELINES, OURS, Scores, summary
from pps_vision.experiments.study import median
from pps_vision.experiments.tables import Table, estimate, judged

Cells = Mapping[str, Mapping[str, Sequence[Scores]]]
"""Scores of each film by case and tracker."""
COLUMNS = {
    "right_percent": "right (%)",
    "least_right_percent": "right, worst film (%)",
    "most_found_s": "found after, worst film (s)",
    "false_percent": "false claims (%)",
    "median_mm": "median error (mm)",
    "radius_percent": "radius error (%)",
    "covered_percent": "95 % ellipsoid (%)",
    "least_covered_percent": "95 % ellipsoid, least of a film (%)",
    "most_covered_percent": "95 % ellipsoid, most of a film (%)",
    "stated_mm": "stated σ (mm)",
    "ms_per_pair": "ms per pair",
}
_CASES = {case.name: case for case in CASES}
_COLORS = dict(zip((OURS, *BASELINES), ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple"), strict=True))
_RIGHT_PERCENT = 90.0
_SHOWN_MS = (0.5, 200)
_COMPARED = ("right_percent", "false_percent", "median_mm", "ms_per_pair")


class JudgedGoal(NamedTuple):
    """A case's score and one of its goals."""

    case: str
    key: str
    goal: Goal
    score: float


def judged_goals(cells: Cells) -> Iterator[JudgedGoal]:
    """Yield every goal of every case, as far as its score was measured."""
    for name, by_tracker in cells.items():
        scores = summary(by_tracker[OURS])
        for key in [key for key in COLUMNS if key in scores]:
            yield from (JudgedGoal(name, key, goal, scores[key]) for goal in _CASES[name].goals.get(key, ()))


def scores_table(cells: Cells) -> Table:
    """Return one row a case: means over its films and the worst film; bold where a goal is missed, with the goal."""
    missed = {(one.case, one.key) for one in judged_goals(cells) if one.goal.missed(one.score)}
    rows = []
    for name, by_tracker in cells.items():
        scores, row = summary(by_tracker[OURS]), [name]
        for key in COLUMNS:
            text = estimate([scores.get(key)])
            own = () if key in COMMON else _CASES[name].goals.get(key, ())
            row.append(judged(text, (name, key) in missed) + "".join(f" ({goal})" for goal in own))
        rows.append(row)
    header = [", ".join([text, *map(str, COMMON.get(key, ()))]) for key, text in COLUMNS.items()]
    return Table(["case", *header], rows)


def goals_table(by_source: Mapping[str, Cells]) -> Table:
    """Return how many of the cases that have a goal meet it, one row a score."""
    every = {source: list(judged_goals(cells)) for source, cells in by_source.items()}
    rows = []
    for key, text in COLUMNS.items():
        counts = []
        for found in every.values():
            of = {one.case for one in found if one.key == key}
            missed = {one.case for one in found if one.key == key and one.goal.missed(one.score)}
            counts.append(f"{len(of) - len(missed)} of {len(of)}" if of else "–")
        if set(counts) != {"–"}:
            rows.append([text, *counts])
    return Table(["goal met, cases", *by_source], rows)


def missed_table(by_source: Mapping[str, Cells]) -> Table:
    """Return every missed goal, with the cases that miss it and what was measured."""
    by_goal: dict[tuple[str, str, Goal], list[str]] = {}
    for source, cells in by_source.items():
        for one in judged_goals(cells):
            if one.goal.missed(one.score):
                at = by_goal.setdefault((source, one.key, one.goal), [])
                at.append(f"{one.case} {judged(estimate([one.score]), True)}")
    rows = [[f"{source}: {COLUMNS[key]} {goal}", "; ".join(at)] for (source, key, goal), at in by_goal.items()]
    return Table(["missed goal", "cases and what was measured"], rows)


def baselines_table(by_source: Mapping[str, Cells]) -> Table:
    """Return one row a source and tracker, over the films on which all were tried."""
    rows = []
    for source, cells in by_source.items():
        for tracker in _COLORS:
            of = [summary(films[tracker]) for films in map(_compared, cells.values()) if tracker in films]
            if of:
                right, false, mm, ms = (np.array([one[key] for one in of]) for key in _COMPARED)
                mostly = f"{np.count_nonzero(right >= _RIGHT_PERCENT)} of {len(of)}"
                middle = [estimate([median(x[np.isfinite(x)])]) for x in (mm, ms)]
                means = [estimate([float(x.mean())]) for x in (right, false)]
                rows.append([f"{source}: {tracker}", mostly, *means, *middle])
    header = ["right (%), mean", "false claims (%), mean", "median error (mm), median", "ms per pair, median"]
    return Table(["scenes: tracker", f"cases right in {_RIGHT_PERCENT:g} %", *header], rows)


def _compared(by_tracker: Mapping[str, Sequence[Scores]]) -> dict[str, Sequence[Scores]]:
    """The films on which all trackers were tried."""
    n = min((len(films) for films in by_tracker.values()), default=0)
    return {tracker: films[:n] for tracker, films in by_tracker.items()}


def against_time(by_source: Mapping[str, Cells], key: str, label: str) -> Figure:
    """Draw a score against processor time, a panel a case and a point a tracker, hollow on rendered scenes; who has no
    value stands on top as a cross."""
    names = list(dict.fromkeys(name for cells in by_source.values() for name in cells))
    figure, axes = panels(len(names), 8, width=1.75, height=1.5)
    for axis in axes[1:]:
        axis.sharex(axes[0])
        axis.sharey(axes[0])
    for axis, name in zip(axes, names, strict=True):
        points = [
            (tracker, source, summary(films))
            for source, cells in by_source.items()
            for tracker, films in _compared(cells.get(name, {})).items()
        ]
        top = max((one[key] for _, _, one in points if np.isfinite(one[key])), default=1.0)
        for tracker, source, one in points:
            known, color = bool(np.isfinite(one[key])), _COLORS[tracker]
            y, inside = one[key] if known else top, color if source == "independent" else "none"
            text = "_" if not known else tracker if source == "independent" else f"{tracker}, {source}"
            axis.plot(one["ms_per_pair"], y, "o" if known else "x", mec=color, mfc=inside, ls="", ms=5, label=text)
        axis.set_title(fill(name, 32), fontsize=6)
        axis.set(xscale="log", xlim=_SHOWN_MS)
        axis.tick_params(labelsize=6, which="both")
        axis.grid(alpha=0.25)
        if key == "median_mm":
            axis.set_yscale("log")
        else:
            axis.set_ylim(-5, 105)
    figure.supxlabel("processor time (ms per pair)", fontsize=9)
    figure.supylabel(label, fontsize=9)
    shown = {text: line for axis in axes for line, text in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=5, fontsize=8)
    return figure
