"""Scores against closed forms and SciPy, and the files that other tools read and write."""

import json
from pathlib import Path

import numpy as np
import pytest
from evo.core import metrics
from evo.tools.file_interface import read_tum_trajectory_file
from tracks import track_at

from pps_vision.app.cli import main
from pps_vision.app.evaluate import Path3D, errors_of, evaluate, read_path
from pps_vision.errors import InputError
from pps_vision.recordings.exchange import TrackedPair, open_forms, write_tum_rows
from pps_vision.recordings.tables import COVARIANCE, TRAJECTORY, trajectory_row, write_table
from pps_vision.types import Track3D

STAMPS = 1403636579.75 + np.arange(400) / 20


def curve(stamps_s: np.ndarray) -> np.ndarray:
    t = stamps_s - STAMPS[0]
    return np.stack([0.1 * np.sin(2 * t), 0.08 * np.cos(3 * t), 0.4 + 0.05 * np.sin(t)], axis=1)


def path(position: np.ndarray, stamps_s: np.ndarray = STAMPS, cov: np.ndarray | None = None) -> Path3D:
    return Path3D("path", stamps_s, position, np.full((len(position), 3, 3), np.nan) if cov is None else cov)


TRUTH = path(curve(STAMPS))


def test_quantiles_of_errors_from_1_to_400_mm():
    off = np.arange(1, 401) / 1000
    score = evaluate(path(curve(STAMPS) - off[:, None] * [0.0, 1.0, 0.0]), TRUTH)
    assert (score.rows, score.unknown, score.compared) == (400, 0, 400)
    assert (score.lost_share, score.lag_s) == (0, 0)
    assert evaluate(path(curve(STAMPS)[:300], STAMPS[:300]), TRUTH).lost_share == pytest.approx(1 / 4)
    assert np.isnan([score.coverage_95, score.nees]).all()
    rms = np.sqrt(401 * 801 / 6)  # mean square of 1 to n: (n + 1)(2n + 1) / 6
    np.testing.assert_allclose(
        [score.rmse_mm, score.median_mm, score.p95_mm, score.bias_y_mm], [rms, 200.5, 1 + 0.95 * 399, -200.5]
    )


def test_coverage_and_nees_are_of_covariances_that_can_be_one():
    """χ² of three dimensions is below 7.815 with a probability of 95 %."""
    cov = np.tile(1e-6 * np.eye(3), (400, 1, 1))
    cov[:100] = np.nan
    cov[100:200] = 0.0
    cov[200:300] = np.diag([1e-6, 1e-6, -1e-6])
    nees = np.full(400, 7.7)
    nees[350:] = 7.9
    score = evaluate(path(curve(STAMPS) + 1e-3 * np.sqrt(nees)[:, None] * [0.6, 0.0, 0.8], cov=cov), TRUTH)
    assert (score.nees, score.coverage_95) == pytest.approx((7.8, 0.5))


@pytest.mark.parametrize("lag_s", [-0.2, 0.0, 0.0733])
def test_the_lag_is_found(lag_s):
    """The tracker says where the object is, and says it late."""
    late = path(curve(STAMPS), STAMPS + lag_s)
    score = evaluate(late, TRUTH, lag=True, align=True)
    assert abs(score.lag_s - lag_s) < 2e-3
    assert score.rmse_mm < 1
    if lag_s:
        assert evaluate(late, TRUTH).rmse_mm > 5


@pytest.mark.parametrize(("longest_s", "compared"), [(1.5, 1), (1.75, 0)])
def test_more_than_one_and_a_half_intervals_are_a_gap(longest_s, compared):
    stamps = np.array([0, 1, 2, 2 + longest_s, 3 + longest_s, 4 + longest_s])
    within = path(np.zeros((1, 3)), np.array([2 + longest_s / 2]))
    assert len(errors_of(within, path(np.zeros((6, 3)), stamps))[0]) == compared


def test_too_little_in_common_is_refused():
    apart = r"0 of 400 positions have a truth .* \(stamps 0\.000 to 399\.000 s; of the truth 1403636579\.750 to "
    with pytest.raises(InputError, match=apart):
        evaluate(path(curve(STAMPS), np.arange(400.0)), TRUTH)
    with pytest.raises(InputError, match="0 of 400 positions have a truth"):
        evaluate(path(curve(STAMPS)), path(np.empty((0, 3)), np.empty(0)))


