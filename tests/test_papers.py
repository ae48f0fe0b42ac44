"""docs/papers.md: each numbered equation, figure and table of both papers has a row; the studies, modules and figures
that it names exist, and its numbers agree with the results."""

import json
import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
from documents import ROOT

from pps_vision.experiments.study import catalogue

PAGE = (ROOT / "docs" / "papers.md").read_text()
NUMBERS = {
    "R": [
        *(f"eq. {k}" for k in range(1, 7)),
        *(f"Fig {k}" for k in range(1, 16)),
        *("S1 Fig", "S2 Fig"),
        *(f"Table {k}" for k in range(1, 8)),
    ],
    "J": [*(f"eq. IV.{k}" for k in range(1, 8)), *(f"Fig {k}" for k in range(1, 10))],
}
STATES = ("reproduced", "implemented, not reproduced", "absent")
STUDIES = catalogue()


def rows(paper: str) -> dict[str, list[str]]:
    """Rows by number: content, state, place, note."""
    section = PAGE.split(f"\n## {paper}: ")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")][2:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert {len(row) for row in cells} == {5}
    assert len({row[0] for row in cells}) == len(cells)
    return {number: row for number, *row in cells}


@cache
def result(study: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((ROOT / "docs" / "results" / f"{study}.json").read_text())
    return content


@pytest.mark.parametrize("paper", NUMBERS)
def test_every_number_of_a_paper_has_a_row_and_a_state(paper):
    table = rows(paper)
    assert list(table) == NUMBERS[paper]
    for number, (_, state, where, note) in table.items():
        if state == "–":
            assert note.endswith("nothing to reproduce") or "nothing to reproduce;" in note, number
        else:
            assert state in STATES, number
            assert (where == "–") == (state == "absent"), number
            assert note or state == "reproduced", number


@pytest.mark.parametrize("paper", NUMBERS)
def test_studies_modules_and_figures_exist(paper):
    for number, cells in rows(paper).items():
        row = " ".join(cells)
        studies = re.findall(r"`bench (\w+)`", row)
        for study in studies:
            assert study in STUDIES, (number, study)
            assert result(study)["study"] == study
        for module in re.findall(r"`([\w/]+\.py)`", row):
            assert (ROOT / module).is_file(), (number, module)
        for shown, figure in re.findall(r"\[([\w.]+)\]\(figures/([\w.]+)\)", row):
            assert shown == figure, number
            assert (ROOT / "docs" / "figures" / figure).is_file(), (number, figure)
            assert any(re.match(rf"{study}[_.]", figure) for study in studies), (number, figure)
        assert studies or not cells[1].startswith(("reproduced", "implemented")) or number.startswith("eq. "), number


def of_r() -> Iterator[tuple[str, str]]:
    maps = result("pps_taxel")["monte_carlo"]["landscapes"]["landing"]
    offset = maps["noisy, offset −10 cm"]
    crosses = {name: [f"{x:.3g}".replace("-", "−") for x in m["crosses_ttc_0_at_cm"]] for name, m in maps.items()}
    counts = result("pps_taxel")["authors_counts"]
    clean = counts["monte_carlo"]
    trials = counts["fig9"]
    yield "Fig 2", f"{clean['only_ours'] + clean['only_theirs']} of {clean['samples']}"
    yield "Fig 2", "{} cm ({}–{})".format(*crosses["exact"])
    yield "Fig 3", "{} cm ({} to {})".format(*crosses["noisy, offset −10 cm"])
    yield "Fig 3", f"{offset['ridge_width_cm']} cm wide, without noise and offset {maps['exact']['ridge_width_cm']};"
    yield "Fig 3", f"widens it to {maps['noisy']['ridge_width_cm']} only"
    yield "Fig 3", f"{counts['fig3']['l1_percent']:.0f} % of the published counts"
    yield "Fig 3", "{:.1f} to {:.1f} cm".format(min(counts["ridge_cm"].values()), max(counts["ridge_cm"].values()))
    landscapes = result("pps_sessions")["landscapes"]
    sessions = landscapes["sessions"]
    width = {name: f"{session['ridge_width_cm'][0]:.2f}" for name, session in sessions.items()}
    erring = [sessions[name]["ridge_width_erring_cm"] for name in ("motor", "visual")]
    yield "Fig 4", f"{sessions['motor']['samples_of_shown_taxel']} samples"
    yield "Fig 4", f"{width['motor']} cm"
    yield "Fig 5", f"{sessions['visual']['samples_of_shown_taxel']} samples"
    yield "Fig 5", f"width {width['visual']} cm"
    yield "Fig 5", f"({erring[0][0]:.2f} and {erring[1][0]:.2f} cm)"
    assert max(low for _, low, _ in erring) < min(high for _, _, high in erring)  # with R's errors they are as wide
    shown = [sessions[name]["samples_of_shown_taxel"] for name in ("inner", "outer", "palm")]
    yield "Fig 7", "{}, {} and {} samples".format(*shown)
    yield "Fig 7", "width {inner}, {outer} and {palm} cm".format(**width)
    yield "Fig 8", "{:.2f}, {:.2f} and {:.2f} cm".format(*counts["fig8"]["means_cm"])
    parts = result("pps_sessions")["offsets"]["parts"].values()
    yield "Fig 8", "{:.0f}, {:.0f} and {:.0f} mm".format(*(part["found_mm"][0] for part in parts))
    assert trials["only_ours"] == 0
    yield "Fig 9", f"{trials['only_theirs']} of {trials['samples']}"
    single = next(iter(result("pps_taxel")["single_touch"]["approaches"].values()))["centre"]
    yield "Fig 9", f"{single['8×4, σ 1 bin (R, default)']['above_at_lead_percent']} %"
    mean = [np.mean(values) for name, values in landscapes["fig9"].items() if name.endswith(", 53 trials")]
    yield "Fig 9", "{:.3f}, of its neighbour {:.3f}".format(*mean)
    yield "Fig 9", f"rank correlation {landscapes['wrist']['rank_correlation']}"
    avoided = result("encounters")["sessions"]["avoidance"]
    reached = result("encounters")["sessions"]["reaching"]
    yield "Fig 10", f"{avoided['touched']} of {avoided['approaches']} approaches touch"
    yield "Fig 11", f"{reached['touched']} of {reached['approaches']}"
    yield "Fig 11", f"{reached['by the part aimed at']} by the part aimed at"
    met = result("encounters")["controllers"]
    still = {name: row["still"]["harmless_receding"][0] for name, row in met["controllers"].items() if row}
    n = met["encounters"]["harmless_receding"]
    assert still["distance only"] == 0
    yield "S2 Fig", f"such an arm always, ours in {round(n * (1 - still['ours'] / 100))} of {n} encounters"
    table5 = list(sessions.values())
    yield "Table 5", "samples {}, {}, {}, {} and {} (".format(*(session["samples"] for session in table5))
    yield "Table 5", f"({table5[0]['minutes']}, R 31)"
    yield "Table 5", f"({table5[0]['taxels_touched']} are, R 6 of 8)"
    for side in ("left", "right"):
        joints, palm = (spans(side, key) for key in ("joints_deg", "palm_m"))
        yield "Table 6", "{:.1f}, {:.1f}, {:.1f} and {:.1f}°".format(*joints[:4])
        yield "Table 7", f"{side} " + "{:.0f}, {:.0f} and {:.0f} cm".format(*(100 * x for x in palm))


def spans(side: str, key: str) -> list[float]:
    """Ranges over avoidance and reaching together."""
    ranges = [result("encounters")["sessions"][name]["arms"][side][key] for name in ("avoidance", "reaching")]
    lower, upper = (zip(*(ends[k] for ends in ranges), strict=True) for k in (0, 1))
    return [round(max(high) - min(low), 3) for low, high in zip(lower, upper, strict=True)]


def of_j() -> Iterator[tuple[str, str]]:
    solvers = result("stages")["solvers"]["cells"]["RMS optimality lost"]
    whole = result("reach_paper")["whole_paper"]
    lost = (solvers[name]["error"] for name in ("batched, 2 starts", "IPOPT, 2 starts"))
    yield "eq. IV.3", "{:.2g} of optimality, J's solver IPOPT {:.2g}".format(*lost)
    forward = result("reach_kinematics")["forward_model"]["methods"]
    models = {name: rows[-1]["rmse_deg"][0] for name, rows in forward.items()}
    yield "Fig 2", f"{models['LWPR, each sample once']:.2g}° after 4400 samples"
    yield "Fig 2", f"{models['model of revolute joints']:.2g}°"
    smallest, largest = (point["vergence_deg"] for point in whole["extremes"].values())
    yield "Fig 3", f"C {smallest:.1f}° (J 11.17°)"
    yield "Fig 3", f"D, {largest:.1f}° (J 89.15°)"
    ours, theirs = whole["maps"].values()
    keys = ("je", "fn", "fp")
    yield "Fig 4", "{:.2g}, {:.2g} and {:.2g} %, LWPR".format(*(ours["learned"][key][0] for key in keys))
    yield "Fig 4", "LWPR as in J {:.2g}, {:.2g} and {:.2g} %".format(*(theirs["learned"][key][0] for key in keys))
    yield "Fig 6", f"{ours['true']['box_je'][0]:.2g} %, LWPR as in J {theirs['true']['box_je'][0]:.2g} %"
    degree = [method["learned"]["degree_rmse"][0] for method in (ours, theirs)]
    yield "Fig 7", "{:.2g}, LWPR as in J {:.2g}".format(*degree)


@pytest.mark.parametrize(("paper", "numbers"), [("R", of_r), ("J", of_j)])
def test_our_numbers_are_those_of_the_results(paper, numbers):
    notes = {number: row[-1] for number, row in rows(paper).items()}
    wrong = [f"{number}: the results say {text!r}" for number, text in numbers() if text not in notes[number]]
    assert not wrong
