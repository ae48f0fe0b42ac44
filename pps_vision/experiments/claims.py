"""What README.md claims, beside its goal, and what was measured at all: read from the results of the other studies."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pps_vision.experiments.consistency import GOALS, misses
from pps_vision.experiments.pipeline import GOAL_MS, MEANT_FOR
from pps_vision.experiments.study import Study, catalogue
from pps_vision.experiments.tables import Table, estimate, judged, read_numbers

Cells = Mapping[str, Any]
_GOAL_MIN = 180  # of all studies by the clock on two cores


class Claim(NamedTuple):
    """What is claimed, its goal, the study that measures it, and its sentence made from that study's numbers, in which
    what misses the goal is bold."""

    what: str
    goal: str
    study: str
    measured: Callable[[Cells], str]


def _tracking(numbers: Cells) -> str:
    cells = [numbers["cells"][f"rendered, {o}"]["tracker"] for o in ("ball", "marker")]
    errors, tracked = ([cell[key][0] for cell in cells] for key in ("mean_recording_mm", "near_percent"))
    means = " / ".join(judged(f"{mm:.2f}", mm > 1.0) for mm in errors)
    worst = " / ".join(f"{cell['worst_recording_mm'][0]:.2f}" for cell in cells)
    near = " / ".join(judged(f"{percent:.0f}", percent < 99) for percent in tracked)
    return f"{means} mm, worst recording {worst} mm; tracked {near} % of the time"


def _coverage(numbers: Cells) -> str:
    cell, parts = numbers["cells"]["rendered"]["all"], []
    for q in sorted({key.rsplit(" ", 1)[0] for key in cell if key.endswith((" 68", " 95"))}):
        found = {share: cell[f"{q} {share}"][0] for share in GOALS}
        told = (judged(f"{value:.0f}", misses(share, value)) for share, value in found.items())
        parts.append(f"{q} {' / '.join(told)}")
    return ", ".join(parts)


def _pipeline(numbers: Cells) -> str:
    parts = []
    for object_, name in MEANT_FOR.items():
        cell = numbers["cells"][f"rendered, {object_}"]
        ours, csrt = cell[name], cell["two CSRT"]
        ms = judged(f"{ours['ms'][1]:.2f} ms", ours["ms"][1] > GOAL_MS[name])
        parts.append(
            f"{ms}, {1 / ours['ratio'][0]:.0f} times as fast, "
            f"{ours['rms_mm'][0]:.2f} against {csrt['rms_mm'][0]:.1f} mm"
        )
    return "; ".join(parts)


def _trigger(numbers: Cells) -> str:
    cell = numbers["cells"]["independent"]["nothing"]
    ours, without = (cell[name]["alarms_per_minute"][0] for name in ("ours", "ours, without flow"))
    ms = cell["ours"]["ms"][1]
    alarms = judged(f"{ours:.2g}", ours >= 1)
    return f"{alarms} (without optical flow {without:.2g}); {judged(f'{ms:.2f} ms', ms > 1)}"


def _real_ball(numbers: Cells) -> str:
    cell = numbers["cells"]["vot_ball1"]
    ours, csrt = cell["120 particles"], cell["CSRT"]
    overlaps = [1 - c["lost_overlap"][0] for c in (ours, csrt)]
    own = judged(f"{overlaps[0]:.3f}", overlaps[0] < 0.8)
    return f"{own}, CSRT {overlaps[1]:.3f}; {1 / ours['ratio'][0]:.0f} times as fast"


def _loop(numbers: Cells) -> str:
    n, (on, off) = numbers["n"], (numbers[case]["touched"] for case in ("avoidance on", "avoidance off"))
    moved = [numbers[case]["commanded"] for case in ("receding", "static", "own arm")]
    told = ", ".join(judged(str(count), count > 0) for count in moved)
    return f"{judged(str(on), on > 0)} / {judged(str(off), off < n)} of {n}; {told} of {n}"


def _map(numbers: Cells) -> str:
    errors = [numbers["maps"]["ours"][truth]["je"] for truth in ("true", "learned")]
    return " / ".join(judged(f"{je:.2f}", je > 0.2) for je in errors) + " %"


CLAIMS = (
    Claim("3D error of a rendered ball / marker, moving head, 0.25–0.6 m", "≤ 1 mm", "tracking", _tracking),
    Claim(
        "stated 68 / 95 % intervals hold the truth (%; rendered, head moves)",
        "68 ± 5 / 95 ± 3",
        "consistency",
        _coverage,
    ),
    Claim(
        "a rendered stereo pair (320×240) with a ball 36–50 px across; with a marker 10–14 px across; beside two CSRT",
        "≤ 4.5; 0.8 ms",
        "pipeline",
        _pipeline,
    ),
    Claim("false alarms a minute, head turning before photographs; idle image", "< 1; ≤ 1 ms", "trigger", _trigger),
    Claim(
        "IoU on `vot_ball1` (real, 48 px across in 1280×720; choices were made on it)",
        "≥ 0.80",
        "imagetracker",
        _real_ball,
    ),
    Claim(
        "touched by a rendered octopus that stops at the skin, 5–15 cm/s, avoidance on / off; moved without cause",
        "0 / all; 0",
        "loop",
        _loop,
    ),
    Claim(
        "misjudged gaze postures, against true / learned kinematics (simulated, exact fixation)",
        "≤ 0.2 %",
        "reach_whole_paper",
        _map,
    ),
)


@dataclass(frozen=True)
class Claims(Study):
    """What README.md claims beside its goals, and every study with seed, commit and time, from the results that are
    there; run it after the other studies."""

    results: Path = Path("docs/results")
    """Folder of the results."""

    def run(self) -> dict[str, Any]:
        """Return for each claim its text, goal, study and what was measured; for each study how it was run."""
        known, found = catalogue(), {}
        for file in sorted(self.results.glob("*.json")):
            if file.stem in known and "results" not in known[file.stem].defaults():
                found[file.stem] = read_numbers(file)
        claims = [
            {
                "what": claim.what,
                "goal": claim.goal,
                "study": claim.study,
                "measured": claim.measured(found[claim.study]),
            }
            for claim in CLAIMS
            if claim.study in found and "skipped" not in found[claim.study]
        ]
        studies = [
            {"study": name, "what": known[name].summary(), **_run_as(numbers)} for name, numbers in found.items()
        ]
        return {"claims": claims, "studies": studies}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one row a claim; one row a study."""
        rows = [[c["what"], c["goal"], c["measured"], f"`{c['study']}`"] for c in numbers["claims"]]
        studies = []
        for s in numbers["studies"]:
            told = ("–" if s[key] is None else str(s[key]) for key in ("seed", "n", "commit"))
            studies.append([f"`{s['study']}`", s["what"], *told, estimate([s["processor_min"]], 2)])
        minutes = sum(s["processor_min"] for s in numbers["studies"])
        processors = ", ".join(sorted({s["processor"] for s in numbers["studies"]}))
        studies.append(["all of which the time is known", f"Processor: {processors}.", "", "", "", f"{minutes:.0f}"])
        least = judged(f"≥ {minutes / 2:.0f}", minutes / 2 > _GOAL_MIN)
        studies.append(["by the clock on two cores", f"Goal: at most {_GOAL_MIN} min.", "", "", "", least])
        return {
            "": Table(["what", "goal", "measured", "`bench`"], rows),
            "studies": Table(["`bench`", "what it measures", "seed", "n", "commit", "processor minutes"], studies),
        }


def _run_as(numbers: Cells) -> dict[str, Any]:
    """Seed, number of units, commit, time and processor of a result."""
    told = numbers["parameters"]
    return {
        "seed": told.get("seed"),
        "n": told.get("n", numbers.get("n")),
        "commit": numbers["machine"]["commit"],
        "processor_min": numbers["processor_min"],
        "processor": numbers["machine"]["processor"],
    }
