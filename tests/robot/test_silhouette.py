"""The robot's own image, against rays cast at its bodies."""

import numpy as np
import pytest

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.icub import LEFT_EYE, home, icub_rig, load_icub, set_gaze
from pps_vision.robot.model import Body
from pps_vision.robot.silhouette import Silhouette


def _hits(body: Body, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Whether rays (n, 3) from `origin` (body's frame) come into the body: points along them."""
    at = origin + rays[:, None] * np.linspace(0.05, 0.8, 300)[:, None]
    if body.shape == "sphere":
        inside = np.linalg.norm(at, axis=-1) < body.size_m[0]
    elif body.shape == "cylinder":
        inside = (np.hypot(at[..., 0], at[..., 1]) < body.size_m[0]) & (np.abs(at[..., 2]) < body.size_m[1] / 2)
    else:
        inside = np.all(np.abs(at) < np.array(body.size_m) / 2, axis=-1)
    return inside.any(axis=1)


def test_it_covers_the_arm_and_little_else():
    robot = load_icub()
    q = set_gaze(robot, home(robot), yaw=np.deg2rad(15), pitch=np.deg2rad(-38), tilt=np.deg2rad(-15))
    view = icub_rig(robot).view(q).left
    mask = Silhouette(robot, margin_px=0)(q, view)
    v, u = np.mgrid[2:240:8, 2:320:8]
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)
    rays = view.rays(pixels)
    true = np.zeros(len(pixels), bool)
    for body in robot.bodies:
        T_body_root = inverse(robot.at(q).T_root(body.frame) @ body.T_frame_body)
        true |= _hits(body, move_points(T_body_root, view.center), rays @ T_body_root[:3, :3].T)
    said = mask[pixels[:, 1], pixels[:, 0]]
    assert true.sum() > 60
    assert np.count_nonzero(true & ~said) < 0.03 * true.sum()
    assert np.count_nonzero(said & ~true) < 0.12 * true.sum()
    assert np.count_nonzero(Silhouette(robot, margin_px=4)(q, view)) > np.count_nonzero(mask)


def test_a_view_away_from_the_body_is_free():
    robot = load_icub()
    up = np.eye(4)
    up[:3, 3] = (0.0, 0.0, 1.0)
    assert not Silhouette(robot)(home(robot), View(LEFT_EYE, up)).any()


def test_bad_margin_is_named():
    with pytest.raises(ValueError, match="margin -1"):
        Silhouette(load_icub(), margin_px=-1)
