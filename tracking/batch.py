"""Detections in many stereo pairs at once, on torch: the offline path of the tracker.

    RGB ─► likelihood image ─► mask ─► blobs ─► outlines

The images of a batch are searched as a whole on one device; the blobs of their masks are outlined as frame by frame.
The tracker then takes the outline that is where the track predicts it and as large, and searches by itself where there
is none (`CameraTracker.find`).  Every image is searched by itself, so the results do not depend on the size of the
batch.
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

_BLUR_PX = (2 * np.log(2)) ** -0.5  # its three weights are ¼, ½, ¼, as those of `ImageTracker`


class BatchTracker:
    """A tracker whose images are searched in batches.

    Args:
        tracker: which the frames advance; its own frame-by-frame search finds and confirms an object first.
        device: on which all images are searched.
    """

    def __init__(self, tracker: Tracker, device: torch.device) -> None:
        self._tracker, self._device = tracker, device
        self._optics = Optics(tracker.searched_rig.left), Optics(tracker.searched_rig.right)

    def steps(self, frames: Sequence[StereoFrame]) -> list[TrackerStep]:
        """The tracker's step at each of the frames, in the order of their stamps."""
        steps: list[TrackerStep] = []
        while rest := frames[len(steps) :]:
            if (appearance := self._tracker.appearance) is None:
                steps.append(self._tracker.step(rest[0]))
                continue
            searched = [self._tracker.searched(frame) for frame in rest]
            left = find(appearance[0], [frame.left for frame in searched], self._optics[0], self._device)
            right = find(appearance[1], [frame.right for frame in searched], self._optics[1], self._device)
            for frame, found in zip(rest, zip(left, right, strict=True), strict=True):
                steps.append(self._tracker.step(frame, found))
                if self._tracker.appearance is not appearance:
                    break
        return steps


@torch.inference_mode()
def find(appearance: Appearance, images: Sequence[Image], optics: Optics, device: torch.device) -> list[Outlines]:
    """Outlines of what may be the object in each of the RGB images (h, w, 3) of one camera; None for all, if they are
    not that camera's.

    Args:
        appearance: the marker's hue, or the object's colours.
        optics: of the camera that took the images.
        device: on which the masks are computed.
    """
    width, height = optics.camera.width, optics.camera.height
    if any(image.shape != (height, width, 3) for image in images):
        return [None] * len(images)
    marked = masks(appearance, torch.from_numpy(np.stack(images)).to(device)).cpu().numpy()
    box = 0, 0, width, height
    return [blob_outlines(image, mask, box, optics) for image, mask in zip(images, marked, strict=True)]


def masks(appearance: Appearance, pixels: Tensor) -> Tensor:
    """(n, h, w) 1 where RGB images (n, h, w, 3) uint8 show the object or its colours, else 0."""
    if isinstance(appearance, MarkerParams):
        return _look_up(pixels, _marker_table(appearance), 8)
    table = torch.from_numpy(appearance.table()[color_bins(all_colors(6))[0]])
    likelihood = _look_up(pixels, table, 6)
    return (gaussian_blur2d(likelihood[:, None], (3, 3), (_BLUR_PX, _BLUR_PX))[:, 0] > 0.5).byte()


@lru_cache(maxsize=2)
def _marker_table(params: MarkerParams) -> Tensor:
    """(2^24,) whether each colour R8G8B8 has the marker's hue."""
    return torch.from_numpy(threshold(params, all_colors(8).reshape(4096, 4096, 3)).ravel())


def _look_up(pixels: Tensor, table: Tensor, bits: int) -> Tensor:
    """(n, h, w) entry for each pixel's colour in a table of all colours of that many bits a channel."""
    r, g, b = (pixels >> (8 - bits)).int().unbind(dim=-1)
    index = (r << (2 * bits)) + (g << bits) + b
    return table.to(pixels.device).index_select(0, index.flatten()).view(index.shape)
