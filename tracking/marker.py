"""Marker of known hue: threshold in HSV, blobs, sub-pixel outlines; which blobs have moved or are near."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import islice
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.errors import InputError
from pps_vision.geometry import masks
from pps_vision.geometry.camera import StereoView
from pps_vision.geometry.masks import Box
from pps_vision.types import Array, Image, Mask
from tracking.camera_pose import color_difference
from tracking.foreground import Background
from tracking.outline import Optics, Outline, fit_outline
from tracking.stereo import Association, CameraFrame, CameraFrames

_MAX_ELONGATION = 2.0  # ratio of a marker's sides
_COMPARED_PIXELS = 300  # inside a marker, and around it
_MAX_INVERSE_DISTANCE = 0.8  # largest inverse distance of the surroundings, relative to the marker's
_DISTANCES = 16  # hypotheses of the surroundings' distance
_MAX_RATIO = 0.7  # ratio of the image differences at the surroundings' distance and at the marker's
_MARGIN_PX = 8  # of background around a blob that its outline is fitted in: the whole image takes half as long again
MIN_AREA_PX = 8  # smallest object
_CHANGED = 0.3  # least foreground share of a marker's box
_MAX_COMPARED = 40  # blobs that are compared with the background
_MAX_BLOBS = 4  # blobs that are outlined, the largest and roundest: it limits the time in an image full of the hue
_LARGER = 1.03  # ratio of the hue's area and the expected one from which thin parts are removed
_INSIDE = 0.9  # share of a marker's width and height in which its own colours are taken
_THIN = 0.4  # radius of the disc that removes them, relative to the root of the expected area (a disc's is 0.56)
_OUTLIER = 4.0  # standard deviations of a marker's own colours from their median
_MIN_HUE_DEG = 6.0  # three of OpenCV's steps: least tolerance of the marker's hue
_MIN_SATURATION = 0.05  # the same of its saturation
_SATURATIONS = (0.6, 0.7, 0.8, 0.9)  # least saturations that separate a marker from a scene of its hue


@dataclass(frozen=True)
class MarkerParams:
    """Colour of a marker."""

    hue_deg: float = 120.0
    """Hue, degrees."""
    hue_tolerance_deg: float = 35.0
    """Largest difference from that hue, degrees."""
    min_saturation: float = 0.5
    """Smallest saturation, 0–1."""
    min_value: float = 0.12
    """Smallest value, 0–1: below it the hue is noise."""

    @cached_property
    def ranges(self) -> list[tuple[Array, Array]]:
        """Lowest and highest hue (0–180), saturation and value (0–255) in OpenCV's units; two ranges if the hue
        crosses 0°."""
        low = (self.hue_deg - self.hue_tolerance_deg) / 2
        high = (self.hue_deg + self.hue_tolerance_deg) / 2
        floor = (255 * self.min_saturation, 255 * self.min_value)
        shifts = [shift for shift in (-180.0, 0.0, 180.0) if low + shift <= 180 and high + shift >= 0]
        return [(np.array([low + shift, *floor]), np.array([high + shift, 255.0, 255.0])) for shift in shifts]

    def narrowed(self) -> Iterator["MarkerParams"]:
        """The parameters, then parts of their range, for a marker before something of its hue: more and more saturated,
        then of half the tolerance."""
        half = 0.5 * self.hue_tolerance_deg
        parts = [(self.hue_deg, self.hue_tolerance_deg), *((self.hue_deg + k * half, half) for k in (0, -1, 1))]
        for hue_deg, tolerance_deg in parts:
            part = replace(self, hue_deg=hue_deg % 360, hue_tolerance_deg=tolerance_deg)
            yield part
            yield from (replace(part, min_saturation=level) for level in _SATURATIONS if level > self.min_saturation)

    def __post_init__(self) -> None:
        if not (0 <= self.hue_deg < 360 and 0 < self.hue_tolerance_deg <= 90):
            raise InputError(
                "marker",
                f"hue {self.hue_deg}° ± {self.hue_tolerance_deg}°; "
                "expected a hue in [0, 360) and a tolerance in (0, 90]",
            )
        if not (0 <= self.min_saturation <= 1 and 0 <= self.min_value <= 1):
            raise InputError(
                "marker",
                f"saturation {self.min_saturation}, value {self.min_value}; expected shares from 0 to 1",
            )


def find_markers(
    params: MarkerParams,
    image: Image,
    optics: Optics,
    near: tuple[float, float, float] | None = None,
    is_candidate: Callable[[int, int, int, int], bool] = lambda *_: True,
    differs: Callable[[Box], Mask] | None = None,
    expected_area_px: float | None = None,
) -> list[Outline]:
    """Return the outlines of the blobs of the marker's hue in an RGB image, the largest and roundest first.

    `near` (x, y, half side px) is the square to search instead of the whole image; `is_candidate` takes a blob's box
    (x, y, width, height px), `differs` a region, and returns which of its pixels may be the marker.
    """
    height, width = image.shape[:2]
    box = (0, 0, width, height)
    if near is not None:
        x, y, half = near
        box = masks.clipped((int(x - half), int(y - half), int(x + half) + 2, int(y + half) + 2), width, height)
    x0, y0, x1, y1 = box
    if x1 - x0 < 3 or y1 - y0 < 3:
        return []
    mask = threshold(params, image[y0:y1, x0:x1])
    if differs is not None:
        mask = np.where(differs(box), mask, np.uint8(0))
    if expected_area_px is not None and np.count_nonzero(mask) > _LARGER * expected_area_px:
        whole = masks.filled(masks.closed(mask > 0, masks.square(1)))
        mask = masks.opened(whole, int(_THIN * math.sqrt(expected_area_px))).view(np.uint8)
    return blob_outlines(image, mask, box, optics, is_candidate, expected_area_px)


def colors_of(params: MarkerParams, image: Image, outline: Outline) -> MarkerParams:
    """Return the part of a marker's range of colours that one with this outline has: median and spread."""
    x, y, w, h = outline.box_px
    box = masks.clipped((int(x), int(y), math.ceil(x + w), math.ceil(y + h)), image.shape[1], image.shape[0])
    hsv = cv2.cvtColor(image[box[1] : box[3], box[0] : box[2]], cv2.COLOR_RGB2HSV)
    hue, saturation, _ = hsv[masks.ellipse(box, outline.center_px, _INSIDE * w, _INSIDE * h)].astype(float).T
    if not len(hue):
        return params
    off_deg = (2 * hue - params.hue_deg + 180) % 360 - 180
    middle_deg = float(np.median(off_deg))
    tolerance_deg = max(_OUTLIER * _spread(off_deg), _MIN_HUE_DEG)
    lowest = float(np.median(saturation)) / 255 - max(_OUTLIER * _spread(saturation) / 255, _MIN_SATURATION)
    return replace(
        params,
        hue_deg=(params.hue_deg + middle_deg) % 360,
        hue_tolerance_deg=min(tolerance_deg, params.hue_tolerance_deg),
        min_saturation=max(lowest, params.min_saturation),
    )


