"""What the stereo methods are shown: a ball at a distance, before eyes of a vergence, and its true outline."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from pps_vision.geometry.camera import StereoRig, StereoView, View
from pps_vision.robot.icub import home, icub_rig, load_icub, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask, StereoFrame
from rendering.eyes import Eyes
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.shapes import Part, sphere
from rendering.stimuli import ORANGE, Stimulus, make_stimulus
from tracking.ego_motion import Box

BALL_M = 0.035
_OPEN_M = np.array([[-1.8, -1.4, -0.1], [0.8, 1.4, 1.3]])  # root frame: inside the room, above the table
_MARGIN_PX = 8  # around the object's mask: the outline wants to see some background


@dataclass(frozen=True, slots=True)
class Scene:
    """A stereo pair, both eyes as they were, where the ball (3,) really is, its radius, and for each eye the
    pixels of a region whose centre is on the ball, and the region."""

    frame: StereoFrame
    view: StereoView
    p: Array
    radius_m: float
    masks: tuple[tuple[Mask, Box], tuple[Mask, Box]]


def shown(frame: StereoFrame, view: StereoView, p: Array, radius_m: float) -> Scene:
    """A scene with its true masks."""
    return Scene(frame, view, p, radius_m, (_mask(view.left, p, radius_m), _mask(view.right, p, radius_m)))


def _mask(eye: View, p: Array, radius_m: float) -> tuple[Mask, Box]:
    line = p - eye.center
    distance = float(np.linalg.norm(line))
    toward = eye.T_root_camera[:3, :3].T @ line / distance
    mask = eye.camera.bearing_map @ toward > np.sqrt(1 - (radius_m / distance) ** 2)
    ys, xs = np.nonzero(mask)
    x0, y0 = max(int(xs.min()) - _MARGIN_PX, 0), max(int(ys.min()) - _MARGIN_PX, 0)
    x1, y1 = int(xs.max()) + _MARGIN_PX + 1, int(ys.max()) + _MARGIN_PX + 1
    box = x0, y0, min(x1, eye.camera.width), min(y1, eye.camera.height)
    return mask[box[1] : box[3], box[0] : box[2]], box


class Theatre:
    """Shows balls to a robot; made by `open_theatre`."""

    def __init__(self, robot: Robot, rig: StereoRig, eyes: Eyes) -> None:
        self.robot, self.rig, self._eyes = robot, rig, eyes

    def scenes(
        self, stimulus: Stimulus, depth_m: float, vergence_rad: float | None, n: int, rng: np.random.Generator
    ) -> Iterator[Scene]:
        """`n` scenes with the stimulus so far before the eyes, seen whole by both; they converge on its
        distance unless their vergence is given."""
        self._eyes.set_stimulus(stimulus)
        vergence = converging(depth_m) if vergence_rad is None else vergence_rad
        for _ in range(50 * n):
            yaw, pitch = rng.uniform((-0.7, -0.3), (0.7, 0.1))
            q = set_gaze(self.robot, home(self.robot), yaw, pitch, vergence=vergence)
            view = self.rig.view(q)
            p = ahead(view, depth_m, rng.normal(0, 0.08, 3))
            distance = np.linalg.norm(p - view.left.center)
            margin_px = 1.1 * view.left.camera.focal_px * np.tan(np.arcsin(stimulus.radius_m / distance)) + 4
            in_the_open = np.all((_OPEN_M[0] < p) & (p < _OPEN_M[1]))
            if in_the_open and view.left.sees(p, margin_px) and view.right.sees(p, margin_px):
                yield shown(self._eyes.render(SceneState(q, p), 0.0, rng), view, p, stimulus.radius_m)
                n -= 1
            if not n:
                return
        raise ValueError(f"no ball {depth_m} m ahead is seen whole by eyes of {np.rad2deg(vergence):.0f}° vergence")

    def film(
        self, stimulus: Stimulus, depth_m: float, moving_head: bool, n: int, rng: np.random.Generator
    ) -> Iterator[Scene]:
        """`n` frames at 20 Hz of a slow round of 3 cm about a point that far ahead; the head sways or is still."""
        self._eyes.set_stimulus(stimulus)
        yaw, pitch = rng.uniform((-0.3, -0.3), (0.3, 0.0))
        vergence = converging(depth_m)
        start = self.rig.view(set_gaze(self.robot, home(self.robot), yaw, pitch, vergence=vergence))
        middle, plane = ahead(start, depth_m, np.zeros(3)), np.linalg.qr(rng.standard_normal((3, 3)))[0][:2]
        for k in range(n):
            t = 0.05 * k
            sway = np.deg2rad([4.0, 2.5]) * np.sin(2 * np.pi * np.array([0.31, 0.23]) * t) * moving_head
            q = set_gaze(self.robot, home(self.robot), yaw + sway[0], pitch + sway[1], vergence=vergence)
            p = middle + 0.03 * np.array([np.cos(3.3 * t), np.sin(3.3 * t)]) @ plane
            yield shown(self._eyes.render(SceneState(q, p), t, rng), self.rig.view(q), p, stimulus.radius_m)


@contextmanager
def open_theatre(noise_sigma: float) -> Iterator[Theatre]:
    """An iCub at home whose eyes add pixel noise; leaving gives the graphics memory back."""
    robot = load_icub()
    rig = icub_rig(robot)
    with Eyes(robot, rig, make_stimulus("ball"), sensor=Sensor(noise_sigma=noise_sigma)) as eyes:
        yield Theatre(robot, rig, eyes)


def converging(depth_m: float) -> float:
    """The vergence (rad) of eyes that meet at a distance."""
    return float(2 * np.arctan(0.034 / depth_m))


def ahead(view: StereoView, depth_m: float, aside: Array) -> Array:
    """(3,) the point so far before the middle between the eyes, `aside` of where both look."""
    way = 0.5 * (view.left.T_root_camera[:3, 2] + view.right.T_root_camera[:3, 2])
    way = way / np.linalg.norm(way) + aside
    p: Array = 0.5 * (view.left.center + view.right.center) + depth_m * way / np.linalg.norm(way)
    return p


def patched_ball(rng: np.random.Generator, patches: int = 90, shades: int = 6) -> Stimulus:
    """An orange ball with texture: patches of different brightness."""
    mesh: Any = sphere(BALL_M, ORANGE).mesh
    patch = np.argmax(mesh.face_normals @ rng.standard_normal((patches, 3)).T, axis=1)
    shade = rng.permutation(np.resize(np.arange(shades), patches))[patch]
    parts = []
    for k in np.unique(shade):
        light = 0.25 + 0.75 * k / (shades - 1)
        color = (ORANGE[0] * light, ORANGE[1] * light, ORANGE[2] * light)
        parts.append(Part(mesh.submesh([np.flatnonzero(shade == k)], repair=False)[0], color))
    return Stimulus("ball", BALL_M, tuple(parts))
