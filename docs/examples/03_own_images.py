"""Track your own stereo images, given as arrays, with your own calibration (files: pv.open_recording(left=…))."""

import cv2
import numpy as np

import pps_vision as pv
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.types import StereoFrame
from tracking.tracker import TrackerParams

camera = Camera(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5)
T_left_right = np.eye(4)
T_left_right[0, 3] = 0.12  # the right camera is 12 cm to the right
rig = StereoRig.fixed(camera, camera, T_left_right)
tracker = pv.Tracker(TrackerParams(), rig, np.random.default_rng(0))

rng = np.random.default_rng(3)
wall = [cv2.GaussianBlur(rng.integers(0, 255, (480, 640, 3), np.uint8), (0, 0), 4) for _ in range(2)]
RADIUS_M, SHIFT = 0.04, 4  # cv2 draws at 1/16 px


def photo(view, background, center_m):
    """Stands for your camera: a red ball before a wall."""
    image = background.copy()
    at = tuple(int(v) for v in np.round(view.project(center_m) * 2**SHIFT))
    radius = round(camera.fx * RADIUS_M / center_m[2] * 2**SHIFT)
    return cv2.circle(image, at, radius, (220, 30, 30), -1, cv2.LINE_AA, SHIFT)


errors_mm = []
for k in range(40):
    center = np.array([-0.12 + 0.006 * k, 0.02, 0.9 - 0.003 * k])
    views = rig.view()
    images = photo(views.left, wall[0], center), photo(views.right, wall[1], center)
    track = tracker.step(StereoFrame(*images, k / 30, k / 30)).track
    if track.is_known:
        errors_mm.append(1000 * np.linalg.norm(track.position - center))
print(f"tracked in {len(errors_mm)} of 40 pairs, median error {np.median(errors_mm):.2f} mm at 0.8 m")
print(f"radius {1000 * track.radius_m:.1f} mm, velocity {np.round(track.velocity, 2)} m/s")
