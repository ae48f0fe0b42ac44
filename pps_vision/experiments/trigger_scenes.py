"""What motion triggers are tried on: a head that is still or turns, and nothing, or a ball, that moves by itself."""

from dataclasses import dataclass

import numpy as np

from control.fixation import gaze_at
from pps_vision.experiments.disturbances import noisy
from pps_vision.experiments.footage import Footage, Posing, Studio
from pps_vision.geometry.camera import Camera, View
from pps_vision.robot.icub import home
from pps_vision.robot.model import Robot
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, Image, Mask
from rendering.stimuli import make_stimulus

FPS = 20.0
STARTS = 20  # frame at which the ball begins to move: by then every method has a second behind it
AFTER = 12  # frames that it moves
_SWAY_HZ = (0.3, 0.6)


@dataclass(frozen=True)
class Glimpse:
    """One eye's image, whence it was taken, when, the robot's joints (rad) then, and where it sees itself."""

    image: Image
    view: View
    stamp_s: float
    joints_rad: Array
    own: Mask


@dataclass(frozen=True)
class Scene:
    """What one eye sees at `FPS`; `center_px` (n, 2) and `radius_px` of the ball in it, NaN where there is none;
    it moves from frame `STARTS` on."""

    glimpses: tuple[Glimpse, ...]
    center_px: Array
    radius_px: float

    @property
    def camera(self) -> Camera:
        """The eye's."""
        return self.glimpses[0].view.camera


def quiet(studio: Studio, rng: np.random.Generator, seconds: float, speed_rad_s: float, noise: float) -> list[Scene]:
    """Both eyes of a head that turns at up to `speed_rad_s`, the robot's arms in view and nothing that moves."""
    p = _place(rng)
    motion = _Starting(p, np.zeros(3))
    pose = swaying(studio.robot, rng, p, speed_rad_s)
    footage = noisy(studio.film(motion, seconds, pose, FPS, empty=True), noise, rng)
    return _eyes(studio, footage, shown=False)


def starting(
    studio: Studio, rng: np.random.Generator, radius_m: float, px_per_frame: float, speed_rad_s: float, noise: float
) -> list[Scene]:
    """Both eyes of such a head, and a ball at rest that at frame `STARTS` begins to cross the view."""
    p = _place(rng)
    pose = swaying(studio.robot, rng, p, speed_rad_s)
    view = studio.rig.view(pose(STARTS / FPS, home(studio.robot), p)).left
    line = p - view.center
    across = np.cross(line, rng.standard_normal(3))
    per_px = float(np.linalg.norm(line)) / view.camera.focal_px
    velocity = across / np.linalg.norm(across) * px_per_frame * per_px * FPS
    footage = studio.film(
        _Starting(p, velocity), (STARTS + AFTER) / FPS, pose, FPS, stimulus=make_stimulus("ball", radius_m)
    )
    return _eyes(studio, noisy(footage, noise, rng), shown=True)


def swaying(robot: Robot, rng: np.random.Generator, p: Array, speed_rad_s: float) -> Posing:
    """A gaze at `p` (3,) with neck yaw and pitch swinging about it, at most `speed_rad_s` together."""
    q0 = gaze_at(robot, home(robot), p)
    joints = robot.indices(robot.names.gaze_joints)[:2]
    omega = 2 * np.pi * rng.uniform(*_SWAY_HZ, 2)
    phase = rng.uniform(0, 2 * np.pi, 2)
    share = rng.uniform(0, np.pi / 2)
    amplitude = speed_rad_s * np.array([np.cos(share), np.sin(share)]) / omega

    def pose(t: float, _q: Array, _p: Array) -> Array:
        q = q0.copy()
        q[joints] += amplitude * np.sin(omega * t + phase)
        return robot.clamp(q)

    return pose


@dataclass(frozen=True)
class _Starting:
    """At rest until frame `STARTS`, then at constant velocity."""

    p: Array
    velocity: Array

    def __call__(self, t_s: float) -> tuple[Array, Array]:
        since = t_s - (STARTS - 1) / FPS  # so that frame STARTS is the first to show it elsewhere
        return self.p + max(since, 0.0) * self.velocity, self.velocity if since > 0 else np.zeros(3)


def _place(rng: np.random.Generator) -> Array:
    """A point 0.35 to 0.6 m before the robot's eyes, above its arms or among them."""
    azimuth, elevation = np.deg2rad(rng.uniform((-20, -30), (20, 5)))
    ahead = [-np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    return np.array([-0.063, 0.0, 0.341]) + rng.uniform(0.35, 0.6) * np.array(ahead)


def _eyes(studio: Studio, footage: Footage, shown: bool) -> list[Scene]:
    """The footage as each eye's own scene."""
    silhouette = Silhouette(studio.robot)
    views = [studio.rig.view_of(frame) for frame in footage.frames]
    sides = (
        [(f.left, v.left) for f, v in zip(footage.frames, views, strict=True)],
        [(f.right, v.right) for f, v in zip(footage.frames, views, strict=True)],
    )
    joints = [frame.joints_left_rad for frame in footage.frames]
    scenes = []
    for side in sides:
        glimpses = tuple(
            Glimpse(image, view, k / FPS, q, silhouette(q, view))
            for k, ((image, view), q) in enumerate(zip(side, joints, strict=True))
            if q is not None
        )
        center = np.array([one.view.project(p) for one, p in zip(glimpses, footage.position, strict=True)])
        nearest = min(np.linalg.norm(p - one.view.center) for one, p in zip(glimpses, footage.position, strict=True))
        radius = glimpses[0].view.camera.focal_px * footage.radius_m / float(nearest)
        scenes.append(Scene(glimpses, center if shown else np.full_like(center, np.nan), radius))
    return scenes
