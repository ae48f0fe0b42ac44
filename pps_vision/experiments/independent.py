"""Tracking on independent scenes and on rendered ones, case by case, beside baselines and goals."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from matplotlib.figure import Figure
from tqdm import tqdm

from pps_vision.errors import InputError
from pps_vision.experiments.independent_cases import CASES, Case
from pps_vision.experiments.independent_films import Film
from pps_vision.experiments.independent_report import (
    Cells,
    against_time,
    baselines_table,
    goals_table,
    missed_table,
    scores_table,
)
from pps_vision.experiments.independent_scenes import PHOTOS
from pps_vision.experiments.independent_score import Scores, measure
from pps_vision.experiments.rendered_films import RenderedFilm, can_render
from pps_vision.experiments.study import DATA, SceneSource, TrackingStudy
from pps_vision.experiments.tables import Table


@dataclass(frozen=True)
class Independent(TrackingStudy):
    """Every case of the tracking table on scenes that share no code with our renderer, and on rendered ones.

    Right: status tracking, less than 30 mm off, as a share of the frames from 1 s on (of `start` rest: from 1 s after
    the object first moves) in which both eyes see at least half of the object.  False claim: status tracking, more
    than 50 mm off, as a share of all frames.  Found: seconds from when both eyes see the object move until the first
    right frame.  Medians of the error, of the radius's error and of the stated standard deviation (geometric mean
    of the three axes), and coverage of the 95 % ellipsoid: over the frames of the first share with status tracking.
    Of two balls that nothing tells apart either may be tracked, but the same one throughout: all numbers refer to the
    ball for which most frames are right. Baselines are told the true boxes in the first frame that shows the object.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"only": "head moves, 10 ms stale"}

    n: int = 6
    """Independent films of each case, over different photographs."""
    n_rendered: int = 1
    """Rendered films of each case that our renderer can draw."""
    n_compared: int = 1
    """Independent films of each case on which the baselines are tried too."""
    data: Path = DATA
    """Folder of the photographs (default: PPS_VISION_DATA, else ../shared/data); procedural where they are absent."""
    only: str = ""
    """Only the cases whose names contain this."""

    def run(self) -> dict[str, Any]:
        """By source, case and tracker: each film's scores."""
        chosen = [case for case in CASES if self.only in case.name]
        if not chosen:
            raise InputError("bench independent", f"--only {self.only!r}; expected a part of a case's name")
        found: dict[str, Any] = {source: {} for source in self.sources}
        for source in self.sources:
            for case in tqdm(chosen, desc=source, unit="case", disable=None):
                films = list(self._films(source, case))
                if films:
                    found[source][case.name] = _by_tracker(films)
        absent = [name for name in PHOTOS if not (self.data / name).exists()]
        return {**found, "procedural_instead_of": absent}

    def _films(self, source: SceneSource, case: Case) -> Iterator[dict[str, Scores]]:
        """Each film's scores by tracker; none of what the source cannot draw."""
        for k in range(self.n if source == "independent" else self.n_rendered * can_render(case.base)):
            make, compared = (Film, k < self.n_compared) if source == "independent" else (RenderedFilm, False)
            yield measure(case, make(case.scene(k), self.seed + k, self.data), compared)

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Success and error against time, a panel a case, ours beside the baselines."""
        cells = _by_source(numbers)
        labels = {"right": ("right_percent", "right (%)"), "error": ("median_mm", "median error (mm)")}
        return {name: against_time(cells, *what) for name, what in labels.items()}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the scores by case, of each source; which goals are met and missed; ours beside the baselines."""
        cells = _by_source(numbers)
        summaries = {"goals": goals_table(cells), "missed": missed_table(cells), "baselines": baselines_table(cells)}
        return {"": scores_table(cells["independent"]), "rendered": scores_table(cells["rendered"]), **summaries}


def _by_source(numbers: dict[str, Any]) -> dict[str, Cells]:
    """The scores by source, case and tracker; none of a source that was not asked for."""
    return {source: numbers.get(source, {}) for source in ("independent", "rendered")}


def _by_tracker(films: list[dict[str, Scores]]) -> dict[str, list[Scores]]:
    return {name: [film[name] for film in films if name in film] for name in films[0]}
