"""By how much the robot's encoders are off, learned from where its eyes saw what touched its skin.

A touch says where an object is: on the taxels that feel it.  Between the eyes that saw it and that skin lie all joints
of head and arm, so touches in several postures tell how far they are off together (Roncone et al. 2014 calibrate arms
that touch each other so).  An offset in metres would not do: eyes that converge 1° less than they believe see what is
20 cm off 1 cm further and what is 35 cm off 3 cm.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from learning.touch_trial import TouchTrial
from pps_vision.geometry.camera import StereoRig
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.geometry.triangulation import midpoint
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import TOUCH_RADIUS_M, Skin, SkinPart
from pps_vision.types import Array, Mask

_NOWHERE_M = 10.0  # how far off what two lines of sight do not meet in is
_APART_M = 0.005  # from one place where something may be to the next


@dataclass(frozen=True)
class JointOffsetParams:
    """What is believed before the first touch, standard deviations: `joint_rad` of an encoder's offset (R's sources of
    error: joints, links and cameras together), `touch_m`, each axis, of an object's centre from where a touch puts it
    (measured without errors: 8 to 11 mm; a virtual taxel is felt up to 2 cm around).  A touch further than
    `outlier_sigmas` off counts less and less."""

    joint_rad: float = np.deg2rad(1.5)
    touch_m: float = 0.01
    outlier_sigmas: float = 3.0

    def __post_init__(self) -> None:
        if not all(sigma > 0 for sigma in (self.joint_rad, self.touch_m, self.outlier_sigmas)):  # NaN is not
            raise ValueError(f"{self}: expected standard deviations above 0")


@dataclass(frozen=True)
class _Sighting:
    """What touched: the encoders `q_rad`, the directions from each eye to it in the eye's frame, and where it must have
    been, in the frame of the part it touched."""

    q_rad: Array
    left: Array
    right: Array
    frame: str
    touched_at: Array


def joint_offsets(
    params: JointOffsetParams, robot: Robot, rig: StereoRig, skin: Skin, trials: Iterable[TouchTrial]
) -> Array:
    """(n_joints,) rad to be added to what the encoders say, so that what touches is seen where it is felt.

    The most probable ones given the ends of the `trials`, whose `touched` are of `skin`; 0 for joints of which touches
    tell nothing (all, where none was seen).  They need not be each joint's own error: other combinations, a link or a
    camera may move what is seen in the same way.
    """
    sightings = [sighting for trial in trials for sighting in _sightings(rig, skin, trial)]

    def surprises(offsets: Array) -> Array:
        missed = [_missed(robot, rig, sighting, offsets) for sighting in sightings]
        return np.concatenate([offsets / params.joint_rad, *(_bounded(m / params.touch_m, params) for m in missed)])

    found: Array = least_squares(surprises, np.zeros(robot.n_joints), xtol=1e-4, ftol=1e-4).x
    return found


def _sightings(rig: StereoRig, skin: Skin, trial: TouchTrial) -> list[_Sighting]:
    """One of each part that the trial's object touched, if it was seen then."""
    q, p, radius = trial.joints_rad[-1], trial.positions[-1], trial.radius_m[-1]
    if not (np.isfinite(p).all() and np.isfinite(radius)):
        return []
    left, right = (T[:3, :3].T @ (p - T[:3, 3]) for T in rig.eye_poses(q))
    left, right = left / np.linalg.norm(left), right / np.linalg.norm(right)
    found = []
    for k, part in enumerate(skin.parts):
        touched = trial.touched[skin.part_index == k]
        if touched.any():
            found.append(_Sighting(q, left, right, part.frame, touching(part, touched, radius)))
    return found


def touching(part: SkinPart, touched: Mask, radius_m: float) -> Array:
    """(3,) where a ball is that touches just these (n,) taxels of a part, in its frame: the middle of all places before
    the skin, and not in it, from which it would touch those; where there is none, of those with the fewest taxels
    touched too many or too few."""
    far = radius_m + TOUCH_RADIUS_M
    near = part.positions_m[touched]
    axes = (
        np.arange(low - far, high + far, 0.005) for low, high in zip(near.min(axis=0), near.max(axis=0), strict=True)
    )
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    gaps = np.linalg.norm(places[:, None] - part.positions_m, axis=2)
    nearest = gaps.argmin(axis=1)
    before = np.einsum("ij,ij->i", places - part.positions_m[nearest], part.normals[nearest]) > 0
    possible = before & (gaps.min(axis=1) >= radius_m)
    wrong = ((gaps[possible] <= far) != touched).sum(axis=1)
    middle: Array = places[possible][wrong == wrong.min()].mean(axis=0)
    return middle


def _missed(robot: Robot, rig: StereoRig, sighting: _Sighting, offsets: Array) -> Array:
    """(3,) m from where it must have been to where it was seen, were these the offsets."""
    q = sighting.q_rad + offsets
    (T_left, T_right), T_part = rig.eye_poses(q), robot.at(q).T_root(sighting.frame)
    seen = midpoint(T_left[:3, 3], T_left[:3, :3] @ sighting.left, T_right[:3, 3], T_right[:3, :3] @ sighting.right)
    return np.full(3, _NOWHERE_M) if seen is None else move_points(inverse(T_part), seen) - sighting.touched_at


def _bounded(sigmas: Array, params: JointOffsetParams) -> Array:
    """A residual whose square grows as its logarithm once it is improbable (Cauchy)."""
    squared = float(sigmas @ sigmas) / params.outlier_sigmas**2
    return sigmas * np.sqrt(np.log1p(squared) / squared) if squared > 0 else sigmas
