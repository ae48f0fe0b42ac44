"""Encounters of the arm with objects: who is touched, who moves without cause, by controller."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.encounters.encounter import FAST_M_S, HARMLESS, HAZARDS, SPEED_M_S, Condition
from pps_vision.app.encounters.registry import ASKING, BASELINES, NAMES, NONE, OURS, REACHING, TRUE
from pps_vision.app.encounters.suite import Rows, run_suite
from pps_vision.experiments.charts import curves, panels
from pps_vision.experiments.study import SampledStudy, interval, kept_folder, median, percent_of
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.recordings.outputs import whole_file, write_json
from pps_vision.types import Array

SLOW_M_S = 0.15  # up to which objects approached R's robot
_BANDS_M_S, _FAST_BANDS_M_S = np.linspace(*SPEED_M_S, 6), np.linspace(*FAST_M_S, 4)
_LEAST_SELF_MM = 20.0
_HARMLESS = 0.6  # encounters of each harmless condition for one of each approaching condition, except in this study:
_SHARES: dict[Condition, float] = {
    **dict.fromkeys(HAZARDS, 1.0),
    **dict.fromkeys(HARMLESS, 0.06),
    "stop": 0.2,
    "reach": 0.1,
    "through_fast": 0.1,
}
_REACHING = {
    "can be touched": "reachable",
    "touched": "touched",
    "touched of what can be": "reachable: touched",
    "by the part aimed at": "reachable: by the part aimed at",
    "attempted of what cannot be": "out of reach: attempted",
}
Row = dict[str, Any]


@dataclass(frozen=True)
class Encounters(SampledStudy):
    """Objects at 5–30 cm/s that stop at the would-be contact, press on or fly through, harmless ones, and ones to reach
    for, without rendering: touched, smallest distance, lead and needless commands by controller."""

    n: int = 1500
    """Encounters of each of press and through; a fifth as many of stop, 6 % of each harmless kind, a tenth of `reach`
    and of through at 30–60 cm/s; the rate of all approaching objects at 15–30 cm/s is of equal numbers of the three."""
    share: float = 1.0
    """Share of R's numbers of approaches (Table 5) that the memories are learned from."""
    controller: str = ""
    """A further controller, "MODULE:FUNCTION" (`pps_vision.app.encounters.controllers`)."""
    json: Path | None = None
    """File for a row of every encounter."""
    workers: int = 2
    """Parallel processes."""

    def run(self) -> dict[str, Any]:
        """Return rates by condition, speed and controller, and paired differences from ours."""
        names = (*NAMES, self.controller) if self.controller else NAMES
        some = {condition: ceil(share * self.n) for condition, share in _SHARES.items()}
        rows = run_suite(kept_folder(self), some, self.seed, (*names, ASKING), self.workers, self.share)
        write_rows(self.json, rows)
        return summary(rows, names)

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the tables: all, goals, by condition, beyond 30 cm/s, harmless, reaching, and what was left of the
        limits."""
        return tables(numbers)

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw the share not touched against speed, by controller and condition."""
        figure, axes = panels(len(HAZARDS))
        bands = np.concatenate([_BANDS_M_S, _FAST_BANDS_M_S[1:]])
        middle_cm_s = 50 * (bands[1:] + bands[:-1])
        for axis, condition in zip(axes, HAZARDS, strict=True):
            fast = condition == "through"
            series = {
                name: of["by speed"][condition] + (of["fast through, by speed"] if fast else [])
                for name, of in numbers["controllers"].items()
                if name != NONE
            }
            n = len(series[OURS])
            curves(axis, middle_cm_s[:n], series, "speed (cm/s)", "not touched (%)")
            axis.set_title(condition, fontsize=9)
            axis.set_ylim(-2, 102)
        axes[0].legend(fontsize=7)
        return figure


def counts(n: int) -> dict[Condition, int]:
    """Return how many encounters of each condition but `reach` a run of the tuning, or a rendered one, has."""
    return dict.fromkeys(HAZARDS, n) | dict.fromkeys(HARMLESS, ceil(_HARMLESS * n))


def write_rows(file: Path | None, rows: Rows) -> None:
    """Write a row of every encounter, if there is a file for them."""
    if file is not None:
        with whole_file(file) as partial:
            write_json(partial, {"encounters": rows})


def summary(rows: Rows, names: Sequence[str]) -> dict[str, Any]:
    """Return what the tables and the chart show, from a row for each encounter and controller."""
    of = {name: [row for row in rows if row["controller"] == name] for name in (*names, ASKING)}
    faults = [row for row in rows if row["faults"] or not row["self_distance_m"] * 1000 >= _LEAST_SELF_MM]
    return {
        "encounters": {c: len({row["number"] for row in rows if row["condition"] == c}) for c in (*HAZARDS, *HARMLESS)},
        "controllers": {name: _of_controller(of[name], of[OURS]) for name in names},
        "reaching": {name: _reaching(of[name]) for name in REACHING if name in of},
        "limits": {
            "encounters": len(rows),
            "smallest_self_distance_mm": 1000 * min(row["self_distance_m"] for row in rows),
            "left": len(faults),
        },
    }


def rate(rows: Rows, is_counted: Callable[[Row], bool]) -> list[float]:
    """Return the percentage of rows that count, with Wilson's 95 % interval; NaN of none."""
    return percent_of(sum(map(is_counted, rows)), len(rows))


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
        "by speed": {c: [rate(some, _untouched) for some in _bands(hazards, c, _BANDS_M_S)] for c in HAZARDS},
        "fast through, by speed": [rate(some, _untouched) for some in _bands(rows, "through_fast", _FAST_BANDS_M_S)],
        "press and through": rate(hard, _untouched),
        "press and through, beyond ours": _beyond(hard, ours),
        "fast": rate(fast, _untouched),
        "fast, beyond ours": _beyond(fast, ours),
        "still": {c: rate([row for row in rows if row["condition"] == c], _still) for c in HARMLESS},
        "still, all": rate([row for row in rows if row["condition"] in HARMLESS], _still),
    }


