"""A ball thrown past level cameras that rest, cast ray by ray, on a path of gravity and drag integrated finely."""

from functools import cache

import numpy as np
from ball_scenes import Sphere, look
from scipy.integrate import solve_ivp

from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.types import Array, Image, StereoFrame

FOCAL_PX, CENTER_PX, DRAG_PER_M = 300.0, (159.5, 119.5), 0.14
CAMERA = Camera(320, 240, FOCAL_PX, FOCAL_PX, *CENTER_PX)
T_LEFT_RIGHT = np.array([[1.0, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
RIG = StereoRig.fixed(CAMERA, CAMERA, T_LEFT_RIGHT)
UP = (0.0, -1.0, 0.0)
FPS, HIDDEN = 60, range(15, 26)


def _rate(_: float, x: Array) -> Array:
    return np.concatenate([x[3:], [0, 9.81, 0] - DRAG_PER_M * np.linalg.norm(x[3:]) * x[3:]])


@cache
def thrown() -> tuple[list[StereoFrame], Array]:
    """Frames, in those of `HIDDEN` without the ball, and its position and velocity (n, 6) in the left camera's
    frame."""
    stamps, begin = np.arange(31) / FPS, [-0.5, 0.15, 1.1, 2.0, -2.2, -0.5]
    path = solve_ivp(_rate, (0, stamps[-1]), begin, t_eval=stamps, rtol=1e-9).y.T
    rng, black = np.random.default_rng(5), np.zeros((240, 320, 3), np.uint8)
    view = RIG.view_of(StereoFrame(black, black, 0.0, 0.0))

    def images(k: int) -> tuple[Image, Image]:
        balls = [] if k in HIDDEN else [Sphere(path[k, :3], 0.03, (210.0, 45.0, 40.0))]
        return look(view.left, balls, rng), look(view.right, balls, rng)

    return [StereoFrame(*images(k), float(t), float(t)) for k, t in enumerate(stamps)], path
