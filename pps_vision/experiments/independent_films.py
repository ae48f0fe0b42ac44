"""Independent scene source: what is filmed, from where, and the truth.

Motions, rig and head kinematics are this file's own (from the iCub's Denavit–Hartenberg tables in iKin); only what the
tracker is told is made of the project's types.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from pps_vision.experiments.baselines.image_trackers import BoxPx
from pps_vision.experiments.independent_scenes import (
    EDGE_SAMPLES,
    Arrangement,
    Ball,
    Caster,
    Color,
    Cylinder,
    Lens,
    Panel,
    Pattern,
    Room,
    Surface,
    outline,
    photograph,
    visible_share,
)
from pps_vision.experiments.sensor_chain import SensorChain, noise_tape
from pps_vision.experiments.study import DATA
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.types import Array, Image, StereoFrame, Truth

Path3D = Callable[[float], tuple[Array, Array]]  # time → position (3,) m and velocity (3,) m/s
SEEN_SHARE = 0.5  # of its image an eye must see to be said to see the object
CARDBOARD: Color = (140.0, 107.0, 71.0)
FINGER: Color = (150.0, 150.0, 150.0)
FINGER_M = (0.008, 0.4)  # radius and length of what holds an object
_FINGER_AXIS = np.array([0.1, 1.0, -0.35]) / np.linalg.norm([0.1, 1.0, -0.35])  # from the object, down and nearer

# The iCub's head, standard Denavit–Hartenberg: joint, A (m), D (m), α (deg), offset (deg); the sign of the eye's D is
# minus for the left eye, plus for the right (iKin).
_H0 = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
_HEAD = (
    ("torso_pitch", 0.032, 0.0, 90.0, 0.0),
    ("torso_roll", 0.0, -0.0055, 90.0, -90.0),
    ("torso_yaw", 0.00231, -0.1933, -90.0, -90.0),
    ("neck_pitch", 0.033, 0.0, 90.0, 90.0),
    ("neck_roll", 0.0, 0.001, -90.0, -90.0),
    ("neck_yaw", -0.054, 0.0825, -90.0, 90.0),
    ("eyes_tilt", 0.0, 0.034, -90.0, 0.0),
    ("eye_pan", 0.0, 0.0, 90.0, -90.0),
)
EYES_AT_REST = np.array([-0.06281, 0.0, 0.3408])  # midway between the iCub's eyes with all joints at 0, root frame
T_ROOT_STAGE_HEAD = np.array([[0.0, 0, -1, EYES_AT_REST[0]], [1, 0, 0, 0], [0, -1, 0, EYES_AT_REST[2]], [0, 0, 0, 1]])


@dataclass(frozen=True)
class IndependentScene:
    """A film's parameters.  The defaults are the setting of the tracking table: 640×480, 12 cm baseline, 0.6 m away,
    30 cm/s, noise of 2 levels."""

    # camera
    width: int = 640
    """Image width, px."""
    height: int = 480
    """Image height, px."""
    focal: float = 0.86
    """Focal length as a share of the width."""
    distortion: tuple[float, float, float, float, float] = (-0.12, 0.05, 0.0006, -0.0004, 0.0)
    """OpenCV's k1, k2, p1, p2, k3 of the left eye; the right eye's are 0.9 times as large."""
    baseline_m: float = 0.12
    """Distance between the eyes; the head has its own, 68 mm."""
    fps: float = 30.0
    """Pairs a second, 10–60."""
    seconds: float = 4.0
    """Length of the film."""
    # rig
    rig: Literal["fixed", "rotating", "shaking", "head"] = "fixed"
    """How the eyes move: not; about the vertical axis, sinusoidally; about all axes, irregularly; an iCub's neck and
    eyes."""
    rig_known: bool = False
    """Whether the tracker is told the pose of a rotating or shaking rig; else the rig is declared fixed."""
    rotation_deg: float = 1.0
    """Amplitude of the rotating rig."""
    rotation_hz: float = 0.5
    """Its frequency."""
    shake_deg: float = 0.1
    """Standard deviation of the shaking rig about each axis."""
    head_deg: float = 8.0
    """Amplitude of the neck's yaw; the other joints of neck and eyes move less."""
    stale_s: float = 0.0
    """Age of the joints that come with an image."""
    # object
    shape: Literal["ball", "square"] = "ball"
    """A ball, or a flat square that faces the eyes, slightly turned."""
    radius_m: float = 0.03
    """Radius of the ball; half the side of the square."""
    color: Color | Literal["background"] = (205.0, 30.0, 25.0)
    """RGB, levels; background: the mean of the photograph."""
    color2: Color = (235.0, 235.0, 235.0)
    """Second colour of a pattern."""
    pattern: Pattern = "plain"
    """How the object is painted."""
    texture: int = 1
    """Photograph (index) of a textured object."""
    spin_rad_s: float = 0.0
    """How fast the object turns about an oblique axis (a ball), or in its plane (a square)."""
    second: Literal["none", "same", "other"] = "none"
    """A second ball, 15 cm farther away, that moves against the first: none, of the same colour, blue."""
    hidden_s: float = 0.0
    """A board amid the view hides what passes it at `speed_m_s` for so long; 0: no board."""
    finger: bool = False
    """A grey finger from beyond the image's lower edge holds the object and moves with it."""
    # motion
    motion: Literal["straight", "stop_and_go", "reversal", "circle", "still"] = "circle"
    """Straight across the view; 1.5 s on a circle, 2 s at rest, and on; to and fro with instant reversal; around an
    oblique circle; at rest."""
    start: Literal["moving", "rest", "entering"] = "entering"
    """How the film begins: moving in view, at rest in view for `rest_s`, or out of view."""
    rest_s: float = 1.0
    """Rest of `start` rest."""
    speed_m_s: float = 0.3
    """Speed, 0.02–1."""
    extent_m: float = 0.12
    """Radius of the circle; half the way of the reversal."""
    distance_m: float = 0.6
    """From the eyes to the middle of the motion."""
    # light and sensor
    background: int = 0
    """Photograph (index) on the walls."""
    ahead_m: float = 1.6
    """Distance of the wall ahead."""
    shutter_s: float = 0.0
    """How long the shutter is open, centred on the stamp: motion blur."""
    gain_drift: float = 0.0
    """Amplitude of a slow (0.2 Hz) change of the gain, a share, a quarter period later in the right eye."""
    flicker: float = 0.0
    """Amplitude of the light's 100 Hz flicker as the shutter's phase drifts along it, a share."""
    sensor: SensorChain = SensorChain()
    """The rest of the sensor."""

    def __post_init__(self) -> None:
        if not (32 <= self.width <= 4096 and 24 <= self.height <= 4096 and self.fps > 0 and self.seconds > 0):
            raise ValueError(f"scene of {self.width}×{self.height} px, {self.fps} fps, {self.seconds} s")
        if self.rig == "head" and self.rig_known:
            raise ValueError("rig_known with the head; its joints are always told, `stale_s` old")

    @property
    def mode_hue_deg(self) -> float:
        """Hue of the object's colour, for a marker tracker."""
        color = np.array([[self.color if not isinstance(self.color, str) else (128.0, 128.0, 128.0)]], np.float32)
        return float(cv2.cvtColor(color / 255, cv2.COLOR_RGB2HSV)[0, 0, 0])


