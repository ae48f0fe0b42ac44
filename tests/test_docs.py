"""The documentation: its site builds without a broken link, and the commands and code of its pages work.

Blocks marked `console` and `python` run in the folder of a made-up laboratory, a page after the other; a block with a
title is a file.  Tests marked `long` run in `make test-all`.
"""

import ast
import re
import shlex
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest
from documents import PAGES, ROOT, blocks, typed
from laboratory import PATH, N, write_laboratory

import pps_vision
from pps_vision.app import cli

NOT_RUN_HERE = {
    "pps-vision ": "those of docs/commands.md, in test_commands.py",
    "python3 -m venv ": "installs",
    "pip install ": "installs; test_track_environment.py and test_wheel.py say what runs then",
    "make ": "installs, tests, or `pps-vision demo`",
    "sbatch ": "test_cluster.py and test_batch.py, as there is no SLURM here",
    "snakemake ": "test_batch.py, where it is installed",
}


def run(page: str) -> None:
    """Run the blocks of a page in the working folder."""
    for language, title, text in blocks(ROOT / page):
        if title:
            Path(title).write_text(text)
        elif language == "console":
            for line in text.splitlines():
                program, *words = shlex.split(line)
                assert program == "pps-vision"
                cli.main(words)
        elif language == "python":
            exec(compile(text, page, "exec"), {"__name__": "__main__"})


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("laboratory")
    write_laboratory(folder)
    return folder


@pytest.fixture
def workdir(laboratory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the laboratory, where commands are typed."""
    folder = tmp_path / "laboratory"
    shutil.copytree(laboratory, folder)
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    return folder


def errors_mm(file: Path) -> np.ndarray:
    """Distances of a table's known positions from the ball's."""
    path = np.genfromtxt(file, delimiter=",", names=True, dtype=None, encoding="utf-8")
    position = np.stack([path["x_m"], path["y_m"], path["z_m"]], axis=1)
    return 1000 * np.linalg.norm(position - PATH, axis=1)[path["status"] == "tracking"]


def test_the_quick_start(workdir, capsys):
    run("docs/quickstart.md")
    assert "pairs, z from 0.6" in capsys.readouterr().out
    errors = errors_mm(workdir / "path" / "trajectory.csv")
    assert len(errors) > 0.7 * N
    assert np.median(errors) < 10  # with the calibration that was found
    assert (workdir / "path" / "report.html").is_file()


@pytest.mark.long
def test_own_camera(workdir):
    run("docs/howto/camera.md")
    for name in ("from_images", "from_one_video", "within_10_mm"):
        assert np.median(errors_mm(workdir / name / "trajectory.csv")) < 10


@pytest.mark.long
def test_points_of_another_detector(workdir, capsys):
    run("docs/howto/points.md")
    said = capsys.readouterr().out
    assert "40 pairs, noise 0.0" in said
    assert "right camera's clock: -0.00 ms late" in said or "right camera's clock: 0.00 ms late" in said
    assert errors_mm(workdir / "points" / "trajectory.csv").max() < 0.1
    assert (workdir / "points" / "report.html").is_file()


@pytest.mark.long
def test_clocks(workdir, capsys):
    run("docs/howto/clock.md")
    said = capsys.readouterr().out
    assert said.count("unobservable, all moves at a constant rate across the epipolar lines") == 2
    assert np.median(errors_mm(workdir / "corrected" / "trajectory.csv")) < 10


@pytest.mark.long
def test_a_calibration_by_hand(workdir, capsys):
    run("docs/howto/calibration.md")
    assert "cameras: 120.1 mm apart" in capsys.readouterr().out
    assert np.median(errors_mm(workdir / "by_hand" / "trajectory.csv")) < 10


@pytest.mark.long
def test_own_tracker_and_its_evaluation(workdir, capsys):
    run("docs/howto/tracker.md")
    said = capsys.readouterr().out
    assert re.findall(r"order (\d): (?:0|1)\.\d+ mm", said) == ["2", "3", "4"]
    rows = {row.split()[0]: float(row.split()[2]) for row in said.splitlines() if row.startswith(("ours/", "mine"))}
    assert rows["ours/trajectory.csv"] < rows["mine.tum"] < 10
    run("docs/howto/evaluate.md")
    truth = np.loadtxt(workdir / "truth.tum")
    assert len(truth) == 7
    overlap = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("boxes.csv")]
    assert float(overlap[0][2]) > 0.7
    assert (workdir / "errors.png").is_file()
    assert (workdir / "curves.png").is_file()


@pytest.mark.long
def test_many_recordings(workdir, capsys):
    run("docs/howto/cluster.md")
    said = capsys.readouterr().out
    assert said.count("2 of 2 recordings tracked") == 3  # two batches and a report
    assert (workdir / "batch" / "a.mp4" / "report.html").is_file()


@pytest.mark.long
def test_own_robot(workdir):
    run("docs/robots.md")
    for name in ("landscapes7.png", "map7.png"):
        assert cv2.imread(str(workdir / name)).std() > 5


@pytest.mark.long
def test_own_controller(workdir, capsys):
    run("docs/howto/controller.md")
    assert "my_controller:new" in (workdir / "compared" / "encounters.json").read_text()


@pytest.mark.long
def test_the_readmes_example(workdir, capsys):
    run("README.md")
    assert float(re.findall(r"median error (\d+\.\d+) mm", capsys.readouterr().out)[0]) < 2


def test_every_page_with_something_to_run_is_run():
    """Except for scripts of docs/examples and commands of docs/commands.md, which have their own tests."""
    runs = {str(page.relative_to(ROOT)) for page in PAGES if {b[0] for b in blocks(page)} & {"console", "python"}}
    called = {
        node.args[0].value
        for node in ast.walk(ast.parse(Path(__file__).read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "run"
    }
    assert runs == called


def test_whatever_is_typed_is_run():
    """By these tests, unless it installs or is run by another test."""
    for page in PAGES:
        typed_lines = {
            line for language, _, text in blocks(page) if language == "console" for line in text.splitlines()
        }
        for line in set(typed(page)) - typed_lines:
            assert line.startswith(tuple(NOT_RUN_HERE)), f"{page.name}: {line}"
            listed = line in typed(ROOT / "docs" / "commands.md")
            assert listed or not line.startswith("pps-vision "), f"{page.name}: {line}"


def test_the_site_builds_without_a_broken_link(tmp_path):
    out = tmp_path / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(out)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout + built.stderr
    pages = {file.relative_to(out).as_posix(): file.read_text() for file in out.rglob("*.html")}
    assert pages.keys() >= {"index.html", "quickstart.html", "howto/evaluate.html", "examples.html", "api.html"}
    for name, text in pages.items():
        assert not re.findall(r'<(?:script|img|link)[^>]*(?:src|href)="(?:https?:)?//', text), name
    for name in set(pps_vision.__all__) - {"__version__"}:
        defined = f"{pps_vision._MODULES[name]}.{name}"
        assert f'id="{defined}"' in pages["api.html"]


GLOSSARY = Path(__file__).parents[1] / "docs" / "glossary.md"
NAMES = sorted(set(re.findall(r"`((?:pps_vision|tracking|learning|control|rendering)\.[\w.]+)`", GLOSSARY.read_text())))


@pytest.mark.parametrize("name", NAMES)
def test_a_name_of_the_glossary_exists(name):
    module, _, attribute = name.rpartition(".")
    if attribute[0].isupper():
        assert hasattr(import_module(module), attribute)
    else:
        import_module(name)
