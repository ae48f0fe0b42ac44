"""Acquisition of an object while none is tracked (R Fig 13, left half).

A motion region grows to the whole object, by its colours; what moves in both eyes and has the same colours and size is
the object.  A marker is searched by its hue, and must have moved; before moving eyes the only one need not, if it is
nearer than what surrounds it.
"""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import StereoView, View
from pps_vision.types import Array, Image, Mask
from tracking import masks
from tracking.appearance import ColorModel, color_bins, histogram
from tracking.background import CHANGED, Background
from tracking.background_edge import LEARNED_EDGE
from tracking.ego_motion import Box
from tracking.marker import MarkerParams, find_markers, find_vivid_markers
from tracking.motion_trigger import MotionTrigger, Region2D, TriggerParams
from tracking.optical_flow import Flow2D
from tracking.outline import Optics, Outline, fit_outline
from tracking.stereo import Association, CameraFrame, CameraFrames

OwnBody = Callable[[Array, View], Mask]
"""Joints (rad) and an eye's view → the pixels (H, W) where the robot sees itself."""
Stages = Callable[[Literal["trigger", "image", "triangulation", "filter"]], AbstractContextManager[object]]
Backgrounds = tuple[Background, Background]
Regions = tuple[list[Region2D], list[Region2D]]
SearchCounts = Counter[str]
"""What the search has met so far: "frames" searched, those with "motion_left" and "motion_right", "candidates_left" and
"candidates_right" for an object, and pairs of candidates "rejected by" colour, size, epipolar gate, …"""

# Saturation of each colour bin, squared; the bins without a hue count as a tenth saturated.
_VIVIDNESS = np.concatenate([np.tile((np.arange(10) + 0.5) / 10, 10), np.full(10, 0.1)]).astype(np.float32) ** 2
_SAME_MASK, _MOST = 0.8, 0.6  # overlap from which colours show the object that an eye at rest sees; one that moves
_MOVED = 0.05  # of its area that a moving object covers anew in the trigger's interval: 2 cm/s cover 8 % of 6 cm
_UNCOVERED = 0.3  # of what it covers anew, what it must at least have uncovered before an eye that moves
_ALIKE = 2.0  # ratio of what it covers anew and what it uncovers before an eye at rest, if the background lacks it
_SMOOTHED_PX = 2  # reach of smoothing and closing of what differs
_WITHIN = 0.9  # of a colour's region, what the hull of its change must hold: the rest is something else
_LONG = 2.0  # ratio of a marker's sides
_APART, _RING_POINTS = 1.3, 300  # of its size, from which on its surroundings are compared; so many points of them
_FARTHER, _DISTANCES, _BETTER = 0.8, 16, 0.7  # nearness of these beside the marker's; number; how much better they fit
_DISTINCT = 0.5  # Bhattacharyya coefficient below which colours need no change beside them
_LOW_SATURATION = 0.4  # of the object's mean vividness; a less vivid colour is not the object's but its carrier's


@dataclass(frozen=True)
class AcquisitionParams:
    """What counts as an object, and as the same object in both eyes."""

    margin: float = 1.0
    """Searched around a motion region, relative to its size."""
    max_likeness: float = 0.8
    """Bhattacharyya coefficient of a region's colours and its surroundings', above which nothing stands out."""
    rounds: int = 4
    """At most so often colours and extent are estimated in turn."""
    min_area_px: int = 16
    """Smallest object."""
    min_fill: float = 0.35
    """Least share of its box that an object covers."""
    max_share: float = 0.25
    """Largest share of the image that an object covers."""
    min_likeness: float = 0.7
    """Least Bhattacharyya coefficient of one object's colours in both eyes."""
    max_ratio: float = 1.2
    """Largest ratio of one object's angular radii in both eyes."""
    trigger: TriggerParams = field(default_factory=TriggerParams)
    """Motion trigger of either eye."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """An object that may be tracked, in one image; its evidence is the region's residual, less where its colours are
    the surroundings'."""

    outline: Outline
    model: ColorModel
    evidence: float
    flow: Flow2D | None
    by_color: bool
    """Whether its colours alone separate it from what surrounds it."""
    mask: Mask
    box: Box
    """Region of the image that `mask` (h, w) is of."""
    emerges: bool = False
    """Whether it uncovers nothing: it comes from behind something, and a part of it may still be hidden."""