def head_pose(joints_rad: Mapping[str, float], side: Literal["left", "right"]) -> Array:
    """T_root_eye (4, 4) of the iCub by the table above; joints that are not named are 0."""
    T = _H0.copy()
    for name, a, d, alpha, offset in _HEAD:
        joint = f"{side}_eye_pan" if name == "eye_pan" else name
        if name == "eyes_tilt" and side == "left":
            d = -d
        T = T @ _denavit_hartenberg(a, d, np.deg2rad(alpha), joints_rad.get(joint, 0.0) + np.deg2rad(offset))
    return T


def _denavit_hartenberg(a: float, d: float, alpha: float, theta: float) -> Array:
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]])


def lenses(scene: IndependentScene) -> tuple[Lens, Lens]:
    """Left and right; slightly different, as lenses are."""
    f, w, h = scene.focal * scene.width, scene.width, scene.height
    K = [np.array([[f * s, 0, (w - 1) / 2 + du], [0, f * s, (h - 1) / 2 + dv], [0, 0, 1.0]]) for s, du, dv in _MADE]
    bent = np.array(scene.distortion)
    return Lens(w, h, K[0], bent), Lens(w, h, K[1], 0.9 * bent)


_MADE = ((1.0, 3.2, -2.6), (1.004, -2.4, 1.7))  # of each eye: relative focal length, principal point off the middle


