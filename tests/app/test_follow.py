"""Users say what to follow: a hue, boxes in the first images, a time, a part of the images.

Two balls, red and blue, circle before a wall.
"""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from data import HAS_PHOTOGRAPHS
from filmed import SIZE, calibration, errors_mm

from pps_vision.app.cli import main
from pps_vision.experiments.films.scenes import Film, FilmObject, FilmScene

RED, BLUE = (205.0, 30.0, 25.0), (25.0, 60.0, 210.0)
FPS = 25.0
SCENE = FilmScene(
    width=SIZE[0],
    height=SIZE[1],
    seconds=2.0,
    fps=FPS,
    start="moving",
    color=RED,
    extent_m=0.05,
    others=(FilmObject(color=BLUE, start="moving", distance_m=0.8, extent_m=0.2, radius_m=0.04, speed_m_s=0.25),),
)


@pytest.fixture(scope="module")
def balls(tmp_path_factory: pytest.TempPathFactory) -> tuple[Film, list[str]]:
    """The film, and options of `track` to its images."""
    folder = tmp_path_factory.mktemp("balls")
    shown = Film(SCENE, 12)
    for k, frame in enumerate(shown):
        cv2.imwrite(str(folder / f"L{k:02d}.png"), frame.left[..., ::-1])
        cv2.imwrite(str(folder / f"R{k:02d}.png"), frame.right[..., ::-1])
    calib = calibration(folder / "c.yml", shown)
    sides = ["--left", str(folder / "L*.png"), "--right", str(folder / "R*.png")]
    return shown, [*sides, "--fps", "25", "--calib", str(calib)]


def errors_of(balls: tuple[Film, list[str]], options: list[str], out: Path, ball: int) -> np.ndarray:
    """Distance in mm of each tracked position from a ball, in a track of this ball alone."""
    main(["track", *balls[1], *options, "--out", str(out)])
    truth = balls[0].truths[ball]
    path = np.array([row.position for row in truth])
    errors = errors_mm(out / "trajectory.csv", np.array([row.stamp_s for row in truth]), path)
    return errors[np.isfinite(errors)]


@pytest.mark.parametrize(("ball", "hue"), [(0, "359"), (1, "225")])
def test_a_hue(balls, tmp_path, ball, hue):
    errors = errors_of(balls, ["--hue", hue], tmp_path / "out", ball)
    assert len(errors) > 40
    assert np.median(errors) < 5
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["mode"] == "marker"


def box(shown: Film, ball: int, side: str, first: int = 0) -> list[str]:
    """X Y W H of a ball in an image."""
    truth = shown.truths[ball][first]
    x, y = truth.left_px if side == "left" else truth.right_px
    radius_px = 275 * truth.radius_m / truth.position[2]
    return [f"{value:.0f}" for value in (x - radius_px, y - radius_px, 2 * radius_px + 1, 2 * radius_px + 1)]


@pytest.mark.parametrize(("ball", "start_s"), [(0, 0.0), (1, 0.4)])
def test_boxes_in_the_first_images(balls, tmp_path, ball, start_s):
    shown = balls[0]
    first = round(FPS * start_s)
    boxes = [word for side in ("left", "right") for word in (f"--init-{side}", *box(shown, ball, side, first))]
    errors = errors_of(balls, [*boxes, "--start-s", str(start_s)], tmp_path / "out", ball)
    assert len(errors) > 40 - first
    assert np.median(errors) < 5
    assert len(json.loads((tmp_path / "out" / "summary.json").read_text())["tracks"]) == 1


def test_boxes_that_are_none(balls, tmp_path, refused):
    options = ["track", *balls[1], "--out", tmp_path / "out"]
    assert "expected both, or none" in refused(*options, "--init-left", 1, 2, 30, 40)
    line = refused(*options, "--init-left", 310, 2, 30, 40, "--init-right", 1, 2, 30, 40)
    assert "the object's box 310 2 30 40; expected X Y W H of at least 4 pixels a side, within 320×240" in line
    assert not (tmp_path / "out").exists()


def test_a_part_of_the_time(balls, tmp_path, refused, capsys):
    main(["info", *balls[1], "--start-s", "0.5", "--stop-s", "1.5", "--json"])
    facts = json.loads(capsys.readouterr().out)
    assert facts["pairs"] == 25
    assert facts["duration_s"] == pytest.approx(0.96)
    assert "--start-s 0.5 --stop-s 1.5" in facts["command"]
    line = refused("info", *balls[1], "--start-s", 9)
    assert "from 9 s to the end there is no pair; expected times from 0 to 1.96 s" in line


def test_a_part_of_the_images(balls, tmp_path, refused):
    """The red ball alone stays within it."""
    shown, options = balls
    px = np.array([[truth.left_px, truth.right_px] for truth in shown.truths[0]]).reshape(-1, 2)
    x, y = np.floor(px.min(axis=0) - 20).astype(int)
    w, h = np.ceil(px.max(axis=0) + 20).astype(int) - (x, y)
    errors = errors_of(balls, ["--one", "--roi", *map(str, (x, y, w, h))], tmp_path / "out", 0)
    assert len(errors) > (40 if HAS_PHOTOGRAPHS else 39)
    assert np.median(errors) < 5
    line = refused("track", *options, "--roi", 300, 0, 100, 100, "--out", tmp_path / "none")
    assert "roi 300 0 100 100; expected X Y W H within (320, 240) pixels" in line
