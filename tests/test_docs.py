"""The documentation: its site builds without a broken link, and what its pages say to type works as it is.

Blocks marked `console` and `python` run in the folder of a made-up laboratory, a page after the other; a block with a
title is a file.  Long ones run in `make test-all`.
"""

import ast
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from flat_patterns import SIZE, K, R, T, seen
from scipy.spatial.transform import Rotation

import pps_vision
from pps_vision.app import cli

ROOT = Path(__file__).parents[1]
PAGES = [*sorted((ROOT / "docs").rglob("*.md")), *(ROOT / name for name in ("README.md", "CONTRIBUTING.md"))]
LONG = pytest.mark.skipif("PPS_VISION_ALL" not in os.environ, reason="in make test-all")
N, FPS, RADIUS_M, SHIFT = 40, 20, 0.04, 4  # OpenCV draws at 1/16 px
PATH = [np.array([-0.15 + 0.006 * k, 0.02, 0.7 - 0.002 * k]) for k in range(N)]


def blocks(page: Path) -> list[tuple[str, str, str]]:
    """Language, title and text of the code blocks of a page."""
    found = re.findall(r"^```(\w+)(?: title=\"(.+)\")?\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)
    return [(language, title, text) for language, title, text in found]


def commands(page: Path) -> list[str]:
    """The commands of a page, in blocks or indented ones."""
    lines = re.findall(r"^(?: {4})?(pps-vision .*)$", page.read_text(), re.MULTILINE)
    return [part.strip() for line in lines for part in line.partition("  #")[0].split("&&")]


def run(page: str) -> None:
    """Do in the working folder what a page says."""
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


def place(side: int, at: np.ndarray) -> tuple[float, float]:
    """Where a point in the left camera's frame is seen."""
    u, v, w = K[side] @ (R @ at + T if side else at)
    return u / w, v / w


def photo(side: int, at: np.ndarray, wall: np.ndarray) -> np.ndarray:
    """A red ball before a wall."""
    middle = tuple(round(x * 2**SHIFT) for x in place(side, at))
    radius = round(K[side][0, 0] * RADIUS_M / at[2] * 2**SHIFT)
    return cv2.circle(wall.copy(), middle, radius, (220, 30, 30), -1, cv2.LINE_AA, SHIFT)


def film(file: Path, images: list[np.ndarray]) -> None:
    file.parent.mkdir(exist_ok=True)
    with av.open(str(file), "w") as container:
        stream = container.add_stream("libx264", rate=FPS, options={"crf": "12", "preset": "veryfast"})
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())


def write(file: Path, image: np.ndarray) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), image[..., ::-1] if image.ndim == 3 else image)


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Videos and images of a ball, of a chessboard and of a tag, a calibration, true boxes, and a robot."""
    folder, rng = tmp_path_factory.mktemp("laboratory"), np.random.default_rng(0)
    walls = [cv2.GaussianBlur(rng.integers(0, 255, (*SIZE[::-1], 3), np.uint8), (0, 0), 4) for _ in range(2)]
    photos = [[photo(side, at, walls[side]) for at in PATH] for side in range(2)]
    both = [np.hstack(pair) for pair in zip(*photos, strict=True)]
    for k, (left, right) in enumerate(zip(*photos, strict=True)):
        write(folder / f"frames/left/{k:03d}.png", left)
        write(folder / f"frames/right/{k:03d}.png", right)
    for name, images in {"left": photos[0], "right": photos[1], "both": both}.items():
        film(folder / f"{name}.mp4", images)
    for name in "ab":
        film(folder / f"recs/{name}.mp4", both[:20])
    rows = [(*(c - 29 for c in place(0, at)), 60, 60) for at in PATH]  # pixels count from 1, as in OTB
    np.savetxt(folder / "true_boxes.txt", rows, delimiter=",")
    storage = cv2.FileStorage(str(folder / "calibration.yml"), cv2.FILE_STORAGE_WRITE)
    for key, value in {"K1": K[0], "K2": K[1], "R": R, "T": T}.items():
        storage.write(key, value)
    storage.release()
    (folder / "tag").mkdir()
    shutil.copy(folder / "calibration.yml", folder / "tag")
    y, x = np.mgrid[:360, :540] // 60
    board = cv2.copyMakeBorder(
        np.where((x + y) % 2, 255, 0).astype(np.uint8), *[60] * 4, cv2.BORDER_CONSTANT, value=255
    )
    tag = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 7, 240)
    tag = cv2.copyMakeBorder(tag, *[60] * 4, cv2.BORDER_CONSTANT, value=255)
    for k in range(7):
        turn = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)).as_matrix()
        at = np.array([rng.uniform(-0.01, 0.11), rng.uniform(-0.06, 0.06), rng.uniform(0.45, 0.6)])
        for side, name in enumerate(("left", "right")):
            write(folder / f"board/{name}{k}.png", seen(board, 0.03 / 60, turn, at, side))
            write(folder / f"tag/{name}/{k}.png", seen(tag, 0.048 / 240, np.eye(3), at, side))
    shutil.copytree(ROOT / "tests" / "arm7", folder / "arm7")
    return folder


@pytest.fixture
def here(laboratory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the laboratory, where commands are typed."""
    folder = tmp_path / "laboratory"
    shutil.copytree(laboratory, folder)
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    return folder