def _spread(values: Array) -> float:
    """Robust standard deviation of values (n,)."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def blob_outlines(
    image: Image,
    mask: NDArray[np.uint8],
    box: Box,
    optics: Optics,
    is_candidate: Callable[[int, int, int, int], bool] = lambda *_: True,
    expected_area_px: float | None = None,
) -> list[Outline]:
    """Return the outlines of the blobs of a mask (h, w) of the region `box` of an RGB image, the largest and roundest
    first."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    blobs = [blob for blob in map(_blob, contours) if blob.area_px >= MIN_AREA_PX]
    largest = sorted(blobs, key=lambda blob: -blob.weight)[:_MAX_COMPARED]
    chosen = (blob for blob in largest if is_candidate(box[0] + blob.box[0], box[1] + blob.box[1], *blob.box[2:]))
    fits = (fit_outline(image, *_cut_out(blob, box), optics, expected_area_px) for blob in islice(chosen, _MAX_BLOBS))
    return [outline for outline in fits if outline]


def threshold(params: MarkerParams, image: Image) -> NDArray[np.uint8]:
    """Return 255 where an RGB image (h, w, 3) has the marker's hue, else 0."""
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    parts = [np.asarray(cv2.inRange(hsv, low, high), dtype=np.uint8) for low, high in params.ranges]
    return parts[0] if len(parts) == 1 else parts[0] | parts[1]


class _Blob(NamedTuple):
    """A contour's box (x, y, width, height), its enclosed area, and that area weighted by roundness."""

    contour: NDArray[Any]
    box: tuple[int, int, int, int]
    area_px: float
    weight: float


