"""Acquisition of an object while none is tracked (R Fig 13, left half).

A motion region grows to the whole object by its colours.  Candidates of both images with the same colours and size are
one object.  A marker is detected by its hue.
"""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry import masks
from pps_vision.geometry.camera import StereoView
from pps_vision.geometry.masks import Box, BoxPx
from pps_vision.jit import njit
from pps_vision.types import Array, Image, Mask
from tracking.appearance import N_BINS, SEPARABLE, ColorModel, color_bins, histogram
from tracking.camera_pose import OwnBody
from tracking.foreground import HIDING, SOLID, Background, Foreground, foreground_around
from tracking.marker import MarkerParams, is_nearer_than_surroundings, moved_markers
from tracking.motion_trigger import MotionTrigger, Region2D, TriggerParams
from tracking.outline import Optics, Outline, fit_outline, fit_visible_disc
from tracking.stereo import Association, CameraFrame, CameraFrames

Stages = Callable[[Literal["trigger", "image", "triangulation", "filter"]], AbstractContextManager[object]]
Backgrounds = tuple[Background, Background]
FollowedBoxes = tuple[Sequence[BoxPx], Sequence[BoxPx]]  # of objects in the left and the right image
SearchCounts = Counter[str]
"""Statistics of the search: "frames" searched, those with "motion_left" and "motion_right", numbers of
"candidates_left" and "candidates_right", and pairs of candidates "rejected by" colour, size, epipolar gate, …"""

# Squared saturation of each colour bin; 0.1 for the bins without a hue.
_VIVIDNESS = np.concatenate([np.tile((np.arange(10) + 0.5) / 10, 10), np.full(10, 0.1)]).astype(np.float32) ** 2
_VIVID = 6  # tenth of the saturation from which a colour is vivid
_AROUND_PX = 6  # around a motion region whose vivid parts are sought
_WHOLE_PART = 0.8  # share of the moving region from which a part is the whole
_RIM_PX = 1.0  # distance of a part's edge from the circle around it
_RIM = 0.04  # the same, relative to the radius
_SECTORS = 36  # around the circle
_MIN_RIM = 0.5  # of them, in which the edge lies on the circle
_MIN_HIDDEN_RIM = 0.35  # the same where something may hide a part
_MOST_HIDDEN = 0.75  # largest radius of the circle, relative to the visible part
_TRIPLES = 24  # from which circles are drawn
_MARGIN = 1.0  # around a motion region, relative to its size
_ROUNDS = 4  # largest number of alternating estimates of colours and mask
_GROWN_PX = 10_000  # pixels that grow to an object
_MIN_AREA_PX = 16  # area of an object
_MIN_LIKENESS = 0.7  # Bhattacharyya coefficient of an object's colours in both images
_MAX_RATIO = 1.2  # largest ratio of an object's radii (m) in both images
_SAME_SIDE = math.acos(0.7)  # angle between both cameras' axes, beyond which borders cut off different parts
_ALIGNED_PX = 1.0  # standard deviation of the centre of an aligned silhouette
_LOW_SATURATION = 0.4  # share of the object's mean squared saturation below which a colour is the surroundings'


@dataclass(frozen=True, slots=True)
class Candidate:
    """Possible object in one image.

    Its evidence is the residual of its motion region; if it was segmented by colour, times 1 − the Bhattacharyya
    coefficient of its colours and its surroundings'.
    """

    outline: Outline
    model: ColorModel
    evidence: float
    by_color: bool  # whether its colours alone separate it from its surroundings
    mask: Mask
    box: Box  # region of the image of `mask` (h, w)
    is_partly_occluded: bool = False  # whether it appears from behind an occluder, possibly still partly hidden
    is_part: bool = False  # whether it is a vivid part of a moving region, such as an object in a hand
    silhouette: tuple[Mask, Box] | None = None  # the whole object's, where the image's border cuts `mask` off

    @property
    def is_cut(self) -> bool:
        """Whether a part of the object is beyond the image's border, and its outline does not tell how much."""
        return self.outline.is_cut and not self.outline.is_edge


