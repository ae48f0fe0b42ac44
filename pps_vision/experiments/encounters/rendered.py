"""The same encounters with and without rendering."""

from typing import Any, get_args

import numpy as np
from tqdm import tqdm

from pps_vision.app.encounters.encounter import HARMLESS, HAZARDS, EncounterScene, draw
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import OURS, new_controller
from pps_vision.app.encounters.rendered import render_encounter
from pps_vision.app.encounters.suite import track_rng
from pps_vision.app.encounters.tracks import ERRORS, track_of
from pps_vision.app.encounters.training import learn
from pps_vision.app.simulation import Side
from pps_vision.experiments.encounters.parameters import EncountersParameters, counts, rate
from pps_vision.experiments.study import NOISE_SIGMA, interval, median
from pps_vision.experiments.tables import Table, estimate, judged

Row = dict[str, Any]


def run(study: EncountersParameters) -> dict[str, Any]:
    """Return rates of both modes, their paired difference, and the errors of the rendered tracks."""
    scene = EncounterScene()
    memories = {side: learn(scene, side, study.seed, study.share) for side in get_args(Side)}
    numbers = [(condition, k) for condition, n in counts(study.n_rendered).items() for k in range(n)]
    rows: list[Row] = []
    for condition, number in tqdm(numbers, desc="rendered encounters", disable=None):
        encounter = draw(scene, condition, number, study.seed)
        memory = memories[encounter.side]
        tracks = track_of(scene, encounter, track_rng(study.seed, condition, number))
        simulated = simulate_encounter(scene, memory, encounter, OURS, new_controller(OURS), tracks)
        rendered = render_encounter(scene, memory, encounter, NOISE_SIGMA, study.seed + number)
        is_harmless = condition in HARMLESS
        results = (rendered.result, simulated)
        rows.append(
            {
                "condition": condition,
                "object": encounter.stimulus,
                "good": [not (result.commands if is_harmless else result.touched) for result in results],
                "self_distance_m": rendered.result.self_distance_m,
                "has_fault": bool(rendered.result.faults),
                "error_m": rendered.error_m,
                "constant_m": rendered.observed.constant_m,
                "random_m": rendered.observed.random_m,
                "tracked_share": rendered.tracked_share,
            }
        )
    return summary(rows)


def summary(rows: list[Row]) -> dict[str, Any]:
    """Return the rates by condition, and the errors by object."""
    groups: dict[str, list[Row]] = {c: [row for row in rows if row["condition"] == c] for c in HAZARDS}
    groups["all approaching"] = [row for row in rows if row["condition"] in HAZARDS]
    groups["harmless"] = [row for row in rows if row["condition"] in HARMLESS]
    tracked = {name: [row for row in rows if row["object"] == name and row["tracked_share"]] for name in ERRORS}
    return {
        "rates": {
            name: {
                "n": len(group),
                "rendered": rate(group, lambda row: bool(row["good"][0])),
                "without": rate(group, lambda row: bool(row["good"][1])),
                "difference": interval([[100.0 * (row["good"][0] - row["good"][1])] for row in group]),
            }
            for name, group in groups.items()
        },
        "tracks": {
            name: {
                "rendered_mm": 1000 * median(np.array([row["error_m"] for row in group])),
                "constant_mm": _rms_mm([row["constant_m"] for row in group]),
                "constant_drawn_mm": [1000 * value for value in ERRORS[name].constant_m],
                "random_mm": _rms_mm([row["random_m"] for row in group]),
                "random_drawn_mm": [1000 * value for value in ERRORS[name].random_m],
            }
            for name, group in tracked.items()
        },
        "limits": {
            "smallest_self_distance_mm": 1000 * min(row["self_distance_m"] for row in rows),
            "left": sum(row["has_fault"] for row in rows),
        },
    }


def _rms_mm(pairs: list[tuple[float, float]]) -> list[float]:
    """RMS along and across the line of sight, over encounters."""
    values = 1000 * np.array(pairs).reshape(-1, 2)
    return [float(value) for value in np.sqrt(np.mean(values**2, axis=0))] if len(values) else [np.nan] * 2


def table(numbers: dict[str, Any]) -> Table:
    """Return the rates of both modes; a difference that misses its goal is bold."""
    rows = []
    for name in ("all approaching", "harmless"):
        cell = numbers["rates"][name]
        difference = judged(estimate(cell["difference"]), abs(cell["difference"][0]) > 10)
        rows.append([name, str(cell["n"]), estimate(cell["rendered"]), estimate(cell["without"]), difference])
    return Table(["not touched, harmless: no command (%)", "n", "rendered", "not rendered", "difference"], rows)
