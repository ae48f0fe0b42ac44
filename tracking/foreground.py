"""Segments a moving object by background subtraction in the current and in an earlier image of one camera.

A moving object covers background that was visible in the earlier image, and uncovers background that it hid there.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from pps_vision.geometry.camera import View
from pps_vision.types import Image, Mask
from tracking import masks
from tracking.background import CHANGED, Background
from tracking.ego_motion import Box
from tracking.moving_background import LEARNED_EDGE

_SAME_MASK = 0.8  # overlap from which a colour region is the object of a static camera
_MIN_OVERLAP = 0.6  # the same, of a moving camera
_MIN_COVERED = 0.05  # share of a moving object's area covered in the trigger's interval: 2 cm/s cover 8 % of 6 cm
_MIN_UNCOVERED = 0.3  # uncovered to covered area of an object in front of a moving camera, at least
_MAX_AREA_RATIO = 2.0  # of covered and uncovered area in front of a static camera
_SMOOTHED_PX = 2  # reach of the smoothing and closing of the masks
_MIN_ENCLOSED = 0.9  # share of a colour region enclosed by the hull of the foreground


@dataclass(frozen=True)
class StaticForeground:
    """Foreground of a static camera: its background, and its earlier and current images (H, W, 3)."""

    background: Background
    view: View
    earlier: Image
    current: Image

    def confirms(self, colored: Mask, box: Box, is_distinct: bool) -> bool:
        """Whether a colour region (h, w) in `box` may be a moving object.

        Its colour is distinct, the hull of the foreground encloses most of the region, and enough of the enclosed part
        is foreground (the inside of a uniform object need not be).
        """
        if not is_distinct:
            return False
        differs = self._differs[box[1] : box[3], box[0] : box[2]]
        enclosed = np.count_nonzero(_hull(differs, colored) & colored)
        differing = np.count_nonzero(differs & colored)
        return bool(differing >= CHANGED * enclosed and enclosed >= _MIN_ENCLOSED * np.count_nonzero(colored))

    def differs(self, box: Box) -> Mask:
        """Foreground mask (h, w) of a box."""
        return self._differs[box[1] : box[3], box[0] : box[2]]

    def shows_the_object(self, colored: Mask, moved: Mask) -> bool:
        """Whether a colour region (h, w) is the object of the foreground `moved` (h, w): both are nearly equal, or the
        foreground is not solid, such as an arm that holds an object."""
        overlap = np.count_nonzero(colored & moved) / np.count_nonzero(colored | moved)
        return bool(overlap > _SAME_MASK or masks.solidity(moved) < masks.SOLID)

    def moved_mask(self, seed: Mask, box: Box) -> Mask | None:
        """Mask (h, w) of the object that moved as a whole onto the `seed` (h, w) in `box`; None if there is none.

        It has uncovered about the area that it has covered.  None also for an object that overlaps its ghost, and for a
        ghost (the place where it rested when the background was learned).
        """
        x0, y0, x1, y1 = box
        height, width = self.current.shape[:2]
        m = max(x1 - x0, y1 - y0)  # motion of a fast object
        around = np.s_[max(y0 - m, 0) : min(y1 + m, height), max(x0 - m, 0) : min(x1 + m, width)]
        mask, covered = self._covered(seed, box)
        if mask is None:
            return None
        uncovered = np.count_nonzero(self._differed[around] & ~self._differs[around])
        moves = (
            covered > _MIN_COVERED * np.count_nonzero(mask)
            and covered / _MAX_AREA_RATIO < uncovered < _MAX_AREA_RATIO * covered
        )
        return mask if moves else None

    def disoccluded_mask(self, seed: Mask, box: Box) -> Mask | None:
        """Mask (h, w) of an object that appears on the `seed` (h, w) in `box` from behind an occluder; None if there is
        none.

        It need not have uncovered background, but it is solid and no ghost.  An object that enters over the image's
        border is soon visible as a whole: None.
        """
        mask, covered = self._covered(seed, box)
        if mask is None or covered <= _MIN_COVERED * np.count_nonzero(mask) or masks.solidity(mask) < masks.SOLID:
            return None
        if masks.is_cut(mask, box, self.current) or _meets_border(mask, box, self.current):
            return None
        edge = self.background.learned_edge(self.current, self.view, mask, box)
        return mask if edge is not None and edge < LEARNED_EDGE else None

    def _covered(self, seed: Mask, box: Box) -> tuple[Mask | None, int]:
        """Foreground component (h, w) at the seed, and the number of its pixels that were background earlier."""
        x0, y0, x1, y1 = box
        mask = masks.closed_component(self._differs[y0:y1, x0:x1], seed)
        return mask, 0 if mask is None else int(np.count_nonzero(mask & ~self._differed[y0:y1, x0:x1]))

    @cached_property
    def _differs(self) -> Mask:
        """Foreground (H, W) of the current image."""
        return self.background.differs(self.current, self.view, (0, 0, self.current.shape[1], self.current.shape[0]))

    @cached_property
    def _differed(self) -> Mask:
        """Foreground (H, W) of the earlier image."""
        return self.background.differs(self.earlier, self.view, (0, 0, self.earlier.shape[1], self.earlier.shape[0]))


@dataclass(frozen=True)
class MovingForeground:
    """Foreground of a moving camera: its background and current image (H, W, 3); `warp_earlier` returns a box of the
    earlier image warped to `view` (None where there is none)."""

    background: Background
    view: View
    warp_earlier: Callable[[Box], Image | None]
    current: Image

    def confirms(self, colored: Mask, box: Box, is_distinct: bool) -> bool:
        """True: in front of a moving camera optical flow confirms colour regions."""
        return True

    def differs(self, box: Box) -> Mask:
        """Foreground mask (h, w) of a box."""
        return self.background.moving.differs(self.current, self.view, box)

    def shows_the_object(self, colored: Mask, moved: Mask) -> bool:
        """Whether a colour region (h, w) and the foreground `moved` (h, w) largely overlap: the colour's edge is more
        accurate."""
        larger = max(np.count_nonzero(colored), np.count_nonzero(moved))
        return bool(np.count_nonzero(colored & moved) > _MIN_OVERLAP * larger)

    def moved_mask(self, seed: Mask, box: Box) -> Mask | None:
        """Mask (h, w) of a solid object that has covered and uncovered background and is no ghost; None if there is
        none."""
        earlier = self.warp_earlier(box)
        background = self.background.moving
        differs = background.differs(self.current, self.view, box)
        mask = masks.closed_component(differs, seed)
        if mask is None or earlier is None or masks.is_cut(mask, box, self.current):
            return None
        differed = background.differs_in(earlier, self.view, box)
        covered = np.count_nonzero(mask & ~differed)
        uncovered = np.count_nonzero(differed & ~differs)
        moves = covered > _MIN_COVERED * np.count_nonzero(mask) and uncovered > _MIN_UNCOVERED * covered
        if not moves or masks.solidity(mask) < masks.SOLID:
            return None
        edge = self.background.learned_edge(self.current, self.view, mask, box)
        return None if edge is not None and edge > LEARNED_EDGE else mask

    def disoccluded_mask(self, seed: Mask, box: Box) -> Mask | None:
        """None: only a static camera detects a disocclusion."""
        return None


Foreground = StaticForeground | MovingForeground


def _meets_border(mask: Mask, box: Box, image: Image) -> bool:
    """Whether a mask (h, w) of the region `box` reaches the image's border, within the reach of smoothing."""
    y, x = np.nonzero(mask)
    from_top_left = min(box[0] + x.min(), box[1] + y.min())
    from_bottom_right = min(image.shape[1] - 1 - box[0] - x.max(), image.shape[0] - 1 - box[1] - y.max())
    return bool(min(from_top_left, from_bottom_right) <= _SMOOTHED_PX)


def _hull(changed: Mask, touched: Mask) -> Mask:
    """(h, w) the convex hull of the components of `changed` (h, w) that touch another mask (h, w)."""
    _, labels = cv2.connectedComponents(changed.view(np.uint8))
    near = np.isin(labels, np.unique(np.asarray(labels)[touched & changed])) & changed
    contours, _ = cv2.findContours(near.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    whole = np.zeros(changed.shape, np.uint8)
    if contours:
        cv2.fillConvexPoly(whole, cv2.convexHull(np.concatenate(contours)), (1,))
    return whole.view(bool)
