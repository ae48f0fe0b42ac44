"""Delays of a camera and of joints are found in images and corrected by `track --clock auto`, or said to be unknown."""

import json
import shutil
from pathlib import Path

import pytest

from pps_vision.app.cli import main
from pps_vision.app.evaluate import evaluate, read_path

FPS = 25


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Recordings of a robot that rests, and of one that looks around."""
    folder = tmp_path_factory.mktemp("rendered")
    words = f"--stimulus ball --radius 0.012 --motion jerk --speed 0.2 --seconds 3.2 --fps {FPS} --noise 2 --seed 3"
    for head in ("still", "sway"):
        main(["render", *words.split(), "--head", head, "--out", str(folder / head)])
    return {head: folder / head for head in ("still", "sway")}


@pytest.fixture
def rec(rendered: dict[str, Path], tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    return Path(shutil.copytree(rendered[request.param], tmp_path / "rec"))


def delayed(log: Path, late_s: float, missing: int = 0) -> None:
    """Make the stamps of a log later; of its middle, rows are `missing` and later ones have their stamps."""
    rows = [row.split(maxsplit=2) for row in log.read_text().splitlines()]
    n = len(rows) // 2
    rows = [[a, stamp, c] for (a, _, c), (_, stamp, _) in zip(rows[:n] + rows[n + missing :], rows, strict=False)]
    log.write_text("".join(f"{number} {float(stamp) + late_s:.6f} {rest}\n" for number, stamp, rest in rows))


def clock(rec: Path, capsys: pytest.CaptureFixture[str]) -> dict:
    capsys.readouterr()
    main(["clock", str(rec), "--max-skew-s", "0.05", "--json"])
    return json.loads(capsys.readouterr().out)


def error_mm(rec: Path, clock: str) -> float:
    """Median error of the path, by the given stamps ("stamps") or corrected ones ("auto")."""
    out = rec.parent / clock
    main(["track", str(rec), "--one", "--max-skew-s", "0.05", "--clock", clock, "--out", str(out)])
    return evaluate(read_path(out / "trajectory.csv"), read_path(rec / "truth.csv")).median_mm


@pytest.mark.parametrize("rec", ["still"], indirect=True)
def test_a_late_camera_that_rests(rec, capsys):
    delayed(rec / "cam" / "right" / "data.log", 0.04)
    main(["info", str(rec), "--max-skew-s", "0.05"])
    assert "clock of the joints: unobservable" in capsys.readouterr().out
    found = clock(rec, capsys)
    assert abs(found["delay_ms"] - 40) < 1
    assert found["joints"]["unobservable"]
    assert error_mm(rec, "auto") < 1.5  # 3.4 by the given stamps
    assert json.loads((rec.parent / "auto" / "summary.json").read_text())["clock"]["corrected"]


@pytest.mark.parametrize("rec", ["still"], indirect=True)
def test_a_recorder_that_misses_images_has_not_one_delay(rec, capsys):
    delayed(rec / "cam" / "right" / "data.log", 0.0, missing=3)
    assert clock(rec, capsys)["unobservable"].endswith("are images missing?")


@pytest.mark.parametrize("rec", ["sway"], indirect=True)
def test_a_late_camera_and_late_joints_of_a_robot_that_looks_around(rec, capsys):
    delayed(rec / "cam" / "right" / "data.log", 0.04)
    delayed(rec / "head" / "data.log", 0.05)
    found = clock(rec, capsys)
    assert abs(found["delay_ms"] - 40) < 2
    assert abs(found["joints"]["delay_ms"] - 50) < 2


@pytest.mark.long
@pytest.mark.parametrize("rec", ["sway"], indirect=True)
def test_they_are_corrected(rec):
    delayed(rec / "cam" / "right" / "data.log", 0.04)
    delayed(rec / "head" / "data.log", 0.05)
    assert error_mm(rec, "auto") < 0.5 * error_mm(rec, "stamps")