def tracked(file: Path) -> np.ndarray:
    return np.genfromtxt(file, delimiter=",", names=True, dtype=None, encoding="utf-8")


def errors_mm(file: Path) -> np.ndarray:
    """Distances of a table's known positions from the ball's."""
    path = tracked(file)
    found = np.stack([path["x_m"], path["y_m"], path["z_m"]], axis=1)
    return 1000 * np.linalg.norm(found - PATH, axis=1)[path["status"] == "tracking"]


def test_the_quick_start(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("docs/quickstart.md")
    assert "pairs, z from 0.6" in capsys.readouterr().out
    errors = errors_mm(here / "path" / "trajectory.csv")
    assert len(errors) > 0.7 * N
    assert np.median(errors) < 10  # with the calibration that was found
    assert (here / "path" / "report.html").is_file()


@LONG
def test_own_camera(here: Path) -> None:
    run("docs/howto/camera.md")
    for name in ("from_images", "from_one_video", "within_10_mm"):
        assert np.median(errors_mm(here / name / "trajectory.csv")) < 10


def test_own_tracker_and_its_evaluation(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("docs/howto/tracker.md")
    said = capsys.readouterr().out
    assert re.findall(r"order (\d): (?:0|1)\.\d+ mm", said) == ["2", "3", "4"]
    rows = {row.split()[0]: float(row.split()[2]) for row in said.splitlines() if row.startswith(("ours/", "mine"))}
    assert rows["ours/trajectory.csv"] < rows["mine.tum"] < 10
    run("docs/howto/evaluate.md")
    truth = np.loadtxt(here / "truth.tum")
    assert len(truth) == 7
    overlap = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("boxes.csv")]
    assert float(overlap[0][2]) > 0.7
    assert (here / "errors.png").is_file()
    assert (here / "curves.png").is_file()


@LONG
def test_many_recordings(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("docs/howto/cluster.md")
    said = capsys.readouterr().out
    assert said.count("2 of 2 recordings tracked") == 2
    assert (here / "batch" / "a.mp4" / "report.html").is_file()


@LONG
def test_own_robot(here: Path) -> None:
    run("docs/robots.md")
    for name in ("landscapes7.png", "map7.png"):
        assert cv2.imread(str(here / name)).std() > 5


@LONG
def test_own_controller(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("docs/howto/controller.md")
    assert "my_controller:new" in (here / "measured" / "results" / "encounters.json").read_text()


@LONG
def test_the_readmes_example(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("README.md")
    assert float(re.findall(r"median error (\d+\.\d+) mm", capsys.readouterr().out)[0]) < 2


def test_every_page_with_something_to_run_is_run() -> None:
    """But for what a test of its own runs: the scripts of docs/examples, docs/cluster/slurm.sh."""
    runs = {str(page.relative_to(ROOT)) for page in PAGES if {b[0] for b in blocks(page)} & {"console", "python"}}
    called = {
        node.args[0].value  # type: ignore[attr-defined]
        for node in ast.walk(ast.parse(Path(__file__).read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "run"
    }
    assert runs == called


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=lambda page: page.name)
def test_commands_are_understood(page: Path) -> None:
    for command in commands(page):
        program, *words = shlex.split(command)
        assert program == "pps-vision"
        cli._parsed(words)  # a wrong option ends the process


def test_the_site_builds_without_a_broken_link(tmp_path: Path) -> None:
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