class Acquisition:
    """Finds a moving object anywhere in both images; `step` takes frames in the order of their stamps."""

    def __init__(
        self,
        trigger: TriggerParams,
        optics: tuple[Optics, Optics],
        backgrounds: Backgrounds,
        own_body: OwnBody | None,
        stages: Stages,
        counts: SearchCounts,
    ) -> None:
        self.own_body = own_body
        self.stages = stages
        self._counts = counts
        self._optics = optics
        self._backgrounds = backgrounds
        self._triggers = tuple(MotionTrigger(trigger, side.camera) for side in optics)

    def step(
        self,
        cameras: CameraFrames,
        view: StereoView,
        association: Association,
        followed: FollowedBoxes = ((), ()),
    ) -> tuple[Candidate, Candidate] | None:
        """An object in both images beside the `followed` ones, or None.

        The right image is searched only if the left one shows motion; flow need not confirm it again.
        """
        with self.stages("trigger"):
            left = self._trigger(0, cameras[0], followed[0], confirm=True)
            if left:
                right = self._trigger(1, cameras[1], followed[1], confirm=False)
            else:
                right = self._remember(1, cameras[1], followed[1])
        self._counts.update(frames=1, motion_left=int(bool(left)), motion_right=int(bool(right)))
        if not (left and right):
            return None
        with self.stages("image"):
            a, b = (
                self._candidates(eye, camera, regions)
                for eye, (camera, regions) in enumerate(zip(cameras, (left, right), strict=True))
            )
            self._counts.update(candidates_left=len(a), candidates_right=len(b))
            return self._best_pair(association, cameras, view, a, b)

    def remember(self, cameras: CameraFrames, followed: FollowedBoxes) -> None:
        """Keep both images for later comparisons, without a search."""
        for eye, camera in enumerate(cameras):
            self._remember(eye, camera, followed[eye])

    def find_marker(
        self, marker: MarkerParams, cameras: CameraFrames, view: StereoView, association: Association
    ) -> tuple[Outline, Outline] | None:
        """The marker in both images, or None.

        Of the consistent pairs of blobs of its hue, the first that has moved (in both images if the cameras move), or
        with moving cameras the only one that is nearer than its surroundings (not a patch of a wall).  If there is
        none, the same with parts of the range of its colours: it may be before something of its hue.
        """
        self.remember(cameras, ((), ()))
        self._counts.update(frames=1)
        counts = self._counts  # only over the whole range of colours
        for part in marker.narrowed():
            pairs = self._marker_pairs(part, cameras, view, association, counts)
            if pairs and self._backgrounds[0].rests(cameras[0].view):
                return pairs[0]
            for a, b in pairs:
                if self._moves(0, a) and self._moves(1, b):
                    return a, b
            nearer = [pair for pair in pairs if is_nearer_than_surroundings(association, cameras, view, *pair)]
            if len(nearer) == 1:
                return nearer[0]
            counts.update({"rejected since it did not move": len(pairs)})
            counts = Counter()
            cameras = cameras[0]._replace(outlines=None), cameras[1]._replace(outlines=None)  # in the whole range too
        return None

    def _marker_pairs(
        self,
        marker: MarkerParams,
        cameras: CameraFrames,
        view: StereoView,
        association: Association,
        counts: SearchCounts,
    ) -> list[tuple[Outline, Outline]]:
        """The consistent pairs of blobs of a marker's hue."""
        lefts, rights = (
            moved_markers(marker, camera, optics, background)
            for camera, optics, background in zip(cameras, self._optics, self._backgrounds, strict=True)
        )
        counts.update(candidates_left=len(lefts), candidates_right=len(rights))
        pairs = []
        for a, b in itertools.product(lefts, rights):
            if reason := association.refusal(view, a, b, _MAX_RATIO):
                counts[f"rejected by {reason}"] += 1
            else:
                pairs.append((a, b))
        return pairs

    def _moves(self, eye: int, outline: Outline) -> bool:
        """Whether the optical flow of a camera's last image shows that an outline moves relative to the scene."""
        x, y, w, h = outline.box_px
        camera = self._optics[eye].camera
        box = masks.clipped((int(x), int(y), int(x + w) + 1, int(y + h) + 1), camera.width, camera.height)
        return self._triggers[eye].moves(masks.ellipse(box, outline.center_px, w, h), box)

    def _trigger(self, eye: int, camera: CameraFrame, followed: Sequence[BoxPx], confirm: bool) -> list[Region2D]:
        own = self._own(camera)
        return self._triggers[eye].step(camera.image, camera.view, camera.stamp_s, own, confirm, followed)

    def _remember(self, eye: int, camera: CameraFrame, followed: Sequence[BoxPx]) -> list[Region2D]:
        self._triggers[eye].remember(camera.image, camera.view, camera.stamp_s, self._own(camera), followed)
        return []

    def _own(self, camera: CameraFrame) -> Callable[[], Mask] | None:
        joints = camera.joints_rad
        own_body = self.own_body
        return None if own_body is None or joints is None else lambda: own_body(joints, camera.view)

    def _candidates(self, eye: int, camera: CameraFrame, regions: list[Region2D]) -> list[Candidate]:
        """Candidates of one camera's motion regions."""
        background = self._backgrounds[eye]
        trigger = self._triggers[eye]
        foreground = None
        if background.is_known:
            foreground = Foreground(background, camera.image, camera.view, trigger.before(camera.stamp_s))
        candidates = []
        for region in regions:
            whole = segment(camera.image, region, self._optics[eye], foreground)
            if whole is not None:
                whole = _completed(camera.image, whole, self._optics[eye], foreground)
                candidates.append(whole)
            is_ragged = whole is None or whole.outline.is_partial or masks.solidity(whole.mask) < SOLID
            if is_ragged and not (whole and whole.by_color and not whole.is_cut):
                candidates += vivid_parts(camera.image, region, self._optics[eye], foreground)
        if eye == 0 and not background.rests(camera.view):  # flow confirms that a colour region moves by itself
            candidates = [a for a in candidates if not a.by_color or trigger.moves(a.mask, a.box)]
        return candidates

    def _best_pair(
        self,
        association: Association,
        cameras: CameraFrames,
        view: StereoView,
        left: list[Candidate],
        right: list[Candidate],
    ) -> tuple[Candidate, Candidate] | None:
        """The consistent pair of candidates with most evidence, or None."""
        best = None
        best_rank = (False, 0.0)
        on_one_side = view.axes_angle_rad < _SAME_SIDE
        for a, b in itertools.product(left, right):
            likeness = a.model.similarity(b.model.object)
            if likeness < _MIN_LIKENESS:
                self._counts["rejected by colour"] += 1
                continue
            whole_a = self._whole(0, cameras, a, b)
            whole_b = self._whole(1, cameras, b, a)
            neither_is_whole = a.is_partly_occluded and b.is_partly_occluded
            if not (whole_a and whole_b) or neither_is_whole or not _is_cut_alike(whole_a, whole_b, on_one_side):
                self._counts["rejected since half hidden"] += 1
                continue
            outlines = whole_a.outline, whole_b.outline
            rank = a.is_part and b.is_part, likeness * float(np.sqrt(a.evidence * b.evidence))
            if rank <= best_rank:
                continue
            if reason := association.refusal(view, *outlines, _MAX_RATIO):
                self._counts[f"rejected by {reason}"] += 1
            else:
                best = whole_a, whole_b
                best_rank = rank
        return best

    def _whole(self, eye: int, cameras: CameraFrames, candidate: Candidate, partner: Candidate) -> Candidate | None:
        """The candidate with the outline of the whole object, if the other image shows more of it: a disc of that size,
        or the silhouette in the other image, where the image's border cuts it off; None if it is partly occluded."""
        own = None if candidate.is_partly_occluded else candidate
        view, other_view = cameras[eye].view, cameras[1 - eye].view
        baseline = other_view.center - view.center
        sine = _sine(baseline, view.rays(candidate.outline.center_px))
        nearer = sine / _sine(baseline, other_view.rays(partner.outline.center_px))  # by the law of sines
        ratio = nearer * partner.outline.angular_radius_rad / candidate.outline.angular_radius_rad
        # a vivid part has the size of the circle along its edge
        is_size_known = candidate.is_part or not (candidate.outline.is_partial or candidate.is_partly_occluded)
        if ratio < (_MAX_RATIO if is_size_known else 1.0):
            return candidate
        if not partner.outline.is_disc:
            is_cut = candidate.outline.is_cut and not partner.outline.is_partial
            return _aligned(candidate, partner, self._optics[eye]) if is_cut else own
        area_px = candidate.outline.area_px * ratio**2
        image = cameras[eye].image
        outline = fit_outline(image, candidate.mask, candidate.box, self._optics[eye], area_px)
        return own if outline is None else replace(candidate, outline=outline)


