"""Offsets of the robot's encoders, estimated from objects that its eyes saw touching its skin.

A touch gives the position of an object: at the taxels that feel it.  The kinematic chain from the eyes to that skin
holds all joints of head and arm, so touches in several postures constrain their offsets (Roncone et al. 2014 calibrate
two arms that touch each other in this way).  One offset in metres would not suffice: an error of the vergence of 1°
places an object at 20 cm 1 cm too far and one at 35 cm 3 cm.
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
# centimetres), and noise of a taxel's own position and of the triangulated one, each axis.
_JOINT_RAD = np.deg2rad(1.5)
_TAXEL_M = 0.005
_OUTLIER_SIGMAS = 3.0  # a touch with a larger residual gets less weight (Cauchy)
_CLEAR_SIGMAS = 3.0  # mean gain of held-out touches, in standard errors, from which offsets are applied
_NO_POINT_M = 10.0  # residual of each axis where two lines of sight do not meet: larger than any room
_FEWEST = 5  # held-out touches from which offsets are applied
_GRID = 24  # positions along each axis: about 5 mm apart, as a taxel's own error


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
    before_m: Array  # (k,) distance between the felt and the seen position of a touch
    after_m: Array  # (k,) the same with the offsets added


@dataclass(frozen=True)
class _Sighting:
    """A touch by a seen object: the encoders `q_rad`, the directions from each eye to it in the eye's frame, and its
    position with covariance (3, 3) m² in the frame of the part it touched, according to the skin."""

    q_rad: Array
    left: Array
    right: Array
    frame: str
    felt_at: Array
    cov: Array


def verified_offsets(robot: Robot, rig: StereoRig, skin: Skin, trials: Sequence[TouchTrial]) -> JointOffsets:
    """Offsets from all trials, as `joint_offsets`, where those from every other trial clearly shorten the distances
    between felt and seen positions of the trials left out, which are returned; else 0."""
    offsets = joint_offsets(robot, rig, skin, trials[::2]).offsets_rad
    held_out = [sighting for trial in trials[1::2] for sighting in _sightings(rig, skin, trial)]
    none = np.zeros(robot.n_joints)
    before, after = (
        np.array([np.linalg.norm(_error_m(robot, rig, sighting, q)) for sighting in held_out]) for q in (none, offsets)
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
    covs = np.array([sighting.cov for sighting in sightings]).reshape(-1, 3, 3) + _TAXEL_M**2 * np.eye(3)
    whitening = np.linalg.inv(np.linalg.cholesky(covs))

    def errors_m(offsets: Array) -> Array:
        return np.array([_error_m(robot, rig, sighting, offsets) for sighting in sightings]).reshape(-1, 3)

    def residuals(offsets: Array) -> Array:
        sigmas = np.einsum("kij,kj->ki", whitening, errors_m(offsets))
        squared = np.maximum(np.sum(sigmas**2, axis=1, keepdims=True) / _OUTLIER_SIGMAS**2, 1e-12)
        robust = sigmas * np.sqrt(np.log1p(squared) / squared)  # Cauchy: squared norms grow logarithmically
        return np.concatenate([offsets / _JOINT_RAD, robust.ravel()])

    zero = np.zeros(robot.n_joints)
    estimate: Array = least_squares(residuals, zero, xtol=1e-4, ftol=1e-4).x
    return JointOffsets(estimate, *(np.linalg.norm(errors_m(offsets), axis=1) for offsets in (zero, estimate)))


def _sightings(rig: StereoRig, skin: Skin, trial: TouchTrial) -> list[_Sighting]:
    """One of each part that the trial's object touched, if it was seen then."""
    q = trial.joints_rad[-1]
    p = trial.positions[-1]
    radius = trial.radius_m[-1]
    if not (np.isfinite(p).all() and np.isfinite(radius)):
        return []
    left, right = _rays(rig, q, p)
    touched = [trial.touched[skin.part_index == k] for k in range(len(skin.parts))]
    return [
        _Sighting(q, left, right, part.frame, *felt_position(part, mask, radius))
        for part, mask in zip(skin.parts, touched, strict=True)
        if mask.any()
    ]


def _rays(rig: StereoRig, q: Array, p: Array) -> list[Array]:
    """Unit vectors (3,) from each eye to a position, in the eye's frame."""
    rays = [T[:3, :3].T @ (p - T[:3, 3]) for T in rig.eye_poses(q)]
    return [ray / np.linalg.norm(ray) for ray in rays]


def felt_position(part: SkinPart, touched: Mask, radius_m: float) -> tuple[Array, Array]:
    """Mean (3,) m and covariance (3, 3) m², in a part's frame, of a ball's centre that touches just these (n,) taxels.

    Taken over all positions on a grid before the skin, and not in it, from which the ball would touch these taxels;
    where there is none, over the positions with the fewest taxels touched too many or too few.
    """
    reach_m = radius_m + TOUCH_RADIUS_M
    low = part.positions_m[touched].min(axis=0) - reach_m
    high = part.positions_m[touched].max(axis=0) + reach_m
    axes = (np.linspace(a, b, _GRID) for a, b in zip(low, high, strict=True))
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    near = ((part.positions_m > low - reach_m) & (part.positions_m < high + reach_m)).all(axis=1)
    taxels = part.positions_m[near]
    gaps = np.linalg.norm(places[:, None] - taxels, axis=2)
    nearest = gaps.argmin(axis=1)
    is_outside = np.einsum("ij,ij->i", places - taxels[nearest], part.normals[near][nearest]) > 0
    possible = is_outside & (gaps.min(axis=1) >= radius_m)
    wrong = ((gaps[possible] <= reach_m) != touched[near]).sum(axis=1)
    likely = places[possible][wrong == wrong.min()]
    mean: Array = likely.mean(axis=0)
    return mean, (likely - mean).T @ (likely - mean) / len(likely)


def _error_m(robot: Robot, rig: StereoRig, sighting: _Sighting, offsets: Array) -> Array:
    """(3,) m from the felt to the seen position, with these offsets."""
    q = sighting.q_rad + offsets
    return _seen_from(robot, rig, sighting.frame, q, sighting.left, sighting.right) - sighting.felt_at


def seen_from(robot: Robot, rig: StereoRig, frame: str, trial: TouchTrial, offsets: Array) -> Array:
    """(3,) m the position at the end of a trial in one of the robot's frames, had the encoders had these offsets."""
    q = trial.joints_rad[-1]
    return _seen_from(robot, rig, frame, q + offsets, *_rays(rig, q, trial.positions[-1]))


def _seen_from(robot: Robot, rig: StereoRig, frame: str, q: Array, left: Array, right: Array) -> Array:
    T_left, T_right = rig.eye_poses(q)
    p = midpoint(T_left[:3, 3], T_left[:3, :3] @ left, T_right[:3, 3], T_right[:3, :3] @ right)
    return np.full(3, _NO_POINT_M) if p is None else move_points(inverse(robot.at(q).T_root(frame)), p)
