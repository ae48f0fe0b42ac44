"""Films of the independent scene source: parameters, rig, motion, frames and truth.

Motions, rig and head kinematics are this module's own (from the iCub's Denavit–Hartenberg tables in iKin); only the
tracker's inputs use the project's types.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from pps_vision.experiments.baselines.image_trackers import BoxPx
from pps_vision.experiments.films.bodies import make_hand, make_person
from pps_vision.experiments.films.caster import (
    INSTANTS,
    Ball,
    Cylinder,
    FilmLens,
    Levels,
    Paint,
    Panel,
    Pattern,
    RayCaster,
    SensorChain,
    Solid,
    Solids,
    levels_of,
    noise_tape,
    photograph,
    visible_share,
)
from pps_vision.experiments.study import DATA
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.types import Array, StereoFrame, Truth

TimedPath = Callable[[float], tuple[Array, Array]]  # time → position (3,) m and velocity (3,) m/s
VISIBLE_SHARE = 0.5  # an eye sees the object if this share of its image is visible
_HALF_BASELINE_M = 0.034  # iCub's eyes
FOCAL = 0.86  # focal length as a share of the width
_BASELINE_M = 0.12  # between the eyes of a rig without a head
_DISTORTION = np.array([-0.12, 0.05, 0.0006, -0.0004, 0.0])  # left eye
_ROTATION_RAD = np.deg2rad(1.0)  # amplitude of a rotating rig about the vertical axis
_ROTATION_HZ = 0.5
_DARK_GAIN = 0.0005
_ABSENT = np.array([0.0, 0.0, -10.0])  # place of an object that is to come, behind the eyes
_THROW_S = 0.8  # from throw to throw
_GRAVITY = np.array([0.0, 9.81, 0.0])
_HAND_M_S = 0.6  # speed of a hand that comes
CARDBOARD: Levels = (140.0, 107.0, 71.0)
DARK_S = 0.5
FINGER: Levels = (150.0, 150.0, 150.0)
FINGER_RADIUS_M = 0.008
FINGER_LENGTH_M = 0.4
_FINGER_AXIS = np.array([0.1, 1.0, -0.35]) / np.linalg.norm([0.1, 1.0, -0.35])  # from the object, down and nearer

# The iCub's head, standard Denavit–Hartenberg (iKin): joint, A (m), D (m), α (deg), offset (deg). The sign of the eye's
# D is minus for the left eye, plus for the right.
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
_SWAYING_JOINTS = ("neck_yaw", "neck_pitch", "neck_roll", "eyes_tilt", "version")
_SWAY_SHARE = np.array([1.0, 0.6, 0.25, 0.4, 0.8])
_SWAY_HZ = np.array([0.31, 0.23, 0.17, 0.41, 0.29])
_LENSES = ((1.0, 3.2, -2.6), (1.004, -2.4, 1.7))  # each eye's relative focal length, offset of the principal point


@dataclass(frozen=True)
class FilmObject:
    """Parameters of an object and its motion. Defaults as in the tracking table: 0.6 m, 30 cm/s."""

    shape: Literal["ball", "square", "rod"] = "ball"  # square and rod face the eyes, slightly turned; the rod at 45°
    radius_m: float = 0.03  # radius of the ball; half the side of the square; half the length of the rod
    color: Levels | Literal["background"] = (205.0, 30.0, 25.0)  # background: the mean of the photograph
    pattern: Pattern = "plain"  # pattern of the object
    texture: int = 1  # photograph (index) of a textured object
    spin_rad_s: float = 0.0  # rotation about an oblique axis (ball) or in its plane (square, rod)

    motion: Literal["straight", "stop_and_go", "reversal", "circle", "still", "approach", "throws"] = "circle"
    start: Literal["moving", "rest", "entering"] = "entering"  # rest: in view, for `rest_s`
    appears_s: float = 0.0  # it is absent until then, and for up to 0.5 s longer
    rest_s: float = 1.0  # rest before the motion with `start` rest
    moves_s: float = 1.5  # motion before the stop of `stop_and_go`
    stop_s: float = 2.0  # length of that stop
    speed_m_s: float = 0.3  # 0.02–1; of `throws` 3, when thrown
    extent_m: float = 0.12  # radius of the circle; half the length of the reversal
    distance_m: float = 0.6  # from the eyes to the middle of the motion, or to where the approach begins


@dataclass(frozen=True, kw_only=True)
class FilmScene(FilmObject):
    """Parameters of a film, and of its first object. The defaults: 640×480, 12 cm baseline."""

    width: int = 640  # width of the images, px
    height: int = 480  # px
    fps: float = 30.0  # pairs a second
    seconds: float = 4.0  # length of the film

    rig: Literal["fixed", "rotating", "shaking", "head"] = "fixed"  # head: an iCub's neck and eyes
    rig_known: bool = False  # whether the tracker gets the pose of a rotating or shaking rig; else it is declared fixed
    shake_deg: float = 0.1  # standard deviation of the shaking rig about each axis
    head_deg: float = 8.0  # amplitude of the neck's yaw; the other joints of neck and eyes move less
    stale_s: float = 0.0  # age of the joints that come with an image

    others: tuple[FilmObject, ...] = ()  # further objects
    second_ball: bool = False  # one more object, equal to the first, 15 cm farther away, that moves against it
    hidden_s: float = 0.0  # time for which a board amid the view hides the passing object; 0: no board
    finger: bool = False  # a grey finger from beyond the lower edge holds the object and moves with it
    hand: Literal["none", "holds", "takes"] = "none"  # it moves with the object, or comes while that stops
    walker: bool = False  # a person walks across or away, 1.9 m to 4 m away

    background: int = 0  # photograph (index) on the walls
    room_m: float = 1.6  # from the eyes to the wall ahead
    shutter_s: float = 0.0  # exposure centred on the stamp: motion blur
    gain_drift: float = 0.0  # amplitude of a 0.2 Hz change of the gain, a quarter period later in the right eye
    flicker: float = 0.0  # amplitude of the light's 100 Hz flicker
    dark_from_s: float = -DARK_S  # from when the light is out, for `DARK_S`
    sensor: SensorChain = SensorChain()


def head_pose(joints_rad: Mapping[str, float], side: Literal["left", "right"]) -> Array:
    """Return T_root_eye (4, 4) of the iCub by the table above; joints without a value are 0."""
    T = _H0.copy()
    for name, a, d, alpha_deg, offset_deg in _HEAD:
        joint = f"{side}_eye_pan" if name == "eye_pan" else name
        if name == "eyes_tilt" and side == "left":
            d = -d
        T = T @ denavit_hartenberg(a, d, np.deg2rad(alpha_deg), joints_rad.get(joint, 0.0) + np.deg2rad(offset_deg))
    return T


def denavit_hartenberg(a: float, d: float, alpha: float, theta: float) -> Array:
    """Return the pose (4, 4) of a link: lengths in m, angles in rad."""
    ct = np.cos(theta)
    st = np.sin(theta)
    ca = np.cos(alpha)
    sa = np.sin(alpha)
    return np.array([[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]])


def lenses(scene: FilmScene) -> tuple[FilmLens, FilmLens]:
    """Return left and right lens; slightly different, as real lenses are."""
    w = scene.width
    h = scene.height
    f = FOCAL * w
    left, right = (
        np.array([[f * scale, 0, (w - 1) / 2 + du], [0, f * scale, (h - 1) / 2 + dv], [0, 0, 1.0]])
        for scale, du, dv in _LENSES
    )
    return FilmLens(w, h, left, _DISTORTION), FilmLens(w, h, right, 0.9 * _DISTORTION)


class Film:
    """Stereo frames of a scene with their truth; iterating draws them, bit for bit the same for the same seed."""

    def __init__(self, scene: FilmScene, seed: int, data: Path = DATA) -> None:
        self.scene = scene
        self.seed = seed
        self.data = data
        rng = np.random.default_rng((seed, 0))
        self._joint_phases = rng.uniform(0, 2 * np.pi, 8)
        self._shake = _shaking(rng, np.deg2rad(scene.shake_deg))
        self._lenses = lenses(scene)
        self.objects: tuple[FilmObject, ...] = (scene, *scene.others, *((scene,) if scene.second_ball else ()))
        path = make_path(scene, rng, scene.seconds)
        self._turn_axis = _unit(rng.standard_normal(3) + np.array([0.0, 1.0, 0.5]))
        self._tilt = rng.uniform(-0.2, 0.2, 2)
        self._paths = [path, *(make_path(other, rng, scene.seconds) for other in scene.others)]
        if scene.second_ball:
            twice = 2 * np.array([0, 0, scene.distance_m])
            self._paths.append(lambda t: (twice - path(t)[0] + np.array([0, 0, 0.15]), -path(t)[1]))
        self._hand = make_hand(rng)
        self._person = make_person(rng)
        self.stamps_s = np.arange(max(1, round(scene.seconds * scene.fps))) / scene.fps

    # inputs of the tracker

    @property
    def hue_deg(self) -> float:
        """Hue of the object's colour, for a marker tracker."""
        color = (128.0, 128.0, 128.0) if isinstance(self.scene.color, str) else self.scene.color
        return float(cv2.cvtColor(np.array([[color]], np.float32) / 255, cv2.COLOR_RGB2HSV)[0, 0, 0])

    @cached_property
    def rig(self) -> StereoRig:
        """Cameras and, as far as the tracker may know them, their poses by the frame's joints."""
        left, right = (_camera_of(lens) for lens in self._lenses)
        if self.scene.rig == "head":
            return icub_rig(load_icub(), left, right)
        T_left_right = transform(translation=(_BASELINE_M, 0, 0))
        if not self.scene.rig_known:
            return StereoRig.fixed(left, right, T_left_right)

        def eye_poses(pose: Array | None) -> tuple[Array, Array]:
            T_root_left = transform(_rotation(np.asarray(pose)[:3]), np.asarray(pose)[3:])
            return T_root_left, T_root_left @ T_left_right

        return StereoRig(left, right, eye_poses)

    def joints(self, t_s: float) -> Array | None:
        """Return the joints of an image of that stamp, `stale_s` old.

        They are the head's configuration in the robot's order, the pose of a rig whose motion is known (rotation vector
        of T_root_left and translation), or None.
        """
        t = t_s - self.scene.stale_s
        if self.scene.rig == "head":
            joints_rad = self.head_joints(t)
            return np.array([joints_rad.get(name, 0.0) for name in _joint_names()])
        if not self.scene.rig_known:
            return None
        T = self.T_root_stage @ self.eye_poses(t)[0]
        return np.concatenate([cv2.Rodrigues(T[:3, :3])[0].ravel(), T[:3, 3]])

    # truth

    @cached_property
    def T_root_stage(self) -> Array:
        """The tracker's root frame: the left camera at rest, or the iCub's root."""
        return T_ROOT_STAGE_HEAD if self.scene.rig == "head" else transform(translation=(_BASELINE_M / 2, 0, 0))

    def head_joints(self, t_s: float) -> dict[str, float]:
        """Return the head's joints (rad): it looks ahead, and every joint of neck and eyes sways."""
        amplitude = np.deg2rad(self.scene.head_deg) * _SWAY_SHARE
        angles = amplitude * np.sin(2 * np.pi * _SWAY_HZ * t_s + self._joint_phases[:5])
        sway = dict(zip(_SWAYING_JOINTS, angles, strict=True))
        version = sway.pop("version")
        half_vergence = np.arctan2(_HALF_BASELINE_M, self.scene.distance_m)
        return {**sway, "left_eye_pan": version + half_vergence, "right_eye_pan": version - half_vergence}

    def eye_poses(self, t_s: float) -> tuple[Array, Array]:
        """Return T_stage_left and T_stage_right (4, 4)."""
        if self.scene.rig == "head":
            T_stage_root = np.linalg.inv(T_ROOT_STAGE_HEAD)
            joints = self.head_joints(t_s)
            return T_stage_root @ head_pose(joints, "left"), T_stage_root @ head_pose(joints, "right")
        R = _rotation(self._rig_rotation(self.scene.rig, t_s))
        return transform(R, -0.5 * _BASELINE_M * R[:, 0]), transform(R, 0.5 * _BASELINE_M * R[:, 0])

    def _rig_rotation(self, rig: str, t_s: float) -> Array:
        """Return the rotation vector (3,) of a rotating or shaking rig (rad)."""
        if rig == "rotating":
            return np.array([0, _ROTATION_RAD * np.sin(2 * np.pi * _ROTATION_HZ * t_s), 0])
        return self._shake(t_s) if rig == "shaking" else np.zeros(3)

    @cached_property
    def _background_mean(self) -> Array:
        return np.asarray(photograph(self.data, self.scene.background, self.scene.width).mean(axis=(0, 1)))

    def _paint(self, shown: FilmObject) -> Paint:
        color = shown.color
        if isinstance(color, str):
            # shading leaves three quarters of a ball's light
            r, g, b = levels_of(self._background_mean / 0.75).tolist()
            color = r, g, b
        return Paint(color, shown.pattern, photo=shown.texture)

    @cached_property
    def static(self) -> Solids:
        """The board, at two thirds of the object's distance, as wide as to hide it from both eyes at once."""
        scene = self.scene
        if scene.hidden_s == 0:
            return ()
        nearer = 0.67
        half = 0.5 * nearer * (scene.speed_m_s * scene.hidden_s + 2 * scene.radius_m) + 0.5 * (1 - nearer) * _BASELINE_M
        middle = np.array([0.0, 0.0, nearer * scene.distance_m])
        return (Panel(middle, np.array([half, 0, 0]), np.array([0, 0.5, 0]), Paint(CARDBOARD)),)

    def solids(self, t_s: float) -> Solids:
        """Return the moving solids: the objects in their order, then bodies without truth: finger, hand, walker."""
        scene = self.scene
        p = self._paths[0](t_s)[0]
        solids: list[Solid] = [
            self._solid(shown, path(t_s)[0], t_s) for shown, path in zip(self.objects, self._paths, strict=True)
        ]
        if scene.finger:  # begins within the object
            half = 0.5 * FINGER_LENGTH_M * _FINGER_AXIS
            middle = p + 0.8 * scene.radius_m * _FINGER_AXIS + half
            solids.append(Cylinder(middle, half, FINGER_RADIUS_M, Paint(FINGER)))
        if scene.hand != "none":
            grasps_s = scene.moves_s + 0.7 * scene.stop_s if scene.hand == "takes" else 0.0
            solids += self._hand(p, scene.radius_m, _HAND_M_S * max(grasps_s - t_s, 0.0))
        if scene.walker:
            solids += self._person(t_s)
        return tuple(solids)

    def _solid(self, shown: FilmObject, p: Array, t_s: float) -> Solid:
        if shown.shape == "ball":
            return Ball(p, shown.radius_m, self._paint(shown), _rotation(self._turn_axis * shown.spin_rad_s * t_s))
        axes = _rotation(np.array([*self._tilt, shown.spin_rad_s * t_s])) * shown.radius_m
        if shown.shape == "square":
            return Panel(p, axes[:, 0], axes[:, 1], self._paint(shown))
        diagonal = np.sqrt(0.5) * (axes[:, 0] + np.sign(self._tilt[0]) * axes[:, 1])
        return Cylinder(p, diagonal, 0.1 * shown.radius_m, self._paint(shown))

    @cached_property
    def _truths_and_shares(self) -> list[tuple[tuple[Truth, ...], Array]]:
        return [self._truth_and_share(k) for k in range(len(self.objects))]

    def _truth_and_share(self, k: int) -> tuple[tuple[Truth, ...], Array]:
        R = self.T_root_stage[:3, :3]
        rows = []
        shares = []
        for t in self.stamps_s.tolist():
            solids = (*self.solids(t), *self.static)
            solid = solids[k]
            views = list(zip(self._lenses, self.eye_poses(t), strict=True))
            share = [0.0 if self.is_dark(t) else visible_share(lens, pose, solids, solid) for lens, pose in views]
            left_px, right_px = (lens.project(pose, solid.center)[0] for lens, pose in views)
            visible = [value >= VISIBLE_SHARE for value in share]
            p_root = R @ solid.center + self.T_root_stage[:3, 3]
            velocity = R @ self._paths[k](t)[1]
            rows.append(Truth(t, p_root, velocity, self.objects[k].radius_m, left_px, right_px, *visible))
            shares.append(share)
        return tuple(rows), np.array(shares)

    @property
    def truths(self) -> tuple[tuple[Truth, ...], ...]:
        """Truth (n) of each object, the first one first, in the tracker's root frame.

        An eye that sees at least half of an object sees it.
        """
        return tuple(truth for truth, _ in self._truths_and_shares)

    @property
    def truth(self) -> tuple[Truth, ...]:
        """Truth (n) of the first object."""
        return self.truths[0]

    @property
    def share(self) -> Array:
        """(n, 2) visible share of the first object's image in the left and the right eye."""
        return self._truths_and_shares[0][1]

    @property
    def awaited_s(self) -> float:
        """When the first object first moves in view, or when the light is back."""
        scene = self.scene
        if scene.appears_s > 0:
            return next(row.stamp_s for row in self.truth if row.visible_left and row.visible_right)
        return max(scene.dark_from_s + DARK_S, scene.rest_s if scene.start == "rest" else 0.0)

    def is_dark(self, t_s: float) -> bool:
        """Whether the light is out."""
        return self.scene.dark_from_s <= t_s < self.scene.dark_from_s + DARK_S

    @cached_property
    def first_boxes(self) -> tuple[int, tuple[BoxPx, BoxPx]]:
        """Index of the first frame that shows the whole object to both eyes (else most), and the true boxes there."""
        share = self.share.min(axis=1)
        k = int(np.argmax(share >= min(0.99, float(share.max()))))
        t = float(self.stamps_s[k])
        solid = self.solids(t)[0]
        boxes = []
        for lens, pose in zip(self._lenses, self.eye_poses(t), strict=True):
            rim = lens.project(pose, solid.outline(pose[:3, 3])) + 0.5  # pixel centres are whole numbers
            x0, y0 = rim.min(axis=0).clip(0)
            x1, y1 = rim.max(axis=0).clip(None, (lens.width, lens.height))
            boxes.append((float(x0), float(y0), float(x1 - x0), float(y1 - y0)))
        return k, (boxes[0], boxes[1])

    def __len__(self) -> int:
        """Number of pairs."""
        return len(self.stamps_s)

    def __iter__(self) -> Iterator[StereoFrame]:
        """Yield the frames in the order of their stamps."""
        rng = np.random.default_rng((self.seed, 1))
        tape = noise_tape(rng)
        scene = self.scene
        casters = self._casters()
        n = INSTANTS if scene.shutter_s > 0 else 1
        for t in self.stamps_s.tolist():
            instants = t + scene.shutter_s * ((np.arange(n) + 0.5) / n - 0.5)
            solids = [self.solids(instant) for instant in instants]
            poses = zip(*(self.eye_poses(instant) for instant in instants), strict=True)
            left, right = (
                scene.sensor.expose(caster.light(list(seen), solids, self.static), self.gain(eye, t), rng, tape)
                for eye, (caster, seen) in enumerate(zip(casters, poses, strict=True))
            )
            joints = self.joints(t)
            yield StereoFrame(left, right, t, t, joints, joints)

    def _casters(self) -> list[RayCaster]:
        """One for each eye; the walls' picture is 0.4 % smaller for the right one."""
        return [RayCaster(lens, self.scene.background, self.data, self.scene.room_m) for lens in self._lenses]

    def gain(self, eye: int, t_s: float) -> float:
        """Return the factor of the light in an eye's image (0 left, 1 right): drift, flicker and darkness."""
        drift = 1 + self.scene.gain_drift * np.sin(2 * np.pi * 0.2 * t_s - eye * np.pi / 2)
        light = _DARK_GAIN if self.is_dark(t_s) else 1.0
        return float(light * drift * (1 + self.scene.flicker * np.sin(2 * np.pi * 100.0 * 1.0013 * t_s)))