class Acquisition:
    """Finds a moving object anywhere in both images; `step` takes frames in the order of their stamps."""

    def __init__(
        self,
        params: AcquisitionParams,
        optics: tuple[Optics, Optics],
        own_body: OwnBody | None,
        stages: Stages,
        counts: SearchCounts,
    ) -> None:
        self.params, self.own_body, self.stages, self._counts = params, own_body, stages, counts
        self._optics = optics
        self._triggers = tuple(MotionTrigger(params.trigger, one.camera) for one in optics)

    def step(
        self,
        cameras: CameraFrames,
        view: StereoView,
        stamp_s: float,
        backgrounds: Backgrounds,
        association: Association,
    ) -> tuple[tuple[Candidate, Candidate] | None, Regions]:
        """Return the object in both eyes, if there is one, and the motion regions of each.

        The right image is searched only if something moves in the left one; flow need not confirm it again.
        """
        with self.stages("trigger"):
            left = self._trigger(0, cameras[0], confirm=True)
            right = self._trigger(1, cameras[1], confirm=False) if left else self._remember(1, cameras[1])
        self._counts.update(frames=1, motion_left=bool(left), motion_right=bool(right))
        if not (left and right):
            return None, (left, right)
        with self.stages("image"):
            a, b = (
                self._candidates(eye, camera, regions, backgrounds)
                for eye, (camera, regions) in enumerate(zip(cameras, (left, right), strict=True))
            )
            self._counts.update(candidates_left=len(a), candidates_right=len(b))
            pair = self._best_pair(association, cameras, view, a, b, stamp_s)
        return pair and _with_both_colors(*pair), (left, right)

    def find_marker(
        self,
        marker: MarkerParams,
        cameras: CameraFrames,
        view: StereoView,
        stamp_s: float,
        backgrounds: Backgrounds,
        association: Association,
    ) -> tuple[Outline, Outline] | None:
        """Return the marker anywhere in both images: of the pairs of blobs of its hue that may be one thing, one that
        has moved; before moving eyes also the only one, if it is nearer than what surrounds it: no patch of a wall.
        """
        self._remember(0, cameras[0])
        lefts, rights = (
            _moved_markers(marker, camera, one, background)
            for camera, one, background in zip(cameras, self._optics, backgrounds, strict=True)
        )
        self._counts.update(frames=1, candidates_left=len(lefts), candidates_right=len(rights))
        pairs = []
        for a, b in itertools.product(lefts, rights):
            ratio = a.angular_radius_rad / b.angular_radius_rad
            if max(ratio, 1 / ratio) > self.params.max_ratio:
                self._counts["rejected by size"] += 1
            elif association.observe(view, a, b, stamp_s):
                pairs.append((a, b))
            else:
                self._counts[f"rejected by {association.refusal(view, a, b)}"] += 1
        if pairs and backgrounds[0].is_known(cameras[0].view):
            return pairs[0]
        moving = {id(a): self._moves(a) for a, _ in pairs}
        for a, b in pairs:
            if moving[id(a)] or (len(lefts) == len(rights) == 1 and _stands_out(association, cameras, view, a, b)):
                return a, b
        self._counts.update({"rejected since it did not move": len(pairs)})
        return None

    def _moves(self, one: Outline) -> bool:
        """Whether flow shows that an outline of the left image moves by itself."""
        x, y, w, h = one.box_px
        camera = self._optics[0].camera
        box = max(int(x), 0), max(int(y), 0), min(int(x + w) + 1, camera.width), min(int(y + h) + 1, camera.height)
        return self._triggers[0].moves(masks.ellipse(box, one.center_px, w, h), box)

    def _trigger(self, eye: int, camera: CameraFrame, confirm: bool) -> list[Region2D]:
        own = self._own(camera)
        return self._triggers[eye].step(camera.image, camera.view, camera.stamp_s, own, confirm)

    def _remember(self, eye: int, camera: CameraFrame) -> list[Region2D]:
        self._triggers[eye].remember(camera.image, camera.view, camera.stamp_s, self._own(camera))
        return []

    def _own(self, camera: CameraFrame) -> Callable[[], Mask] | None:
        joints, own_body = camera.joints_rad, self.own_body
        return None if own_body is None or joints is None else lambda: own_body(joints, camera.view)

    def _candidates(
        self, eye: int, camera: CameraFrame, regions: list[Region2D], backgrounds: Backgrounds
    ) -> list[Candidate]:
        then = self._triggers[eye].image_before(camera.view, camera.stamp_s)
        known = then is not None and backgrounds[eye].is_known(camera.view)
        change: Change | ChangeOfMovingEye | None = None
        if then is not None:
            change = Change(backgrounds[eye], camera.view, then, camera.image) if known else None
        elif backgrounds[eye].behind_moving_eye(camera.view, camera.stamp_s) is not None:
            before = partial(self._triggers[eye].seen_before, camera.view, camera.stamp_s)
            change = ChangeOfMovingEye(backgrounds[eye], camera.view, before, camera.image)
        found = (segment(self.params, camera.image, one, self._optics[eye], change) for one in regions)
        parts = [candidate for candidate in found if candidate is not None]
        parts += joined(self.params, camera.image, parts, self._optics[eye])
        if then is None and eye == 0:  # the eye moves: flow tells whether what has a motion region's colours moves too
            parts = [one for one in parts if not one.by_color or self._triggers[eye].moves(one.mask, one.box)]
        return parts

    def _best_pair(
        self,
        association: Association,
        cameras: CameraFrames,
        view: StereoView,
        left: list[Candidate],
        right: list[Candidate],
        stamp_s: float,
    ) -> tuple[Candidate, Candidate] | None:
        """The two candidates that are one object, those with most evidence."""
        best, most = None, 0.0
        for a, b in itertools.product(left, right):
            likeness = a.model.similarity(b.model.object)
            if likeness < self.params.min_likeness:
                self._counts["rejected by colour"] += 1
                continue
            one_whole = self._completed(0, cameras[0], cameras[1], a, b)
            other_whole = self._completed(1, cameras[1], cameras[0], b, a)
            if one_whole is None or other_whole is None:
                self._counts["rejected since half hidden"] += 1
                continue
            pair = one_whole, other_whole
            one, other = pair[0].outline, pair[1].outline
            ratio = one.angular_radius_rad / other.angular_radius_rad
            evidence = likeness * float(np.sqrt(a.evidence * b.evidence))
            if max(ratio, 1 / ratio) > self.params.max_ratio:
                self._counts["rejected by size"] += 1
            elif evidence > most and association.observe(view, one, other, stamp_s):
                best, most = pair, evidence
            elif evidence > most:
                self._counts[f"rejected by {association.refusal(view, one, other)}"] += 1
        return best

    def _completed(
        self, eye: int, camera: CameraFrame, other_camera: CameraFrame, part: Candidate, other: Candidate
    ) -> Candidate | None:
        """A candidate as a disc of the size that the other eye sees, where it is smaller and a part of such a disc;
        None where it emerges and is no such part."""
        if part.emerges and other.emerges:
            return None
        ratio = other.outline.angular_radius_rad / part.outline.angular_radius_rad
        may_be_whole = ratio < (1.0 if part.outline.is_partial or part.emerges else self.params.max_ratio)
        if may_be_whole or not other.outline.is_disc:
            return part if may_be_whole or not part.emerges else None
        baseline = other_camera.view.center - camera.view.center
        sine = _sine(baseline, camera.view.rays(part.outline.center_px))
        nearer = sine / _sine(baseline, other_camera.view.rays(other.outline.center_px))  # by the law of sines
        area_px = part.outline.area_px * (nearer * ratio) ** 2
        whole = fit_outline(camera.image, part.mask, part.box, self._optics[eye], area_px)
        if whole is None:
            return None if part.emerges else part
        return replace(part, outline=whole)


