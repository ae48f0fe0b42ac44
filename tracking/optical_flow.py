"""Optical flow of motion regions: pyramidal Lucas–Kanade (Bouguet 2001) on an image pair compensated for ego-motion.

A point is matched if the flow from the present image to the older one and back returns to it (forward–backward error,
Kalal 2010).  It moves if its flow differs from the median flow of the region's surroundings, so that an error of the
eye's pose, which shifts the whole image, moves nothing.  Points move together if one translation and expansion explain
their flow: an object that comes along the line of sight only expands.
"""

import math
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
_WINDOW_PX = 9  # of Lucas–Kanade; R's 15 covers too much of the background of a region of 20 px
_LEVELS = 4  # of its image pyramid (the default of OpenCV)
_MAX_POINTS = 40  # points in a region, and in the surroundings; limits the time
_MIN_POINTS = 4  # for a median
_SURROUND_PX = 4  # nearer to a region a window contains much of it
_EQUAL_PX = 0.5  # tolerance of equal flows
_EQUAL_SHARE = 0.15  # additional tolerance, as a share of the flow
_MAX_PAIRS = 200  # of points, each of which gives one hypothesis of an expansion
_COMMON_STD_PX = 0.1  # standard deviation of the error that all points in a region share


@dataclass(frozen=True, slots=True)
class Flow2D:
    """Image velocity of a region relative to its static surroundings."""

    velocity_px_s: Array  # (2,)
    cov: Array  # (2, 2) px²/s²: spread of the points' flow, and their common error
    now_px: Array  # (2,) mean position of the points, without ego-motion compensation
    then_px: Array  # (2,) their position in the older image
    reference_view: View  # view of the older image
    interval_s: float  # age of the older image


class Match(NamedTuple):
    """Share of a region's points that move together, share without a match, and the flow of the moving points."""

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
    reference: GreyImage,
    current: GreyImage,
    room_m: float,
    tolerance_px: float,
    regions: Sequence[tuple[Box, Mask]],
) -> list[Match]:
    """Return the flow of regions (x, y, width, height px; mask) of the present image since an older one.

    The older image is warped to the present view as if everything were `room_m` away.  A point moves if its flow
    differs from that of the surroundings by more than `tolerance_px` and three of their standard deviations.
    """
    box = _surroundings([box for box, _ in regions], current.pixels.shape)
    old = _cut(reference.pixels, box) if ego.is_still(reference.view, current.view) else None
    if old is None:
        old = ego.warp(reference.pixels, reference.view, current.view, 1 / room_m, box)
    new = _cut(current.pixels, box)
    outside = np.ones(new.shape, bool)
    grids = []
    for (x, y, w, h), mask in regions:
        top = y - box[1]
        left = x - box[0]
        outside[
            max(top - _SURROUND_PX, 0) : top + h + _SURROUND_PX, max(left - _SURROUND_PX, 0) : left + w + _SURROUND_PX
        ] = False
        grids.append(_grid(mask) + np.array([left, top]))
    grids.append(_grid(outside))
    ends = np.cumsum([len(grid) for grid in grids])
    flow, matched = _lucas_kanade(new, old, np.concatenate(grids).astype(np.float32))
    static, spread = _median(flow[ends[-2] :][matched[ends[-2] :]])
    threshold = max(tolerance_px, 3 * spread)
    parallax = ego.parallax_px_m(reference.view, current.view) / room_m  # of surroundings at another distance
    common_var = _COMMON_STD_PX**2 + (0.4 * parallax) ** 2
    dt = current.stamp_s - reference.stamp_s
    matches = []
    for points, end in zip(grids[:-1], ends[:-1], strict=True):
        part = np.s_[end - len(points) : end]
        relative = flow[part] - static
        is_moving = matched[part] & (np.hypot(relative[:, 0], relative[:, 1]) > threshold)
        alike = _most_alike(points, relative, is_moving)
        measured = None
        if np.count_nonzero(alike) >= _MIN_POINTS:
            mean = np.median(relative[alike], axis=0)
            cov = np.cov(relative[alike].T) + common_var * np.eye(2)
            now_px = points[alike].mean(axis=0) + box[:2]
            then_px = reference.view.project(current.view.center + room_m * current.view.rays(now_px - mean))
            measured = Flow2D(mean / dt, cov / dt**2, now_px, then_px, reference.view, dt)
        matches.append(Match(float(alike.mean()), 1 - float(matched[part].mean()), measured))
    return matches