class Film:
    """Stereo frames of a scene, drawn anew on every iteration, bit for bit the same for the same seed.

    `truth` (n) and `share` (n, 2; of the object's image that left and right eye see) are known beforehand, as are the
    `truths` of all that moves; `rig` and `hue_deg` are what a tracker may be told.
    """

    def __init__(self, scene: IndependentScene, seed: int, data: Path = DATA) -> None:
        self.scene, self.seed, self.data = scene, seed, data
        rng = np.random.default_rng((seed, 0))
        self.hue_deg = scene.mode_hue_deg
        self._joint_phases = rng.uniform(0, 2 * np.pi, 8)
        self._shake = _shaking(rng, np.deg2rad(scene.shake_deg))
        self._eyes = lenses(scene)
        self._path = make_path(scene, rng)
        self._turn_axis = _unit(rng.standard_normal(3) + np.array([0.0, 1.0, 0.5]))
        self._tilt = rng.uniform(-0.2, 0.2, 2)
        self.stamps_s = np.arange(max(1, round(scene.seconds * scene.fps))) / scene.fps

    # what the tracker is told

    @cached_property
    def rig(self) -> StereoRig:
        """The cameras, and their poses by the frame's joints, as far as they are known."""
        left, right = (camera_of(lens) for lens in self._eyes)
        if self.scene.rig == "head":
            return icub_rig(load_icub(), left, right)
        T_left_right = np.eye(4)
        T_left_right[0, 3] = self.scene.baseline_m
        if not self.scene.rig_known:
            return StereoRig.fixed(left, right, T_left_right)
        return StereoRig(left, right, lambda pose: _told(pose, T_left_right))

    def joints(self, t_s: float) -> Array | None:
        """What comes with an image of that stamp: the head's configuration in the robot's order, or the pose of a
        rig whose motion is known (rotation vector of T_root_left and translation), `stale_s` old."""
        t = t_s - self.scene.stale_s
        if self.scene.rig == "head":
            names = robot_joints()
            values = self.head_joints(t)
            return np.array([values.get(name, 0.0) for name in names])
        if not self.scene.rig_known:
            return None
        T = self.T_root_stage @ self.eye_poses(t)[0]
        return np.concatenate([cv2.Rodrigues(T[:3, :3])[0].ravel(), T[:3, 3]])

    # what is so

    @cached_property
    def T_root_stage(self) -> Array:
        """Stage coordinates in the tracker's root frame: the left camera at rest, or the iCub's root."""
        if self.scene.rig == "head":
            return T_ROOT_STAGE_HEAD
        T = np.eye(4)
        T[0, 3] = self.scene.baseline_m / 2
        return T

    def head_joints(self, t_s: float) -> dict[str, float]:
        """The head at a moment, rad: it looks ahead, and every joint of neck and eyes sways."""
        a = np.deg2rad(self.scene.head_deg)
        sway = dict(
            zip(_SWAYING, a * _SWAY_SHARE * np.sin(2 * np.pi * _SWAY_HZ * t_s + self._joint_phases[:5]), strict=True)
        )
        version, half = sway.pop("version"), np.arctan2(0.034, self.scene.distance_m)
        return {**sway, "left_eye_pan": version + half, "right_eye_pan": version - half}

    def eye_poses(self, t_s: float) -> tuple[Array, Array]:
        """T_stage_left, T_stage_right (4, 4)."""
        if self.scene.rig == "head":
            T_stage_root, joints = np.linalg.inv(T_ROOT_STAGE_HEAD), self.head_joints(t_s)
            return T_stage_root @ head_pose(joints, "left"), T_stage_root @ head_pose(joints, "right")
        R = _rotation(self.turn(self.scene.rig, t_s))
        poses = []
        for x in (-0.5, 0.5):
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = R, R @ np.array([x * self.scene.baseline_m, 0, 0])
            poses.append(T)
        return poses[0], poses[1]

    def turn(self, rig: str, t_s: float) -> Array:
        """(3,) rad, rotation vector of a rotating or shaking rig at a moment."""
        if rig == "rotating":
            return np.array(
                [0, np.deg2rad(self.scene.rotation_deg) * np.sin(2 * np.pi * self.scene.rotation_hz * t_s), 0]
            )
        return self._shake(t_s) if rig == "shaking" else np.zeros(3)

    @cached_property
    def _background_mean(self) -> Array:
        return np.asarray(photograph(self.data, self.scene.background, self.scene.width).mean(axis=(0, 1)))

    @cached_property
    def _surface(self) -> Surface:
        color = self.scene.color
        if isinstance(color, str):
            r, g, b = self._background_mean.tolist()
            color = (r / 0.75, g / 0.75, b / 0.75)  # three quarters of a ball's paint is what its shading leaves
        return Surface(color, self.scene.pattern, self.scene.color2, 3, self.scene.texture)

    @cached_property
    def _still(self) -> tuple[Panel, ...]:
        """The board, at two thirds of the object's distance."""
        if self.scene.hidden_s == 0:
            return ()
        nearer = 0.67
        half = 0.5 * nearer * (self.scene.speed_m_s * self.scene.hidden_s + 2 * self.scene.radius_m)
        half += 0.5 * (1 - nearer) * self.scene.baseline_m  # from both eyes at once
        middle = np.array([0.0, 0.0, nearer * self.scene.distance_m])
        return (Panel(middle, np.array([half, 0, 0]), np.array([0, 0.5, 0]), Surface(CARDBOARD)),)

    def arrangement(self, t_s: float) -> Arrangement:
        """What moves, at a moment; the object comes first."""
        scene, p = self.scene, self._path(t_s)[0]
        if scene.shape == "square":
            turn = _rotation(np.array([*self._tilt, scene.spin_rad_s * t_s])) * scene.radius_m
            return Arrangement((), (Panel(p, turn[:, 0], turn[:, 1], self._surface),))
        R = _rotation(self._turn_axis * scene.spin_rad_s * t_s)
        balls = [Ball(p, scene.radius_m, self._surface, R)]
        if scene.second != "none":
            middle = np.array([0, 0, scene.distance_m])
            surface = self._surface if scene.second == "same" else replace(self._surface, color=(30.0, 60.0, 205.0))
            balls.append(Ball(2 * middle - p + np.array([0, 0, 0.15]), scene.radius_m, surface, R))
        return Arrangement(tuple(balls), cylinders=self._finger(p))

    def _finger(self, p: Array) -> tuple[Cylinder, ...]:
        """What holds the object at `p` (3,): it begins within it."""
        if not self.scene.finger:
            return ()
        radius_m, length_m = FINGER_M
        begin, half = 0.8 * self.scene.radius_m, 0.5 * length_m * _FINGER_AXIS
        return (Cylinder(p + begin * _FINGER_AXIS + half, half, radius_m, Surface(FINGER)),)

    @cached_property
    def _truths_and_shares(self) -> tuple[tuple[tuple[Truth, ...], Array], ...]:
        """Of each ball or square that moves, the object first."""
        objects = 1 if self.scene.second == "none" else 2
        found: list[tuple[list[Truth], list[list[float]]]] = [([], []) for _ in range(objects)]
        R, o = self.T_root_stage[:3, :3], self.T_root_stage[:3, 3]
        for t in self.stamps_s.tolist():
            v, arrangement = self._path(t)[1], self.arrangement(t)
            views = list(zip(self._eyes, self.eye_poses(t), strict=True))
            things: tuple[Ball | Panel, ...] = (*arrangement.balls, *arrangement.panels)
            for (rows, shares), one, sign in zip(found, things, _SIGNS, strict=False):
                p = one.center
                share = [visible_share(lens, pose, arrangement, one, self._still) for lens, pose in views]
                pixels = [lens.project(pose, p)[0] for lens, pose in views]
                seen = [value >= SEEN_SHARE for value in share]
                velocity, radius_m = sign * (R @ v), self.scene.radius_m
                rows.append(Truth(t, R @ p + o, velocity, radius_m, pixels[0], pixels[1], seen[0], seen[1]))
                shares.append(share)
        return tuple((tuple(rows), np.array(shares)) for rows, shares in found)

    @property
    def truths(self) -> tuple[tuple[Truth, ...], ...]:
        """Of each ball or square that moves, the object first: (n) in the tracker's root frame; an eye that sees at
        least half of it sees it."""
        return tuple(truth for truth, _ in self._truths_and_shares)

    @property
    def truth(self) -> tuple[Truth, ...]:
        """The same of the object."""
        return self.truths[0]

    @cached_property
    def first_boxes(self) -> tuple[int, tuple[BoxPx, BoxPx]]:
        """The first frame of which both eyes see the whole object (else most), and its true boxes: what baselines are
        told."""
        seen = self.share.min(axis=1)
        k = int(np.argmax(seen >= min(0.99, float(seen.max()))))
        t = float(self.stamps_s[k])
        one, boxes = self.arrangement(t).things[0], []
        for lens, pose in zip(self._eyes, self.eye_poses(t), strict=True):
            rim = lens.project(pose, outline(one, pose[:3, 3])) + 0.5  # pixel centres are whole numbers
            low, high = rim.min(axis=0).clip(0), rim.max(axis=0).clip(None, (lens.width, lens.height))
            boxes.append((float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])))
        return k, (boxes[0], boxes[1])

    @property
    def share(self) -> Array:
        """(n, 2) share of the object's image that lies in the picture with nothing before it."""
        return self._truths_and_shares[0][1]

    def __len__(self) -> int:
        """Number of pairs."""
        return len(self.stamps_s)

    def __iter__(self) -> Iterator[StereoFrame]:
        """The frames, in the order of their stamps."""
        room = Room(self.scene.background, self.scene.ahead_m)
        casters = [Caster(lens, room, self.data) for lens in self._eyes]
        rng = np.random.default_rng((self.seed, 1))
        tape = noise_tape(rng)
        for t in self.stamps_s.tolist():
            images = [self._picture(caster, k, t, rng, tape) for k, caster in enumerate(casters)]
            joints = self.joints(t)
            yield StereoFrame(images[0], images[1], t, t, joints, joints)

    def _picture(self, caster: Caster, eye: int, t: float, rng: np.random.Generator, tape: Array) -> Image:
        n = EDGE_SAMPLES**2 if self.scene.shutter_s > 0 else 1
        instants = t + self.scene.shutter_s * ((np.arange(n) + 0.5) / n - 0.5)
        poses = [self.eye_poses(one)[eye] for one in instants]
        light = caster.light(poses, [self.arrangement(one) for one in instants], self._still)
        return self.scene.sensor.expose(light, self.gain(eye, t), rng, tape)

    def gain(self, eye: int, t_s: float) -> float:
        """Factor of an eye's (0 left, 1 right) levels: drift of the gain, and the light's flicker."""
        drift = 1 + self.scene.gain_drift * np.sin(2 * np.pi * 0.2 * t_s - eye * np.pi / 2)
        return float(drift * (1 + self.scene.flicker * np.sin(2 * np.pi * 100.0 * 1.0013 * t_s)))