def _moved_markers(params: MarkerParams, camera: CameraFrame, optics: Optics, background: Background) -> list[Outline]:
    """The blobs of the marker's hue, but for those that look like the background, are long, or are cut by the image's
    border: what is seen in part may be of any size."""
    height, width = camera.image.shape[:2]

    def may_be(x: int, y: int, w: int, h: int) -> bool:
        whole = x > 0 and y > 0 and x + w < width and y + h < height
        compact = max(w, h) <= _LONG * min(w, h)
        return whole and compact and background.has_changed(camera.image, camera.view, x, y, w, h)

    if camera.found is None:
        found = find_markers(params, camera.image, optics, is_candidate=may_be)
    else:
        found = [one for one in camera.found if may_be(*(round(value) for value in one.box_px))]
    vivid = find_vivid_markers(params, camera.image, optics, is_candidate=may_be)
    return [one for one in found if not any(_holds(one, other) for other in vivid)] + vivid


def _stands_out(
    association: Association, cameras: CameraFrames, view: StereoView, left: Outline, right: Outline
) -> bool:
    """Whether what surrounds an object in the left image is found in the right one much better at a larger distance
    than at the object's (mean absolute difference)."""
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
    far, here = math.dist(observation.p_root, view.left.place), cameras[0].image[rows, columns].astype(np.float32)
    differences = []
    for nearness in (1.0, *np.linspace(_FARTHER, 0.05, _DISTANCES)):
        there = view.right.project(view.left.center + far / nearness * rays).astype(np.float32)
        seen = cv2.remap(cameras[1].image, there[None], np.empty(0, np.float32), cv2.INTER_LINEAR)[0]
        differences.append(float(np.abs(seen - here).mean()))
    return min(differences[1:]) < _BETTER * differences[0]