@cache
def _joint_names() -> tuple[str, ...]:
    return tuple(load_icub().joint_names)


def _camera_of(lens: FilmLens) -> Camera:
    """Return the project's camera of the same numbers."""
    (fx, _, cx), (_, fy, cy), _ = lens.K.tolist()
    k1, k2, p1, p2, k3 = lens.distortion.tolist()
    return Camera(lens.width, lens.height, fx, fy, cx, cy, (k1, k2, p1, p2, k3))


def _rotation(vector: Array) -> Array:
    return np.asarray(cv2.Rodrigues(vector)[0], dtype=float)


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v)


def _shaking(rng: np.random.Generator, std_rad: float) -> Callable[[float], Array]:
    """Irregular rotation vectors (3,): eight sines of 1–12 Hz an axis."""
    hz = rng.uniform(1, 12, (3, 8))
    phase = rng.uniform(0, 2 * np.pi, (3, 8))
    return lambda t: std_rad * 0.5 * np.sin(2 * np.pi * hz * t + phase).sum(axis=1)


def make_path(moved: FilmObject, rng: np.random.Generator, seconds: float) -> TimedPath:
    """Return an object's path in the stage frame, in a film of that length."""
    middle = np.array([*rng.uniform(-0.03, 0.03, 2), moved.distance_m])
    phase = rng.uniform(0, 2 * np.pi)
    r = moved.extent_m
    speed = moved.speed_m_s
    first = _unit(np.array([1.0, rng.uniform(-0.3, 0.3), rng.uniform(-0.4, 0.4)]))
    second = _unit(np.cross(first, _unit(np.array([0.0, rng.uniform(-0.4, 0.4), 1.0]))))
    direction = rng.choice([-1.0, 1.0])
    inward = np.array([1.0, 0.0, 0.0])  # direction of the entry
    if moved.motion == "throws":
        return _throws(moved, rng, seconds)
    if moved.motion == "approach":
        inward *= direction
        middle -= rng.uniform(0.25, 0.33) * moved.distance_m * inward
    late_s = moved.appears_s + rng.uniform(0, 0.5) if moved.appears_s > 0 else 0.0

    def along(s: float) -> tuple[Array, Array]:
        """Position and direction after s metres."""
        if moved.motion == "approach":
            return middle - s * _unit(middle), -_unit(middle)
        if moved.motion in ("circle", "stop_and_go"):
            a = phase + s / r
            return middle + r * (np.cos(a) * first + np.sin(a) * second), np.cos(a) * second - np.sin(a) * first
        if moved.motion == "reversal":
            place = (s + r * phase / np.pi) % (4 * r)
            forward = place < 2 * r
            return middle + (place - r if forward else 3 * r - place) * first, first if forward else -first
        half = 0.5 * speed * seconds
        start = middle if moved.motion == "still" else middle - min(half, _out_of_view_m(moved)) * direction * first
        return start + s * direction * first, direction * first

    rest = moved.rest_s if moved.start == "rest" else 0.0
    begin = along(0.0)[0]
    is_entering = moved.start == "entering" and moved.motion != "straight"
    entry_m = begin @ inward + _out_of_view_m(moved) if is_entering else 0.0

    def motion(t: float) -> tuple[Array, Array]:
        if max(t, 0.0) < late_s:
            return _ABSENT, np.zeros(3)
        travelled = speed * max(t - late_s - rest, 0.0)
        v = speed if t - late_s >= rest else 0.0
        if travelled < entry_m:
            return begin - (entry_m - travelled) * inward, v * inward
        travelled -= entry_m
        if moved.motion == "still":
            return begin, np.zeros(3)
        if moved.motion == "stop_and_go":
            stop = moved.moves_s * speed
            pause = moved.stop_s * speed
            v = 0.0 if stop <= travelled < stop + pause else v
            travelled = travelled if travelled < stop else max(stop, travelled - pause)
        p, heading = along(travelled)
        return p, v * heading

    return motion