_SIGNS = (1, -1)  # of the object's and the second ball's velocity
_SWAYING = ("neck_yaw", "neck_pitch", "neck_roll", "eyes_tilt", "version")
_SWAY_SHARE = np.array([1.0, 0.6, 0.25, 0.4, 0.8])
_SWAY_HZ = np.array([0.31, 0.23, 0.17, 0.41, 0.29])


@lru_cache(maxsize=1)
def robot_joints() -> tuple[str, ...]:
    """The order in which the tracker's robot takes its joints."""
    return tuple(load_icub().joint_names)


def camera_of(lens: Lens) -> Camera:
    """The project's camera of the same numbers."""
    (fx, _, cx), (_, fy, cy), _ = lens.K.tolist()
    k1, k2, p1, p2, k3 = lens.distortion.tolist()
    return Camera(lens.width, lens.height, fx, fy, cx, cy, (k1, k2, p1, p2, k3))


def _told(pose: Array | None, T_left_right: Array) -> tuple[Array, Array]:
    """T_root_left and T_root_right of a known pose (6,)."""
    if pose is None:
        raise ValueError("a rig whose motion is known needs its pose with every frame")
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = _rotation(pose[:3]), pose[3:]
    return T, T @ T_left_right


def _rotation(vector: Array) -> Array:
    return np.asarray(cv2.Rodrigues(vector)[0], dtype=float)


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v)


