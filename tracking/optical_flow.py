"""Optical flow of motion regions: pyramidal Lucas–Kanade (Bouguet 2001) on an image pair compensated for ego-motion.

A point is matched if the flow from the present image to the older one and back returns to it (forward–backward error,
Kalal 2010).  It moves if its flow differs from the median flow of the region's surroundings, so an error of the eye's
pose, which shifts everything alike, moves nothing.  Points move alike if a translation and an expansion explain their
flow: what comes along the line of sight only expands.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import StereoView, View
from pps_vision.types import Array, Mask
from tracking.ego_motion import Box, EgoMotion

Grey = NDArray[np.uint8]  # (H, W)
JITTER_S = 0.005  # of stamps
_WINDOW_PX = 9  # of Lucas–Kanade; R's 15 takes in too much of the background of a region of 20 px
_LEVELS = 4  # of its image pyramid (the default of OpenCV)
_MAX_POINTS = 40  # of a region, and of the surroundings; it limits the time
_MIN_POINTS = 4  # for a median
_SURROUND_PX = 4  # nearer to a region a window contains much of it
_EQUAL_PX, _EQUAL_SHARE = 0.5, 0.15  # flows equal up to so many pixels, and up to that share of the flow
_MAX_PAIRS = 200  # of points, from each of which an expansion is tried
_COMMON_STD_PX = 0.1  # of the error that all points of a region share


@dataclass(frozen=True, slots=True)
class Flow2D:
    """Image velocity of a region relative to its static surroundings.

    `velocity_px_s` (2,) with `cov` (2, 2) px²/s²: the spread of its points' flow, and their common error.  Without
    ego-motion compensation: what is at `now_px` (2,) was at `then_px` in the image taken from `then`, `interval_s` ago.
    """

    velocity_px_s: Array
    cov: Array
    now_px: Array
    then_px: Array
    then: View
    interval_s: float


class Match(NamedTuple):
    """Share of a region's points that move alike, share without a match, and the flow of the former."""

    moving: float
    unmatched: float
    flow: Flow2D | None


class GreyImage(NamedTuple):
    """A grey image, the view it was taken from, and its stamp."""

    pixels: Grey
    view: View
    stamp_s: float


def match(
    ego: EgoMotion,
    then: GreyImage,
    now: GreyImage,
    room_m: float,
    tolerance_px: float,
    regions: Sequence[tuple[Box, Mask]],
) -> list[Match]:
    """Measure the flow of regions (x, y, width, height px; mask) of the present image since an older one.

    The older image is warped to the present view as if everything were `room_m` away.  Points move whose flow differs
    from the surroundings' by `tolerance_px`, and by 3 standard deviations of theirs.
    """
    box = _surroundings([box for box, _ in regions], now.pixels.shape)
    old = _cut(then.pixels, box) if ego.is_still(then.view, now.view) else None
    if old is None:
        old = ego.warp(then.pixels, then.view, now.view, 1 / room_m, box)
    new = _cut(now.pixels, box)
    dt, outside, parts = now.stamp_s - then.stamp_s, np.ones(new.shape, bool), []
    for (x, y, w, h), mask in regions:
        top, left, m = y - box[1], x - box[0], _SURROUND_PX
        outside[max(top - m, 0) : top + h + m, max(left - m, 0) : left + w + m] = False
        parts.append(_grid(mask) + np.array([left, top]))
    parts.append(_grid(outside))
    points, ends = np.concatenate(parts), np.cumsum([len(part) for part in parts])
    flow, matched = _lucas_kanade(new, old, points.astype(np.float32))
    static, spread = _median(flow[ends[-2] :][matched[ends[-2] :]])
    threshold = max(tolerance_px, 3 * spread)
    parallax = ego.parallax_px_m(then.view, now.view) / room_m  # of surroundings at another distance than `room_m`
    result = []
    for first, last in zip([0, *ends[:-2]], ends[:-1], strict=True):
        relative, found = flow[first:last] - static, matched[first:last]
        alike = _most_alike(
            points[first:last], relative, found & (np.hypot(relative[:, 0], relative[:, 1]) > threshold)
        )
        measured = None
        if np.count_nonzero(alike) >= _MIN_POINTS:
            mean = np.median(relative[alike], axis=0)
            cov = np.cov(relative[alike].T) + (_COMMON_STD_PX**2 + (0.4 * parallax) ** 2) * np.eye(2)
            at = points[first:last][alike].mean(axis=0) + box[:2]
            then_px = then.view.project(now.view.center + room_m * now.view.rays(at - mean))
            measured = Flow2D(mean / dt, cov / dt**2, at, then_px, then.view, dt)
        result.append(Match(float(alike.mean()), 1 - float(found.mean()), measured))
    return result


