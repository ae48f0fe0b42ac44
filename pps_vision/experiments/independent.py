"""Tracking on independent scenes, case by case, as it is."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from pps_vision.errors import InputError
from pps_vision.experiments.independent_cases import CASES, Case
from pps_vision.experiments.independent_films import Film
from pps_vision.experiments.independent_scenes import PHOTOS
from pps_vision.experiments.study import DATA, Study
from pps_vision.experiments.tables import Table, estimate
from pps_vision.experiments.timing import timed_steps
from pps_vision.types import Array, Mask, Status, StereoFrame, Track3D, Truth
from tracking.tracker import Tracker, TrackerParams

RIGHT_M = 0.03
FALSE_M = 0.05
SETTLE_S = 1.0
_CHI2_95 = 7.815  # of three degrees of freedom


@dataclass(frozen=True)
class Independent(Study):
    """Every case of the tracking table on scenes that share no code with our renderer.

    Right: status tracking, less than 30 mm off, as a share of the frames from 1 s on (of `start` rest: from 1 s after
    the object first moves) in which both eyes see at least half of the object.  False claim: status tracking, more
    than 50 mm off, as a share of all frames.  Medians of the error and of the stated standard deviation (geometric mean
    of the three axes), and coverage of the 95 % ellipsoid: over the frames of the first share with status tracking.
    Of two balls that nothing tells apart either may be tracked, but the same one throughout: all numbers refer to the
    ball for which most frames are right.
    """

    n: int = 6
    """Films of each case, over different photographs."""
    seed: int = 0
    """Seed of the first film of a case; the others count up."""
    data: Path = DATA
    """Folder of the photographs (default: PPS_VISION_DATA, else ../shared/data); procedural where they are absent."""
    only: str = ""
    """Only the cases whose names contain this."""

    def run(self) -> dict[str, object]:
        """By case: each film's scores, and their means."""
        chosen = [case for case in CASES if self.only in case.name]
        if not chosen:
            raise InputError("bench independent", f"--only {self.only!r}; expected a part of a case's name")
        found: dict[str, Any] = {}
        for case in tqdm(chosen, desc="independent scenes", unit="case", disable=None):
            films = [measure(case, k, self.seed + k, self.data) for k in range(self.n)]
            found[case.name] = {"films": films, **mean_score(films)}
            tqdm.write(f"{case.name}: right {found[case.name]['right_percent']:.0f} %")
        absent = [name for name in PHOTOS if not (self.data / name).exists()]
        return {"cases": found, "procedural_instead_of": absent}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """One row a case: right and falsely claimed, error, coverage, time; a dot a film."""
        names = list(numbers["cases"])[::-1]
        figure = Figure((15, 0.27 * len(names) + 1.4), layout="constrained")
        axes = figure.subplots(1, 4, sharey=True)
        for y, name in enumerate(names):
            films = numbers["cases"][name]["films"]
            for axis, key, color in (
                (axes[0], "right_percent", "tab:blue"),
                (axes[0], "false_percent", "tab:red"),
                (axes[1], "median_mm", "tab:blue"),
                (axes[2], "covered_percent", "tab:blue"),
                (axes[3], "ms_per_pair", "tab:blue"),
            ):
                x = np.array([film[key] for film in films], dtype=float)
                marker = "x" if color == "tab:red" else "o"
                axis.plot(x, np.full(len(x), y), marker, color=color, ms=5, alpha=0.7)
        axes[0].plot([], [], "o", color="tab:blue", label="right")
        axes[0].plot([], [], "x", color="tab:red", label="false claim")
        axes[0].legend(fontsize=8, loc="upper center")
        axes[0].set_yticks(range(len(names)), names, fontsize=8)
        axes[2].axvline(95, color="0.25", lw=1, ls="--")
        for axis, label in zip(
            axes,
            (
                "frames (%)",
                "median error where tracking (mm)",
                "in the 95 % ellipsoid (%)",
                "processor time (ms per pair)",
            ),
            strict=True,
        ):
            axis.set_xlabel(label)
            axis.grid(alpha=0.25)
        axes[1].set_xscale("log")
        axes[3].set_xscale("log")
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one row a case: means over its films."""
        columns = {
            "right (%)": "right_percent",
            "false claims (%)": "false_percent",
            "median error (mm)": "median_mm",
            "95 % ellipsoid (%)": "covered_percent",
            "stated σ (mm)": "stated_mm",
            "ms per pair": "ms_per_pair",
        }
        cases = numbers["cases"].items()
        rows = [[name, *(estimate([cell[key]]) for key in columns.values())] for name, cell in cases]
        return {"": Table(["case", *columns], rows)}


def measure(case: Case, number: int, seed: int, data: Path) -> dict[str, float]:
    """Track one film with nothing but its rig known."""
    film = Film(case.scene(number), seed, data)
    return scored(case, film, film, case.tracker(film.hue_deg))


def scored(case: Case, film: Film, frames: Iterable[StereoFrame], params: TrackerParams) -> dict[str, float]:
    """Track a film's frames and score the tracks."""
    tracker = Tracker(params, film.rig, np.random.default_rng(film.seed))
    steps, ms = timed_steps(tracker.step, frames)
    scene, tracks = film.scene, [step.track for step in steps]
    moves_at_s = scene.rest_s if scene.start == "rest" else 0.0
    told_which = case.marker and scene.second != "same"
    truths = film.truths[: 1 if told_which else None]
    return {**score_of_either(tracks, truths, moves_at_s), "ms_per_pair": float(np.median(ms))}