def _blob(contour: NDArray[Any]) -> _Blob:
    x, y, w, h = cv2.boundingRect(contour)
    area = cv2.contourArea(contour) + 0.5 * len(contour) + 1  # Pick's theorem: pixels inside and on the contour
    roundness = area / (math.pi / 4 * max(w, h) ** 2)  # share of the circle around its box
    return _Blob(contour, (x, y, w, h), area, area * min(roundness, 1.0) ** 2)


def _cut_out(blob: _Blob, within: Box) -> tuple[Mask, Box]:
    """Return the blob's mask, holes filled, and its box in the image: `_MARGIN_PX` wider than the blob, but inside
    `within`, from whose corner the blob's coordinates count."""
    x, y, w, h = blob.box
    x0, y0, x1, y1 = within
    left = max(x0 + x - _MARGIN_PX, x0)
    top = max(y0 + y - _MARGIN_PX, y0)
    right = min(x0 + x + w + _MARGIN_PX, x1)
    bottom = min(y0 + y + h + _MARGIN_PX, y1)
    mask = np.zeros((bottom - top, right - left), np.uint8)
    cv2.drawContours(mask, [blob.contour], 0, (1,), cv2.FILLED, offset=(x0 - left, y0 - top))
    return mask.view(bool), (left, top, right, bottom)


def moved_markers(params: MarkerParams, camera: CameraFrame, optics: Optics, background: Background) -> list[Outline]:
    """Return the blobs of the marker's hue that differ from the background, are compact and inside the image.

    If there is none, return compact parts of the refused blobs that differ from the background: a marker in front of
    something of its hue.
    """
    height, width = camera.image.shape[:2]
    refused: list[Box] = []
    rests = background.rests(camera.view)
    differs = partial(background.differs, camera.image, camera.view)

    def is_compact(x: int, y: int, w: int, h: int) -> bool:
        return x > 0 and y > 0 and x + w < width and y + h < height and max(w, h) <= _MAX_ELONGATION * min(w, h)

    def has_changed(box: Box) -> bool:
        """Whether a box is foreground, or the background is unknown."""
        return not rests or float(differs(box).mean()) > _CHANGED

    def is_candidate(x: int, y: int, w: int, h: int) -> bool:
        moved = is_compact(x, y, w, h) and has_changed((x, y, x + w, y + h))
        if not moved:
            refused.append((x, y, x + w, y + h))
        return moved

    if camera.outlines is None:
        outlines = find_markers(params, camera.image, optics, is_candidate=is_candidate)
    else:
        outlines = [outline for outline in camera.outlines if is_candidate(*map(round, outline.box_px))]
    if outlines or not refused or not rests:
        return outlines
    return find_markers(params, camera.image, optics, is_candidate=is_compact, differs=differs)


def is_nearer_than_surroundings(
    association: Association, cameras: CameraFrames, view: StereoView, left: Outline, right: Outline
) -> bool:
    """Whether two outlines show an object that is nearer than its surroundings.

    These match the right image much better at some larger distance than at the object's.  Its own pixels do not: else
    it is a patch of its surroundings, and the right outline is another one.
    """
    observation = association.observe(view, left, right, cameras[0].stamp_s)
    if observation is None:
        return False
    x, y, w, h = left.box_px
    around = (int(x - w), int(y - h), int(x + 2 * w) + 1, int(y + 2 * h) + 1)
    box = masks.clipped(around, view.left.camera.width, view.left.camera.height)
    distance_m = math.dist(observation.p_root, view.left.place)
    inverse_distances = np.array([1.0, *np.linspace(_MAX_INVERSE_DISTANCE, 0.05, _DISTANCES)])  # the object's first

    def differences(mask: Mask) -> Array:
        """Mean difference from the right image of the pixels of a mask, by inverse distance."""
        rows, columns = np.nonzero(mask)
        step = len(rows) // _COMPARED_PIXELS + 1
        rows = rows[::step] + box[1]
        columns = columns[::step] + box[0]
        colors = cameras[0].image[rows, columns].astype(np.float32)
        rays = distance_m * view.left.rays(np.stack([columns, rows], axis=-1).astype(float))
        points = (view.left.center + rays / inverse for inverse in inverse_distances)
        return np.array([color_difference(colors, place, cameras[1].image, view.right) for place in points])

    marker = masks.ellipse(box, left.center_px, w, h)
    own, surroundings = differences(marker), differences(~marker)
    farther = 1 + int(surroundings[1:].argmin())
    return bool(surroundings[farther] < _MAX_RATIO * surroundings[0] and own[0] < _MAX_RATIO * own[farther])