def _shaking(rng: np.random.Generator, std_rad: float) -> Callable[[float], Array]:
    """Irregular rotation vectors (3,): eight sines of 1–12 Hz an axis."""
    hz, phase = rng.uniform(1, 12, (3, 8)), rng.uniform(0, 2 * np.pi, (3, 8))
    return lambda t: std_rad * 0.5 * np.sin(2 * np.pi * hz * t + phase).sum(axis=1)


def make_path(scene: IndependentScene, rng: np.random.Generator) -> Path3D:
    """The object's way in the stage frame."""
    middle = np.array([*rng.uniform(-0.03, 0.03, 2), scene.distance_m])
    phase, r, speed = rng.uniform(0, 2 * np.pi), scene.extent_m, scene.speed_m_s
    first = _unit(np.array([1.0, rng.uniform(-0.3, 0.3), rng.uniform(-0.4, 0.4)]))
    second = _unit(np.cross(first, _unit(np.array([0.0, rng.uniform(-0.4, 0.4), 1.0]))))
    direction = rng.choice([-1.0, 1.0])

    def along(s: float) -> tuple[Array, Array]:
        """Place and direction after a way of s metres."""
        if scene.motion in ("circle", "stop_and_go"):
            a = phase + s / r
            return middle + r * (np.cos(a) * first + np.sin(a) * second), np.cos(a) * second - np.sin(a) * first
        if scene.motion == "reversal":
            turn = (s + r * phase / np.pi) % (4 * r)
            forth = turn < 2 * r
            return middle + (turn - r if forth else 3 * r - turn) * first, first if forth else -first
        half = 0.5 * speed * scene.seconds
        start = middle if scene.motion == "still" else middle - min(half, _beyond(scene)) * direction * first
        return start + s * direction * first, direction * first

    rest = scene.rest_s if scene.start == "rest" else 0.0
    begin = along(0.0)[0]
    way = begin[0] + _beyond(scene) if scene.start == "entering" and scene.motion != "straight" else 0.0

    def motion(t: float) -> tuple[Array, Array]:
        gone, v = speed * max(t - rest, 0.0), speed if t >= rest else 0.0
        if gone < way:
            return begin - np.array([way - gone, 0, 0]), np.array([v, 0, 0])
        gone -= way
        if scene.motion == "still":
            return begin, np.zeros(3)
        if scene.motion == "stop_and_go":
            stop, pause = 1.5 * speed, 2.0 * speed
            v = 0.0 if stop <= gone < stop + pause else v
            gone = gone if gone < stop else max(stop, gone - pause)
        p, ahead = along(gone)
        return p, v * ahead

    return motion


def _beyond(scene: IndependentScene) -> float:
    """How far aside the object is just out of both eyes' sight, m."""
    return 0.5 * scene.distance_m / scene.focal + scene.baseline_m / 2 + 1.5 * scene.radius_m
