"""Offsets of the robot's encoders, estimated from objects that its eyes saw touching its skin.

A touch tells how far the object's centre is from the nearest taxel that feels it, and that it is farther from all that
do not.  The kinematic chain from the eyes to that skin holds all joints of head and arm, so touches in several postures
constrain their offsets (Roncone et al. 2014 calibrate two arms that touch each other in this way).  One offset in
metres would not suffice: an error of the vergence of 1° places an object at 20 cm 1 cm too far and one at 35 cm 3 cm.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from pps_vision.geometry.camera import StereoRig
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.geometry.triangulation import midpoint
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import TOUCH_RADIUS_M, Skin, SkinPart
from pps_vision.types import Array, Mask, Track3D

# Standard deviations: prior of an encoder's offset, which must explain errors of links and cameras too (R's several
# centimetres), and noise of the distance from a taxel to the triangulated position.
_JOINT_RAD = np.deg2rad(1.5)
_DISTANCE_M = 0.006
_ONSET_M = 0.008  # by which an object may have come nearer before its touch is reported: 15 cm/s at 20 Hz
_OUTLIER_SIGMAS = 3.0  # a touch with a larger residual gets less weight (Cauchy)
_CLEAR_SIGMAS = 3.0  # mean gain of held-out touches, in standard errors, from which offsets are applied
_NO_POINT_M = 10.0  # position on each axis where two lines of sight do not meet: larger than any room
_FEWEST = 5  # held-out touches from which offsets are applied


@dataclass(frozen=True, slots=True)
class TouchTrial:
    """An object's approach to the skin, T samples until it touches taxels or ends; NaN while the object is unknown."""

    stamps_s: Array  # (T,)
    joints_rad: Array  # (T, k) all joints of the robot
    positions: Array  # (T, 3) m, root frame: centre of the object
    velocities: Array  # (T, 3) m/s, root frame
    velocity_covs: Array  # (T, 3, 3) m²/s²
    radius_m: Array  # (T,)
    touched: Mask  # (n,) taxels of the skin that were touched at the end

    @classmethod
    def at_touch(cls, track: Track3D, joints_rad: Array, touched: Mask) -> "TouchTrial":
        """The touch alone, by a known object, at joints (k,)."""
        state = track.position[None], track.velocity[None], track.cov[None, 3:6, 3:6], np.array([track.radius_m])
        return cls(np.array([track.stamp_s]), joints_rad[None], *state, touched)


@dataclass(frozen=True)
class JointOffsets:
    """Result of the calibration from k touches."""

    offsets_rad: Array  # (n_joints,) to be added to the encoders' angles
    before_m: Array  # (k,) distance by which the seen position of a touch contradicts the taxels (`_misfit_m`)
    after_m: Array  # (k,) the same with the offsets added


@dataclass(frozen=True)
class _Sighting:
    """A touch of a part by a seen object: the encoders `q_rad`, the directions from each eye to it in the eye's frame,
    its radius, and which taxels (n,) of the part it touched."""

    q_rad: Array
    left: Array
    right: Array
    radius_m: float
    part: SkinPart
    touched: Mask


def verified_offsets(robot: Robot, rig: StereoRig, skin: Skin, trials: Sequence[TouchTrial]) -> JointOffsets:
    """Offsets from all trials, as `joint_offsets`, where those from every other trial clearly shorten the distances
    by which the trials left out contradict the taxels, which are returned; else 0."""
    offsets = joint_offsets(robot, rig, skin, trials[::2]).offsets_rad
    held_out = [sighting for trial in trials[1::2] for sighting in _sightings(rig, skin, trial)]
    none = np.zeros(robot.n_joints)
    before, after = (
        np.array([np.linalg.norm(_misfit_m(robot, rig, sighting, q)) for sighting in held_out]) for q in (none, offsets)
    )
    gain = before - after
    if len(gain) < _FEWEST or not gain.mean() > _CLEAR_SIGMAS * gain.std(ddof=1) / np.sqrt(len(gain)):
        return JointOffsets(none, before, before)
    return JointOffsets(joint_offsets(robot, rig, skin, trials).offsets_rad, before, after)


