"""A tag drawn through two known cameras, and the path that is read from it."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibrations import store
from flat_patterns import SIZE, K, R, T, seen
from scipy.spatial.transform import Rotation

from pps_vision.app.cli import main
from pps_vision.app.evaluate import read_path

TAG_PX = 240
TAG_MM = 48.0


@pytest.fixture
def tagged(tmp_path: Path) -> tuple[list[str], np.ndarray]:
    """Options of a recording of a tag that moves and turns, and where a point 30 mm behind its centre is."""
    tag = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 7, TAG_PX)
    tag = cv2.copyMakeBorder(tag, *[TAG_PX // 4] * 4, cv2.BORDER_CONSTANT, value=255)
    truth = []
    for k in range(4):
        turn = Rotation.from_rotvec([0.1 * k, -0.25 + 0.1 * k, 0.15 * k]).as_matrix()
        at = np.array([0.02 * k + 0.02, 0.01 * k - 0.02, 0.45 + 0.02 * k])
        for side, name in enumerate(("left", "right")):
            cv2.imwrite(str(tmp_path / f"{name}{k}.png"), seen(tag, TAG_MM / 1000 / TAG_PX, turn, at, side))
        truth.append(at + turn @ np.array([0, 0, 0.03]))  # in the image's frame z points into the tag
    calib = store(tmp_path / "calib.yml", K1=K[0], K2=K[1], R=R, T=T, image_width=SIZE[0], image_height=SIZE[1])
    images = ["--left", str(tmp_path / "left*.png"), "--right", str(tmp_path / "right*.png"), "--fps", "10"]
    return [*images, "--calib", str(calib)], np.array(truth)


def test_the_path_of_a_point_behind_the_tag(tmp_path, tagged, capsys):
    options, truth = tagged
    words = ["truth", *options, "--aruco", "7", "--offset-mm", "0", "0", "-30", "--out", str(tmp_path / "truth.tum")]
    main([*words, "--tag-mm", str(TAG_MM)])
    said = capsys.readouterr()
    assert re.match(r"tag 7 in 4 of 4 pairs, 4[78]\.\d\d mm → ", said.out)
    assert said.err == ""
    path = read_path(tmp_path / "truth.tum")
    np.testing.assert_allclose(path.stamps_s, [0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(path.position, truth, atol=6e-4)
    for stated_mm, doubted in (("45", True), ("46.5", False), ("49.5", False), ("51.5", True)):  # by 5 %
        main([*words, "--tag-mm", stated_mm])
        said = capsys.readouterr().err
        warning = f"warning: the tag measures 4[78]\\.\\d mm, not {stated_mm}: wrong unit\\?\n"
        assert re.fullmatch(warning if doubted else "", said)


def test_without_an_offset_it_is_the_tags_centre_where_both_eyes_see_it_once(tmp_path, tagged):
    options, truth = tagged
    hidden, twice = tmp_path / "right1.png", tmp_path / "left2.png"
    cv2.imwrite(str(hidden), 0 * cv2.imread(str(hidden)))
    cv2.imwrite(str(twice), np.hstack([cv2.imread(str(twice))[:, 160:480]] * 2))
    main(["truth", *options, "--aruco", "7", "--tag-mm", str(TAG_MM), "--out", str(tmp_path / "truth.tum")])
    path = read_path(tmp_path / "truth.tum")
    np.testing.assert_allclose(path.stamps_s, [0, 0.3])
    turns = [Rotation.from_rotvec([0.1 * k, -0.25 + 0.1 * k, 0.15 * k]).as_matrix() for k in (0, 3)]
    centre = truth[[0, 3]] - 0.03 * np.array([turn[:, 2] for turn in turns])
    np.testing.assert_allclose(path.position, centre, atol=6e-4)


def test_what_shows_no_tag(tmp_path, tagged, refused):
    words = ["truth", *tagged[0], "--out", tmp_path / "a"]
    assert "no pair shows tag 8" in refused(*words, "--aruco", 8, "--tag-mm", 48)
    assert "inf is no finite number" in refused(*words, "--aruco", 7, "--tag-mm", "inf")
    assert "positive length" in refused(*words, "--aruco", 7, "--tag-mm", 0)
    assert "dictionary 'x'" in refused(*words, "--aruco", 7, "--tag-mm", 48, "--dictionary", "x")
