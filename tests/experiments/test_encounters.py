"""Rates, sessions and the search for parameters of the encounters' study."""

import json
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from pps_vision.app.encounters.encounter import HAZARDS, EncounterScene
from pps_vision.app.encounters.kinematic import FrameLog
from pps_vision.app.encounters.postures import start_posture
from pps_vision.app.encounters.registry import ASKING, BASELINES, NAMES, OURS
from pps_vision.app.encounters.training import learn
from pps_vision.app.encounters.tuned import TUNED
from pps_vision.app.simulation import Side
from pps_vision.experiments.encounters import controllers
from pps_vision.experiments.encounters.controllers import draw_params, score, summary
from pps_vision.experiments.encounters.sessions import ranges, session


@pytest.fixture(scope="module")
def scene() -> EncounterScene:
    return EncounterScene()


def made_up(controller: str, condition: str, number: int, *, touched: bool, commands: int = 1) -> dict[str, object]:
    row = {"controller": controller, "condition": condition, "number": number, "touched": touched}
    row |= {"speed_m_s": 0.1 + 0.02 * number, "commands": commands, "distance_m": 0.02, "lead_s": 0.5}
    return row | {"touched_part": "palm", "part": "palm", "faults": [], "self_distance_m": 0.03}


def test_rates_and_differences_by_hand() -> None:
    rows = [made_up(OURS, c, k, touched=k < 2) for c in HAZARDS for k in range(10)]
    rows += [made_up(name, c, k, touched=k < 5) for name in NAMES[1:] for c in HAZARDS for k in range(10)]
    rows += [made_up(name, "harmless_static", k, touched=False, commands=k) for name in NAMES for k in range(4)]
    rows += [made_up(name, "through_fast", 4 * k + 10, touched=k > 1) for name in NAMES for k in range(4)]
    for name in (OURS, ASKING):  # of 10 two are out of reach; without the map the arm moves for both
        for k in range(10):
            row = made_up(name, "reach", k, touched=k < 8, commands=int(k < 8 or name == OURS))
            rows.append(row | {"reachable": k < 8})
    rows += [made_up(name, "through", k, touched=True) for name in NAMES for k in (10, 11)]  # more than of the others
    rows[0]["self_distance_m"] = 0.019
    rows[1]["lead_s"], rows[2]["distance_m"] = None, 0.05
    numbers = summary(rows, NAMES)
    ours = numbers["controllers"][OURS]
    other = numbers["controllers"]["R eq. 6"]
    assert ours["untouched"]["press"] == pytest.approx([80, 49.02, 94.33], abs=0.01)  # Wilson, 8 of 10
    assert ours["stop, slow"][0] == pytest.approx(100 / 3)  # 0.10, 0.12, 0.14 m/s
    assert ours["stop, slow, distance_mm"] == pytest.approx([20, 20, 35])
    assert ours["stop, slow, lead_s"] == [0.5, 0.5, 0.5]
    assert other["press and through, beyond ours"][0] == pytest.approx(-600 / 22)
    assert (ours["fast"][0], other["fast"][0]) == pytest.approx((100, 500 / 7)), "0.16–0.28 m/s, as many of each"
    assert other["fast, beyond ours"][0] == pytest.approx(-200 / 7)
    assert other["press and through, beyond ours"][2] < 0
    assert ours["press and through, beyond ours"] == [0, 0, 0]
    assert ours["still"]["harmless_static"][0] == ours["still, all"][0] == 25
    assert np.isnan(ours["still"]["harmless_head"][0])
    assert numbers["limits"]["left"] == 1
    # 0.30, 0.38, 0.46, 0.54 m/s: the first two are not touched
    assert [of[0] for of in ours["fast through, by speed"]] == [100, 0, 0]
    assert [numbers["reaching"][n]["out of reach: attempted"][0] for n in (OURS, ASKING)] == [100, 0]
    tables = controllers.tables(numbers)
    goals = {name: (goal, measured) for name, goal, measured in tables["goals"].rows}
    assert goals["stop, ≤ 15 cm/s: not touched (%)"][1].startswith("**33.3")
    assert goals["points above distance only"][1].startswith("27.3 (")
    assert goals["out of reach, attempted (%)"][1].startswith("0 (")
    assert goals["encounters that left a limit"] == ("0", "**1**")
    assert goals["smallest self-collision distance (mm)"] == ("≥ 20", "**19**")


def test_tuned_parameters_are_those_of_the_tuning_study() -> None:
    file = Path(__file__).parents[2] / "docs" / "results" / "encounters.json"
    best = {name: of for name, of in json.loads(file.read_text())["tuning"]["best"].items() if name in BASELINES}
    assert {name: {k: v for k, v in of.items() if k != "score"} for name, of in best.items()} == TUNED
    for name, baseline in BASELINES.items():
        assert all(low <= TUNED[name][k] <= high for k, (low, high) in baseline.ranges.items())


@pytest.mark.parametrize("name", ["ours, wrist at rest", "distance only"])
def test_a_session_shows_the_activations_that_move_the_arm(scene: EncounterScene, name: str) -> None:
    """One approach: the arm begins to move after a shown activation has exceeded the threshold; ours stays on the path
    that is kept."""
    memories = {side: learn(scene, side, 3, share=0.05) for side in get_args(Side)[:1]}
    numbers = session(scene, memories, "stop", name, 0.1, 3)
    (shown,) = numbers["frames"]["left"]
    first = int(np.argmax(np.array(shown["speed_m_s"]) > 1e-3))
    above = int(np.argmax(np.array(shown["activations"]).max(axis=1) > TUNED["distance only"]["threshold"]))
    delay_s = shown["t_s"][first] - shown["t_s"][above]
    if name == "distance only":
        assert delay_s == pytest.approx(TUNED[name]["confirmation_s"], abs=0.051)
        assert numbers["paths_mm"] == {}
        return
    assert 0 <= delay_s < 0.5, "until the object has come nearer"
    (path,) = numbers["paths_mm"]["left"]
    low, high = numbers["arms"]["left"]["palm_m"]
    assert len(path) >= 3
    assert np.all((np.array(path) >= 1000 * np.array(low) - 1) & (np.array(path) <= 1000 * np.array(high) + 1))


def test_a_session_without_activation_has_no_ranges(scene: EncounterScene) -> None:
    q = start_posture(scene.robot, "inner")
    quiet = [FrameLog(0.05 * k, q, np.zeros(2), np.array([0.1, 0.3]), 0.0, touching=False) for k in range(4)]
    assert np.isnan(ranges(scene, "left", [quiet])["joints_deg"]).all()


def test_parameters_are_drawn_from_their_ranges_the_gain_logarithmically() -> None:
    baseline = BASELINES["potential field"]
    rng = np.random.default_rng(1)
    draws = [draw_params(baseline, rng) for _ in range(400)]
    for name, (low, high) in baseline.ranges.items():
        values = np.array([draw[name] for draw in draws])
        if name == "gain":
            values = np.log(values)
            low, high = np.log([low, high])
        assert low <= values.min() < low + 0.02 * (high - low)
        assert high - 0.02 * (high - low) < values.max() <= high
        assert values.mean() == pytest.approx((low + high) / 2, abs=0.05 * (high - low))


def test_the_score_adds_touches_and_needless_motion() -> None:
    rows = [{"condition": "press", "touched": k < 1, "commands": 5} for k in range(4)]
    rows += [{"condition": "harmless_static", "touched": False, "commands": commands} for commands in (0, 0, 0, 0, 1)]
    assert score(rows) == 25 + 20
