"""`reach` from its command line: a map learned, asked, drawn; and what it refuses."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from data import SEED

from learning.reach.labels import Labels
from learning.reach.map import ReachableMap
from learning.reach.params import MapParams
from pps_vision.app.cli import main
from pps_vision.app.report.figures import reachable_space
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


def query(learned: Path, folder: Path, text: str) -> list[dict[str, str]]:
    (folder / "gaze.csv").write_text(text)
    main(["reach", "query", str(learned), str(folder / "gaze.csv"), "--out", str(folder / "out.csv")])
    with (folder / "out.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_says_what_the_closed_form_says(learned: Path, tmp_path: Path) -> None:
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


def test_outside_the_map_and_more_columns(learned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = query(
        learned, tmp_path, "what,vergence_deg,yaw_deg,pitch_deg\na,20,0,-20\n\nb,3,0,0\nc,20,60,0\nd,nan,0,0\n"
    )
    assert capsys.readouterr().out == f"1 of 4 reachable, 3 outside the map → {tmp_path / 'out.csv'}\n"
    assert [row["reachable"] for row in rows] == ["1", "0", "0", "0"]
    assert [row["probability"] == row["degree"] == "" for row in rows] == [False, True, True, True]
    assert query(learned, tmp_path, GAZE) == []


def test_it_is_drawn(learned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["reach", "show", str(learned), "--out", str(tmp_path / "map.png")])
    assert capsys.readouterr().out == f"right arm, palm → {tmp_path / 'map.png'}\n"
    image = cv2.imread(str(tmp_path / "map.png"))
    assert image is not None
    green = (image[..., 1] > image[..., 2].astype(int) + 60).mean()
    assert 0.03 < green < 0.5, "where it can be reached"


def test_each_panel_states_how_far_away_its_vergence_fixates(learned: Path) -> None:
    """Straight ahead the axes of eyes 68 mm apart meet at half of that over tan(vergence / 2)."""
    one = ReachableMap.load(learned)
    for end_point, named in (("palm", "by the right hand;"), ("right_forearm:3", "by taxel right_forearm:3;")):
        assert named in reachable_space(replace(one, end_point=end_point), load_icub()).get_suptitle()
    titles = [axis.get_title() for axis in reachable_space(one, load_icub()).axes]
    stated = re.findall(r"vergence (\d+)° \((\d+) cm\)", " ".join(titles))
    assert len(stated) > 1
    for vergence, distance_cm in np.array(stated, dtype=float):
        assert distance_cm == pytest.approx(3.4 / np.tan(np.deg2rad(vergence / 2)), abs=0.51)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("gaze.csv:1", "yaw_deg")),
        ("yaw_deg,vergence_deg\n", ("gaze.csv:1", "pitch_deg")),
        (GAZE + "0,0,20\n0,up,20\n", ("gaze.csv:3", "pitch_deg", "'up'")),
        (GAZE + "0,0\n", ("gaze.csv:2", "vergence_deg", "''")),
    ],
)
def test_a_bad_table(refused, learned: Path, tmp_path: Path, text: str, words: tuple[str, ...]) -> None:
    (tmp_path / "gaze.csv").write_text(text)
    line = refused("reach", "query", learned, tmp_path / "gaze.csv", "--out", tmp_path / "out.csv")
    assert all(word in line for word in words), line
    assert not (tmp_path / "out.csv").exists()


def test_what_cannot_be_learned(refused, learned: Path, tmp_path: Path) -> None:
    out = ("--out", tmp_path / "m.npz")
    assert "map of right" in refused("reach", "train", "--arm", "left", *out, "--into", learned)
    assert "--arm both" in refused("reach", "train", "--arm", "both", *out, "--into", learned)
    line = refused("reach", "train", "--arm", "right", *out, "--into", learned, "--measure", "approach")
    assert "a map of joint-limits; expected one of approach" in line
    line = refused("reach", "train", "--arm", "left", *out, "--end-point", "left_forearm:4")
    assert "'left_forearm:4'" in line
    assert "left_forearm:27" in line
    assert "--ik-budget 1; expected at least 200" in refused(
        "reach", "train", "--arm", "left", *out, "--ik-budget", "1"
    )
    assert "below 1" in refused("reach", "train", "--arm", "left", *out, "--max-error", "2")
    assert "gaze.csv" in refused("reach", "query", learned, tmp_path / "gaze.csv", "--out", tmp_path / "o.csv")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, MapParams, float, ReachableMap | None]]:
    """What training is asked for: arm, parameters, the first random number, and the map to continue from; the answer
    is made up, of three labels and two problems without an answer."""
    found = []

    def trained(
        robot: object, side: str, rng: np.random.Generator, params: MapParams, hand: object, into: ReachableMap | None
    ) -> ReachableMap:
        found.append((side, params, rng.random(), into))
        values = np.zeros((2, 2, 2))
        labels = Labels(np.zeros((3, 3)), np.zeros(3, bool), np.zeros(3), np.zeros(3), np.zeros((3, 3)))
        one = ReachableMap(side, params.gaze_limits, values, values, values, 0.4, 0.05, 0.0, labels, 2)
        return replace(one, error_bound=0.0123)

    monkeypatch.setattr("learning.reach.training.train_reachable_map", trained)
    return found


def test_of_both_arms_the_errors_and_the_risks_add_up_to_what_is_asked_for(
    asked, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "map.npz"
    main(["reach", "train", "--arm", "both", "--max-error", "0.02", "--seed", "5", "--out", str(file)])
    (left, l_params, l_number, _), (right, r_params, r_number, _) = asked
    assert (left, right) == ("left", "right")
    assert l_params.max_error + r_params.max_error == pytest.approx(0.02)
    assert (1 - l_params.confidence) + (1 - r_params.confidence) == pytest.approx(0.05)
    assert l_params.n_test == r_params.n_test == 0  # as many as the error asks for
    assert l_number == r_number == np.random.default_rng(5).random()
    assert ReachableMap.load(file).side == "both"
    text = "10 inverse-kinematics problems, 4 without an answer, at most 2.5 % misjudged, with 95 % confidence → "
    missed = "--max-error 0.02 was not reached within --ik-budget 24000\n"
    assert capsys.readouterr().out == f"{text}{file}\n{missed}"


@pytest.mark.parametrize(("max_error", "missed"), [(0.0, False), (0.012, True), (0.013, False)])
def test_a_bound_above_the_error_that_is_asked_for_is_said(
    asked, tmp_path: Path, capsys: pytest.CaptureFixture[str], max_error: float, missed: bool
) -> None:
    """Without such an error the map is tested all the same; of two rounds each has half of the budget."""
    words = ["--ik-budget", "200", "--max-error", str(max_error), "--out", str(tmp_path / "map.npz")]
    main(["reach", "train", "--arm", "left", *words])
    ((side, params, _, into),) = asked
    assert (side, params.n_labels, params.round_labels, into) == ("left", 200, 100, None)
    assert (params.max_error, params.confidence) == (max_error, pytest.approx(0.95))
    assert (params.n_test > 5000) == (max_error == 0)
    said = capsys.readouterr().out
    assert said.startswith("5 inverse-kinematics problems, 2 without an answer, at most 1.2 % misjudged")
    assert ("was not reached" in said) == missed


def test_training_goes_on_from_a_map_of_the_same_arm(asked, learned: Path, tmp_path: Path) -> None:
    """And of all labels at least two rounds are made, of 1500 at most."""
    main(["reach", "train", "--arm", "right", "--into", str(learned), "--out", str(tmp_path / "map.npz")])
    ((side, params, _, into),) = asked
    assert (side, into.side, params.round_labels) == ("right", "right", MapParams().round_labels)
    np.testing.assert_array_equal(into.labels.gaze_rad, ReachableMap.load(learned).labels.gaze_rad)


def test_another_measure(tmp_path: Path) -> None:
    """The map says what it is of, also once it is saved; what is good is never better than possible."""
    file = tmp_path / "even.npz"
    main(["reach", "train", "--arm", "left", "--out", str(file), "--ik-budget", "700", "--measure", "isotropy"])
    one = ReachableMap.load(file)
    assert (one.side, one.end_point, one.measure) == ("left", "palm", "isotropy")
    good = one.labels.optimality[one.labels.reachable]
    assert good.min() > 0
    assert good.max() < 0.5, "this arm's singular values are never even"


def test_fewer_false_positives_when_asked(learned: Path, tmp_path: Path) -> None:
    """A stricter map says "reachable" less often, and only of what it is surer of."""
    gaze = np.random.default_rng(SEED).uniform([-55, -40, 5], [55, 40, 90], (2000, 3))
    text = GAZE + "".join(f"{y},{p},{v}\n" for y, p, v in gaze)
    plain = query(learned, tmp_path, text)
    main(
        [
            "reach",
            "query",
            str(learned),
            str(tmp_path / "gaze.csv"),
            "--out",
            str(tmp_path / "s.csv"),
            "--max-fp",
            "1e-4",
        ]
    )
    with (tmp_path / "s.csv").open(newline="") as file:
        strict = list(csv.DictReader(file))
    said = [[row["reachable"] == "1" for row in rows] for rows in (plain, strict)]
    assert 0 < sum(said[1]) < sum(said[0])
    least = min(float(row["probability"]) for row, yes in zip(strict, said[1], strict=True) if yes)
    most = max(float(row["probability"]) for row, yes in zip(strict, said[1], strict=True) if not yes)
    assert 0.5 < most <= least


def test_a_share_of_false_positives_is_a_share(refused, learned: Path, tmp_path: Path) -> None:
    (tmp_path / "gaze.csv").write_text(GAZE)
    line = refused("reach", "query", learned, tmp_path / "gaze.csv", "--out", tmp_path / "o.csv", "--max-fp", "1.5")
    assert "1.5" in line
