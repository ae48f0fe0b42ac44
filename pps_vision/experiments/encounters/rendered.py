"""The same encounters with and without rendering."""

from typing import Any, get_args

from tqdm import tqdm

from pps_vision.app.encounters.encounter import HARMLESS, HAZARDS, EncounterScene, draw
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import OURS, new_controller
from pps_vision.app.encounters.rendered import render_encounter
from pps_vision.app.encounters.suite import track_rng
from pps_vision.app.encounters.tracks import track_of
from pps_vision.app.encounters.training import learn
from pps_vision.app.simulation import Side
from pps_vision.experiments.encounters.parameters import EncountersParameters, counts, rate
from pps_vision.experiments.study import NOISE_SIGMA, interval
from pps_vision.experiments.tables import Table, estimate, judged

Row = dict[str, Any]


def run(study: EncountersParameters) -> dict[str, Any]:
    """Return rates of both modes and their paired difference."""
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
        rows.append({
            "condition": condition,
            "good": [not (result.commands if is_harmless else result.touched) for result in results],
        })  # fmt: skip
    return summary(rows)


def summary(rows: list[Row]) -> dict[str, Any]:
    """Return the rates by condition."""
    groups: dict[str, list[Row]] = {c: [row for row in rows if row["condition"] == c] for c in HAZARDS}
    groups["all approaching"] = [row for row in rows if row["condition"] in HAZARDS]
    groups["harmless"] = [row for row in rows if row["condition"] in HARMLESS]
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
    }


def table(numbers: dict[str, Any]) -> Table:
    """Return the rates of both modes; a difference that misses its goal is bold."""
    rows = []
    for name in ("all approaching", "harmless"):
        cell = numbers["rates"][name]
        difference = judged(estimate(cell["difference"]), abs(cell["difference"][0]) > 10)
        rows.append([name, str(cell["n"]), estimate(cell["rendered"]), estimate(cell["without"]), difference])
    return Table(["not touched, harmless: no command (%)", "n", "rendered", "not rendered", "difference"], rows)