def velocity(
    flows: tuple[Flow2D | None, Flow2D | None],
    view: StereoView,
    position: Array,
    prior_std: tuple[float, float],
    position_px: float = 0.0,
) -> tuple[Array, Array] | None:
    """Velocity (3,) m/s of an object at `position` (3,) m from its flow, and its covariance (3, 3); None without flow.

    In each eye, J v Δt = π(q) − x: π(q) is where the older image would show the point q that is seen there now, were
    it at rest, x where it did, J = ∂π/∂q.  The mean over both eyes gives the velocity across the view; toward the eyes
    it stays 0 ± the prior, for in so short a time positions are more certain than a difference of flows.  Of different
    intervals the shorter counts: what has just begun to move was slower on average in the longer.

    Args:
        prior_std: Standard deviation of velocity (m/s) and acceleration (m/s²) before anything was measured.  Flow is
            the mean velocity of its interval, from which the present one differs by half the acceleration's part.
        position_px: By how much (standard deviation) each position that will be measured is taken to err anew.  The
            covariance is at least that of a difference of two such positions, so that flow outweighs none that
            follow; the mean stays.
    """
    known = [(flow, eye) for flow, eye in zip(flows, (view.left, view.right), strict=True) if flow is not None]
    if not known:
        return None
    shortest = min(flow.interval_s for flow, _ in known)
    known = [pair for pair in known if pair[0].interval_s < shortest + JITTER_S]
    J, rate, cov = np.zeros((2, 3)), np.zeros(2), np.zeros((2, 2))
    for flow, eye in known:
        q = eye.center + float(np.linalg.norm(position - eye.center)) * eye.rays(flow.now_px)
        J += flow.then.project_jacobian(q) / len(known)
        rate += (flow.then.project(q) - flow.then_px) / flow.interval_s / len(known)
        cov += flow.cov / len(known) ** 2
    prior = np.eye(3) / prior_std[0] ** 2
    weights = J.T @ np.linalg.inv(cov)
    mean = np.linalg.inv(weights @ J + prior) @ weights @ rate
    cov = cov + 2 * (position_px / shortest) ** 2 / len(known) * np.eye(2)
    whole = np.linalg.inv(J.T @ np.linalg.inv(cov) @ J + prior)
    return mean, 0.5 * (whole + whole.T) + (0.5 * prior_std[1] * shortest) ** 2 * np.eye(3)


def _surroundings(boxes: list[Box], shape: tuple[int, ...]) -> Box:
    """x0, y0, x1, y1 around all boxes (x, y, width, height) and their surroundings."""
    x0, y0 = min(box[0] for box in boxes), min(box[1] for box in boxes)
    x1, y1 = max(box[0] + box[2] for box in boxes), max(box[1] + box[3] for box in boxes)
    m = max(20, max(x1 - x0, y1 - y0) // 2)
    return max(x0 - m, 0), max(y0 - m, 0), min(x1 + m, shape[1]), min(y1 + m, shape[0])


def _cut(image: Grey, box: Box) -> Grey:
    return np.ascontiguousarray(image[box[1] : box[3], box[0] : box[2]])


def _grid(mask: Mask) -> Array:
    """(n, 2) pixels x, y of a mask on a square grid, about `_MAX_POINTS` at most."""
    ys, xs = np.nonzero(mask)
    step = max(int(np.ceil(np.sqrt(len(ys) / _MAX_POINTS))), 1)
    kept = (ys % step == 0) & (xs % step == 0)
    grid = np.stack([xs[kept], ys[kept]], axis=-1) if kept.any() else np.stack([xs, ys], axis=-1)[:_MAX_POINTS]
    return grid.astype(float)


def _lucas_kanade(new: Grey, old: Grey, points: NDArray[np.float32]) -> tuple[Array, Mask]:
    """(n, 2) px that each point of `new` has come since `old`, and whether it is matched."""
    start, window = points.reshape(-1, 1, 2), (_WINDOW_PX, _WINDOW_PX)
    there, found, _ = cv2.calcOpticalFlowPyrLK(new, old, start, np.empty(0), winSize=window, maxLevel=_LEVELS - 1)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(old, new, there, np.empty(0), winSize=window, maxLevel=_LEVELS - 1)
    error = np.linalg.norm((back - start)[:, 0], axis=1)
    matched = (found[:, 0] > 0) & (found_back[:, 0] > 0) & (error <= _EQUAL_PX)
    return (start - there)[:, 0].astype(float), matched


def _median(flow: Array) -> tuple[Array, float]:
    """Median flow (2,) and its standard deviation by the median absolute deviation; 0 where too few are known."""
    if len(flow) < _MIN_POINTS:
        return np.zeros(2), 0.0
    median = np.median(flow, axis=0)
    return median, 1.4826 * float(np.median(np.abs(flow - median)))


def _most_alike(points: Array, flow: Array, moving: Mask) -> Mask:
    """The moving ones of points (n, 2) px whose flow (n, 2) px one translation and expansion explains: those of the
    point, or of the pair of points, with which most agree."""
    if not moving.any():
        return moving
    at, by = points[moving], flow[moving]
    i, j = np.triu_indices(len(at), 1)
    i, j = i[:: len(i) // _MAX_PAIRS + 1], j[:: len(j) // _MAX_PAIRS + 1]
    apart = at[i] - at[j]
    rate = np.sum((by[i] - by[j]) * apart, axis=1) / np.sum(apart**2, axis=1)
    center, shift = np.concatenate([at, (at[i] + at[j]) / 2]), np.concatenate([by, (by[i] + by[j]) / 2])
    expansion = np.concatenate([np.zeros(len(at)), rate])[:, None, None]
    explained = shift[:, None] + expansion * (points - center[:, None])
    allowed = _EQUAL_PX + _EQUAL_SHARE * np.linalg.norm(explained, axis=-1)
    near = (np.linalg.norm(explained - flow, axis=-1) <= allowed) & moving
    best: Mask = near[near.sum(axis=1).argmax()]
    return best
