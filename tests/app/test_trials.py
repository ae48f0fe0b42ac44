"""`trials`: what it writes and prints, and what it refuses."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from trials_made_up import approach, session, write

from learning.pps.contact import learn_contact, predict_session
from learning.pps.scores import auroc, brier
from pps_vision.app.cli import main
from pps_vision.app.trials import _one_class, _print_scores


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A session to learn from and another to predict, not too easy."""
    rng = np.random.default_rng(0)
    train, test = (session(rng, n, beside_m=0.02) for n in (14, 9))
    return write(tmp_path / "train.npz", train), write(tmp_path / "test.npz", test)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_row_for_every_trial_and_taxel(files, tmp_path, capsys) -> None:
    rng = np.random.default_rng(0)
    train, test = (session(rng, n, beside_m=0.02) for n in (14, 9))
    main(["trials", *map(str, files), "--out", str(tmp_path / "p.csv")])
    printed = capsys.readouterr().out
    rows = rows_of(tmp_path / "p.csv")
    assert list(rows[0]) == ["trial", "taxel", "activation", "lower", "upper", "outcome"]
    assert [(int(row["trial"]), int(row["taxel"])) for row in rows] == list(np.ndindex(9, 3))
    found = predict_session(0.15, learn_contact(0.15, train), test)
    for name, expected in (("activation", found.probability), ("lower", found.lower), ("upper", found.upper)):
        np.testing.assert_array_equal([float(row[name]) for row in rows], expected.ravel())
    touched = np.array([trial.touched for trial in test])
    assert [row["outcome"] for row in rows] == ["1" if y else "0" for y in touched.ravel()]
    base = np.tile([0.5, 0.5, 0.0], (9, 1))
    for name, score in (("AUROC", auroc), ("Brier", brier)):
        line = re.search(rf"^{name} +(\S+) +(\S+)", printed, re.MULTILINE)
        assert [float(x) for x in line.groups()] == pytest.approx(
            [score(touched, found.probability), score(touched, base)], abs=5e-4
        )
    assert re.search(r"taxel 0 +[01]\.\d+ +0\.500\n", printed)
    assert re.search(r"taxel 2 +nan +nan  \(never touched\)", printed)


def test_only_what_was_known_in_time_is_used(files, tmp_path) -> None:
    rng = np.random.default_rng(0)
    _, test = (session(rng, n, beside_m=0.02) for n in (14, 9))
    for trial in test:
        trial.d_m[-2:], trial.v_m_s[-2:] = 0.5, -3.0  # 0.1 and 0 s before the end
    late = write(tmp_path / "late.npz", test)
    for name, file in (("a", files[1]), ("b", late)):
        main(["trials", str(files[0]), str(file), "--out", str(tmp_path / f"{name}.csv")])
    assert (tmp_path / "a.csv").read_text() == (tmp_path / "b.csv").read_text()
    main(["trials", str(files[0]), str(late), "--out", str(tmp_path / "c.csv"), "--horizon-s", "0"])
    assert (tmp_path / "c.csv").read_text() != (tmp_path / "a.csv").read_text()


def test_trials_too_short_for_the_horizon_are_counted_and_given_the_rate(files, tmp_path, capsys) -> None:
    rng = np.random.default_rng(1)
    short = write(tmp_path / "short.npz", (approach(rng, 0, seconds=0.2), approach(rng, 1)))
    main(["trials", str(files[0]), str(short), "--out", str(tmp_path / "p.csv")])
    assert "short.npz: 3 of 6 pairs of trial and taxel are lost 0.15 s before" in capsys.readouterr().err
    values = [float(row["activation"]) for row in rows_of(tmp_path / "p.csv")]
    assert values[:3] == pytest.approx([0.5, 0.5, 0.5 / 15])
    assert values[3] < 0.5 < values[4]


def test_samples_that_are_not_finite_are_left_out_and_counted(files, tmp_path, capsys) -> None:
    rng = np.random.default_rng(1)
    trials = session(rng, 3)
    trials[1].d_m[5, 2], trials[1].d_m[-4] = np.nan, np.inf
    main(["trials", str(files[0]), str(write(tmp_path / "holes.npz", trials)), "--out", str(tmp_path / "p.csv")])
    assert "skipped" in (printed := capsys.readouterr().err)
    assert "holes.npz: 4 positions that are not finite, in trials 1" in printed
    assert all(0 < float(row["activation"]) < 1 for row in rows_of(tmp_path / "p.csv"))


