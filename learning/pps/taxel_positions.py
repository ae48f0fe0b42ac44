"""Positions of taxels in their part's frame, from touches by balls: fingertips in double touches (Roncone et al. 2014),
or seen objects.

The mean of the positions of a touching ball lies a centimetre or more before the skin.  Instead every touch limits the
distances d of its centre from the taxels: touched ones are between its radius r and `TOUCH_RADIUS_M` more, all others
beyond that.  A fingertip stops at the nearest, whose distance then is r.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from pps_vision.robot.skin import TOUCH_RADIUS_M, SkinPart
from pps_vision.types import Array, Mask

# Standard deviations of a position before any touch, and of a distance (fingertip by the joints; end of a movement).
_PRIOR_M = 0.03
_DISTANCE_M = 0.003
_ROUNDS = 3  # which taxel is the nearest depends on the positions
_FEWEST = 5  # touches of a taxel, from which its position is estimated
_CLEAR_SIGMAS = 3.0  # mean gain of held-out touches, in standard errors, from which positions are applied


@dataclass(frozen=True)
class PartTouch:
    """A ball that has just touched a skin part."""

    center: Array  # (3,) m, in the part's frame
    radius_m: float
    touched: Mask  # (n,) taxels of the part that report it


def verified_positions(part: SkinPart, touches: Sequence[PartTouch], stops: bool = True) -> SkinPart:
    """The part with positions from all touches, where positions from every other touch clearly improve the
    prediction of the others; else unchanged.  `stops`: the balls are fingertips that stop at the skin."""
    if len(touches) < _FEWEST:
        return part
    wrong = [
        [np.sum((_distances(p, [t])[0] <= t.radius_m + TOUCH_RADIUS_M) != t.touched) for t in touches[1::2]]
        for p in (part, estimated(part, touches[::2], stops))
    ]
    before, after = np.array(wrong)
    gain = before - after
    if not gain.mean() > _CLEAR_SIGMAS * gain.std(ddof=1) / np.sqrt(len(gain)):
        return part
    return estimated(part, touches, stops)


def estimated(part: SkinPart, touches: Sequence[PartTouch], stops: bool = True) -> SkinPart:
    """The part with the most probable position of every taxel that was touched often enough."""
    centers = np.array([t.center for t in touches])
    radii = np.array([t.radius_m for t in touches])
    touched = np.array([t.touched for t in touches])
    new = part
    for attempt in range(_ROUNDS if stops else 1):
        distances = np.where(touched, _distances(new, touches), np.inf)
        is_nearest = touched & (distances == distances.min(axis=1, keepdims=True)) & (attempt > 0)
        positions = part.positions_m.copy()
        for k in np.flatnonzero(touched.sum(axis=0) >= _FEWEST):
            near = touched[:, k], is_nearest[:, k]
            start = centers[near[attempt > 0 and bool(near[1].any())]].mean(axis=0) - radii.mean() * part.normals[k]
            positions[k] = least_squares(_residuals, start, args=(part.positions_m[k], centers, radii, *near)).x
        new = replace(part, positions_m=positions)
    return new


def _residuals(x: Array, prior: Array, centers: Array, radii: Array, touched: Mask, is_nearest: Mask) -> Array:
    d = np.linalg.norm(centers - x, axis=1)
    farthest = np.where(is_nearest, radii, radii + TOUCH_RADIUS_M)
    beyond = np.where(touched, np.maximum(radii - d, 0.0) + np.maximum(d - farthest, 0.0), 0.0)
    within = np.where(touched, 0.0, np.maximum(radii + TOUCH_RADIUS_M - d, 0.0))
    return np.concatenate([(x - prior) / _PRIOR_M, (beyond + within) / _DISTANCE_M])


def _distances(part: SkinPart, touches: Sequence[PartTouch]) -> Array:
    """(k, n) m from the centres to the taxels."""
    return np.linalg.norm(np.array([t.center for t in touches])[:, None] - part.positions_m, axis=2)
