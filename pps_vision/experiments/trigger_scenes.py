"""What motion triggers are tried on: a head that is still or turns, and nothing, or a ball, that moves by itself."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from control.fixation import gaze_at
from pps_vision.experiments.disturbances import noisy
from pps_vision.experiments.footage import Footage, Posing, Studio
from pps_vision.experiments.independent_films import Film, IndependentScene
from pps_vision.experiments.independent_scenes import SensorChain
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
_FILM_HEAD_RATE = 3.9  # 1/s: how fast a film's eyes turn at most, per amplitude
_FILM_FOCAL = 0.86  # of a film, as a share of the width


@dataclass(frozen=True)
class Glimpse:
    """One eye's image, the view it was taken from, when, the robot's joints (rad) then, and where it sees itself."""

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
    return _eyes(studio, starting_footage(studio, rng, radius_m, px_per_frame, speed_rad_s, noise), shown=True)


def starting_footage(
    studio: Studio, rng: np.random.Generator, radius_m: float, px_per_frame: float, speed_rad_s: float, noise: float
) -> Footage:
    """The same as stereo frames."""
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
    return noisy(footage, noise, rng)


def independent_film(
    rng: np.random.Generator,
    data: Path,
    seconds: float,
    radius_m: float,
    px_per_frame: float,
    speed_deg_s: float,
    noise: float,
) -> Film:
    """A film of another source (ray casting, photographs on the walls): the head sways at up to `speed_deg_s`, its
    joints are 0–20 ms late, the light drifts and flickers; a ball starts to move at frame `STARTS`, or (0) rests."""
    distance = float(rng.uniform(0.4, 0.7))
    scene = IndependentScene(
        width=320,
        height=240,
        fps=FPS,
        seconds=seconds,
        rig="head",
        head_deg=speed_deg_s / _FILM_HEAD_RATE,
        stale_s=float(rng.uniform(0, 0.02)),
        radius_m=radius_m,
        color=tuple(rng.uniform(20, 235, 3).tolist()),
        motion="straight" if px_per_frame else "still",
        start="rest",
        rest_s=(STARTS - 1) / FPS,
        speed_m_s=px_per_frame * FPS * distance / (_FILM_FOCAL * 320),
        distance_m=distance,
        background=int(rng.integers(0, 100)),
        gain_drift=0.1,
        flicker=0.03,
        sensor=SensorChain(read_noise=noise, bayer=True),
    )
    return Film(scene, int(rng.integers(2**31)), data)


def independent(film: Film) -> list[Scene]:
    """The film as each eye's own scene; no robot is in view."""
    frames, views = [], []
    for frame in film:
        frames.append(frame)
        views.append(film.rig.view_of(frame))
    nobody = np.zeros(frames[0].left.shape[:2], bool)
    joints = [np.zeros(0) if frame.joints_left_rad is None else frame.joints_left_rad for frame in frames]
    radius = film.rig.left.focal_px * film.scene.radius_m / film.scene.distance_m
    sides = (
        ([frame.left for frame in frames], [view.left for view in views], [one.left_px for one in film.truth]),
        ([frame.right for frame in frames], [view.right for view in views], [one.right_px for one in film.truth]),
    )
    return [
        Scene(
            tuple(
                Glimpse(image, view, float(stamp), q, nobody)
                for image, view, stamp, q in zip(images, eye_views, film.stamps_s, joints, strict=True)
            ),
            np.array(centers),
            radius,
        )
        for images, eye_views, centers in sides
    ]


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
