"""What README.md claims, beside its goal, and what was measured at all: read from the results of the other studies."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pps_vision.experiments.study import Study, catalogue
from pps_vision.experiments.tables import Table, estimate

Cells = Mapping[str, Any]


class Claim(NamedTuple):
    """What is claimed, its goal, the study that measures it, and its sentence made from that study's numbers."""

    what: str
    goal: str
    study: str
    measured: Callable[[Cells], str]


def _tracking(numbers: Cells) -> str:
    cells = [numbers["cells"][f"rendered, {o}"]["tracker"] for o in ("ball", "marker")]
    means = " / ".join(f"{cell['mean_recording_mm'][0]:.2f}" for cell in cells)
    worst = " / ".join(f"{cell['worst_recording_mm'][0]:.2f}" for cell in cells)
    tracked = " / ".join(f"{cell['near_percent'][0]:.0f}" for cell in cells)
    return f"{means} mm, worst recording {worst} mm; tracked {tracked} % of the time"


def _coverage(numbers: Cells) -> str:
    cell = numbers["cells"]["rendered"]["all"]
    quantities = sorted({key.rsplit(" ", 1)[0] for key in cell if key.endswith((" 68", " 95"))})
    return ", ".join(f"{q} {cell[f'{q} 68'][0]:.0f} / {cell[f'{q} 95'][0]:.0f}" for q in quantities)


def _pipeline(numbers: Cells) -> str:
    parts = []
    for object_, mode in (("ball", "generic"), ("marker", "marker")):
        cell = numbers["cells"][f"rendered, {object_}"]
        ours, csrt = cell[f"ours, {mode}"], cell["two CSRT"]
        parts.append(
            f"{ours['ms'][1]:.2f} ms, {1 / ours['ratio'][0]:.0f} times as fast, "
            f"{ours['rms_mm'][0]:.2f} against {csrt['rms_mm'][0]:.1f} mm"
        )
    return "; ".join(parts)


def _trigger(numbers: Cells) -> str:
    cell = numbers["cells"]["independent"]["nothing"]
    alarms = [cell[name]["alarms_per_minute"][0] for name in ("ours", "ours, without flow")]
    return f"{alarms[0]:.2g} (without optical flow {alarms[1]:.2g}); {cell['ours']['ms'][1]:.2f} ms"


def _real_ball(numbers: Cells) -> str:
    cell = next(cell for name, cell in numbers["cells"].items() if "vot" in name)
    ours, csrt = cell["120 particles"], cell["CSRT"]
    overlaps = [1 - c["lost_overlap"][0] for c in (ours, csrt)]
    return f"{overlaps[0]:.3f}, CSRT {overlaps[1]:.3f}; {1 / ours['ratio'][0]:.0f} times as fast"


def _loop(numbers: Cells) -> str:
    n, touched = numbers["n"], [numbers[case]["touched"] for case in ("avoidance on", "avoidance off")]
    moved = [numbers[case]["commanded"] for case in ("receding", "static", "own arm")]
    return f"{touched[0]} / {touched[1]} of {n}; {', '.join(map(str, moved))} of {n}"


def _contact(numbers: Cells) -> str:
    of, base = (numbers["methods"][m]["blocked"] for m in ("displacement (ours)", "base rate"))
    gain, low, high = of["gain"]
    return f"Brier {of['brier'][0]:.3f} ({base['brier'][0]:.3f}), lower by {gain:.3f} ({low:.3f}–{high:.3f})"


def _map(numbers: Cells) -> str:
    return " / ".join(f"{numbers['maps']['ours'][truth]['je']:.2f}" for truth in ("true", "learned")) + " %"


CLAIMS = (
    Claim("3D error of a rendered ball / marker, moving head, 0.25–0.6 m", "≤ 1 mm", "tracking", _tracking),
    Claim("stated 68 / 95 % intervals hold the truth (%)", "68 ± 5 / 95 ± 3", "consistency", _coverage),
    Claim("a stereo pair with a ball; with a marker; beside two CSRT", "≤ 4.5; 0.8 ms", "pipeline", _pipeline),
    Claim("false alarms a minute, head turning before photographs; idle image", "< 1; ≤ 1 ms", "trigger", _trigger),
    Claim("IoU on `vot_ball1` (real; choices were made on it)", "≥ 0.80", "imagetracker", _real_ball),
    Claim("touched by what stops at the skin, avoidance on / off; moved without cause", "0 / all; 0", "loop", _loop),
    Claim("contact on a real robot, quarters of 37 trials (base rate)", "not above", "pps_real_trials", _contact),
    Claim("misjudged gaze postures, against true / learned kinematics", "≤ 0.2 %", "reach_whole_paper", _map),
)


def _without_null(value: Any) -> Any:
    """NaN instead of null: a short run has numbers that nothing was measured for."""
    if isinstance(value, dict):
        return {key: _without_null(x) for key, x in value.items()}
    if isinstance(value, list):
        return [_without_null(x) for x in value]
    return math.nan if value is None else value


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
            if file.stem in known and "results" not in known[file.stem].fields:
                found[file.stem] = _without_null(json.loads(file.read_text()))
        claims = [
            {
                "what": claim.what,
                "goal": claim.goal,
                "study": claim.study,
                "measured": claim.measured(found[claim.study]),
            }
            for claim in CLAIMS
            if claim.study in found
        ]
        studies = [{"study": name, "what": known[name].summary, **_run_as(numbers)} for name, numbers in found.items()]
        return {"claims": claims, "studies": studies}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one row a claim; one row a study."""
        rows = [[c["what"], c["goal"], c["measured"], f"`{c['study']}`"] for c in numbers["claims"]]
        studies = []
        for s in numbers["studies"]:
            told = ("–" if s[key] is None else str(s[key]) for key in ("seed", "n", "commit"))
            studies.append([f"`{s['study']}`", s["what"], *told, estimate([s["processor_min"]], 2)])
        minutes = sum(s["processor_min"] or 0.0 for s in numbers["studies"])
        studies.append(["all of which the time is known", "", "", "", "", f"{minutes:.0f}"])
        return {
            "": Table(["what", "goal", "measured", "`bench`"], rows),
            "studies": Table(["`bench`", "what it measures", "seed", "n", "commit", "processor minutes"], studies),
        }


def _run_as(numbers: Cells) -> dict[str, Any]:
    """Seed, number of units, commit and time of a result."""
    told = numbers["parameters"]
    commit, minutes = numbers["machine"]["commit"], numbers.get("processor_min")
    return {"seed": told.get("seed"), "n": told.get("n", numbers.get("n")), "commit": commit, "processor_min": minutes}