def tracks() -> list[Track3D]:
    """The curve, 2 mm beside it, after a frame without a position."""
    cov = 1e-6 * np.eye(12)
    cov[0, 1] = cov[1, 0] = 2e-7
    on = [
        track_at(position + np.array([0.002, 0, 0]), stamp_s=float(t), cov=cov)
        for t, position in zip(STAMPS, curve(STAMPS), strict=True)
    ]
    return [Track3D.unknown(STAMPS[0] - 0.05), *on]


def write_tum(file: Path) -> None:
    write_tum_rows(file, [track.stamp_s for track in tracks()[1:]], [track.position for track in tracks()[1:]])


def test_a_row_is_of_use_with_all_three_coordinates_whatever_its_covariance(tmp_path):
    file = tmp_path / "a.csv"
    cov = "1,0,0,1,0,1"
    rows = [f"0,1,2,3,{cov}", "1,1,2,3,,,,,,", f"2,,2,3,{cov}", f"3,1,nan,3,{cov}", f"4,1,2,,{cov}", f"5,4,5,6,{cov}"]
    file.write_text("\n".join([",".join(["stamp_s", "x_m", "y_m", "z_m", *COVARIANCE]), *rows]) + "\n")
    read = read_path(file)
    np.testing.assert_array_equal(read.stamps_s, [0, 1, 5])
    np.testing.assert_array_equal(read.position, [[1, 2, 3], [1, 2, 3], [4, 5, 6]])
    assert np.isfinite(read.cov).all(axis=(1, 2)).tolist() == [True, False, True]
    assert (read.unknown, read.missing) == (3, (4, 5, 6))
    for text in (
        "# stamp x y z\n\n 1 2 3 4 0 0 0 1\n2 3 4 5\n",
        '"stamp_s","x_m","y_m","z_m"\n1,2,3,4\n2,3,4,5\n',
        "stamp_s, x_m, y_m, z_m\n1,2,3,4\n2,3,4,5\n",
    ):
        file.write_text(text)
        np.testing.assert_array_equal(read_path(file).position, [[2, 3, 4], [3, 4, 5]])


def test_evo_gives_the_same_errors(tmp_path):
    truth = path(curve(STAMPS))
    bent = path(curve(STAMPS) + 0.01 * np.sin(curve(STAMPS)[:, ::-1] * 30))
    for align in (False, True):
        score = evaluate(bent, truth, align=align)
        trajectories = []
        for points in (truth.position, bent.position):
            np.savetxt(tmp_path / "a.tum", np.c_[STAMPS, points, np.tile([0, 0, 0, 1.0], (400, 1))], "%.17g")
            trajectories.append(read_tum_trajectory_file(str(tmp_path / "a.tum")))
        if align:
            trajectories[1].align(trajectories[0])
        error = metrics.APE(metrics.PoseRelation.translation_part)
        error.process_data(tuple(trajectories))
        expected = error.get_all_statistics()
        np.testing.assert_allclose([score.rmse_mm, score.median_mm], [1000 * expected[k] for k in ("rmse", "median")])


def test_anipose_tables_are_read(tmp_path):
    with open_forms(tmp_path, ["anipose"], (8, 8)) as add:
        for track in tracks():
            add(TrackedPair((Path("l"), Path("r")), track, ()))
    read = read_path(tmp_path / "trajectory_anipose.csv", fps=20)
    np.testing.assert_allclose(read.stamps_s, np.arange(1, 401) / 20)
    np.testing.assert_array_equal(read.position, [track.position for track in tracks()[1:]])
    file = tmp_path / "trajectory_anipose.csv"
    with pytest.raises(InputError, match=r"csv:1: has numbers of frames, no stamps; expected --fps, the frames per"):
        read_path(file)
    with pytest.raises(InputError, match=r"--fps 0; expected a positive number"):
        read_path(file, fps=0)
    file.write_text("a_x,a_y,a_z,b_x,b_y,b_z,fnum\n")
    with pytest.raises(InputError, match=r"csv:1: has the points a, b; expected one point"):
        read_path(file, fps=20)