def joint_offsets(robot: Robot, rig: StereoRig, skin: Skin, trials: Iterable[TouchTrial]) -> JointOffsets:
    """The most probable offsets given the ends of the `trials`, whose `touched` are of `skin`; 0 for joints that
    touches do not constrain (all, where no touch was seen).

    They need not be each joint's own error: other joints, a link or a camera may displace the seen object as they do.
    """
    sightings = [sighting for trial in trials for sighting in _sightings(rig, skin, trial)]

    def misfits_m(offsets: Array) -> Array:
        return np.array([_misfit_m(robot, rig, sighting, offsets) for sighting in sightings]).reshape(-1, 4)

    def residuals(offsets: Array) -> Array:
        sigmas = misfits_m(offsets) / _DISTANCE_M
        squared = np.maximum(np.sum(sigmas**2, axis=1, keepdims=True) / _OUTLIER_SIGMAS**2, 1e-12)
        robust = sigmas * np.sqrt(np.log1p(squared) / squared)  # Cauchy: squared norms grow logarithmically
        return np.concatenate([offsets / _JOINT_RAD, robust.ravel()])

    zero = np.zeros(robot.n_joints)
    estimate: Array = least_squares(residuals, zero, xtol=1e-4, ftol=1e-4).x
    return JointOffsets(estimate, *(np.linalg.norm(misfits_m(offsets), axis=1) for offsets in (zero, estimate)))


def _sightings(rig: StereoRig, skin: Skin, trial: TouchTrial) -> list[_Sighting]:
    """One of each part that the trial's object touched, if it was seen then."""
    q = trial.joints_rad[-1]
    p = trial.positions[-1]
    radius = trial.radius_m[-1]
    if not (np.isfinite(p).all() and np.isfinite(radius)):
        return []
    left, right = _rays(rig, q, p)
    touched = [trial.touched[skin.part_index == k] for k in range(len(skin.parts))]
    parts = zip(skin.parts, touched, strict=True)
    return [_Sighting(q, left, right, float(radius), part, mask) for part, mask in parts if mask.any()]


def _rays(rig: StereoRig, q: Array, p: Array) -> list[Array]:
    """Unit vectors (3,) from each eye to a position, in the eye's frame."""
    rays = [T[:3, :3].T @ (p - T[:3, 3]) for T in rig.eye_poses(q)]
    return [ray / np.linalg.norm(ray) for ray in rays]


def _misfit_m(robot: Robot, rig: StereoRig, sighting: _Sighting, offsets: Array) -> Array:
    """(4,) m by which the object's position, with these offsets, contradicts the touch.

    At the onset of a touch the surface is `TOUCH_RADIUS_M` from the nearest touched taxel, before the skin, at most as
    far from the other touched ones, and farther from all others.
    """
    part = sighting.part
    q = sighting.q_rad + offsets
    away = _seen_from(robot, rig, part.frame, q, sighting.left, sighting.right) - part.positions_m
    gaps = np.linalg.norm(away, axis=1) - sighting.radius_m - TOUCH_RADIUS_M
    nearest = np.where(sighting.touched, gaps, np.inf).argmin()
    return np.array(
        [
            gaps[nearest] - np.clip(gaps[nearest], -_ONSET_M, 0.0),
            max(gaps[sighting.touched].max(), 0.0),
            min(gaps[~sighting.touched].min(initial=0.0), 0.0),
            min(away[nearest] @ part.normals[nearest], 0.0),
        ]
    )


def seen_from(robot: Robot, rig: StereoRig, frame: str, trial: TouchTrial, offsets: Array) -> Array:
    """(3,) m the position at the end of a trial in one of the robot's frames, had the encoders had these offsets."""
    q = trial.joints_rad[-1]
    return _seen_from(robot, rig, frame, q + offsets, *_rays(rig, q, trial.positions[-1]))


def _seen_from(robot: Robot, rig: StereoRig, frame: str, q: Array, left: Array, right: Array) -> Array:
    T_left, T_right = rig.eye_poses(q)
    p = midpoint(T_left[:3, 3], T_left[:3, :3] @ left, T_right[:3, 3], T_right[:3, :3] @ right)
    return np.full(3, _NO_POINT_M) if p is None else move_points(inverse(robot.at(q).T_root(frame)), p)
