"""The same encounters with and without rendering: do both say the same of our controller?"""

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from pps_vision.app.encounters.encounter import HARMLESS, HAZARDS, Arena, Condition, draw
from pps_vision.app.encounters.kinematic import Outcome, meet
from pps_vision.app.encounters.registry import OURS, new_controller
from pps_vision.app.encounters.rendered import Seen, meet_rendered
from pps_vision.app.encounters.suite import track_rng
from pps_vision.app.encounters.tracks import ERRORS, track_of
from pps_vision.app.encounters.training import learn
from pps_vision.app.simulation import Side
from pps_vision.experiments.encounters import SLOW_M_S, counts, rate, write_rows
from pps_vision.experiments.study import NOISE_SIGMA, SampledStudy, interval, median, run_parts
from pps_vision.experiments.tables import Table, estimate, judged

_LATE_S, _LARGE_M = 0.3, 0.02  # of a track: first known later, larger error


@dataclass(frozen=True)
class EncountersRendered(SampledStudy):
    """Encounters of `encounters` through rendered eyes and the whole pipeline, beside the same ones without rendering:
    touched, commanded, and what differs."""

    n: int = 20
    """Encounters of each of stop, press and through; six tenths as many of each harmless kind."""
    share: float = 1.0
    """Share of R's numbers of approaches that the memories are learned from."""
    json: Path | None = None
    """File for two rows of every encounter, rendered and without rendering, as `encounters` has them."""

    def run(self) -> dict[str, Any]:
        """Return rates of both modes, the paired difference, the track's error, and each encounter that differs."""
        arena = Arena()
        memories = {side: learn(arena, side, self.seed, self.share) for side in get_args(Side)}

        def both(condition: Condition, number: int) -> dict[str, Any]:
            encounter = draw(arena, condition, number, self.seed)
            learned, tracks = (
                memories[encounter.side],
                track_of(arena, encounter, track_rng(self.seed, condition, number)),
            )
            without = meet(arena, learned, encounter, OURS, new_controller(OURS), tracks)
            return compared(meet_rendered(arena, learned, encounter, NOISE_SIGMA, self.seed + number), without)

        some = [(c, k) for c, n in counts(self.n).items() for k in range(n)]
        rows = list(run_parts(self, {f"{c} {k}": partial(both, c, k) for c, k in some}).values())
        write_rows(self.json, [outcome for row in rows for outcome in row["outcomes"]])
        return summary(rows)

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the rates of both modes, the goals, the track's error, and the encounters that differ."""
        rows = [
            [name, str(cell["n"]), estimate(cell["rendered"]), estimate(cell["without"]), estimate(cell["difference"])]
            for name, cell in numbers["rates"].items()
        ]
        limits = numbers["limits"]
        apart = numbers["rates"]["all approaching"]["difference"]
        stop, nearest = numbers["stop, slow"], limits["smallest_self_distance_mm"]
        what = f"stop, ≤ 15 cm/s, {stop['n']} encounters, any part: not touched (%)"
        goals = [
            ["points between both, all approaching", "≤ 10", judged(estimate(apart), abs(apart[0]) > 10)],
            [what, "≥ 99", judged(estimate(stop["untouched"]), stop["untouched"][0] < 99)],
            ["smallest self-collision distance (mm)", "≥ 20", judged(estimate([nearest]), nearest < 20)],
            ["encounters that left a limit", "0", judged(str(limits["left"]), limits["left"] > 0)],
        ]
        tracks = [[name, *map(_both, cell.values())] for name, cell in numbers["tracks"].items()]
        why = [[row["encounter"], row["rendered"], row["without"], row["because"]] for row in numbers["differing"]]
        return {
            "": Table(["", "n", "rendered (%)", "without rendering (%)", "difference (points)"], rows),
            "goals": Table(["rendered", "goal", "measured"], goals),
            "tracks": Table(
                [
                    "object",
                    "track, RMS (mm)",
                    "lasting along, across (mm)",
                    "drawn (mm)",
                    "new along, across (mm)",
                    "drawn (mm)",
                    "first known (s)",
                    "tracked (%)",
                ],
                tracks,
            ),
            "differing": Table(["encounter", "rendered", "without rendering", "cause"], why),
        }


