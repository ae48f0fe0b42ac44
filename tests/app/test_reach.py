"""`reach train`, `reach query` and `reach show` from the command line, and their errors."""

import csv
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from data import SEED

from learning.reach.map import ReachableMap
from pps_vision.app.cli import main
from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub

GAZE = "yaw_deg,pitch_deg,vergence_deg\n"


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The right arm's map, quickly."""
    file = tmp_path_factory.mktemp("maps") / "right.npz"
    main(["reach", "train", "--arm", "right", "--out", str(file), "--ik-budget", "1200", "--seed", str(SEED)])
    return file


def query(learned: Path, folder: Path, text: str, *options: str) -> list[dict[str, str]]:
    (folder / "gaze.csv").write_text(text)
    main(["reach", "query", str(learned), str(folder / "gaze.csv"), "--out", str(folder / "out.csv"), *options])
    with (folder / "out.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_says_what_the_closed_form_says(learned, tmp_path):
    gaze = np.random.default_rng(SEED).uniform([-55, -40, 5], [55, 40, 90], (1000, 3))
    rows = query(learned, tmp_path, GAZE + "".join(f"{y},{p},{v}\n" for y, p, v in gaze))
    robot = load_icub()
    arm = SphericalArm.of(
        robot.chain(robot.names.arm("right")[:4], "right_palm"),
        np.deg2rad([-95, 0, -20, 15]),
        np.deg2rad([10, 160, 80, 105]),
    )
    reachable = np.isfinite(arm.solve(fixation_points(robot, np.deg2rad(gaze)))[:, 0])
    said = np.array([row["reachable"] == "1" for row in rows])
    assert np.mean(said != reachable) <= 0.02
    np.testing.assert_allclose([float(row["yaw_deg"]) for row in rows], gaze[:, 0])
    degree = np.array([float(row["degree"]) for row in rows])
    assert ((degree >= 0.5) == said).mean() > 0.99
    assert (np.array([float(row["probability"]) for row in rows]) > 0.5).tolist() == said.tolist()


def test_outside_the_map_and_more_columns(learned, tmp_path, capsys):
    rows = query(
        learned, tmp_path, "what,vergence_deg,yaw_deg,pitch_deg\na,20,0,-20\n\nb,3,0,0\nc,20,60,0\nd,nan,0,0\n"
    )
    assert capsys.readouterr().out == f"1 of 4 reachable, 3 outside the map → {tmp_path / 'out.csv'}\n"
    assert [row["reachable"] for row in rows] == ["1", "0", "0", "0"]
    assert [row["probability"] == row["degree"] == "" for row in rows] == [False, True, True, True]
    assert query(learned, tmp_path, GAZE) == []


def test_it_is_drawn(learned, tmp_path, capsys):
    main(["reach", "show", str(learned), "--out", str(tmp_path / "map.png")])
    assert capsys.readouterr().out == f"right arm, palm, by the robot's own model → {tmp_path / 'map.png'}\n"
    image = cv2.imread(str(tmp_path / "map.png"))
    assert image is not None
    green = (image[..., 1] > image[..., 2].astype(int) + 60).mean()
    assert 0.03 < green < 0.5, "where it can be reached"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("gaze.csv:1", "yaw_deg")),
        ("yaw_deg,vergence_deg\n", ("gaze.csv:1", "pitch_deg")),
        (GAZE + "0,0,20\n0,up,20\n", ("gaze.csv:3", "pitch_deg", "'up'")),
        (GAZE + "0,0\n", ("gaze.csv:2", "vergence_deg", "''")),
    ],
)
def test_a_bad_table(refused, learned, tmp_path, text, words):
    (tmp_path / "gaze.csv").write_text(text)
    line = refused("reach", "query", learned, tmp_path / "gaze.csv", "--out", tmp_path / "out.csv")
    assert all(word in line for word in words), line
    assert not (tmp_path / "out.csv").exists()


def test_what_cannot_be_learned(refused, learned, tmp_path):
    out = ("--out", tmp_path / "m.npz")
    for options, message in (
        (("--into", learned), "map of right"),
        (("--end-point", "left_forearm:4"), "'left_forearm:4'"),
        (("--ik-budget", "1"), "--ik-budget 1; expected at least 200"),
        (("--max-error", "2"), "below 1"),
    ):
        assert message in refused("reach", "train", "--arm", "left", *out, *options)
    assert "--arm both" in refused("reach", "train", "--arm", "both", *out, "--into", learned)
    line = refused("reach", "train", "--arm", "right", *out, "--into", learned, "--measure", "approach")
    assert "a map of joint-limits; expected one of approach" in line
    query = ("reach", "query", learned, tmp_path / "gaze.csv", "--out", tmp_path / "o.csv")
    assert "gaze.csv" in refused(*query)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "gaze.csv").write_text(GAZE)
    assert "1.5" in refused(*query, "--max-fp", "1.5")


def test_of_both_arms_one_map_is_learned_and_a_missed_error_bound_is_reported(tmp_path, capsys):
    """With another measure."""
    file = tmp_path / "map.npz"
    words = ["reach", "train", "--arm", "both", "--ik-budget", "200", "--max-error", "0.02", "--measure", "isotropy"]
    main([*words, "--seed", "5", "--out", str(file)])
    learned = ReachableMap.load(file)
    assert (learned.side, learned.end_point, learned.measure) == ("both", "palm", "isotropy")
    summary, missed = capsys.readouterr().out.splitlines()
    numbers = (
        r"400 inverse-kinematics problems by the robot's own model, \d+ without an answer, "
        r"at most [\d.]+ % misjudged, with 95 % confidence"
    )
    assert re.fullmatch(f"{numbers} → {re.escape(str(file))}", summary)
    assert missed == "--max-error 0.02 was not reached within --ik-budget 200"
