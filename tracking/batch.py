"""Detections in many stereo pairs at once, on torch: the offline path of the tracker.

    RGB ─► likelihood image ─► mask ─► blobs ─► outlines

The images of a batch are searched together on one device; the blobs of their masks are outlined as frame by frame.  The
tracker takes the outline that fits the predicted position and size, and searches itself if there is none
(`CameraTracker.find`).  The results do not depend on the size of the batch.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import torch
from kornia.filters import gaussian_blur2d
from torch import Tensor

from pps_vision.types import Image, StereoFrame
from tracking.appearance import all_colors, color_bins
from tracking.marker import MarkerParams, blob_outlines, threshold
from tracking.outline import Optics
from tracking.stereo import Outlines
from tracking.tracker import Appearance, Tracker, TrackerStep

_BLUR_PX = (2 * np.log(2)) ** -0.5  # kernel ¼, ½, ¼, the same as in `ImageTracker`


class BatchTracker:
    """A tracker whose images are searched in batches.

    Args:
        tracker: Advanced by the frames; its frame-by-frame search acquires and confirms an object first.
        device: Device on which images are searched.
    """

    def __init__(self, tracker: Tracker, device: torch.device) -> None:
        self._tracker = tracker
        self._device = device
        self._optics = (Optics(tracker.searched_rig.left), Optics(tracker.searched_rig.right))

    def steps(self, frames: Sequence[StereoFrame]) -> list[TrackerStep]:
        """The tracker's step at each of the frames, in the order of their stamps."""
        steps: list[TrackerStep] = []
        while remaining := frames[len(steps) :]:
            if (appearance := self._tracker.appearance) is None:
                steps.append(self._tracker.step(remaining[0]))
                continue
            searched = [self._tracker.searched(frame) for frame in remaining]
            left = find(appearance[0], [frame.left for frame in searched], self._optics[0], self._device)
            right = find(appearance[1], [frame.right for frame in searched], self._optics[1], self._device)
            for frame, outlines in zip(remaining, zip(left, right, strict=True), strict=True):
                steps.append(self._tracker.step(frame, outlines))
                if self._tracker.appearance is not appearance:
                    break
        return steps


@torch.inference_mode()
def find(appearance: Appearance, images: Sequence[Image], optics: Optics, device: torch.device) -> list[Outlines]:
    """Return outlines of candidates in each of the RGB images (h, w, 3) of one camera.

    Args:
        appearance: The marker's hue, or the object's colours.
        images: None is returned for all if the size of any differs from the camera's.
        optics: The camera's optics.
        device: Device on which the masks are computed.
    """
    width = optics.camera.width
    height = optics.camera.height
    if any(image.shape != (height, width, 3) for image in images):
        return [None] * len(images)
    object_masks = color_masks(appearance, torch.from_numpy(np.stack(images)).to(device)).cpu().numpy()
    box = (0, 0, width, height)
    return [blob_outlines(image, mask, box, optics) for image, mask in zip(images, object_masks, strict=True)]


def color_masks(appearance: Appearance, pixels: Tensor) -> Tensor:
    """(n, h, w) 1 where RGB images (n, h, w, 3) uint8 have the object's colours, else 0."""
    if isinstance(appearance, MarkerParams):
        return _look_up(pixels, _marker_table(appearance), 8)
    table = torch.from_numpy(appearance.table()[color_bins(all_colors(6))[0]])
    likelihood = _look_up(pixels, table, 6)
    return (gaussian_blur2d(likelihood[:, None], (3, 3), (_BLUR_PX, _BLUR_PX))[:, 0] > 0.5).byte()


@lru_cache(maxsize=2)
def _marker_table(params: MarkerParams) -> Tensor:
    """(2^24,) 255 for each colour R8G8B8 of the marker's hue, else 0."""
    return torch.from_numpy(threshold(params, all_colors(8).reshape(4096, 4096, 3)).ravel())


def _look_up(pixels: Tensor, table: Tensor, bits: int) -> Tensor:
    """(n, h, w) entry of each pixel's colour in a table of all colours with `bits` per channel."""
    r, g, b = (pixels >> (8 - bits)).int().unbind(dim=-1)
    index = (r << (2 * bits)) + (g << bits) + b
    return table.to(pixels.device).index_select(0, index.flatten()).view(index.shape)
