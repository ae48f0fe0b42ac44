"""Encounters of the arm with objects: who is touched, who moves without cause, by controller."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binomtest

from pps_vision.experiments.avoidance.encounter import HARMLESS, HAZARDS, SPEED_M_S, Condition
from pps_vision.experiments.avoidance.registry import NAMES, NONE, OURS, REACHING
from pps_vision.experiments.avoidance.suite import Rows, run_suite
from pps_vision.experiments.charts import curves, panels
from pps_vision.experiments.study import SampledStudy, interval, median
from pps_vision.experiments.tables import Table, estimate
from pps_vision.recordings.outputs import whole_file, write_json

SLOW_M_S = 0.15  # up to which objects approached R's robot
_BANDS_M_S = np.linspace(*SPEED_M_S, 6)
_LEAST_SELF_MM = 20.0
_HARMLESS = 0.6  # encounters of each harmless condition for one of each approaching condition, except in this study:
_SHARES: dict[Condition, float] = {
    **dict.fromkeys(HAZARDS, 1.0),
    **dict.fromkeys(HARMLESS, 0.06),
    "stop": 0.2,
    "reach": 0.1,
}
Row = dict[str, Any]


@dataclass(frozen=True)
class Encounters(SampledStudy):
    """Objects at 5–30 cm/s that stop at the would-be contact, press on or fly through, harmless ones, and ones to reach
    for, without rendering: touched, smallest distance, lead and needless commands by controller."""

    n: int = 1500
    """Encounters of each of press and through; a fifth as many of stop, 6 % of each harmless kind, a tenth of `reach`;
    the rate of all approaching objects at 15–30 cm/s is of equal numbers of the three."""
    share: float = 1.0
    """Share of R's numbers of approaches (Table 5) that the memories are learned from."""
    controller: str = ""
    """A further controller, "MODULE:FUNCTION" (`pps_vision.experiments.avoidance.controllers`)."""
    json: Path | None = None
    """File for a row of every encounter."""
    workers: int = 2
    """Parallel processes."""

    def run(self) -> dict[str, Any]:
        """Return rates by condition, speed and controller, and paired differences from ours."""
        names = (*NAMES, self.controller) if self.controller else NAMES
        some = {condition: ceil(share * self.n) for condition, share in _SHARES.items()}
        rows = run_suite(self, some, self.seed, names, self.workers, self.share)
        if self.json is not None:
            with whole_file(self.json) as partial:
                write_json(partial, {"encounters": rows})
        return summary(rows, names)

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the tables: all, by speed, harmless, reaching, and what was left of the limits."""
        return tables(numbers)

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw the share not touched against speed, by controller and condition."""
        figure, axes = panels(len(HAZARDS))
        middle_cm_s = 50 * (_BANDS_M_S[1:] + _BANDS_M_S[:-1])
        for axis, condition in zip(axes, HAZARDS, strict=True):
            series = {name: of["by speed"][condition] for name, of in numbers["controllers"].items() if name != NONE}
            curves(axis, middle_cm_s, series, "speed (cm/s)", "not touched (%)")
            axis.set_title(condition, fontsize=9)
            axis.set_ylim(-2, 102)
        axes[0].legend(fontsize=7)
        return figure


def counts(n: int) -> dict[Condition, int]:
    """Return how many encounters of each condition but `reach` a run of the tuning, or a rendered one, has."""
    return dict.fromkeys(HAZARDS, n) | dict.fromkeys(HARMLESS, ceil(_HARMLESS * n))


def summary(rows: Rows, names: Sequence[str]) -> dict[str, Any]:
    """Return what the tables and the chart show, from a row for each encounter and controller."""
    of = {name: [row for row in rows if row["controller"] == name] for name in names}
    faults = [row for row in rows if row["faults"] or not row["self_distance_m"] * 1000 >= _LEAST_SELF_MM]
    return {
        "encounters": {c: len({row["number"] for row in rows if row["condition"] == c}) for c in (*HAZARDS, *HARMLESS)},
        "controllers": {name: _of_controller(some, of[OURS]) for name, some in of.items()},
        "reaching": {name: _reaching(of[name]) for name in names if name in REACHING},
        "limits": {
            "encounters": len(rows),
            "smallest_self_distance_mm": 1000 * min(row["self_distance_m"] for row in rows),
            "left": len(faults),
        },
    }


def rate(rows: Rows, is_counted: Callable[[Row], bool]) -> list[float]:
    """Return the percentage of rows that count, with Wilson's 95 % interval; NaN of none."""
    if not rows:
        return [np.nan] * 3
    counted = sum(map(is_counted, rows))
    ends = binomtest(counted, len(rows)).proportion_ci(method="wilson")
    return [100 * float(value) for value in (counted / len(rows), ends.low, ends.high)]