def _is_cut_alike(a: Candidate, b: Candidate, on_one_side: bool) -> bool:
    """Whether the border does not cut off both, or cuts off the same part in both images: of cameras that look to one
    side, the rest has about one size."""
    if not (a.is_cut and b.is_cut):
        return True
    ratio = a.outline.angular_radius_rad / b.outline.angular_radius_rad
    return on_one_side and 1 / _MAX_RATIO <= ratio <= _MAX_RATIO


def _aligned(candidate: Candidate, partner: Candidate, optics: Optics) -> Candidate:
    """A candidate that the image's border cuts off, as a whole: its partner's silhouette where it covers most of the
    candidate and least of the rest of the image."""
    x, y, w, h = cv2.boundingRect(partner.mask.view(np.uint8))
    silhouette = partner.mask[y : y + h, x : x + w]
    camera = optics.camera
    evidence = np.zeros((camera.height + 2 * h, camera.width + 2 * w), np.float32)
    evidence[h:-h, w:-w] = -1
    x0, y0, x1, y1 = candidate.box
    evidence[h + y0 : h + y1, w + x0 : w + x1][candidate.mask] = 1
    overlap = cv2.matchTemplate(evidence, silhouette.astype(np.float32), cv2.TM_CCORR)
    left, top = cv2.minMaxLoc(overlap)[3]
    box = left - w, top - h, left, top
    shift_px = np.array([box[0] - partner.box[0] - x, box[1] - partner.box[1] - y])
    sides = partner.outline.box_px[2:]
    outline = replace(
        partner.outline,
        center_px=partner.outline.center_px + shift_px,
        cov_px=_ALIGNED_PX**2 * np.eye(2),
        box_px=(float(box[0]), float(box[1]), *sides),
        is_partial=True,
        is_cut=True,
        is_edge=True,
    )
    return replace(candidate, outline=outline, silhouette=(silhouette, box))


