"""Flat patterns seen by two known cameras."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

SIZE = (640, 480)
K = (np.array([[520.0, 0, 318], [0, 524, 236], [0, 0, 1]]), np.array([[498.0, 0, 330], [0, 500, 249], [0, 0, 1]]))
R = Rotation.from_rotvec([0.01, -0.06, 0.02]).as_matrix()
T = np.array([-0.12, 0.003, 0.004])


def seen(pattern: np.ndarray, pixel_m: float, pose_R: np.ndarray, pose_t: np.ndarray, side: int) -> np.ndarray:
    """An image of a pattern with pixels of a side in metres, whose middle is at a pose, anti-aliased.

    It lies in the plane through K [r1 r2 t]; pixel centres are at integer coordinates.
    """
    if side:
        pose_R, pose_t = R @ pose_R, R @ pose_t + T
    middle = (np.array(pattern.shape[::-1]) - 1) / 2
    plane = np.array([[pixel_m, 0, -pixel_m * middle[0]], [0, pixel_m, -pixel_m * middle[1]], [0, 0, 1]])
    H = K[side] @ np.column_stack([pose_R[:, 0], pose_R[:, 1], pose_t]) @ plane
    finer = np.array([[3.0, 0, 1], [0, 3, 1], [0, 0, 1]])
    large = cv2.warpPerspective(pattern, finer @ H, (3 * SIZE[0], 3 * SIZE[1]), borderValue=90)
    return cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA)