def compared(seen: Seen, without: Outcome) -> dict[str, Any]:
    """Return one encounter's row: both outcomes, and what the rendered track was like."""
    because = _margins(seen.outcome, without)
    if not np.isfinite(seen.first_s):
        because = "never found"
    elif seen.first_s > _LATE_S:
        because = f"found after {seen.first_s:.2f} s"
    elif seen.known < 0.8:
        because = f"known in {100 * seen.known:.0f} % of the frames"
    elif seen.error_m > _LARGE_M:
        because = f"RMS error {1000 * seen.error_m:.0f} mm"
    return {
        "outcomes": [asdict(seen.outcome), asdict(without)],
        "condition": without.condition,
        "number": without.number,
        "object": without.object,
        "speed_m_s": without.speed_m_s,
        "part": f"{without.side} {without.part}",
        "touched": [seen.outcome.touched, without.touched],
        "commands": [seen.outcome.commands, without.commands],
        "distance_m": [seen.outcome.distance_m, without.distance_m],
        "lead_s": [seen.outcome.lead_s, without.lead_s],
        "self_distance_m": seen.outcome.self_distance_m,
        "faults": seen.outcome.faults,
        "error_m": seen.error_m,
        "lasting_m": seen.observed.lasting_m,
        "new_m": seen.observed.new_m,
        "first_s": seen.first_s,
        "known": seen.known,
        "because": because,
    }


def _margins(seen: Outcome, without: Outcome) -> str:
    """Return how two encounters with equal tracks differ: in the distance left, the first command and the lead."""
    apart_mm = 1000 * abs(seen.distance_m - without.distance_m)
    first, lead = (
        " and ".join("–" if value is None else f"{value:.2f} s" for value in values)
        for values in ((seen.first_command_s, without.first_command_s), (seen.lead_s, without.lead_s))
    )
    return f"track as drawn; distances left {apart_mm:.0f} mm apart, first command at {first}, lead {lead}"


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    hazards = [row for row in rows if row["condition"] in HAZARDS]
    groups: dict[str, list[dict[str, Any]]] = {c: [row for row in rows if row["condition"] == c] for c in HAZARDS}
    groups |= {"all approaching": hazards, "harmless": [row for row in rows if row["condition"] in HARMLESS]}
    objects = {name: [row for row in rows if row["object"] == name] for name in ERRORS}
    slow_stop = [row for row in groups["stop"] if row["speed_m_s"] <= SLOW_M_S]
    return {
        "stop, slow": {"n": len(slow_stop), "untouched": rate(slow_stop, lambda row: not row["touched"][0])},
        "rates": {name: _rates(some) for name, some in groups.items()},
        "tracks": {
            name: {
                "rendered_mm": 1000 * median(np.array([row["error_m"] for row in some if row["known"]])),
                "lasting_mm": _rms_mm([row["lasting_m"] for row in some if row["known"]]),
                "lasting_drawn_mm": [1000 * value for value in ERRORS[name].lasting_m],
                "new_mm": _rms_mm([row["new_m"] for row in some if row["known"]]),
                "new_drawn_mm": [1000 * value for value in ERRORS[name].new_m],
                "first_s": median(np.array([row["first_s"] for row in some if row["known"]])),
                "known_percent": 100 * float(np.mean([row["known"] for row in some])) if some else np.nan,
            }
            for name, some in objects.items()
        },
        "differing": [
            {
                "encounter": f"{r['condition']} {r['number']}: {r['object']} at {100 * r['speed_m_s']:.0f} cm/s, "
                f"{r['part']}",
                "rendered": _words(r, 0),
                "without": _words(r, 1),
                "because": r["because"],
            }
            for r in rows
            if r["touched"][0] != r["touched"][1] or (r in groups["harmless"] and any(r["commands"]))
        ],
        "limits": {
            "smallest_self_distance_mm": 1000 * min(row["self_distance_m"] for row in rows),
            "left": sum(bool(row["faults"]) for row in rows),
        },
    }


def _rates(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Rates of what should be: not touched, or of harmless objects no command."""
    good = [
        [not c for c in row["commands"]] if row["condition"] in HARMLESS else [not t for t in row["touched"]]
        for row in rows
    ]
    pairs = [{"good": one} for one in good]
    return {
        "n": len(rows),
        "rendered": rate(pairs, lambda row: bool(row["good"][0])),
        "without": rate(pairs, lambda row: bool(row["good"][1])),
        "difference": interval([[100.0 * (one[0] - one[1])] for one in good]),
    }


def _rms_mm(pairs: list[tuple[float, float]]) -> list[float]:
    """Along and across the line of sight, over encounters."""
    values = 1000 * np.array(pairs).reshape(-1, 2)
    return [float(value) for value in np.sqrt(np.mean(values**2, axis=0))] if len(values) else [np.nan] * 2


def _both(cell: float | list[float]) -> str:
    return ", ".join(estimate([value]) for value in cell) if isinstance(cell, list) else estimate([cell])


def _words(row: dict[str, Any], mode: int) -> str:
    touched = "touched" if row["touched"][mode] else f"{1000 * row['distance_m'][mode]:.0f} mm left"
    return f"{touched}, {row['commands'][mode]} commands"