def segment(image: Image, region: Region2D, optics: Optics, foreground: Foreground | None = None) -> Candidate | None:
    """Candidate of a motion region; None where no object stands out.

    It is segmented by its colours or by the `foreground`.  Several colours that move as one solid region are one
    object; if the region is not solid (an arm that holds an object), the distinct colours are the object.
    """
    x, y, w, h = region.box_px
    height, width = image.shape[:2]
    reach = int(_MARGIN * max(w, h)) + 6
    box = max(x - reach, 0), max(y - reach, 0), min(x + w + reach, width), min(y + h + reach, height)
    crop = np.s_[box[1] : box[3], box[0] : box[2]]
    seed = np.zeros((box[3] - box[1], box[2] - box[0]), bool)
    seed[y - box[1] : y - box[1] + h, x - box[0] : x - box[0] + w] = region.mask
    bins = color_bins(image[crop])
    mask, model = _grow(bins, seed)
    if mask is not None and masks.is_cut(mask, box, image):
        mask = model = None
    by_color = model is not None
    is_partly_occluded = False
    if foreground is not None:
        by_color = mask is not None and foreground.confirms(mask, box)
        moved, is_partial = foreground.moved_mask(seed, box) or (None, False)
        if is_partial and by_color:
            moved = None
        is_partly_occluded = moved is not None and is_partial
        if moved is not None and not (mask is not None and foreground.shows_the_object(mask, moved)):
            mask, by_color = moved, False
            model = ColorModel(histogram(bins, moved), histogram(bins, ~masks.dilated(moved, 2)))
        elif not by_color:
            return None
    if mask is None or model is None or np.count_nonzero(mask) < _MIN_AREA_PX:
        return None
    shape = fit_outline(image, mask, box, optics)
    if shape is None:
        return None
    evidence = region.evidence * (1 - model.similarity(model.background) if by_color else 1.0)
    return Candidate(shape, model, evidence, by_color, mask, box, is_partly_occluded)