def _holds(one: Outline, other: Outline) -> bool:
    """Whether another outline's centre lies in the box of an outline."""
    (x, y, w, h), (u, v) = one.box_px, other.center_px
    return bool(x <= u < x + w and y <= v < y + h)


@dataclass(frozen=True)
class Change:
    """What an eye at rest sees before its background, a moment ago and now."""

    background: Background
    view: View
    then: Image
    now: Image

    @cached_property
    def differs(self) -> Mask:
        """(H, W) the pixels that are not the background now."""
        return self._differs(self.now)

    @cached_property
    def differed(self) -> Mask:
        """(H, W) the same a moment ago."""
        return self._differs(self.then)

    def _differs(self, image: Image) -> Mask:
        return self.background.differs(image, self.view, (0, 0, image.shape[1], image.shape[0]))

    def shows_the_object(self, mask: Mask | None, whole: Mask) -> bool:
        """Whether the mask of a colour is the object of which `whole` moves: nearly all of it, or what something
        holds."""
        if mask is None:
            return False
        overlap = np.count_nonzero(mask & whole) / np.count_nonzero(mask | whole)
        return bool(overlap > _SAME_MASK or masks.solidity(whole) < masks.SOLID)

    def covers(self, mask: Mask, box: Box) -> bool:
        """Whether the mask (h, w) of a colour has changed but for its inside, and holds little else."""
        differs = self.differs[box[1] : box[3], box[0] : box[2]]
        within = np.count_nonzero(_hull(differs, mask) & mask)
        changed = np.count_nonzero(differs & mask)
        return bool(changed >= CHANGED * within and within >= _WITHIN * np.count_nonzero(mask))

    def moving(self, seed: Mask, box: Box) -> Mask | None:
        """(h, w) what has moved onto the seed as a whole: it has uncovered about as much as it covers anew.

        None for an object that still overlaps the place where it rested when the background was learned, and for that
        place.
        """
        x0, y0, x1, y1 = box
        height, width = self.now.shape[:2]
        m = max(x1 - x0, y1 - y0)  # a fast object was so far away
        wide = max(x0 - m, 0), max(y0 - m, 0), min(x1 + m, width), min(y1 + m, height)
        around = np.s_[wide[1] : wide[3], wide[0] : wide[2]]
        mask, gained = self._gained(seed, box)
        if mask is None:
            return None
        lost = np.count_nonzero(self.differed[around] & ~self.differs[around])
        moves = gained > _MOVED * np.count_nonzero(mask) and gained / _ALIKE < lost < _ALIKE * gained
        return mask if moves else None

    def emerging(self, seed: Mask, box: Box) -> Mask | None:
        """(h, w) what has moved onto the seed and need not have uncovered anything, since it comes from behind
        something: a solid thing that is no place that something left.  What comes from beyond the image's border is
        soon seen as a whole."""
        mask, gained = self._gained(seed, box)
        if mask is None or gained <= _MOVED * np.count_nonzero(mask) or masks.solidity(mask) < masks.SOLID:
            return None
        if masks.is_cut(mask, box, self.now) or _meets_border(mask, box, self.now):
            return None
        edge = self.background.learned_edge(self.now, self.view, mask, box)
        return mask if edge is not None and edge < LEARNED_EDGE else None

    def _gained(self, seed: Mask, box: Box) -> tuple[Mask | None, int]:
        """(h, w) what differs about the seed, and how many pixels of it did not."""
        x0, y0, x1, y1 = box
        mask = _connected(self.differs[y0:y1, x0:x1], seed)
        return mask, 0 if mask is None else int(np.count_nonzero(mask & ~self.differed[y0:y1, x0:x1]))