def test_bad_input_is_one_line_and_leaves_nothing(files, tmp_path, refused) -> None:
    train, test = files
    rng = np.random.default_rng(2)
    taxels = np.array([[-0.015, 0, 0], [0.015, 0, 0]])
    two = write(tmp_path / "two.npz", (approach(rng, 0, taxels=taxels), approach(rng, 1, taxels=taxels)))
    never = write(tmp_path / "never.npz", [replace(t, touched=np.zeros(3, bool)) for t in session(rng, 3)])
    always = write(tmp_path / "always.npz", [replace(t, touched=np.ones(3, bool)) for t in session(rng, 3)])
    bare = write(tmp_path / "bare.npz", session(rng, 3), velocity_m_s=None)
    lost = session(rng, 3)
    for trial in lost:
        trial.d_m[:] = np.nan
    nowhere = write(tmp_path / "nowhere.npz", lost)
    out = tmp_path / "p.csv"
    assert "nowhere.npz: no position is finite" in refused("trials", nowhere, test, "--out", out)
    assert "two.npz: 2 taxels; expected the 3 of" in refused("trials", train, two, "--out", out)
    assert "never.npz: outcome is -1 throughout" in refused("trials", never, test, "--out", out)
    assert "always.npz: outcome is 1 throughout; expected both" in refused("trials", always, test, "--out", out)
    assert "bare.npz: no velocity_m_s" in refused("trials", bare, test, "--out", out)
    assert "gone.npz" in refused("trials", train, tmp_path / "gone.npz", "--out", out)
    assert "horizon" in refused("trials", train, test, "--out", out, "--horizon-s", "-1")
    assert not out.exists()
    (tmp_path / "folder").mkdir()
    assert "folder" in refused("trials", train, test, "--out", tmp_path / "folder")
    assert list((tmp_path / "folder").iterdir()) == []


def test_a_session_without_a_touch_is_predicted_all_the_same(files, tmp_path, capsys) -> None:
    rng = np.random.default_rng(3)
    never = write(tmp_path / "never.npz", [replace(t, touched=np.zeros(3, bool)) for t in session(rng, 3)])
    main(["trials", str(files[0]), str(never), "--out", str(tmp_path / "p.csv")])
    assert re.search(r"AUROC +nan +nan  \(never touched\)", capsys.readouterr().out)
    assert len(rows_of(tmp_path / "p.csv")) == 9


@pytest.mark.parametrize("n", [1, 2])
def test_scores_stand_beside_those_of_the_base_rate(n: int, capsys: pytest.CaptureFixture[str]) -> None:
    """A touch foreseen with 0.9 and none with 0.2: (0.01 + 0.04) / 2 against 0.25; one trial tells no gain."""
    probability, touched = np.array([[0.9], [0.2]])[:n], np.array([[True], [False]])[:n]
    _print_scores(probability, np.array([0.5]), touched)
    title, area, squares, *rest = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert title == ["learned", "base", "rate"]
    assert squares == (["Brier", "0.025", "0.250"] if n == 2 else ["Brier", "0.010", "0.250"])
    assert area == (["AUROC", "1.000", "0.500"] if n == 2 else ["AUROC", "nan", "nan", "(always", "touched)"])
    assert rest[-1] == ["taxel", "0", *area[1:]]
    assert len(rest) == n
    assert n == 1 or " ".join(rest[0]).startswith("Brier below the base rate's by +0.2250 (+0.")


def test_what_has_only_one_outcome_is_said_to() -> None:
    said = [_one_class(np.array(happened)) for happened in ([True, True], [False, False], [True, False])]
    assert said == ["  (always touched)", "  (never touched)", ""]


def test_pairs_out_of_reach_are_counted_apart_from_lost_ones(files, tmp_path, capsys) -> None:
    """Two trials of three taxels: in one the object is lost, in the other too far away to touch within the horizon."""
    rng = np.random.default_rng(1)
    lost, far = approach(rng, 0), approach(rng, 1)
    lost.d_m[:], far.d_m[:] = np.nan, 5.0
    file = write(tmp_path / "two.npz", (lost, far))
    main(["trials", str(files[0]), str(file), "--out", str(tmp_path / "p.csv")])
    printed = capsys.readouterr().err
    assert "two.npz: 3 of 6 pairs of trial and taxel are out of reach 0.15 s before the end" in printed
    assert "two.npz: 3 of 6 pairs of trial and taxel are lost 0.15 s before the end" in printed