def vivid_parts(
    image: Image, region: Region2D, optics: Optics, foreground: Foreground | None = None
) -> list[Candidate]:
    """Candidates of the vivid colours of a motion region: an object in a hand is one.

    A part behind fingers is taken for a disc if enough of its edge lies on the circle around it.
    """
    x, y, w, h = region.box_px
    height, width = image.shape[:2]
    around = x - _AROUND_PX, y - _AROUND_PX, x + w + _AROUND_PX, y + h + _AROUND_PX
    box = masks.clipped(around, width, height)
    bins = color_bins(image[box[1] : box[3], box[0] : box[2]])
    changed = np.zeros(bins.shape, bool)
    changed[y - box[1] : y - box[1] + h, x - box[0] : x - box[0] + w] = region.mask
    if foreground is not None:
        changed = foreground.differs(box) & masks.dilated(changed, max(w, h) // 4)
    of_bin = np.bincount(bins[changed], minlength=N_BINS)[:100].reshape(10, 10)[:, _VIVID:].sum(axis=1)
    hues = np.flatnonzero(of_bin >= _MIN_AREA_PX)
    seed = changed
    if foreground is not None and len(hues):
        _, ghost = foreground.background.own_and_ghost(image, foreground.view, changed, box)
        seed = changed & ~ghost
    candidates = []
    for group in _adjacent(hues.tolist()):
        table = np.zeros(256, bool)
        for hue in group:
            table[10 * hue + _VIVID : 10 * hue + 10] = True
        mask, model = _grow(bins, table[bins] & seed)
        if mask is None or model is None or np.count_nonzero(mask & changed) > _WHOLE_PART * np.count_nonzero(changed):
            continue
        if outline := _disc_around(image, mask, changed, box, optics):
            evidence = region.evidence * (1 - model.similarity(model.background))
            candidates.append(Candidate(outline, model, evidence, True, mask, box, is_part=True))
    return candidates


def _completed(image: Image, candidate: Candidate, optics: Optics, foreground: Foreground | None) -> Candidate:
    """The candidate, as a part of a disc if most of its edge lies on a circle."""
    if not candidate.by_color or candidate.outline.is_partial:
        return candidate
    changed = np.zeros(candidate.mask.shape, bool) if foreground is None else foreground.covers(candidate.box)
    outline = _disc_around(image, candidate.mask, changed, candidate.box, optics)
    if outline is None or not outline.is_partial:
        return candidate
    return replace(candidate, outline=outline, is_part=True)


def _adjacent(hues: list[int]) -> list[list[int]]:
    """Groups of neighbouring hues on the circle of ten."""
    groups: list[list[int]] = []
    for hue in hues:
        if groups and groups[-1][-1] == hue - 1:
            groups[-1].append(hue)
        else:
            groups.append([hue])
    if len(groups) > 1 and groups[0][0] == 0 and groups[-1][-1] == 9:
        groups[0] += groups.pop()
    return groups


def _disc_around(image: Image, mask: Mask, changed: Mask, box: Box, optics: Optics) -> Outline | None:
    """Outline of a part: its own if it is a disc, else that of a disc on which enough of its edge lies; less if it lies
    beside foreground, a mask `changed` (h, w), which may hide the rest."""
    outline = fit_outline(image, mask, box, optics)
    if outline is None or outline.is_partial:
        return None
    is_hidden = foreground_around(mask, changed) > HIDING
    if outline.is_disc and not is_hidden:
        return outline
    circle = _circle_along(mask, _MIN_HIDDEN_RIM if is_hidden else _MIN_RIM)
    if circle is None:
        return None
    evidence = np.where(mask, np.float32(1), np.float32(-1))
    region = evidence, np.zeros(mask.shape, bool), box
    return fit_visible_disc(image, *region, outline, (np.add(circle[:2], box[:2]), circle[2]))


def _circle_along(mask: Mask, min_rim: float) -> tuple[float, float, float] | None:
    """Centre x, y and radius (px) of the circle through most of a mask's edge, with the rest inside; None if there is
    none."""
    contour = masks.contour(mask).astype(float)
    x, y, radius = _best_circle(contour, _MOST_HIDDEN * float(np.ptp(contour, axis=0).max()))
    off = contour - (x, y)
    is_on_circle = np.abs(np.hypot(*off.T) - radius) < max(_RIM_PX, _RIM * radius)
    sectors = (_SECTORS * np.arctan2(*off[is_on_circle].T) / (2 * np.pi)).astype(int)
    is_round = radius > 0 and len(np.unique(sectors)) >= min_rim * _SECTORS
    return (x, y, radius + 0.5) if is_round else None  # the contour's pixels lie inside


@njit(cache=True, error_model="numpy")
def _best_circle(contour: Array, largest: float) -> tuple[float, float, float]:
    """Centre and radius, at most `largest`, of the circle through three points of a contour (n, 2) with most votes: the
    points on it, minus three for each point outside."""
    n = len(contour)
    most = 0
    best = (0.0, 0.0, 0.0)
    for first in range(0, n, max(n // _TRIPLES, 1)):
        for apart in (n // 10, n // 6, n // 3):
            x0, y0 = contour[first]
            x1, y1 = contour[(first + apart) % n] - contour[first]
            x2, y2 = contour[(first + 2 * apart) % n] - contour[first]
            twice_area = 2 * (x1 * y2 - x2 * y1)
            if abs(twice_area) < 1.0:
                continue
            u = (y2 * (x1**2 + y1**2) - y1 * (x2**2 + y2**2)) / twice_area
            v = (x1 * (x2**2 + y2**2) - x2 * (x1**2 + y1**2)) / twice_area
            radius = math.hypot(u, v)
            if radius > largest:
                continue
            tolerance = max(_RIM_PX, _RIM * radius)
            votes = 0
            for i in range(n):
                off = math.hypot(contour[i, 0] - x0 - u, contour[i, 1] - y0 - v) - radius
                votes += 1 if abs(off) < tolerance else -3 if off > 2 * tolerance else 0
            if votes > most:
                most = votes
                best = (x0 + u, y0 + v, radius)
    return best


def _sine(a: Array, b: Array) -> float:
    """Sine of the angle between two vectors (3,)."""
    return float(np.linalg.norm(np.cross(a, b)) / np.linalg.norm(a) / np.linalg.norm(b))


def _grow(bins: NDArray[np.uint8], seed: Mask) -> tuple[Mask | None, ColorModel | None]:
    """Mask (h, w) and colours of the object at a seed (h, w), from colour bins (h, w); None where no object stands out.

    Mask and colours are estimated alternately, in a large region from some of its pixels. Background in the seed drops
    out, as it surrounds the seed as well.
    """
    step = max(int(math.sqrt(seed.size / _GROWN_PX)), 1)
    every = np.s_[::step, ::step]
    some_bins = np.ascontiguousarray(bins[every])
    some_seed = np.ascontiguousarray(seed[every])
    mask: Mask = some_seed
    for _ in range(_ROUNDS):
        model = _model(some_bins, mask)
        if model.similarity(model.background) > SEPARABLE:
            return None, None
        grown = _grown(some_bins, some_seed, model)
        if grown is None:
            return None, None
        if np.count_nonzero(grown != mask) < 0.02 * np.count_nonzero(grown):
            break
        mask = grown
    model = _model(some_bins, mask)
    if step == 1:
        return mask, model
    whole = _grown(bins, seed, model)
    return (None, None) if whole is None else (whole, _model(bins, whole))


def _grown(bins: NDArray[np.uint8], seed: Mask, model: ColorModel) -> Mask | None:
    """Mask (h, w) of pixels in an object's colours at a seed (h, w)."""
    likely: Mask = np.asarray(cv2.GaussianBlur(model.table()[bins], (3, 3), 0)) > 0.5
    return masks.closed_component(likely, seed, model.backdrop()[bins])


def _model(bins: NDArray[np.uint8], mask: Mask) -> ColorModel:
    """Colours of the mask (low saturations beside vivid colours are rejected) and of its surroundings."""
    colors = histogram(bins, mask) * _VIVIDNESS
    colors /= colors.sum()
    colors[_LOW_SATURATION * (colors @ _VIVIDNESS) > _VIVIDNESS] = 0.0
    return ColorModel(colors / colors.sum(), histogram(bins, ~masks.dilated(mask, 2)))
