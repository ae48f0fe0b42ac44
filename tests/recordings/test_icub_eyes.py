"""The robot's calibration form, and fitting a camera to images of another resolution."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.icub_eyes import fit_to_images, read_icub_eyes, write_icub_eyes
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE


@pytest.fixture
def ini(tmp_path: Path) -> Path:
    file = tmp_path / "icubEyes.ini"
    write_icub_eyes(file, LEFT_EYE, RIGHT_EYE)
    return file


def test_what_is_written_is_read(ini):
    assert read_icub_eyes(ini) == (LEFT_EYE, RIGHT_EYE)


def test_tabs_comments_and_foreign_keys_are_taken(ini):
    text = ini.read_text().replace("fx ", "fx\t\t").replace("[CAMERA", "// a remark\ndrawCenterCross\t0\n[CAMERA")
    ini.write_text(text + "\n[STEREO]\nfx wrong\n")
    assert read_icub_eyes(ini) == (LEFT_EYE, RIGHT_EYE)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fx 219.057", "fx abc", r"icubEyes\.ini:5: fx abc; expected a finite number"),
        ("fx 219.057", "fx nan", r"icubEyes\.ini:5: fx nan; expected a finite number"),
        ("fx 219.057", "fx 0", r"icubEyes\.ini:5: fx 0; expected a positive"),
        ("w 320", "w 0.3", r"icubEyes\.ini:3: w 0\.3; expected a whole number"),
        ("w 320", "w 65537", r"icubEyes\.ini:3: w 65537; expected a whole number of pixels, at most 65536"),
        ("h 240", "h 0", r"icubEyes\.ini:4: h 0; expected a positive number"),
        ("h 240", "h 240.5", r"icubEyes\.ini:4: h 240\.5; expected a whole number"),
        ("fx 219.057", "fx 1e308", r"icubEyes\.ini: .*fx 1e\+308.*; expected a camera whose"),
        ("fx 219.057", "fx 1e-300", r"icubEyes\.ini: .*fx 1e-300.*; expected a camera whose"),
        ("k1 -0.374173", "k1 1e9", r"icubEyes\.ini: .*1000000000\.0.*; expected a camera whose"),
        ("k1 -0.374173", "k1 -3", r"icubEyes\.ini: .*-3\.0.*; expected a camera whose"),
        ("k2 0.205428", "k2 1e308", r"icubEyes\.ini: .*1e\+308.*; expected a camera whose"),
        (f"cx {LEFT_EYE.cx!r}", "cx 1e9", r"icubEyes\.ini: .*cx 1e\+09.*; expected a camera whose"),
        ("fx 219.057", "", r"icubEyes\.ini:1: \[CAMERA_CALIBRATION_LEFT\] has no fx"),
        ("[CAMERA_CALIBRATION_RIGHT]", "[OTHER]", r"icubEyes\.ini: no section \[CAMERA_CALIBRATION_RIGHT\]"),
    ],
)
def test_what_is_missing_is_named(ini, old, new, message):
    assert old in ini.read_text()
    ini.write_text(ini.read_text().replace(old, new))
    with pytest.raises(InputError, match=message):
        read_icub_eyes(ini)


def test_a_resized_image_shows_the_same_point_at_the_resized_camera(ini):
    # the oracle is OpenCV's own resizing: the centroid of a blob seen by either camera
    left, _ = read_icub_eyes(ini, (640, 480))
    point = np.array([0.05, 0.02, 0.4])
    u, v = LEFT_EYE.project(point)
    rows, columns = np.mgrid[:240, :320]
    blob = np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / 18)
    large = cv2.resize(blob, (640, 480), interpolation=cv2.INTER_AREA)
    rows, columns = np.mgrid[:480, :640]
    centroid = np.array([(large * columns).sum(), (large * rows).sum()]) / large.sum()
    np.testing.assert_allclose(left.project(point), centroid, atol=0.01)


def test_other_proportions_are_refused():
    with pytest.raises(InputError, match=r"a\.ini: calibrated for 320×240 pixels, images are 640×360"):
        fit_to_images(LEFT_EYE, (640, 360), Path("a.ini"))
    assert fit_to_images(LEFT_EYE, (640, 481), Path("a.ini")).height == 481  # a pixel of rounding
    with pytest.raises(InputError, match="expected the same proportions"):
        fit_to_images(LEFT_EYE, (640, 482), Path("a.ini"))