def score_of_either(
    tracks: Sequence[Track3D], truths: Sequence[Sequence[Truth]], moves_at_s: float = 0.0
) -> dict[str, float]:
    """`score` by the one of several objects for which most frames are right: a track that changes from one to another
    is wrong for a part of the film."""
    return max((score(tracks, truth, moves_at_s) for truth in truths), key=lambda one: one["right_percent"])


def score(tracks: Sequence[Track3D], truth: Sequence[Truth], moves_at_s: float = 0.0) -> dict[str, float]:
    """Percentages and median error of one film, as `Independent` defines them; NaN where nothing counts."""
    error = np.array([np.linalg.norm(t.position - row.position) for t, row in zip(tracks, truth, strict=True)])
    claimed = np.array([track.status == Status.TRACKING for track in tracks])
    both = np.array([row.visible_left and row.visible_right for row in truth])
    judged = both & np.array([row.stamp_s >= moves_at_s + SETTLE_S for row in truth])
    known = judged & claimed
    covered = [_is_covered(t, row.position) for t, row, k in zip(tracks, truth, known, strict=True) if k]
    stated_m = [np.linalg.det(track.cov[:3, :3]) ** (1 / 6) for track, k in zip(tracks, known, strict=True) if k]
    return {
        "judged": int(judged.sum()),
        "right_percent": _percent((claimed & (error < RIGHT_M))[judged]),
        "false_percent": _percent(claimed & (error > FALSE_M)),
        "median_mm": 1000 * float(np.median(error[known])) if known.any() else np.nan,
        "covered_percent": _percent(np.array(covered, dtype=bool)),
        "stated_mm": 1000 * float(np.median(stated_m)) if stated_m else np.nan,
    }


def _percent(hits: Mask) -> float:
    return 100 * float(np.mean(hits)) if len(hits) else np.nan


def _is_covered(track: Track3D, position: Array) -> bool:
    """Whether the truth lies in the ellipsoid that should hold it 95 times of 100."""
    away = track.position - position
    return bool(away @ np.linalg.solve(track.cov[:3, :3], away) <= _CHI2_95)


def mean_score(films: Sequence[dict[str, float]]) -> dict[str, float]:
    """Mean over the films in which there is a value; NaN where there is none."""
    columns = {key: np.array([film[key] for film in films], dtype=float) for key in films[0]}
    return {key: float(np.nanmean(x)) if np.isfinite(x).any() else np.nan for key, x in columns.items()}
