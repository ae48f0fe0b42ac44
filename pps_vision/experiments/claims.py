"""The claims of README.md beside their goals, read from the results of the studies."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pps_vision.experiments.tables import Table, judged, read_numbers
from pps_vision.experiments.tracking import GOAL_MS, MEANT_FOR
from pps_vision.experiments.tracking.consistency import GOALS, QUANTITIES, misses

Cells = Mapping[str, Any]


class Claim(NamedTuple):
    """A claim, its goal, the study that measures it, and the sentence made from the study's numbers; a number that
    misses the goal is bold."""

    title: str
    goal: str
    study: str
    measured: Callable[[Cells], str]
    part: str = ""
    """Part of the study whose numbers `measured` takes; "": the study's own."""


def _tracking(numbers: Cells) -> str:
    cells = [numbers["cells"][f"rendered, {stimulus}"]["tracker"] for stimulus in ("ball", "marker")]
    means = _joined(((cell["mean_recording_mm"][0], cell["mean_recording_mm"][0] > 1.0) for cell in cells), ".2f")
    worst = " / ".join(f"{cell['worst_recording_mm'][0]:.2f}" for cell in cells)
    near = _joined(((cell["near_percent"][0], cell["near_percent"][0] < 99) for cell in cells), ".0f")
    return f"{means} mm, worst recording {worst} mm; tracked {near} % of the time"


def _joined(values: Iterable[tuple[float, bool]], digits: str) -> str:
    """Values, and whether each misses its goal, separated by slashes."""
    return " / ".join(judged(f"{value:{digits}}", missed) for value, missed in values)


def _coverage(numbers: Cells) -> str:
    cell = numbers["cells"]["rendered"]["all"]
    texts = []
    for quantity in sorted(QUANTITIES):
        values = [(cell[f"{quantity} {share}"][0], share) for share in GOALS]
        texts.append(f"{quantity} {_joined(((value, misses(share, value)) for value, share in values), '.0f')}")
    return ", ".join(texts)


def _pipeline(numbers: Cells) -> str:
    parts = []
    for stimulus, name in MEANT_FOR.items():
        cell = numbers["cells"][f"rendered, {stimulus}"]
        ours = cell[name]
        ms = judged(f"{ours['ms'][0]:.2f} ms", ours["ms"][0] > GOAL_MS[name])
        against = f"{ours['rms_mm'][0]:.2f} against {cell['two CSRT']['rms_mm'][0]:.1f} mm"
        parts.append(f"{ms}, {1 / ours['ratio'][0]:.0f} times as fast, {against}")
    return "; ".join(parts)


def _trigger(numbers: Cells) -> str:
    cell = numbers["cells"]["nothing"]
    ours, without = (cell[name]["alarms_per_minute"][0] for name in ("ours", "ours, without flow"))
    ms = cell["ours"]["ms"][0]
    alarms = judged(f"{ours:.2g}", ours >= 1)
    return f"{alarms} (without optical flow {without:.2g}); {judged(f'{ms:.2f} ms', ms > 1)}"


def _real_ball(numbers: Cells) -> str:
    cell = numbers["cells"]["vot_ball1"]
    ours, csrt = (1 - cell[name]["lost_overlap"][0] for name in ("120 particles", "CSRT"))
    ratio = cell["120 particles"]["ratio"][0]
    return f"{judged(f'{ours:.3f}', ours < 0.8)}, CSRT {csrt:.3f}; {1 / ratio:.0f} times as fast"


def _loop(numbers: Cells) -> str:
    n = numbers["n"]
    on, off = (numbers[case]["touched"] for case in ("avoidance on", "avoidance off"))
    moved = [numbers[case]["commanded"] for case in ("receding", "static", "own arm")]
    counts = ", ".join(judged(str(count), count > 0) for count in moved)
    return f"{judged(str(on), on > 0)} / {judged(str(off), off < n)} of {n}; {counts} of {n}"


def _map(numbers: Cells) -> str:
    errors = [numbers["maps"]["ours"][truth]["je"][0] for truth in ("true", "learned")]
    return _joined(((je, je > 0.2) for je in errors), ".2f") + " %"


CLAIMS = (
    Claim("3D error of a rendered ball / marker, moving head, 0.25–0.6 m", "≤ 1 mm", "tracking", _tracking, "accuracy"),
    Claim("stated 68 / 95 % intervals hold the truth (%; rendered, head moves)",
          "68 ± 5 / 95 ± 3", "tracking", _coverage, "consistency"),
    Claim("a rendered stereo pair (320×240) with a ball 36–50 px across; with a marker 10–14 px across; "
          "beside two CSRT", "≤ 4.5; 0.8 ms", "tracking", _pipeline, "pipeline"),
    Claim("false alarms a minute, head turning before photographs; idle image",
          "< 1; ≤ 1 ms", "stages", _trigger, "trigger"),
    Claim("IoU on `vot_ball1` (real, 48 px across in 1280×720; choices were made on it)",
          "≥ 0.80", "stages", _real_ball, "image_tracker"),
    Claim("touched by a rendered octopus that stops at the skin, 5–15 cm/s, avoidance on / off; moved without cause",
          "0 / all; 0", "loop", _loop),
    Claim("misjudged gaze postures, against true / learned kinematics (simulated, exact fixation)",
          "≤ 0.2 %", "reach_paper", _map, "whole_paper"),
)  # fmt: skip


def claims_table(results: Path) -> Table:
    """Return the table of README.md: one row for each claim whose study has a result in the folder.

    Claims on tracking are those on rendered scenes.
    """
    rows = []
    for claim in CLAIMS:
        numbers = read_numbers(results / f"{claim.study}.json")
        numbers = numbers.get(claim.part, {}) if claim.part else numbers
        if numbers and (claim.study != "tracking" or numbers["parameters"]["scenes"] != "independent"):
            rows.append([claim.title, claim.goal, claim.measured(numbers), f"`{claim.study}`"])
    return Table(["what", "goal", "measured", "`bench`"], rows)
