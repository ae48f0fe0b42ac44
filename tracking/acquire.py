"""From a patch of motion to the whole object: what has the moving pixels' colours and hangs together."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Image, Mask
from tracking import masks
from tracking.appearance import ColorModel, color_bins, histogram
from tracking.ego_motion import Box
from tracking.motion_trigger import Region2D
from tracking.optical_flow import Flow2D
from tracking.outline import Optics, Outline, fit_outline


@dataclass(frozen=True)
class AcquireParams:
    """`margin` of the patch's size is searched around it; `max_likeness` (Bhattacharyya) to the
    surroundings above which nothing stands out; a patch grows in at most `rounds`; an object fills at
    least `min_fill` of its box, covers `min_area_px` and at most `max_share` of the image."""

    margin: float = 1.5
    max_likeness: float = 0.8
    rounds: int = 4
    min_fill: float = 0.35
    min_area_px: int = 16
    max_share: float = 0.25


@dataclass(frozen=True, slots=True)
class Candidate:
    """An object that may be worth tracking, in one image."""

    outline: Outline
    model: ColorModel
    evidence: float
    flow: Flow2D | None  # of the region that it was found by


def acquire(
    params: AcquireParams, image: Image, region: Region2D, optics: Optics, evidence: NDArray[np.float32] | None = None
) -> Candidate | None:
    """The object whose edge or body moved in `region`; None where nothing stands out there.

    `evidence` (H, W), where given, tells object from background instead of colour (grey images).
    """
    x, y, w, h = region.box_px
    height, width = image.shape[:2]
    reach = int(params.margin * max(w, h)) + 6
    box = max(x - reach, 0), max(y - reach, 0), min(x + w + reach, width), min(y + h + reach, height)
    crop = np.s_[box[1] : box[3], box[0] : box[2]]
    seed = np.zeros((box[3] - box[1], box[2] - box[0]), bool)
    seed[y - box[1] : y - box[1] + h, x - box[0] : x - box[0] + w] = region.mask
    bins = color_bins(image[crop])
    distinctness = 1.0
    if evidence is None:
        mask, model = _grow(params, bins, seed)
        distinctness = 1 - model.similarity(model.background) if model else 0.0
    else:
        mask = _connected(evidence[crop] > 0.5, seed)
        model = _model(bins, mask) if mask is not None else None
    if mask is None or model is None or np.count_nonzero(mask) < params.min_area_px:
        return None
    shape = _object_outline(params, image, mask, box, optics)
    if shape is None:
        return None
    return Candidate(shape, model, region.evidence * distinctness, region.flow)


def _object_outline(params: AcquireParams, image: Image, mask: Mask, box: Box, optics: Optics) -> Outline | None:
    """The mask's outline, unless it is too large or too ragged for an object."""
    shape = fit_outline(image, mask, box, optics)
    if shape is None or shape.area_px > params.max_share * image.shape[0] * image.shape[1]:
        return None
    return shape if shape.area_px >= params.min_fill * shape.box_px[2] * shape.box_px[3] else None


def _grow(params: AcquireParams, bins: NDArray[np.uint8], seed: Mask) -> tuple[Mask | None, ColorModel | None]:
    """Alternate between colours and extent; background in the seed drops out, for it is around as well."""
    mask: Mask = seed
    model = None
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
    return _with_other_sides(bins, mask)


def _with_other_sides(bins: NDArray[np.uint8], mask: Mask) -> tuple[Mask, ColorModel]:
    """With what touches it and is nearly as vivid, of colours that nothing farther around has: another side of an
    object of several colours, which did not move enough to be noticed."""
    model = _model(bins, mask)
    far = histogram(bins[~masks.dilated(mask, int(0.5 * np.sqrt(np.count_nonzero(mask))) + 2)])
    vivid = (_DULL * (model.object @ _VIVIDNESS) < _VIVIDNESS) & (far < _FAR)
    whole = _connected(vivid[bins] | mask, mask)
    if whole is None or np.count_nonzero(whole) < 1.1 * np.count_nonzero(mask):
        return mask, model
    return whole, _model(bins, whole)


# Of what moves together the most colourful is taken for the object.
_VIVIDNESS = np.concatenate([np.tile((np.arange(10) + 0.5) / 10, 10), np.full(10, 0.1)]).astype(np.float32) ** 2


_FAR = 0.005  # share of its surroundings up to which they do not have a colour
_DULL = 0.4  # of the object's mean vividness, below which a colour is not the object's


def _model(bins: NDArray[np.uint8], mask: Mask) -> ColorModel:
    thing = histogram(bins[mask], _VIVIDNESS[bins[mask]])
    thing[_DULL * (thing @ _VIVIDNESS) > _VIVIDNESS] = 0.0
    return ColorModel(thing / thing.sum(), histogram(bins[~masks.dilated(mask, 2)]))


def _connected(hard: Mask, seed: Mask, backdrop: Mask | None = None) -> Mask | None:
    """The component that holds most of the seed, gaps and holes filled."""
    one = masks.component(masks.closed(hard, masks.square(1)), seed)
    return None if one is None else masks.filled(one, backdrop)