def velocity(
    flows: tuple[Flow2D | None, Flow2D | None],
    view: StereoView,
    position: Array,
    prior_std: tuple[float, float],
    position_cov: Array | None = None,
) -> tuple[Array, Array] | None:
    """Return the velocity (3,) m/s of an object at `position` (3,) m from its flow, and its covariance (3, 3).

    In each eye, J v Δt = π(q) − x, with q the object's present position, π(q) its pixel in the older image if it
    rests, x the measured pixel, and J = ∂π/∂q.  The mean over both eyes gives the velocity across the view.  Toward
    the eyes it stays 0 ± the prior, since over so short a time positions are more certain than a difference of flows.
    If the intervals differ, the shorter counts: an object that has just started to move was slower in the longer.

    Args:
        flows: Flow in the left and the right eye.
        view: Present view.
        position: (3,) m, root frame.
        prior_std: Prior standard deviation of velocity (m/s) and acceleration (m/s²).  Flow is the mean velocity of
            its interval, from which the present velocity differs by half the acceleration's part.
        position_cov: (3, 3) m² of the white error of each later position.  The covariance is at least that of a
            difference of two such positions, so that flow does not outweigh them; the mean stays.

    Returns:
        None without flow.
    """
    measured = [(flow, eye) for flow, eye in zip(flows, (view.left, view.right), strict=True) if flow is not None]
    if not measured:
        return None
    shortest_s = min(flow.interval_s for flow, _ in measured)
    measured = [(flow, eye) for flow, eye in measured if flow.interval_s < shortest_s + JITTER_S]
    n = len(measured)
    J = np.zeros((2, 3))
    rate = np.zeros(2)
    cov = np.zeros((2, 2))
    for flow, eye in measured:
        q = eye.center + float(np.linalg.norm(position - eye.center)) * eye.rays(flow.now_px)
        J += flow.reference_view.project_jacobian(q) / n
        rate += (flow.reference_view.project(q) - flow.then_px) / flow.interval_s / n
        cov += flow.cov / n**2
    prior = np.eye(3) / prior_std[0] ** 2
    weights = J.T @ np.linalg.inv(cov)
    mean = np.linalg.inv(weights @ J + prior) @ weights @ rate
    if position_cov is not None:
        cov = cov + 2 / shortest_s**2 * J @ position_cov @ J.T
    velocity_cov = np.linalg.inv(J.T @ np.linalg.inv(cov) @ J + prior)
    acceleration_var = (0.5 * prior_std[1] * shortest_s) ** 2
    return mean, 0.5 * (velocity_cov + velocity_cov.T) + acceleration_var * np.eye(3)


def _surroundings(boxes: list[Box], shape: tuple[int, ...]) -> Box:
    """Return x0, y0, x1, y1 around all boxes (x, y, width, height) and their surroundings."""
    x0 = min(x for x, _, _, _ in boxes)
    y0 = min(y for _, y, _, _ in boxes)
    x1 = max(x + width for x, _, width, _ in boxes)
    y1 = max(y + height for _, y, _, height in boxes)
    margin = max(20, max(x1 - x0, y1 - y0) // 2)
    return max(x0 - margin, 0), max(y0 - margin, 0), min(x1 + margin, shape[1]), min(y1 + margin, shape[0])


def _cut(image: Grey, box: Box) -> Grey:
    return np.ascontiguousarray(image[box[1] : box[3], box[0] : box[2]])


def _grid(mask: Mask) -> Array:
    """(n, 2) pixels x, y of a mask on a square grid, about `_MAX_POINTS` at most."""
    step = max(math.ceil(math.sqrt(np.count_nonzero(mask) / _MAX_POINTS)), 1)
    pixels = step * np.argwhere(mask[::step, ::step])[:, ::-1]
    return (pixels if len(pixels) else np.argwhere(mask)[:_MAX_POINTS, ::-1]).astype(float)


def _lucas_kanade(new: Grey, old: Grey, points: NDArray[np.float32]) -> tuple[Array, Mask]:
    """(n, 2) px flow of each point from `old` to `new`, and whether the point is matched."""
    window = (_WINDOW_PX, _WINDOW_PX)
    start = points.reshape(-1, 1, 2)
    end, status, _ = cv2.calcOpticalFlowPyrLK(new, old, start, np.empty(0), winSize=window, maxLevel=_LEVELS - 1)
    back, back_status, _ = cv2.calcOpticalFlowPyrLK(old, new, end, np.empty(0), winSize=window, maxLevel=_LEVELS - 1)
    error = np.linalg.norm((back - start)[:, 0], axis=1)
    matched = (status[:, 0] > 0) & (back_status[:, 0] > 0) & (error <= _EQUAL_PX)
    return (start - end)[:, 0].astype(float), matched


def _median(flow: Array) -> tuple[Array, float]:
    """Median flow (2,) and standard deviation (from the median absolute deviation); 0 for too few points."""
    if len(flow) < _MIN_POINTS:
        return np.zeros(2), 0.0
    median = np.median(flow, axis=0)
    return median, 1.4826 * float(np.median(np.abs(flow - median)))


def _most_alike(points: Array, flow: Array, moving: Mask) -> Mask:
    """Largest subset of the moving points (n, 2) px whose flow (n, 2) px one translation and expansion explain.

    Hypotheses are the translation of each point, and translation and expansion of each pair of points.
    """
    if not moving.any():
        return moving
    p = points[moving]
    f = flow[moving]
    i, j = np.triu_indices(len(p), 1)
    stride = len(i) // _MAX_PAIRS + 1
    i = i[::stride]
    j = j[::stride]
    distance = p[i] - p[j]
    expansion = np.sum((f[i] - f[j]) * distance, axis=1) / np.sum(distance**2, axis=1)
    centers = np.concatenate([p, (p[i] + p[j]) / 2])
    shifts = np.concatenate([f, (f[i] + f[j]) / 2])
    expansions = np.concatenate([np.zeros(len(p)), expansion])[:, None, None]
    explained = shifts[:, None] + expansions * (points - centers[:, None])
    tolerance = _EQUAL_PX + _EQUAL_SHARE * np.linalg.norm(explained, axis=-1)
    agrees = (np.linalg.norm(explained - flow, axis=-1) <= tolerance) & moving
    best: Mask = agrees[agrees.sum(axis=1).argmax()]
    return best