def test_the_command(tmp_path, capsys):
    write_table(tmp_path / "ours.csv", TRAJECTORY, map(trajectory_row, tracks()))
    write_tum(tmp_path / "theirs.tum")
    np.savetxt(tmp_path / "truth.tum", np.c_[STAMPS, curve(STAMPS), np.tile([0, 0, 0, 1.0], (400, 1))], "%.9f")
    files = [str(tmp_path / name) for name in ("ours.csv", "theirs.tum", "truth.tum")]
    main(["evaluate", *files, "--json"])
    ours, theirs = json.loads(capsys.readouterr().out)
    assert ours["rmse_mm"] == pytest.approx(2, abs=1e-3)
    assert [(row["rows"], row["unknown"], row["compared"]) for row in (ours, theirs)] == [(401, 1, 400), (400, 0, 400)]
    assert (theirs["rmse_mm"], theirs["nees"]) == (ours["rmse_mm"], None)
    assert ours["nees"] == pytest.approx(4 / (1 - 0.2**2), rel=1e-3)  # of (2, 0, 0) mm
    main(["evaluate", *files, "--figure", str(tmp_path / "errors.pdf")])
    assert (tmp_path / "errors.pdf").stat().st_size > 5000
    lines = capsys.readouterr().out.splitlines()
    assert [len(line.split()) for line in lines] == [14, 14, 14]
    assert len({len(line) for line in lines}) == 1  # columns are aligned
    assert lines[1].split()[:4] == [files[0], "400", "2", "2"]


def test_of_several_tracks_the_attended_one_or_that_with_a_number_is_scored(tmp_path, capsys, refused):
    """Another object 5 mm off, attended from the middle on; without a number of its track a file is read whole."""
    others = [
        track_at(track.position + np.array([0.003, 0, 0]), stamp_s=track.stamp_s, track_id=2) for track in tracks()[1:]
    ]
    rows = [tracks()[0]]
    for k, (track, other) in enumerate(zip(tracks()[1:], others, strict=True)):
        rows += [track, other] if k < 200 else [other, track]
    write_table(tmp_path / "ours.csv", TRAJECTORY, map(trajectory_row, rows))
    np.savetxt(tmp_path / "truth.tum", np.c_[STAMPS, curve(STAMPS), np.tile([0, 0, 0, 1.0], (400, 1))], "%.9f")
    files = [str(tmp_path / name) for name in ("ours.csv", "truth.tum")]
    scores = []
    for options in ([], ["--track-id", "1"], ["--track-id", "2"]):
        main(["evaluate", *files, "--json", *options])
        (score,) = json.loads(capsys.readouterr().out)
        scores.append((round(score["rmse_mm"], 3), score["rows"]))
    assert scores == [(round(14.5**0.5, 3), 401), (2.0, 400), (5.0, 400)]
    assert "ours.csv: no row of track 9; expected one of 0, 1, 2" in refused("evaluate", *files, "--track-id", "9")


def test_rows_without_a_position_are_counted(tmp_path, capsys):
    """Except for rows with the status searching."""
    rows = [[str(0.1 * k), "0.1", "0.2", "0.3", "tracking"] for k in range(6)]
    rows[0][1:] = "", "", "", "searching"
    rows[4][2] = "nan"
    for name, columns in (("a.csv", 5), ("truth.csv", 4)):
        lines = ["stamp_s,x_m,y_m,z_m,status", *map(",".join, rows)]
        (tmp_path / name).write_text("".join(",".join(line.split(",")[:columns]) + "\n" for line in lines))
    files = [str(tmp_path / name) for name in ("a.csv", "truth.csv")]
    main(["evaluate", *files, "--json"])
    said = capsys.readouterr()
    assert said.err.splitlines() == [
        f"1 row of {files[0]} without a position (line 6)",
        f"2 rows of {files[1]} without a position (from line 2)",
    ]
    (score,) = json.loads(said.out)
    assert (score["rows"], score["unknown"], score["compared"]) == (6, 2, 4)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "0 of 0 positions"),
        ("stamp_s,x_m,y_m\n1,2,3\n", "no column z_m"),
        ("1 2 3\n", "a.csv:1: fewer than four"),
        ("1 2 3 x\n", "a.csv:1: "),
        ("stamp_s,x_m,y_m,z_m\n0,1,2,3\n\nnan,1,2,3\n", "a.csv:4: has no stamp; expected one in every row"),
        ("1 2 3 4\n1 2 3 4\n", "a.csv:2: stamp 1.0 after 1.0"),
    ],
)
def test_a_bad_file_is_named(refused, tmp_path, content, message):
    (tmp_path / "a.csv").write_text(content)
    write_tum(tmp_path / "b.tum")
    assert message in refused("evaluate", tmp_path / "a.csv", tmp_path / "b.tum")
    assert "expected TRACK" in refused("evaluate", tmp_path / "a.csv")