def _throws(moved: FilmObject, rng: np.random.Generator, seconds: float) -> TimedPath:
    """Throws from below the lower edge, to the right or left, that fall back beyond it."""
    n = int(np.ceil(seconds / _THROW_S)) + 1
    elevation = rng.uniform(np.deg2rad(55), np.deg2rad(68), n)
    across = moved.speed_m_s * np.cos(elevation) * rng.choice([-1.0, 1.0], n)
    up = moved.speed_m_s * np.sin(elevation)
    velocity = np.stack([across, -up, rng.uniform(-0.3, 0.3, n)], axis=1)
    below_m = 0.75 * 0.5 * moved.distance_m / FOCAL + 1.5 * moved.radius_m
    flight_s = 2 * up / _GRAVITY[1]
    begin = np.array([0, below_m, moved.distance_m]) - 0.5 * flight_s[:, None] * velocity * np.array([1, 0, 1])

    def motion(t: float) -> tuple[Array, Array]:
        k, since = divmod(max(t - moved.rest_s, 0.0), _THROW_S)
        k = int(k)
        return begin[k] + since * velocity[k] + 0.5 * since**2 * _GRAVITY, velocity[k] + since * _GRAVITY

    return motion


def _out_of_view_m(moved: FilmObject) -> float:
    """Distance to the side at which the object is just out of both eyes' view."""
    return 0.5 * moved.distance_m / FOCAL + _BASELINE_M / 2 + 1.5 * moved.radius_m