def _reaching(rows: Rows) -> dict[str, Any]:
    """Of all objects, of those that a posture of the arm touches with the part aimed at, and of the others."""
    reaches = [row for row in rows if row["condition"] == "reach"]
    reachable = [row for row in reaches if row["reachable"]]
    return {
        "reachable": rate(reaches, lambda row: bool(row["reachable"])),
        "touched": rate(reaches, lambda row: bool(row["touched"])),
        "reachable: touched": rate(reachable, lambda row: bool(row["touched"])),
        "reachable: by the part aimed at": rate(reachable, lambda row: row["touched_part"] == row["part"]),
        "out of reach: attempted": rate([row for row in reaches if not row["reachable"]], lambda row: not _still(row)),
    }


def _beyond(rows: Rows, ours: Rows) -> list[float]:
    """Return by how many points fewer of the same encounters are touched than with ours, with the 95 % interval of the
    paired difference."""
    touched = {(row["condition"], row["number"]): row["touched"] for row in ours}
    differences = [[100.0 * (touched[row["condition"], row["number"]] - row["touched"])] for row in rows]
    return interval(differences)


def _bands(rows: Rows, condition: str, bands: Array) -> list[Rows]:
    of = [row for row in rows if row["condition"] == condition]
    return [[row for row in of if low <= row["speed_m_s"] < high] for low, high in pairwise(bands)]


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
        "goals": Table(["ours", "goal", "measured"], _goals(numbers)),
        "fast": _fast_table(of),
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
            ["reaching (%)", *_REACHING],
            [[n, *(estimate(cell[k]) for k in _REACHING.values())] for n, cell in numbers["reaching"].items()],
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


def _goals(numbers: dict[str, Any]) -> list[list[str]]:
    """Return what ours is to achieve, and what was measured; the measured value, not its interval, meets a goal."""
    of, limits, reaching = numbers["controllers"], numbers["limits"], numbers["reaching"]
    ours, both, smallest_mm = of[OURS], "press and through, beyond ours", limits["smallest_self_distance_mm"]
    apart = {name: _above(of[name][both]) for name in (*BASELINES, TRUE)}
    best = min(BASELINES, key=lambda name: apart[name][0])
    fast, aimed = _above(of[TRUE]["fast, beyond ours"]), reaching[OURS]["reachable: by the part aimed at"]
    still, stop = ours["still, all"], ours["stop, slow"]
    left_mm, lead_s = ours["stop, slow, distance_mm"], ours["stop, slow, lead_s"]
    attempted = reaching[ASKING]["out of reach: attempted"]
    rows: list[tuple[str, str, Sequence[float], bool]] = [
        ("stop, ≤ 15 cm/s: not touched (%)", "≥ 99", stop, stop[0] >= 99),
        ("the same: distance left (mm), quartiles", "≥ 20 in the median", left_mm, left_mm[0] >= 20),
        ("the same: lead (s), quartiles", "≥ 0.4 in the median", lead_s, lead_s[0] >= 0.4),
        ("press, through: points above true positions", "≥ −3", apart[TRUE], apart[TRUE][0] >= -3),
        ("the same: above distance only", "≥ 15", apart["distance only"], apart["distance only"][0] >= 15),
        (f"the same: above the best baseline ({best})", "> 0", apart[best], apart[best][0] > 0),
    ]
    for condition in ("press", "through"):
        best = max(BASELINES, key=lambda name: of[name]["untouched"][condition][0])
        above = ours["untouched"][condition][0] - of[best]["untouched"][condition][0]
        rows.append((f"{condition} alone: above its best baseline ({best})", "> 0", [above], above > 0))
    rows += [
        ("15–30 cm/s: points above true positions", "≥ −5", fast, fast[0] >= -5),
        ("harmless: no command (%)", "≥ 99", still, still[0] >= 99),
        ("reaching: touched by the part aimed at, of what can be (%)", "≥ 98", aimed, aimed[0] >= 98),
        ("asking the map: attempted of what cannot be (%)", "0", attempted, attempted[0] == 0),
        ("smallest self-collision distance (mm)", "≥ 20", [smallest_mm], smallest_mm >= _LEAST_SELF_MM),
        ("encounters that left a limit", "0", [limits["left"]], limits["left"] == 0),
    ]
    return [[what, goal, judged(estimate(value), not is_met)] for what, goal, value, is_met in rows]


def _above(beyond: Sequence[float]) -> list[float]:
    """Return by how many points ours is above another controller, from those by which that one is above ours."""
    value, low, high = beyond
    return [0.0 - value, 0.0 - high, 0.0 - low]


def _fast_table(controllers: dict[str, Any]) -> Table:
    """Return the rates of what flies through ever faster, and the first band in which most of it touches."""
    bands = [f"{100 * low:.0f}–{100 * high:.0f}" for low, high in pairwise([_BANDS_M_S[-2], *_FAST_BANDS_M_S])]
    rows = []
    for name, cell in controllers.items():
        rates = [cell["by speed"]["through"][-1], *cell["fast through, by speed"]]
        broken = next((band for band, value in zip(bands, rates, strict=True) if value[0] < 50), "–")
        rows.append([name, *map(estimate, rates), broken])
    return Table(["through: not touched (%)", *(f"{band} cm/s" for band in bands), "most touched at (cm/s)"], rows)
