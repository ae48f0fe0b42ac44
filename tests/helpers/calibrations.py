"""Calibrations as OpenCV and Kalibr write them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pps_vision.geometry.camera import StereoRig
from pps_vision.geometry.triangulation import triangulate
from pps_vision.recordings import CalibrationOptions
from pps_vision.recordings.stereo_calibration import read_stereo_calibration


@dataclass(frozen=True)
class StereoCamera:
    """The true camera matrices, distortions and pose of a stereo camera; its points are projected by OpenCV."""

    size: tuple[int, int]
    K: tuple[np.ndarray, np.ndarray]
    D: tuple[np.ndarray, np.ndarray]
    T_right_left: np.ndarray
    fisheye: bool = False

    def error_m(self, files: Sequence[Path], options: CalibrationOptions | None = None) -> float:
        """Largest distance of 50 points in the left camera's frame, triangulated by a calibration."""
        points = np.random.default_rng(1).uniform((-0.3, -0.2, 0.8), (0.3, 0.2, 2.0), (50, 3))
        project = cv2.fisheye.projectPoints if self.fisheye else cv2.projectPoints
        pixels = [
            project((points @ T[:3, :3].T + T[:3, 3])[:, None], np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
            for T, K, D in zip((np.eye(4), self.T_right_left), self.K, self.D, strict=True)
        ]
        view = StereoRig.fixed(*read_stereo_calibration(files, self.size, options or CalibrationOptions())).view()
        found = [triangulate(view, left, right, np.eye(2), np.eye(2)) for left, right in zip(*pixels, strict=True)]
        assert all(found)
        return float(np.max(np.abs([point.p_root for point in found if point] - points)))


def store(file: Path, flags: int = 0, **entries: np.ndarray | float) -> Path:
    """Write matrices and numbers under their names with OpenCV; returns the file."""
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE | flags)
    for key, value in entries.items():
        storage.write(key, value)
    storage.release()
    return file


def write_calibration(
    file: Path, focal_px: float, center_px: tuple[float, float], size: tuple[int, int] | None = None
) -> Path:
    """Parallel cameras 10 cm apart, with the size (width, height) of their images if given; returns the file."""
    K = np.array([[focal_px, 0, center_px[0]], [0, focal_px, center_px[1]], [0, 0, 1]])
    sizes = dict(zip(("image_width", "image_height"), size or (), strict=False))
    return store(file, K1=K, K2=K, R=np.eye(3), T=np.array([-0.1, 0, 0]), **sizes)


def write_camchain(
    file: Path, K_left: np.ndarray, K_right: np.ndarray, T_right_left: np.ndarray, size: tuple[int, int]
) -> Path:
    """Kalibr's file of two cameras without distortion whose images have a size (width, height); returns the file."""
    text = ""
    for k, K in enumerate((K_left, K_right)):
        text += f"cam{k}:\n  camera_model: pinhole\n  distortion_coeffs: [0, 0, 0, 0]\n  distortion_model: radtan\n"
        text += f"  intrinsics: [{K[0][0]}, {K[1][1]}, {K[0][2]}, {K[1][2]}]\n  resolution: {list(size)}\n"
    file.write_text(f"{text}  T_cn_cnm1: {T_right_left.tolist()}\n")
    return file