@dataclass(frozen=True)
class ChangeOfMovingEye:
    """The same for an eye that moves: `before` returns a box of its image of a moment ago as seen from where it is now,
    None where there is none."""

    background: Background
    view: View
    before: Callable[[Box], Image | None]
    now: Image

    def shows_the_object(self, mask: Mask | None, whole: Mask) -> bool:
        """Whether the mask of a colour is most of what moves, and not much beside it: its edge is the better one."""
        if mask is None:
            return False
        larger = max(np.count_nonzero(mask), np.count_nonzero(whole))
        return bool(np.count_nonzero(mask & whole) > _MOST * larger)

    def moving(self, seed: Mask, box: Box) -> Mask | None:
        """(h, w) what has moved onto the seed as a whole, as `Change.moving`, and is no place that something left."""
        then, background = self.before(box), self.background.moving
        differs = background.differs(self.now, self.view, box)
        mask = _connected(differs, seed)
        if mask is None or then is None or masks.is_cut(mask, box, self.now):
            return None
        differed = background.differs_in(then, self.view, box)
        gained = np.count_nonzero(mask & ~differed)
        lost = np.count_nonzero(differed & ~differs)
        if (
            not (gained > _MOVED * np.count_nonzero(mask) and lost > _UNCOVERED * gained)
            or masks.solidity(mask) < masks.SOLID
        ):
            return None
        edge = self.background.learned_edge(self.now, self.view, mask, box)
        return None if edge is not None and edge > LEARNED_EDGE else mask


def segment(
    params: AcquisitionParams,
    image: Image,
    region: Region2D,
    optics: Optics,
    change: "Change | ChangeOfMovingEye | None" = None,
) -> Candidate | None:
    """Return the object whose edge or body moved in `region`; None where nothing stands out there.

    Colours show it, or the `change` of an eye against its background.  Several colours that move as one solid
    thing are one object; of what is not solid (an arm that holds something) distinct colours are the object.
    Before eyes at rest what colours show must have changed too, and what has uncovered nothing yet may emerge.
    """
    x, y, w, h = region.box_px
    height, width = image.shape[:2]
    reach = int(params.margin * max(w, h)) + 6
    box = max(x - reach, 0), max(y - reach, 0), min(x + w + reach, width), min(y + h + reach, height)
    crop = np.s_[box[1] : box[3], box[0] : box[2]]
    seed = np.zeros((box[3] - box[1], box[2] - box[0]), bool)
    seed[y - box[1] : y - box[1] + h, x - box[0] : x - box[0] + w] = region.mask
    bins = color_bins(image[crop])
    mask, model = _grow(params, bins, seed)
    if mask is not None and masks.is_cut(mask, box, image):
        mask = model = None
    by_color, emerges = model is not None, False
    if change is not None:
        whole = change.moving(seed, box)
        is_distinct = model is not None and model.similarity(model.background) < _DISTINCT
        if isinstance(change, Change):
            by_color = is_distinct
            if whole is None and not (is_distinct and mask is not None and change.covers(mask, box)):
                whole = change.emerging(seed, box)
                emerges = whole is not None
                if not emerges:
                    return None
        if whole is not None and not (is_distinct and change.shows_the_object(mask, whole)):
            mask, model, by_color = whole, _model(bins, whole), False
        elif mask is not None and isinstance(change, Change) and not change.covers(mask, box):
            return None
    if mask is None or model is None or np.count_nonzero(mask) < params.min_area_px:
        return None
    shape = _object_outline(params, image, mask, box, optics)
    if shape is None:
        return None
    evidence = region.evidence * (1 - model.similarity(model.background) if by_color else 1.0)
    return Candidate(shape, model, evidence, region.flow, by_color, mask, box, emerges)


