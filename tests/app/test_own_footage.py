"""A laboratory's first recording: a compressed side-by-side video of a ball, a calibration file and the true path."""

from fractions import Fraction

import av
import cv2
import numpy as np
from data import SEED

from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.recordings.open import open_recording
from pps_vision.testing import check_error

CAMERA = Camera(width=320, height=240, fx=300.0, fy=300.0, cx=159.5, cy=119.5)
RADIUS_M = 0.04
SHIFT = 4  # OpenCV draws at 1/16 px


def test_tracked_within_millimetres(tmp_path):
    """The ball is drawn by OpenCV where the camera model projects its centre; frames are not evenly spaced."""
    T_left_right = np.eye(4)
    T_left_right[0, 3] = 0.12
    views = StereoRig.fixed(CAMERA, CAMERA, T_left_right).view()
    rng = np.random.default_rng(SEED)
    walls = [cv2.GaussianBlur(rng.integers(0, 255, (240, 320, 3), np.uint8), (0, 0), 4) for _ in range(2)]
    stamps_ms = np.cumsum(np.r_[5000, rng.integers(25, 42, 49)])
    truth = [(-0.12 + 0.15 * t, 0.02, 0.9 - 0.08 * t) for t in (stamps_ms - 5000) / 1000]
    with av.open(str(tmp_path / "both.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=1000, options={"crf": "12"})
        stream.width, stream.height, stream.pix_fmt = 640, 240, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for stamp_ms, center in zip(stamps_ms.tolist(), truth, strict=True):
            halves = []
            for view, wall in zip((views.left, views.right), walls, strict=True):
                at = tuple(int(v) for v in np.round(view.project(np.array(center)) * 2**SHIFT))
                radius = round(CAMERA.fx * RADIUS_M / center[2] * 2**SHIFT)
                halves.append(cv2.circle(wall.copy(), at, radius, (220, 30, 30), -1, cv2.LINE_AA, SHIFT))
            frame = av.VideoFrame.from_ndarray(np.hstack(halves), format="rgb24")
            frame.pts, frame.time_base = stamp_ms, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    np.savetxt(tmp_path / "truth.tum", np.c_[stamps_ms / 1000, truth, np.tile([0, 0, 0, 1.0], (50, 1))])
    camera = "camera_model: pinhole\n  distortion_coeffs: [0, 0, 0, 0]\n  distortion_model: radtan\n"
    camera = f"  {camera}  intrinsics: [300, 300, 159.5, 119.5]\n  resolution: [320, 240]\n"
    pose = "  T_cn_cnm1:\n  - [1, 0, 0, -0.12]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n"
    (tmp_path / "camchain.yaml").write_text(f"cam0:\n{camera}cam1:\n{pose}{camera}")

    recording = open_recording(tmp_path / "both.mp4", calib=[tmp_path / "camchain.yaml"])
    (score,) = check_error([recording], rmse_mm=5, lost_share=0.3, truth=[tmp_path / "truth.tum"])
    assert abs(score.bias_z_mm) < 4