def _of_controller(rows: Rows, ours: Rows) -> dict[str, Any]:
    hazards = [row for row in rows if row["condition"] in HAZARDS]
    slow_stop = [row for row in hazards if row["condition"] == "stop" and row["speed_m_s"] <= SLOW_M_S]
    hard = [row for row in hazards if row["condition"] != "stop"]
    as_many = min(sum(row["condition"] == c for row in hazards) for c in HAZARDS)
    fast = [row for row in hazards if row["speed_m_s"] > SLOW_M_S and row["number"] < as_many]
    return {
        "stop, slow": rate(slow_stop, _untouched),
        "stop, slow, distance_mm": _quartiles([1000 * row["distance_m"] for row in slow_stop]),
        "stop, slow, lead_s": _quartiles([row["lead_s"] for row in slow_stop if row["lead_s"] is not None]),
        "untouched": {c: rate([row for row in hazards if row["condition"] == c], _untouched) for c in HAZARDS},
        "by speed": {c: [rate(some, _untouched) for some in _bands(hazards, c)] for c in HAZARDS},
        "press and through": rate(hard, _untouched),
        "press and through, beyond ours": _beyond(hard, ours),
        "fast": rate(fast, _untouched),
        "fast, beyond ours": _beyond(fast, ours),
        "still": {c: rate([row for row in rows if row["condition"] == c], _still) for c in HARMLESS},
        "still, all": rate([row for row in rows if row["condition"] in HARMLESS], _still),
    }


def _reaching(rows: Rows) -> dict[str, Any]:
    """Of all objects, and of those that a posture of the arm touches with the part aimed at."""
    reaches = [row for row in rows if row["condition"] == "reach"]
    reachable = [row for row in reaches if row["reachable"]]
    return {
        "reachable": rate(reaches, lambda row: bool(row["reachable"])),
        "touched": rate(reaches, lambda row: bool(row["touched"])),
        "reachable: touched": rate(reachable, lambda row: bool(row["touched"])),
        "reachable: by the part aimed at": rate(reachable, lambda row: row["touched_part"] == row["part"]),
    }


def _beyond(rows: Rows, ours: Rows) -> list[float]:
    """Return by how many points fewer of the same encounters are touched than with ours, with the 95 % interval of the
    paired difference."""
    touched = {(row["condition"], row["number"]): row["touched"] for row in ours}
    differences = [[100.0 * (touched[row["condition"], row["number"]] - row["touched"])] for row in rows]
    return interval(differences)


def _bands(rows: Rows, condition: str) -> list[Rows]:
    of = [row for row in rows if row["condition"] == condition]
    return [[row for row in of if low <= row["speed_m_s"] < high] for low, high in pairwise(_BANDS_M_S)]


def _untouched(row: Row) -> bool:
    return not row["touched"]


def _still(row: Row) -> bool:
    return not row["commands"]


def _quartiles(values: Sequence[float]) -> list[float]:
    """Return median and quartiles."""
    return [median(np.array(values)), *np.quantile(values, (0.25, 0.75))] if values else [np.nan] * 3


def tables(numbers: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of `summary`."""
    of = numbers["controllers"]
    main = ["stop, slow", "stop, slow, distance_mm", "stop, slow, lead_s", "press and through", "fast", "still, all"]
    header = [
        "controller",
        "stop, ≤ 15 cm/s: not touched (%)",
        "distance left (mm), quartiles",
        "lead (s), quartiles",
        "press, through: not touched (%)",
        "15–30 cm/s: not touched (%)",
        "harmless: no command (%)",
    ]
    differences = ["press and through, beyond ours", "fast, beyond ours"]
    kinds = [c.removeprefix("harmless_").replace("_", " ") for c in HARMLESS]
    limits = numbers["limits"]
    return {
        "": Table(header, [[name, *(estimate(cell[key]) for key in main)] for name, cell in of.items()]),
        "conditions": Table(
            ["not touched (%)", *HAZARDS],
            [[name, *(estimate(cell["untouched"][c]) for c in HAZARDS)] for name, cell in of.items()],
        ),
        "differences": Table(
            ["fewer touched than ours (points)", "press, through", "15–30 cm/s"],
            [[name, *(estimate(cell[key]) for key in differences)] for name, cell in of.items() if name != OURS],
        ),
        "harmless": Table(
            ["no command (%)", *kinds],
            [[name, *(estimate(cell["still"][c]) for c in HARMLESS)] for name, cell in of.items()],
        ),
        "reaching": Table(
            ["reaching (%)", "can be touched", "touched", "touched of these", "of these by the part aimed at"],
            [[name, *(estimate(value) for value in cell.values())] for name, cell in numbers["reaching"].items()],
        ),
        "limits": Table(
            ["limits", "number"],
            [
                ["encounters, all controllers", str(limits["encounters"])],
                ["smallest self-collision distance (mm)", f"{limits['smallest_self_distance_mm']:.1f}"],
                ["encounters that left a limit", str(limits["left"])],
            ],
        ),
    }