def joined(params: AcquisitionParams, image: Image, parts: Sequence[Candidate], optics: Optics) -> list[Candidate]:
    """Candidates that touch, as one object of several colours; each comes from a motion region of its own."""
    colored = [one for one in parts if one.by_color]
    if len(colored) < 2:
        return []
    boxes = np.array([one.box for one in colored])
    x0, y0, x1, y1 = box = (*boxes[:, :2].min(axis=0).tolist(), *boxes[:, 2:].max(axis=0).tolist())
    whole = np.zeros((y1 - y0, x1 - x0), bool)
    for one in colored:
        left, top, right, bottom = one.box
        whole[top - y0 : bottom - y0, left - x0 : right - x0] |= one.mask
    _, labels = cv2.connectedComponents(masks.closed(whole, masks.square(1)).view(np.uint8))
    groups: dict[int, list[Candidate]] = {}
    for one in colored:
        row, column = np.argwhere(one.mask)[0] + (one.box[1] - y0, one.box[0] - x0)
        groups.setdefault(int(labels[row, column]), []).append(one)
    bins, found = color_bins(image[y0:y1, x0:x1]), []
    for label, group in groups.items():
        if len(group) < 2:
            continue
        mask = masks.filled(np.asarray(labels == label))
        model, shape = _model(bins, mask), _object_outline(params, image, mask, box, optics)
        likeness = model.similarity(model.background)
        if shape is not None and likeness <= params.max_likeness:
            evidence = sum(one.evidence for one in group)
            flow = next((one.flow for one in group if one.flow is not None), None)
            found.append(Candidate(shape, model, evidence, flow, True, mask, box))
    return found


def _meets_border(mask: Mask, box: Box, image: Image) -> bool:
    """Whether the mask (h, w) of the region `box` reaches the image's border, as far as smoothing lets it."""
    y, x = np.nonzero(mask)
    left, top, right, bottom = box[0] + x.min(), box[1] + y.min(), box[0] + x.max(), box[1] + y.max()
    return bool(min(left, top, image.shape[1] - 1 - right, image.shape[0] - 1 - bottom) <= _SMOOTHED_PX)


def _sine(a: Array, b: Array) -> float:
    """Of the angle between two vectors (3,)."""
    return float(np.linalg.norm(np.cross(a, b)) / np.linalg.norm(a) / np.linalg.norm(b))


def _hull(changed: Mask, touched: Mask) -> Mask:
    """The convex hull of what has changed and touches a mask."""
    _, labels = cv2.connectedComponents(changed.view(np.uint8))
    near = np.isin(labels, np.unique(np.asarray(labels)[touched & changed])) & changed
    contours, _ = cv2.findContours(near.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    whole = np.zeros(changed.shape, np.uint8)
    if contours:
        cv2.fillConvexPoly(whole, cv2.convexHull(np.concatenate(contours)), (1,))
    return whole.view(bool)


def _object_outline(params: AcquisitionParams, image: Image, mask: Mask, box: Box, optics: Optics) -> Outline | None:
    """The mask's outline, unless it is too large or too ragged for an object."""
    shape = fit_outline(image, mask, box, optics)
    if shape is None or shape.area_px > params.max_share * image.shape[0] * image.shape[1]:
        return None
    return shape if shape.area_px >= params.min_fill * shape.box_px[2] * shape.box_px[3] else None


def _grow(params: AcquisitionParams, bins: NDArray[np.uint8], seed: Mask) -> tuple[Mask | None, ColorModel | None]:
    """Estimate colours and extent in turn; background in the seed drops out, because it is around as well."""
    mask: Mask = seed
    for _ in range(params.rounds):
        model = _model(bins, mask)
        if model.similarity(model.background) > params.max_likeness:
            return None, None
        hard: Mask = np.asarray(cv2.GaussianBlur(model.table()[bins], (3, 3), 0)) > 0.5
        grown = _connected(hard, seed, model.backdrop()[bins])
        if grown is None:
            return None, None
        if np.count_nonzero(grown != mask) < 0.02 * np.count_nonzero(grown):
            break
        mask = grown
    return mask, _model(bins, mask)


def _model(bins: NDArray[np.uint8], mask: Mask) -> ColorModel:
    """Colours of the mask, without those of low saturation beside vivid ones, and of what surrounds it."""
    colors = histogram(bins[mask], _VIVIDNESS[bins[mask]])
    colors[_LOW_SATURATION * (colors @ _VIVIDNESS) > _VIVIDNESS] = 0.0
    return ColorModel(colors / colors.sum(), histogram(bins[~masks.dilated(mask, 2)]))


def _connected(hard: Mask, seed: Mask, backdrop: Mask | None = None) -> Mask | None:
    """The component that holds most of the seed, gaps and holes filled."""
    one = masks.component(masks.closed(hard, masks.square(1)), seed)
    return None if one is None else masks.filled(one, backdrop)


def _with_both_colors(a: Candidate, b: Candidate) -> tuple[Candidate, Candidate]:
    """Each with the colours of both: what one eye sees of the object now, the other may see later."""
    seen = 0.5 * (a.model.object + b.model.object)
    return replace(a, model=replace(a.model, object=seen)), replace(b, model=replace(b.model, object=seen))
