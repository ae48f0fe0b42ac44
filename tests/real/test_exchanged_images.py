"""Real pairs of images: exchanged ones are told from correct ones, and no correct one is called exchanged."""

from dataclasses import replace

import cv2
from data import shared_data

from pps_vision.app.scene_points import faults_by_points
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.geometry.se3 import transform
from pps_vision.recordings import CalibrationOptions
from pps_vision.recordings.formats.stereo_images import open_stereo_images
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.types import StereoFrame


def test_a_rectified_pair():
    folder = shared_data("motorcycle")
    left, right = (cv2.imread(str(folder / f"motorcycle_{side}.png")) for side in ("left", "right"))
    height, width = left.shape[:2]
    camera = Camera(width, height, 1.35 * width, 1.35 * width, width / 2, height / 2)
    rig = StereoRig.fixed(camera, camera, transform(None, (0.193, 0.0, 0.0)))
    assert list(faults_by_points([StereoFrame(left, right, 0.0, 0.0, None, None)], rig)) == []
    (text,) = faults_by_points([StereoFrame(right, left, 0.0, 0.0, None, None)], rig)
    assert "--left and --right exchanged" in text


def test_a_calibration_that_hardly_fits():
    folder = shared_data("baseball")
    files = [folder / f"calibration_{name}_final.xml" for name in ("left", "right", "stereo")]
    rig = StereoRig.fixed(*read_stereo_calibration(files, (640, 480), CalibrationOptions(unit_m=0.0254)))
    every = list(open_stereo_images([str(folder / "1L*.jpg")], [str(folder / "1R*.jpg")], fps=30.0))
    frames = [frame for frame in every[::20] if isinstance(frame, StereoFrame)]
    (text,) = faults_by_points(frames, rig)
    assert text.startswith("another calibration: ")
    assert 5 < float(text.split("only within ")[1].split()[0]) < 15
    (text,) = faults_by_points([replace(frame, left=frame.right, right=frame.left) for frame in frames], rig)
    assert text.startswith("another calibration, or --left and --right exchanged: of ")
    assert "most matches lie behind the cameras" in text
