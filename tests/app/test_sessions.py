"""Sessions rendered as recordings, and learning from them."""

import re

import numpy as np
import pytest
from data import SEED

from learning.pps.memory import load_memory
from learning.reach.babbling import SeenHand, random_arms
from learning.reach.labels import HandModel
from learning.reach.map import ReachableMap
from pps_vision.app.cli import main
from pps_vision.app.encounters.robots import ErrorSources, MiscalibratedRobot
from pps_vision.experiments.reach_truth import closed_form
from pps_vision.recordings.open import open_recording
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub


def test_a_double_touch_is_rendered_and_learned(tmp_path):
    out = tmp_path / "rec"
    main(["session", "double-touch", "--trials", "1", "--seed", str(SEED), "--out", str(out)])
    recording = open_recording(out)
    touched = [touch.taxel_ids for touch in recording.touches]
    assert any(name.startswith("left_forearm:") for name in touched[-1])
    assert not any(touched[:-10]), "it ends with the touch"
    main(["learn", str(out), "--mode", "marker", "--out", str(tmp_path / "memory.npz")])
    positive, _ = load_memory(tmp_path / "memory.npz").samples.T
    assert positive.sum() > 5


def test_a_seen_hand_corrects_the_robot_s_own_model_where_it_is_seen_and_nearly_nowhere_else():
    rng = np.random.default_rng(SEED)
    true = MiscalibratedRobot.draw(ErrorSources().scaled(3), rng).model
    own = load_icub()
    chains = [robot.chain(robot.names.arm("right")[:4], "right_palm") for robot in (own, true)]
    arm = random_arms(1500, rng)
    seen, test = np.split(arm[arm[:, 0] < -0.5], [500])
    sigma_m = 0.001
    positions = chains[1].positions(seen)[0] + sigma_m * rng.standard_normal((len(seen), 3))
    positions[::50] += 0.2  # something else was tracked
    covs = np.tile(sigma_m**2 * np.eye(3), (len(seen), 1, 1))
    forward = HandModel.seen(own, "right", SeenHand(seen, positions, covs)).forward

    def error_m(q):
        truth = chains[1].positions(q)[0]
        return [np.linalg.norm(model(q)[0] - truth, axis=1).mean() for model in (forward, chains[0].positions)]

    corrected, before = error_m(test)
    assert corrected < 0.002 < 0.2 * before
    corrected, before = error_m(arm[arm[:, 0] > -0.3])
    assert corrected < 1.5 * before
    h = 1e-6
    slopes = [(forward(test + h * e)[0] - forward(test - h * e)[0]) / (2 * h) for e in np.eye(4)]
    np.testing.assert_allclose(forward(test)[1], np.stack(slopes, axis=2), atol=1e-5)


def test_what_no_session_and_no_map_is_made_of(refused, tmp_path):
    out = ("--out", tmp_path / "x")
    assert "--trials 0" in refused("session", "objects", "--trials", "0", *out)
    train = ("reach", "train", "--from", tmp_path, *out)
    assert "expected one arm" in refused(*train, "--arm", "both")
    main(["session", "babbling", "--postures", "3", "--out", str(tmp_path / "rec")])
    line = refused("reach", "train", "--arm", "right", "--from", tmp_path / "rec", *out)
    assert "of 3 frames; expected 200 or more" in line


@pytest.mark.long
def test_a_map_of_the_hand_that_the_eyes_saw_is_right(tmp_path, capsys):
    """Of 400 frames."""
    rec, file = tmp_path / "rec", tmp_path / "map.npz"
    main(["session", "babbling", "--postures", "400", "--seed", str(SEED), "--out", str(rec)])
    main(["reach", "train", "--arm", "right", "--from", str(rec), "--ik-budget", "3000", "--out", str(file)])
    seen, learned = capsys.readouterr().out.splitlines()[-2:]
    assert int(re.fullmatch(r"hand seen in (\d+) of 400 frames", seen)[1]) > 350
    assert f"by the hand seen in {rec}" in learned
    learned_map = ReachableMap.load(file)
    assert learned_map.kinematics == f"the hand seen in {rec}"
    gaze = np.random.default_rng(SEED).uniform(np.deg2rad([-55, -40, 5]), np.deg2rad([55, 40, 90]), (4000, 3))
    robot = load_icub()
    truth = np.isfinite(closed_form(robot).solve(fixation_points(robot, gaze))[:, 0])
    assert np.mean(learned_map.query(gaze).reachable != truth) < 0.02
