"""Robots with R's five sources of model error, and trials as such robots measure them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from learning.pps.joint_offsets import TouchTrial, joint_offsets
from pps_vision.experiments.pps.session_trials import true_robot
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.geometry.triangulation import midpoint
from pps_vision.robot.icub import icub_rig
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin
from pps_vision.types import Array

_H_S = 0.02  # central difference that turns positions into velocities


@dataclass(frozen=True)
class ErrorSources:
    """Standard deviations of R's error sources ("Kinematic model and coordinate transformations").

    R names the sources and their sum, several centimetres; the shares are ours.
    """

    link_m: float = 0.002  # position of each joint frame: mismatch of the CAD model
    link_rad: float = float(np.deg2rad(0.2))  # orientation of each joint frame: mismatch of the CAD model
    joint_rad: float = float(np.deg2rad(1.0))  # constant offset of each encoder: joint calibration
    slack_rad: float = float(np.deg2rad(0.3))
    """Offset of each joint drawn anew for every trial: backlash and elasticity, which cannot be learned."""
    taxel_m: float = 0.004  # position of each taxel
    taxel_rad: float = float(np.deg2rad(5.0))  # direction of each taxel's normal
    focal: float = 0.01  # relative error of a camera's focal length
    principal_px: float = 1.5  # error of a camera's principal point, each axis


SOURCES = {
    "CAD model": ("link_m", "link_rad"),
    "joint calibration": ("joint_rad",),
    "backlash, elasticity": ("slack_rad",),
    "taxel poses": ("taxel_m", "taxel_rad"),
    "cameras": ("focal", "principal_px"),
}


def errors_from(*sources: str) -> ErrorSources:
    """Return the named sources at their defaults, all others zero."""
    names = {name for source in sources for name in SOURCES[source]}
    return ErrorSources(**{name: value if name in names else 0.0 for name, value in vars(ErrorSources()).items()})


@dataclass(frozen=True)
class MiscalibratedRobot:
    """A robot's model of itself; its true kinematics, cameras and skin are the iCub's."""

    model: Robot
    rig: StereoRig
    skin: Skin
    joint_offsets_rad: Array
    slack_rad: float

    @classmethod
    def draw(cls, sources: ErrorSources, rng: np.random.Generator) -> "MiscalibratedRobot":
        """Return a robot with errors drawn from `sources`."""
        _, rig, true_skin = true_robot()
        model = _perturbed_model(sources, rng)
        cameras = (_perturbed_camera(rig.left, sources, rng), _perturbed_camera(rig.right, sources, rng))
        skin = _perturbed_skin(true_skin, sources, rng)
        offsets = sources.joint_rad * rng.standard_normal(model.n_joints)
        return cls(model, icub_rig(model, *cameras), skin, offsets, sources.slack_rad)

    def observe(self, trial: TouchTrial, by_eyes: bool, rng: np.random.Generator) -> TouchTrial:
        """Return a true trial as this robot measures it.

        Args:
            trial: True joints and object.
            by_eyes: Triangulate the object; otherwise it is the right fingertip, located by the joints.
            rng: Source of the slack of the joints.
        """
        q_true = trial.joints_rad
        q = q_true + self.joint_offsets_rad + self.slack_rad * rng.standard_normal(self.model.n_joints)
        around = trial.positions[:, None] + _H_S * np.array([-1.0, 0.0, 1.0])[:, None] * trial.velocities[:, None]
        locate = self._triangulate if by_eyes else self._locate_fingertip
        points = np.array([locate(*sample) for sample in zip(around, q_true, q, strict=True)])
        velocities = (points[:, 2] - points[:, 0]) / (2 * _H_S)
        return replace(trial, joints_rad=q, positions=points[:, 1], velocities=velocities)

    def calibrated(self, observed: Iterable[TouchTrial]) -> "MiscalibratedRobot":
        """Return the robot with its encoder offsets corrected by an estimate from observed touches."""
        estimate = joint_offsets(self.model, self.rig, self.skin, observed)
        return replace(self, joint_offsets_rad=self.joint_offsets_rad + estimate.offsets_rad)

    def _triangulate(self, points: Array, q_true: Array, q: Array) -> Array:
        """Points (k, 3), projected by the true cameras and triangulated with the assumed ones; NaN if impossible."""
        _, rig, _ = true_robot()
        true = rig.view(q_true)
        assumed = self.rig.view(q)
        left = assumed.left.rays(true.left.project(points))
        right = assumed.right.rays(true.right.project(points))
        rays = zip(left, right, strict=True)
        midpoints = [midpoint(assumed.left.center, a, assumed.right.center, b) for a, b in rays]
        return np.array([np.full(3, np.nan) if p is None else p for p in midpoints])

    def _locate_fingertip(self, points: Array, q_true: Array, q: Array) -> Array:
        """Points (k, 3), fixed to the true right fingertip, where the assumed joints place them."""
        robot, _, _ = true_robot()
        tip = robot.names.index_tips[1]
        in_tip = move_points(inverse(robot.at(q_true).T_root(tip)), points)
        return self.model.at(q).point(tip, in_tip)


def _perturbed_model(sources: ErrorSources, rng: np.random.Generator) -> Robot:
    """Return the iCub with every joint frame displaced and rotated."""
    tree = ElementTree.fromstring((files("pps_vision.robot") / "icub.urdf").read_text())
    for origin in (joint.find("origin") for joint in tree.iter("joint")):
        if origin is not None:
            for name, sigma in (("xyz", sources.link_m), ("rpy", sources.link_rad)):
                values = np.array(origin.get(name, "0 0 0").split(), dtype=float) + sigma * rng.standard_normal(3)
                origin.set(name, " ".join(f"{value:.9f}" for value in values))
    with TemporaryDirectory() as folder:
        urdf = Path(folder) / "perturbed.urdf"
        urdf.write_bytes(ElementTree.tostring(tree))
        return Robot(urdf)


def _perturbed_skin(skin: Skin, sources: ErrorSources, rng: np.random.Generator) -> Skin:
    """Return the skin with every taxel displaced and tilted."""
    parts = []
    for part in skin.parts:
        shift = sources.taxel_m * rng.standard_normal(part.positions_m.shape)
        turn = Rotation.from_rotvec(sources.taxel_rad * rng.standard_normal(part.normals.shape))
        parts.append(replace(part, positions_m=part.positions_m + shift, normals=turn.apply(part.normals)))
    return Skin(tuple(parts))


def _perturbed_camera(camera: Camera, sources: ErrorSources, rng: np.random.Generator) -> Camera:
    """Return the camera with errors of focal length and principal point."""
    scale = 1 + sources.focal * rng.standard_normal()
    cx, cy = np.array([camera.cx, camera.cy]) + sources.principal_px * rng.standard_normal(2)
    return replace(camera, fx=camera.fx * scale, fy=camera.fy * scale, cx=float(cx), cy=float(cy))
