"""What the robot gets wrong about itself: R's five sources of error, injected into trials whose truth is known."""

from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from learning.pps.touch_trial import TouchTrial
from pps_vision.geometry.camera import Camera, StereoRig, StereoView
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.geometry.triangulation import midpoint
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin
from pps_vision.types import Array

_H_S = 0.02  # a velocity is what a point so long before and after it lies apart


@dataclass(frozen=True)
class ErrorSources:
    """Standard deviations of each source (R, "Kinematic model and coordinate transformations").

    Mismatch between CAD model and robot, joint calibration, backlash and elasticity (drawn anew for every
    trial: nothing can learn it), taxel pose calibration, camera calibration.  The defaults together
    put a stimulus several centimetres off, as R says of the robot.
    """

    link_m: float = 0.002
    link_rad: float = np.deg2rad(0.2)
    joint_rad: float = np.deg2rad(1.0)
    slack_rad: float = np.deg2rad(0.3)
    taxel_m: float = 0.004
    taxel_rad: float = np.deg2rad(5.0)
    focal: float = 0.01
    principal_px: float = 1.5


SOURCES = {
    "CAD model": ("link_m", "link_rad"),
    "joint calibration": ("joint_rad",),
    "backlash, elasticity": ("slack_rad",),
    "taxel poses": ("taxel_m", "taxel_rad"),
    "cameras": ("focal", "principal_px"),
}


def only(*sources: str) -> ErrorSources:
    """The named sources at their defaults and none of the others."""
    kept = {name for source in sources for name in SOURCES[source]}
    return ErrorSources(**{name: value if name in kept else 0.0 for name, value in vars(ErrorSources()).items()})


@dataclass(frozen=True)
class Belief:
    """What the robot takes itself to be; the truth is the iCub as it is described."""

    true_rig: StereoRig
    true_robot: Robot
    robot: Robot
    rig: StereoRig
    skin: Skin
    joint_offsets_rad: Array
    slack_rad: float

    @classmethod
    def draw(cls, sources: ErrorSources, skin: Skin, rng: np.random.Generator) -> "Belief":
        """A robot that errs as much as `sources` say."""
        truth = load_icub()
        rig = icub_rig(truth)
        robot = _misbuilt(sources, rng)
        return cls(
            rig,
            truth,
            robot,
            icub_rig(robot, _miscalibrated(rig.left, sources, rng), _miscalibrated(rig.right, sources, rng)),
            _misplaced(skin, sources, rng),
            sources.joint_rad * rng.standard_normal(truth.n_joints),
            sources.slack_rad,
        )

    def corrected(self, offsets_rad: Array) -> "Belief":
        """The same robot once it adds offsets (n_joints,) to what its encoders say."""
        return replace(self, joint_offsets_rad=self.joint_offsets_rad + offsets_rad)

    def slack(self, rng: np.random.Generator) -> Array:
        """What play and elasticity make of the joints (n_joints,) in one trial, rad."""
        return self.slack_rad * rng.standard_normal(self.true_robot.n_joints)

    def joints(self, q_rad: Array, slack_rad: Array) -> Array:
        """What the encoders say of true joints (…, n_joints)."""
        return q_rad + self.joint_offsets_rad + slack_rad

    def tells(self, trial: TouchTrial, sees: bool, rng: np.random.Generator) -> TouchTrial:
        """A trial as this robot would have had it: seen by its eyes, or the touch of its own right finger, of
        which it knows by its joints."""
        slack = self.slack(rng)
        p, v = self.locate(trial.positions, trial.velocities, trial.joints_rad, slack, sees)
        return replace(trial, joints_rad=self.joints(trial.joints_rad, slack), positions=p, velocities=v)

    def locate(self, p: Array, v: Array, q_rad: Array, slack_rad: Array, sees: bool) -> tuple[Array, Array]:
        """Where true positions and velocities (T, 3), at true joints (T, n_joints), are taken to be."""
        around = p[:, None] + _H_S * np.array([-1.0, 0.0, 1.0])[:, None] * v[:, None]
        locate = self._seen if sees else self._felt
        believed = self.joints(q_rad, slack_rad)
        at = np.array([locate(*of_sample) for of_sample in zip(around, q_rad, believed, strict=True)])
        return at[:, 1], (at[:, 2] - at[:, 0]) / (2 * _H_S)

    def _seen(self, points: Array, q: Array, q_believed: Array) -> Array:
        """Points (k, 3) as triangulated by eyes that are not where they are believed to be."""
        true, believed = self.true_rig.view(q), self.rig.view(q_believed)
        left = believed.left.rays(true.left.project(points))
        right = believed.right.rays(true.right.project(points))
        return np.array([_meeting(believed, a, b) for a, b in zip(left, right, strict=True)])

    def _felt(self, points: Array, q: Array, q_believed: Array) -> Array:
        """Points (k, 3) of the own right fingertip, as the believed joints place it."""
        tip = self.true_robot.names.index_tips[1]
        in_tip = move_points(inverse(self.true_robot.at(q).T_root(tip)), points)
        return self.robot.at(q_believed).point(tip, in_tip)


def _meeting(view: StereoView, left: Array, right: Array) -> Array:
    """Where two rays come nearest, NaN where they do not meet."""
    p = midpoint(view.left.center, left, view.right.center, right)
    return np.full(3, np.nan) if p is None else p


def _misbuilt(sources: ErrorSources, rng: np.random.Generator) -> Robot:
    """The iCub with every joint a little aside and askew."""
    tree = ElementTree.fromstring((files("pps_vision.robot") / "icub.urdf").read_text())
    for origin in (joint.find("origin") for joint in tree.iter("joint")):
        if origin is not None:
            for name, sigma in (("xyz", sources.link_m), ("rpy", sources.link_rad)):
                values = np.array(origin.get(name, "0 0 0").split(), dtype=float) + sigma * rng.standard_normal(3)
                origin.set(name, " ".join(f"{value:.9f}" for value in values))
    with TemporaryDirectory() as folder:
        urdf = Path(folder) / "misbuilt.urdf"
        urdf.write_bytes(ElementTree.tostring(tree))
        return Robot(urdf)


def _misplaced(skin: Skin, sources: ErrorSources, rng: np.random.Generator) -> Skin:
    """The skin with every taxel a little aside and askew."""
    parts = []
    for part in skin.parts:
        shift = sources.taxel_m * rng.standard_normal(part.positions_m.shape)
        turn = Rotation.from_rotvec(sources.taxel_rad * rng.standard_normal(part.normals.shape))
        parts.append(replace(part, positions_m=part.positions_m + shift, normals=turn.apply(part.normals)))
    return Skin(tuple(parts))


def _miscalibrated(camera: Camera, sources: ErrorSources, rng: np.random.Generator) -> Camera:
    """The camera with focal lengths and principal point a little off."""
    scale = 1 + sources.focal * rng.standard_normal()
    cx, cy = np.array([camera.cx, camera.cy]) + sources.principal_px * rng.standard_normal(2)
    return replace(camera, fx=camera.fx * scale, fy=camera.fy * scale, cx=float(cx), cy=float(cy))
