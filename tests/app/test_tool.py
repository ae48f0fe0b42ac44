"""A stick of 15 cm in the hand, touched at its tip: `learn`, `track --memory` and the closed loop."""

from pathlib import Path

import numpy as np
import pytest

import pps_vision as pv
from control.fixation import FixationParams, gaze_at, step
from learning.pps.memory import load_memory
from pps_vision.app.cli import main
from pps_vision.app.render import write_recording
from pps_vision.app.simulation import PERIOD_S, Episode, at_taxel, first_contact, new_pipeline, open_scene, simulate
from pps_vision.robot.icub import icub_setup
from pps_vision.robot.skin import TOUCH_RADIUS_M, Skin, SkinPart, icub_skin
from rendering.eyes import Eyes
from rendering.motions import Approach, make_approach
from rendering.scene import SceneState
from rendering.stimuli import make_stimulus

SETUP = icub_setup()
ROBOT = SETUP.robot
HOME = ROBOT.at(SETUP.home_rad)
HAND = icub_skin(("left_palm",)).parts[0]
TIP_M = np.array([HAND.positions_m[:, 0].max() + 0.15, *HAND.positions_m[:, 1:].mean(axis=0)])
OUTWARDS = (np.array([1.0, 0.0, 0.0]) + HAND.normals[0]) / np.sqrt(2)
STICK = Skin((SkinPart("left_palm", HAND.frame, HAND.ids, np.tile(TIP_M, (4, 1)), np.tile(OUTWARDS, (4, 1))),))
"""The hand's taxels feel at the tip."""
BALL = make_stimulus("ball")
REACH_M = BALL.radius_m + 0.017
LEAD_S = 0.5


def to_the_tip(seed: int) -> Approach:
    return make_approach(np.random.default_rng(seed), at_taxel(STICK, HOME, 0, REACH_M), 0.12)


def through_the_tip_to_the_palm() -> Approach:
    taxels = SETUP.skin.at(HOME)[0]
    palm = taxels[SETUP.skin.index(f"left_palm:{HAND.ids[0]}")]
    tip = STICK.at(HOME)[0][0]
    start = tip + 0.3 * (tip - palm) / np.linalg.norm(tip - palm)
    return Approach(start, first_contact(start, palm, taxels, REACH_M), 0.15)


def record(out: Path, motion: Approach, feels: Skin) -> Path:
    """A film of a ball, the eyes following it, until 0.4 s after its touch of what `feels` it."""
    q = gaze_at(ROBOT, SETUP.home_rad, motion(0.0)[0])
    states = []
    for k in range(round((motion.contact_s + 0.4) / PERIOD_S)):
        p, v = motion(k * PERIOD_S)
        dq = step(FixationParams(), ROBOT.at(q), p, v, PERIOD_S).dq_rad_s
        states.append((k * PERIOD_S, SceneState(q, p, v, dq)))
        q = ROBOT.clamp(q + PERIOD_S * dq)
    with Eyes(ROBOT, SETUP.rig, BALL) as eyes:
        assert write_recording(out, SETUP, eyes, states, np.random.default_rng(0), feels, {}) > 1
    return out


def activation_ahead(film: Path, memory: Path, contact_s: float, out: Path) -> float:
    """Activation of the tool's place half a second before the touch, as `track --memory` writes it."""
    main(["track", str(film), "--memory", str(memory), "--out", str(out)])
    rows = (out / "activation.csv").read_text().splitlines()
    column = rows[0].split(",").index("left_palm_tool:0")
    cells = [row.split(",") for row in rows[1:]]
    return max(float(c[column]) for c in cells if abs(float(c[0]) - (contact_s - LEAD_S)) < 1.5 * PERIOD_S)


@pytest.mark.long
def test_a_stick_becomes_part_of_the_hand_and_is_forgotten(tmp_path, capsys):
    films = [record(tmp_path / f"tip{seed}", to_the_tip(seed), STICK) for seed in range(2)]
    holding, without = tmp_path / "holding.npz", tmp_path / "without.npz"
    main(["learn", *map(str, films), "--out", str(holding)])
    assert "tool: 1 places beyond the skin, from 2 touches" in capsys.readouterr().out
    memory = load_memory(holding)
    place = memory.places[0]
    assert np.linalg.norm(place[:3] / place[6] - TIP_M) < TOUCH_RADIUS_M
    hand = np.array([name.startswith("left_palm:") for name in memory.taxel_ids])
    assert memory.samples[hand, 0].sum() == 0, "the hand's own taxels were not touched"
    contact_s = to_the_tip(1).contact_s
    assert activation_ahead(films[1], holding, contact_s, tmp_path / "a") > 0.4

    with open_scene(2.0, 0, SETUP) as scene:
        coming = to_the_tip(7)
        steps = [
            *simulate(scene, Episode("", "ball", coming, coming.contact_s + 0.3), new_pipeline(scene, memory).step)
        ]
    at_home, moved = STICK.at(HOME)[0][0], [STICK.at(ROBOT.at(step.q_rad))[0][0] for step in steps]
    left_m = [np.linalg.norm(tip - step.position) - BALL.radius_m for tip, step in zip(moved, steps, strict=True)]
    assert np.linalg.norm(at_home - coming.end) - BALL.radius_m < TOUCH_RADIUS_M < min(left_m)

    empty_handed = record(tmp_path / "palm", through_the_tip_to_the_palm(), SETUP.skin)
    main(["learn", *[str(empty_handed)] * 6, "--into", str(holding), "--out", str(without)])
    assert activation_ahead(films[1], without, contact_s, tmp_path / "b") < 0.4
    only_skin = pv.learn([empty_handed])
    assert only_skin.taxel_ids == SETUP.skin.taxel_ids
