"""Acquisition of a marker: blobs of its hue that have moved, or that are nearer than their surroundings."""

import math
from functools import partial

import numpy as np

from pps_vision.geometry.camera import StereoView
from tracking import masks
from tracking.background import Background
from tracking.ego_motion import Box, color_difference
from tracking.marker import MarkerParams, find_markers, find_vivid_markers
from tracking.outline import Optics, Outline
from tracking.stereo import Association, CameraFrame, CameraFrames

_MAX_ELONGATION = 2.0  # ratio of a marker's sides
_RING_SIZE = 1.3  # inner size of the surroundings, relative to the marker's
_RING_POINTS = 300  # pixels of the surroundings that are compared
_MAX_INVERSE_DISTANCE = 0.8  # largest inverse distance of the surroundings, relative to the marker's
_DISTANCES = 16  # hypotheses of the surroundings' distance
_MAX_RATIO = 0.7  # ratio of the image differences at the surroundings' distance and at the marker's


def moved_markers(params: MarkerParams, camera: CameraFrame, optics: Optics, background: Background) -> list[Outline]:
    """Return the blobs of the marker's hue that differ from the background, are compact and inside the image.

    If there is none, return compact parts of the refused blobs that differ from the background: a marker in front of
    something of its hue.
    """
    height, width = camera.image.shape[:2]
    refused: list[Box] = []

    def is_compact(x: int, y: int, w: int, h: int) -> bool:
        return x > 0 and y > 0 and x + w < width and y + h < height and max(w, h) <= _MAX_ELONGATION * min(w, h)

    def is_candidate(x: int, y: int, w: int, h: int) -> bool:
        moved = is_compact(x, y, w, h) and background.has_changed(camera.image, camera.view, x, y, w, h)
        if not moved:
            refused.append((x, y, x + w, y + h))
        return moved

    if camera.outlines is None:
        outlines = find_markers(params, camera.image, optics, is_candidate=is_candidate)
    else:
        outlines = [outline for outline in camera.outlines if is_candidate(*map(round, outline.box_px))]
    vivid = find_vivid_markers(params, camera.image, optics, is_candidate=is_candidate)
    plain = [outline for outline in outlines if not any(_contains(outline, marker) for marker in vivid)]
    if plain or vivid or not refused or not background.is_known(camera.view):
        return plain + vivid
    differs = partial(background.differs, camera.image, camera.view)
    return find_markers(params, camera.image, optics, is_candidate=is_compact, differs=differs)


def is_nearer_than_surroundings(
    association: Association, cameras: CameraFrames, view: StereoView, left: Outline, right: Outline
) -> bool:
    """Whether an object is nearer than its surroundings: these match the right image much better at some larger
    distance than at the object's."""
    observation = association.observe(view, left, right, cameras[0].stamp_s)
    if observation is None:
        return False
    x, y, w, h = left.box_px
    around = (int(x - w), int(y - h), int(x + 2 * w) + 1, int(y + 2 * h) + 1)
    box = masks.clipped(around, view.left.camera.width, view.left.camera.height)
    rows, columns = np.nonzero(~masks.ellipse(box, left.center_px, _RING_SIZE * w, _RING_SIZE * h))
    step = len(rows) // _RING_POINTS + 1
    rows = rows[::step] + box[1]
    columns = columns[::step] + box[0]
    colors = cameras[0].image[rows, columns].astype(np.float32)
    rays = view.left.rays(np.stack([columns, rows], axis=-1).astype(float))
    distance_m = math.dist(observation.p_root, view.left.place)

    def difference(inverse_distance: float) -> float:
        points = view.left.center + distance_m / inverse_distance * rays
        return color_difference(colors, points, cameras[1].image, view.right)

    farther = min(map(difference, np.linspace(_MAX_INVERSE_DISTANCE, 0.05, _DISTANCES)))
    return farther < _MAX_RATIO * difference(1.0)


def _contains(outline: Outline, marker: Outline) -> bool:
    """Whether the marker's centre lies in the outline's box."""
    x, y, w, h = outline.box_px
    u, v = marker.center_px
    return bool(x <= u < x + w and y <= v < y + h)
