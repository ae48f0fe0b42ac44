"""Tracking on ray-cast scenes, case by case, beside baselines and goals.

Right: status tracking and an error below 30 mm; share of the frames from 1 s on (of `start` rest: from 1 s after the
object first moves) in which both eyes see at least half of the object. False claim: status tracking and an error above
50 mm; share of all frames. Found after: time from when both eyes see the object move to the first right frame. Median
error, error of the radius and coverage of the 95 % ellipsoid: over the judged frames with status tracking. Of two equal
balls either may be tracked, but the same one throughout. An object that comes later, or after darkness, is awaited from
when both eyes see it; known after: until any known track is within 3 cm of it, or 5 % of its distance. Of several
tracks that with the most right frames counts; where other objects move, a claim is false if it is near no object.
Where a person walks, claims of the person count as false. Baselines get the true boxes in the first frame that shows
the whole object.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from pps_vision.experiments.baselines.stereo_pipelines import STEREO_PIPELINES
from pps_vision.experiments.charts import PAGE_IN, panels
from pps_vision.experiments.films.cases import CASES, NEW_CASES, Case
from pps_vision.experiments.films.caster import PHOTOS
from pps_vision.experiments.films.scenes import Film
from pps_vision.experiments.films.score import OURS, Scores, measure_film, summary
from pps_vision.experiments.study import DATA, SampledStudy, median
from pps_vision.experiments.tables import Table, estimate
from pps_vision.worker_pool import mapped

CaseScores = Mapping[str, Mapping[str, Sequence[Scores]]]  # scores of each film by case and tracker
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
    "ms_per_pair": "ms per pair",
    "known_percent": "known after 0.5 s (% of the films)",
}
_COMPARED_COLUMNS = ("right_percent", "false_percent", "median_mm", "ms_per_pair")
_COLORS = {name: f"C{k}" for k, name in enumerate((OURS, *STEREO_PIPELINES))}
_RIGHT_PERCENT = 90.0
_CASES = {case.name: case for case in (*CASES, *NEW_CASES)}


@dataclass(frozen=True)
class Independent(SampledStudy):
    """Every case of `films.cases` by the tracker with its defaults, which gets only the rig."""

    MINUTES: ClassVar[int] = 52
    SHORT: ClassVar[Mapping[str, Any]] = {"only": "head moves, 10 ms stale"}

    n: int = 6  # ray-cast films of each case, before different photographs
    n_compared: int = 1  # ray-cast films of each case on which the baselines run too
    data: Path = DATA
    """Folder of the photographs (default: PPS_VISION_DATA, else ../shared/data); procedural where they are absent."""
    only: str = ""  # only the cases whose names contain this
    workers: int = 1  # parallel processes

    def run(self) -> dict[str, Any]:
        """Return by case and tracker the scores of each film."""
        chosen = [name for name in _CASES if self.only in name]
        cases = mapped(self._case, self.workers, chosen)
        by_case = dict(zip(chosen, tqdm(cases, total=len(chosen), unit="case", disable=None), strict=True))
        absent = [name for name in PHOTOS if not (self.data / name).exists()]
        return {"independent": by_case, "procedural_instead_of": absent}

    def _case(self, name: str) -> dict[str, list[Scores]]:
        """Scores of the case's films by tracker."""
        films = [self._film(_CASES[name], k) for k in range(self.n)]
        return {tracker: [film[tracker] for film in films if tracker in film] for tracker in films[0]}

    def _film(self, case: Case, k: int) -> dict[str, Scores]:
        """Scores of a film by tracker."""
        film = Film(case.scene(k), self.seed + k, self.data)
        return measure_film(film, case.tracker(film.hue_deg), k < self.n_compared, case.each)

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw right and median error of every case, ours beside the baselines."""
        cells: CaseScores = numbers["independent"]
        names = list(cells)
        figure, axes = panels(2, width=PAGE_IN / 2, height=1.0 + 0.15 * len(names))
        for axis, key in zip(axes, ("right_percent", "median_mm"), strict=True):
            for tracker, color in _COLORS.items():
                shown = {k: cells[name] for k, name in enumerate(names) if tracker in cells[name]}
                if not shown:
                    continue
                values = [summary(_compared_films(films)[tracker])[key] for films in shown.values()]
                (line,) = axis.plot(values, list(shown), "o", color=color, ms=4)
                line.set(label=tracker, zorder=3 if tracker == OURS else 2)
            axis.set_xlabel(COLUMNS[key], fontsize=8)
            axis.set_yticks(range(len(names)), names if axis is axes[0] else [], fontsize=5)
            axis.set_ylim(len(names) - 0.5, -0.5)
            axis.grid(alpha=0.25)
        axes[1].set_xscale("log")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=7)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the number of cases that meet each goal, ours beside the baselines, and apart the new cases."""
        cells: CaseScores = numbers["independent"]
        new = {case.name for case in NEW_CASES}
        first = {name: films for name, films in cells.items() if name not in new}
        new_table = _new_table({name: films for name, films in cells.items() if name in new})
        return {"goals": _goals_table(first), "baselines": _baselines_table(first), "new": new_table}


def _compared_films(by_tracker: Mapping[str, Sequence[Scores]]) -> dict[str, Sequence[Scores]]:
    """The films of a case on which all trackers ran."""
    n = min(len(films) for films in by_tracker.values())
    return {tracker: films[:n] for tracker, films in by_tracker.items()}


def _goals_table(cells: CaseScores) -> Table:
    """Number of the cases with a goal that meet it, one row a score."""
    scores = {name: summary(films[OURS]) for name, films in cells.items()}
    rows = []
    for key, text in COLUMNS.items():
        judged = {name: _CASES[name].goals[key] for name in scores if key in _CASES[name].goals}
        met = sum(not any(goal.missed(scores[name][key]) for goal in goals) for name, goals in judged.items())
        if judged:
            rows.append([text, f"{met} of {len(judged)}"])
    return Table(["goal", "cases that meet it"], rows)


def _new_table(cells: CaseScores) -> Table:
    """One row a case: ours, by films."""
    columns = ("right_percent", "false_percent", "median_mm", "known_percent", "most_found_s", "ms_per_pair")
    rows = []
    for name, by_tracker in cells.items():
        scores = summary(by_tracker[OURS])
        rows.append([name, *(estimate([scores[key]]) for key in columns)])
    return Table(["case", *(COLUMNS[key] for key in columns)], rows)


def _baselines_table(cells: CaseScores) -> Table:
    """One row a tracker, over the films on which all trackers ran."""
    rows = []
    films = [_compared_films(by_tracker) for by_tracker in cells.values()]
    for tracker in _COLORS:
        scores = [summary(by_tracker[tracker]) for by_tracker in films if tracker in by_tracker]
        if scores:
            right, false, mm, ms = (np.array([score[key] for score in scores]) for key in _COMPARED_COLUMNS)
            cases = f"{np.count_nonzero(right >= _RIGHT_PERCENT)} of {len(scores)}"
            means = [estimate([float(x.mean())]) for x in (right, false)]
            medians = [estimate([median(x[np.isfinite(x)])]) for x in (mm, ms)]
            rows.append([tracker, cases, *means, *medians])
    header = ["right (%), mean", "false claims (%), mean", "median error (mm), median", "ms per pair, median"]
    return Table(["tracker", f"cases right in {_RIGHT_PERCENT:g} %", *header], rows)
