"""A photograph-like wall so far away that a camera before it only turns, drawn by a homography."""

from functools import cache

import cv2
import numpy as np

from pps_vision.geometry.camera import Camera
from pps_vision.types import Array, Image

CAMERA = Camera(320, 240, 280.0, 280.0, 159.5, 119.5)


@cache
def far_wall() -> Image:
    """(480, 640, 3) blobs of all sizes."""
    rng = np.random.default_rng(1)
    layers = [
        cv2.resize(rng.normal(0, 30, (480 // k, 640 // k, 1)), (640, 480), interpolation=cv2.INTER_CUBIC)
        for k in (6, 12, 24, 60)
    ]
    return np.clip(128 + np.sum(layers, axis=0)[..., None] + np.zeros(3), 0, 255).astype(np.uint8)


def seen(
    rotation: Array, rng: np.random.Generator, noise: float = 2.0, camera: Camera = CAMERA, wall: Image | None = None
) -> Image:
    """The wall from a camera turned by a rotation vector (T_root_camera), with pixel noise."""
    R = cv2.Rodrigues(np.asarray(rotation, float))[0]
    H = np.array([[1.0, 0, 160], [0, 1, 120], [0, 0, 1]]) @ CAMERA.K @ R @ np.linalg.inv(camera.K)
    size = camera.width, camera.height
    source = far_wall() if wall is None else wall
    image = cv2.warpPerspective(source, H, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP).astype(float)
    return np.clip(np.rint(image + noise * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)
