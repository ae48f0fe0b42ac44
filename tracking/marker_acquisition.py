"""Acquisition of a marker: blobs of its hue that have moved, or that are nearer than what surrounds them."""

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

_LONG = 2.0  # ratio of a marker's sides
_APART = 1.3  # of a marker's size, from which on its surroundings are compared
_RING_POINTS = 300  # of its surroundings
_FARTHER = 0.8  # nearness of its surroundings beside its own
_DISTANCES = 16  # at which its surroundings are looked for
_BETTER = 0.7  # ratio of differences from which on another distance fits better


def moved_markers(params: MarkerParams, camera: CameraFrame, optics: Optics, background: Background) -> list[Outline]:
    """The blobs of the marker's hue, but for those that look like the background, are long, or are cut by the image's
    border: the whole of these may be of any size.  If there is none, what differs from the background within them: a
    marker before something of its hue."""
    height, width = camera.image.shape[:2]
    refused: list[Box] = []

    def is_compact(x: int, y: int, w: int, h: int) -> bool:
        return x > 0 and y > 0 and x + w < width and y + h < height and max(w, h) <= _LONG * min(w, h)

    def may_be(x: int, y: int, w: int, h: int) -> bool:
        moved = is_compact(x, y, w, h) and background.has_changed(camera.image, camera.view, x, y, w, h)
        if not moved:
            refused.append((x, y, x + w, y + h))
        return moved

    if camera.outlines is None:
        found = find_markers(params, camera.image, optics, is_candidate=may_be)
    else:
        found = [one for one in camera.outlines if may_be(*(round(value) for value in one.box_px))]
    vivid = find_vivid_markers(params, camera.image, optics, is_candidate=may_be)
    found = [one for one in found if not any(_holds(one, other) for other in vivid)] + vivid
    if not found and refused and background.is_known(camera.view):
        differs = partial(background.differs, camera.image, camera.view)
        found = find_markers(params, camera.image, optics, is_candidate=is_compact, differs=differs)
    return found


def is_nearer_than_surroundings(
    association: Association, cameras: CameraFrames, view: StereoView, left: Outline, right: Outline
) -> bool:
    """Whether an object is nearer than what surrounds it: the surroundings in the left image match the right image much
    better at some larger distance than at the object's."""
    observation = association.observe(view, left, right, cameras[0].stamp_s)
    if observation is None:
        return False
    (x, y, w, h), camera = left.box_px, view.left.camera
    box = (
        *(max(int(x - w), 0), max(int(y - h), 0)),
        *(min(int(x + 2 * w) + 1, camera.width), min(int(y + 2 * h) + 1, camera.height)),
    )
    rows, columns = np.nonzero(~masks.ellipse(box, left.center_px, _APART * w, _APART * h))
    step = len(rows) // _RING_POINTS + 1
    rows, columns = rows[::step] + box[1], columns[::step] + box[0]
    rays = view.left.rays(np.stack([columns, rows], axis=-1).astype(float))
    far_m, colors = math.dist(observation.p_root, view.left.place), cameras[0].image[rows, columns].astype(np.float32)
    differences = [
        color_difference(colors, view.left.center + far_m / nearness * rays, cameras[1].image, view.right)
        for nearness in (1.0, *np.linspace(_FARTHER, 0.05, _DISTANCES))
    ]
    return min(differences[1:]) < _BETTER * differences[0]


def _holds(one: Outline, other: Outline) -> bool:
    """Whether another outline's centre lies in the box of an outline."""
    (x, y, w, h), (u, v) = one.box_px, other.center_px
    return bool(x <= u < x + w and y <= v < y + h)
