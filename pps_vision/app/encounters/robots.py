"""Robots with R's five sources of model error, and trials and tracks as such robots measure them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from pps_vision.app.encounters.encounter import Encounter, EncounterScene
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.icub import icub_rig, icub_setup, load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import Array, Track3D

H_S = 0.02  # central difference that turns positions into velocities


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

    def scaled(self, factor: float) -> "ErrorSources":
        """Return these sources with every standard deviation times `factor`."""
        return ErrorSources(**{name: factor * value for name, value in vars(self).items()})


@cache
def true_robot() -> tuple[Robot, StereoRig, Skin]:
    """Return the iCub as described, its cameras and its skin."""
    robot = load_icub()
    return robot, icub_rig(robot), icub_skin()


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

    @classmethod
    def with_error(cls, error_m: float, touches: Sequence[Encounter], seed: tuple[int, ...]) -> "MiscalibratedRobot":
        """Return a robot that misjudges where the objects touch its skin by `error_m` (RMS over the `touches`).

        R's sources in their proportions, scaled; the same seed gives the same robot at every error.
        """
        sources = ErrorSources()
        unit = cls.draw(sources, np.random.default_rng(seed)).misjudgement_m(touches)
        return cls.draw(sources.scaled(error_m / unit), np.random.default_rng(seed))

    def misjudgement_m(self, touches: Sequence[Encounter]) -> float:
        """Return the RMS distance between true and perceived position of a touching object relative to the taxel."""
        robot, _, skin = true_robot()
        distances = []
        for touch in (touch for touch in touches if np.isfinite(touch.contact_s)):
            k = skin.index(touch.taxel)
            frame, taxel = skin.taxel(k)
            q = touch.q_rad + self.joint_offsets_rad
            p = touch.motion(touch.contact_s)[0]
            seen = self.triangulate(p[None], touch.q_rad, q)[0]
            true = move_points(inverse(robot.at(touch.q_rad).T_root(frame)), p) - taxel
            perceived = move_points(inverse(self.model.at(q).T_root(frame)), seen) - self.skin.taxel(k)[1]
            distances.append(np.linalg.norm(perceived - true))
        return float(np.sqrt(np.mean(np.square(distances))))

    @cached_property
    def scene(self) -> EncounterScene:
        """The robot as it takes itself to be."""
        return EncounterScene(replace(icub_setup(self.skin), robot=self.model, rig=self.rig))

    def reading(self, rng: np.random.Generator) -> Array:
        """Return the difference (n_joints,) rad between encoders and true angles, with the slack of one trial."""
        return self.joint_offsets_rad + self.slack_rad * rng.standard_normal(self.model.n_joints)

    def see(self, tracks: Sequence[Track3D], q_true: Array, reading: Array) -> list[Track3D]:
        """Return exact tracks as this robot measures them at a true posture; unknown where its lines of sight part.

        Acceleration and jerk stay, as does the covariance.
        """
        known = [k for k, track in enumerate(tracks) if track.is_known]
        if not known:
            return list(tracks)
        state = np.array([tracks[k].mean[:2] for k in known])
        around = state[:, :1] + H_S * np.array([-1.0, 0.0, 1.0])[:, None] * state[:, 1:]
        points = self.triangulate(around.reshape(-1, 3), q_true, q_true + reading).reshape(-1, 3, 3)
        seen = list(tracks)
        for k, (before, at, after) in zip(known, points, strict=True):
            track = tracks[k]
            mean = np.array([at, (after - before) / (2 * H_S), *track.mean[2:]])
            seen[k] = replace(track, mean=mean) if np.isfinite(mean).all() else Track3D.unknown(track.stamp_s)
        return seen

    def triangulate(self, points: Array, q_true: Array, q: Array) -> Array:
        """Return points (k, 3), projected by the true cameras and triangulated with the assumed ones; NaN if
        impossible."""
        _, rig, _ = true_robot()
        true = rig.view(q_true)
        assumed = self.rig.view(q)
        left = assumed.left.rays(true.left.project(points))
        right = assumed.right.rays(true.right.project(points))
        gap = assumed.right.center - assumed.left.center
        cosine = np.sum(left * right, axis=1)
        towards = np.column_stack([left @ gap, -(right @ gap)])  # distances along both rays to their nearest points
        along = (towards + cosine[:, None] * towards[:, ::-1]) / np.maximum(1 - cosine**2, 1e-12)[:, None]
        midpoints = assumed.left.center + 0.5 * (along[:, :1] * left + gap + along[:, 1:] * right)
        return np.where((along > 0).all(axis=1, keepdims=True), midpoints, np.nan)


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
