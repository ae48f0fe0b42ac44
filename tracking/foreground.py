"""What has moved before the background of one eye: what differs from it now, and where that was a moment ago.

A moving object covers background that was in view a moment ago, and uncovers some that it hid.
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
from tracking.background_edge import LEARNED_EDGE
from tracking.ego_motion import Box

_SAME_MASK, _MOST = 0.8, 0.6  # overlap from which colours show the object that an eye at rest sees; one that moves
_MOVED = 0.05  # of its area that a moving object covers anew in the trigger's interval: 2 cm/s cover 8 % of 6 cm
_UNCOVERED = 0.3  # of what it covers anew, what it must at least have uncovered before an eye that moves
_ALIKE = 2.0  # ratio of what it covers anew and what it uncovers before an eye at rest, if the background lacks it
_SMOOTHED_PX = 2  # reach of smoothing and closing of what differs
_WITHIN = 0.9  # of a colour's region, what the hull of its change must hold: the rest is something else


@dataclass(frozen=True)
class StaticForeground:
    """An eye at rest: its background, and its images (H, W, 3) of a moment ago and of now."""

    background: Background
    view: View
    then: Image
    now: Image

    def confirms(self, colored: Mask, box: Box, is_distinct: bool) -> bool:
        """Whether a region of one colour (h, w), in `box`, may be a moving object: its colour is distinct, what differs
        from the background encloses nearly all of it, and enough of that differs (a plain object's inside need not)."""
        if not is_distinct:
            return False
        differs = self._differs[box[1] : box[3], box[0] : box[2]]
        enclosed = np.count_nonzero(_hull(differs, colored) & colored)
        differing = np.count_nonzero(differs & colored)
        return bool(differing >= CHANGED * enclosed and enclosed >= _WITHIN * np.count_nonzero(colored))

    def shows_the_object(self, colored: Mask, moved: Mask) -> bool:
        """Whether a region of one colour (h, w) is the object that has `moved` (h, w): nearly all of it, or a part of
        what is not solid, such as an arm that holds something."""
        overlap = np.count_nonzero(colored & moved) / np.count_nonzero(colored | moved)
        return bool(overlap > _SAME_MASK or masks.solidity(moved) < masks.SOLID)

    def moved_mask(self, seed: Mask, box: Box) -> Mask | None:
        """(h, w) the object that has moved as a whole onto the `seed` (h, w) in `box`; None if there is none.

        It has uncovered about as much as it has covered.  None also for an object that still overlaps the place where
        it rested when the background was learned, and for that place.
        """
        x0, y0, x1, y1 = box
        height, width = self.now.shape[:2]
        m = max(x1 - x0, y1 - y0)  # a fast object was so far away
        around = np.s_[max(y0 - m, 0) : min(y1 + m, height), max(x0 - m, 0) : min(x1 + m, width)]
        mask, covered = self._covered(seed, box)
        if mask is None:
            return None
        uncovered = np.count_nonzero(self._differed[around] & ~self._differs[around])
        moves = covered > _MOVED * np.count_nonzero(mask) and covered / _ALIKE < uncovered < _ALIKE * covered
        return mask if moves else None

    def disoccluded_mask(self, seed: Mask, box: Box) -> Mask | None:
        """(h, w) the object that has come onto the `seed` (h, w) in `box` from behind something; None if there is none.

        It need not have uncovered anything, but is solid, and no place that something has left.  What comes from beyond
        the image's border is soon seen as a whole, and none.
        """
        mask, covered = self._covered(seed, box)
        if mask is None or covered <= _MOVED * np.count_nonzero(mask) or masks.solidity(mask) < masks.SOLID:
            return None
        if masks.is_cut(mask, box, self.now) or _meets_border(mask, box, self.now):
            return None
        edge = self.background.learned_edge(self.now, self.view, mask, box)
        return mask if edge is not None and edge < LEARNED_EDGE else None

    def _covered(self, seed: Mask, box: Box) -> tuple[Mask | None, int]:
        """(h, w) what differs about the seed, and how many pixels of it did not a moment ago."""
        x0, y0, x1, y1 = box
        mask = masks.closed_component(self._differs[y0:y1, x0:x1], seed)
        return mask, 0 if mask is None else int(np.count_nonzero(mask & ~self._differed[y0:y1, x0:x1]))

    @cached_property
    def _differs(self) -> Mask:
        """(H, W) the pixels that differ from the background now."""
        return self.background.differs(self.now, self.view, (0, 0, self.now.shape[1], self.now.shape[0]))

    @cached_property
    def _differed(self) -> Mask:
        """(H, W) those that did a moment ago."""
        return self.background.differs(self.then, self.view, (0, 0, self.then.shape[1], self.then.shape[0]))


@dataclass(frozen=True)
class MovingForeground:
    """An eye that moves: its backgrounds, its image (H, W, 3) of now, and `before`, which returns a box of its image of
    a moment ago as seen from `view`, None where there is none."""

    background: Background
    view: View
    before: Callable[[Box], Image | None]
    now: Image

    def confirms(self, colored: Mask, box: Box, is_distinct: bool) -> bool:
        """True: optical flow confirms colours before moving eyes."""
        return True

    def shows_the_object(self, colored: Mask, moved: Mask) -> bool:
        """Whether a region of one colour (h, w) is most of what has `moved` (h, w), and not much beside it: its edge is
        the better one."""
        larger = max(np.count_nonzero(colored), np.count_nonzero(moved))
        return bool(np.count_nonzero(colored & moved) > _MOST * larger)

    def moved_mask(self, seed: Mask, box: Box) -> Mask | None:
        """As of a resting eye: a solid object that has covered and uncovered something, and is no place that something
        has left."""
        then, background = self.before(box), self.background.moving
        differs = background.differs(self.now, self.view, box)
        mask = masks.closed_component(differs, seed)
        if mask is None or then is None or masks.is_cut(mask, box, self.now):
            return None
        differed = background.differs_in(then, self.view, box)
        covered, uncovered = np.count_nonzero(mask & ~differed), np.count_nonzero(differed & ~differs)
        moves = covered > _MOVED * np.count_nonzero(mask) and uncovered > _UNCOVERED * covered
        if not moves or masks.solidity(mask) < masks.SOLID:
            return None
        edge = self.background.learned_edge(self.now, self.view, mask, box)
        return None if edge is not None and edge > LEARNED_EDGE else mask

    def disoccluded_mask(self, seed: Mask, box: Box) -> Mask | None:
        """None: what is_partly_occluded shows only to an eye at rest."""
        return None


Change = StaticForeground | MovingForeground


def _meets_border(mask: Mask, box: Box, image: Image) -> bool:
    """Whether a mask (h, w) of the region `box` reaches the image's border, as far as smoothing lets it."""
    y, x = np.nonzero(mask)
    left, top, right, bottom = box[0] + x.min(), box[1] + y.min(), box[0] + x.max(), box[1] + y.max()
    return bool(min(left, top, image.shape[1] - 1 - right, image.shape[0] - 1 - bottom) <= _SMOOTHED_PX)


def _hull(changed: Mask, touched: Mask) -> Mask:
    """(h, w) the convex hull of the components of `changed` (h, w) that touch another mask (h, w)."""
    _, labels = cv2.connectedComponents(changed.view(np.uint8))
    near = np.isin(labels, np.unique(np.asarray(labels)[touched & changed])) & changed
    contours, _ = cv2.findContours(near.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    whole = np.zeros(changed.shape, np.uint8)
    if contours:
        cv2.fillConvexPoly(whole, cv2.convexHull(np.concatenate(contours)), (1,))
    return whole.view(bool)
