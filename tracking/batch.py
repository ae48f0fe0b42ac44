"""Markers in a batch of images at once, on torch: for long recordings, where no frame has to wait for the last.

Every image is looked at by itself, so that what touches all pixels runs for the whole batch on one device:
hue, the densest blob of the marker's, which of its neighbours hang together, and how far each is covered (as
`outline.cover` has it).  The outline is then taken image by image.  What is cut off by the border or too large
goes to `find_markers` itself.
"""

from typing import Literal

import kornia.color
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from tracking.compiled import BAND, LEAST_DET, LEVEL_VAR, SMALL_PX, UNIT
from tracking.marker import MarkerParams, find_markers
from tracking.outline import Coverage, Optics, Outline, outline

Device = Literal["cpu", "cuda"]
_SIDE = 64  # px, of the patch around a blob that is measured
_ROOM = 8  # px of background that a blob must have around it there
_SKIP = 2  # a blob is looked for in every second row and column


class MarkerBatch:
    """Finds the marker in each of many images of one camera; ValueError where the device is not there."""

    def __init__(self, params: MarkerParams, optics: Optics, device: Device) -> None:
        if device == "cuda" and not torch.cuda.is_available():
            raise ValueError("device cuda: torch finds none on this machine; expected cpu")
        self._params, self._optics, self._device = params, optics, torch.device(device)

    @torch.inference_mode()
    def find(self, images: NDArray[np.uint8]) -> list[Outline | None]:
        """The marker's outline in each of `images` (n, height, width, 3) RGB, None where there is none."""
        if min(images.shape[1:3]) < _SIDE:
            return [self._alone(image) for image in images]
        pixels = torch.from_numpy(images).to(self._device)
        corner, there = self._look(pixels)
        patch = _cut(pixels, corner)
        mask = _connected(self._is_marker(patch))
        margin = mask.clone()
        margin[:, _ROOM:-_ROOM, _ROOM:-_ROOM] = False
        whole = ~margin.any(dim=(1, 2)) & (mask.sum(dim=(1, 2)) >= self._params.min_area_px)
        parts = [part.cpu().numpy() for part in (*_cover(patch, mask), corner, there, whole)]
        return [
            None if not there else self._outline(alpha, variance, corner) if whole else self._alone(image)
            for image, alpha, variance, corner, there, whole in zip(images, *parts, strict=True)
        ]

    def _outline(
        self, alpha: NDArray[np.float32], variance: NDArray[np.float32], corner: NDArray[np.int64]
    ) -> Outline | None:
        """Of a patch's coverage, of which only what is covered is looked at."""
        columns, rows = np.flatnonzero(alpha.any(axis=0)), np.flatnonzero(alpha.any(axis=1))
        if not len(columns):
            return None
        x0, x1, y0, y1 = int(columns[0]), int(columns[-1]) + 1, int(rows[0]), int(rows[-1]) + 1
        box = int(corner[0]) + x0, int(corner[1]) + y0, int(corner[0]) + x1, int(corner[1]) + y1
        return outline(Coverage(alpha[y0:y1, x0:x1].copy(), variance[y0:y1, x0:x1].copy(), box), self._optics)

    def _alone(self, image: NDArray[np.uint8]) -> Outline | None:
        return next(iter(find_markers(self._params, image, self._optics)), None)

    def _is_marker(self, rgb: Tensor) -> Tensor:
        """(n, h, w) of the marker's hue, in the whole numbers that OpenCV gives HSV; `rgb` (n, 3, h, w) 0–255."""
        p = self._params
        hue, saturation, _ = kornia.color.rgb_to_hsv(rgb / 255).unbind(dim=1)
        off = (torch.round(hue * (90 / np.pi)) - 0.5 * p.hue_deg + 90) % 180 - 90
        vivid = (torch.round(255 * saturation) >= 255 * p.min_saturation) & (rgb.amax(dim=1) >= 255 * p.min_value)
        return (off.abs() <= 0.5 * p.hue_tolerance_deg) & vivid

    def _look(self, pixels: Tensor) -> tuple[Tensor, Tensor]:
        """(n, 2) corner x, y of the patch around the densest blob, and (n,) whether there is any."""
        hits = self._is_marker(pixels[:, ::_SKIP, ::_SKIP].permute(0, 3, 1, 2).float()).float()
        density = functional.avg_pool2d(hits[:, None], 8, 2, padding=4)
        best = density.flatten(1).argmax(dim=1)
        spot = torch.stack([best % density.shape[3], best // density.shape[3]], dim=1) * 2
        y, x = (torch.arange(size, device=self._device) for size in hits.shape[1:])
        reach = _SIDE // (2 * _SKIP)
        across = hits * ((x - spot[:, :1]).abs() <= reach)[:, None, :] * ((y - spot[:, 1:]).abs() <= reach)[:, :, None]
        total = across.sum(dim=(1, 2))
        middle = torch.stack([across.sum(dim=1) @ x.float(), across.sum(dim=2) @ y.float()], dim=1)
        corner = (middle * _SKIP / total.clamp(min=1)[:, None]).round().long() - _SIDE // 2
        most = torch.tensor([pixels.shape[2] - _SIDE, pixels.shape[1] - _SIDE], device=self._device)
        return torch.minimum(corner.clamp(min=0), most), total > 0


def _cut(images: Tensor, corner: Tensor) -> Tensor:
    """(n, 3, side, side) patches at the corners (n, 2) of images (n, h, w, 3)."""
    along = torch.arange(_SIDE, device=corner.device)
    x, y = corner[:, 0, None, None] + along[None, None, :], corner[:, 1, None, None] + along[None, :, None]
    image = torch.arange(len(corner), device=corner.device)[:, None, None]
    return images[image, y, x].permute(0, 3, 1, 2).float()


def _connected(mask: Tensor) -> Tensor:
    """(n, side, side) what hangs together (4 neighbours) with the marked pixel nearest to the patch's middle."""
    along = torch.arange(_SIDE, device=mask.device) - (_SIDE - 1) / 2
    far = torch.where(mask, along[:, None] ** 2 + along**2, torch.inf).flatten(1)
    seed = functional.one_hot(far.argmin(dim=1), _SIDE * _SIDE).view_as(mask)
    whole, grown = mask.float()[:, None], (seed * mask).float()[:, None]
    while True:
        before = grown
        for _ in range(4):
            rows = functional.max_pool2d(grown, (3, 1), 1, (1, 0))
            grown = torch.maximum(rows, functional.max_pool2d(grown, (1, 3), 1, (0, 1))) * whole
        if torch.equal(before, grown):
            return grown[:, 0] > 0


def _grown(mask: Tensor, radius: int) -> Tensor:
    """(n, h, w) grown by `radius` to all sides."""
    return functional.max_pool2d(mask.float()[:, None], 2 * radius + 1, 1, radius)[:, 0] > 0


def _cover(patch: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """Coverage and its variance (n, side, side), as `cover` has them; `patch` (n, 3, side, side)."""
    alpha, variance = torch.zeros_like(patch[:, 0]), torch.zeros_like(patch[:, 0])
    large = mask.sum(dim=(1, 2)) > SMALL_PX
    for band, these in ((1, ~large), (BAND, large)):
        which = these.nonzero()[:, 0]
        if len(which):
            alpha[which], variance[which] = _cover_band(patch[which], mask[which], band)
    return alpha, variance


def _cover_band(patch: Tensor, mask: Tensor, band: int) -> tuple[Tensor, Tensor]:
    inner = ~_grown(~mask, band)
    inner = torch.where(inner.any(dim=(1, 2))[:, None, None], inner, mask)
    outer = ~_grown(mask, band)
    image, row, column = (~(inner | outer)).nonzero(as_tuple=True)
    F, B = (_local_mean(patch, where, 4 * band + 5)[image, :, row, column] for where in (inner, outer))
    pixels, bound = patch[image, :, row, column], UNIT**2
    ff, bb, fb = (F * F).sum(1) + bound, (B * B).sum(1) + bound, (F * B).sum(1) + bound
    fi, bi = (F * pixels).sum(1) + bound, (B * pixels).sum(1) + bound
    det = (ff * bb - fb * fb).clamp(min=LEAST_DET)
    a, b = ((bb * fi - fb * bi) / det).clamp(min=0), ((ff * bi - fb * fi) / det).clamp(min=0)
    rest = (pixels - a[:, None] * F - b[:, None] * B).square().mean(dim=1)
    total = torch.zeros(len(patch), device=patch.device).index_add_(0, image, rest)
    noise = total / torch.bincount(image, minlength=len(patch)).clamp(min=1) + LEVEL_VAR
    contrast = (F - B).square().sum(dim=1).clamp(min=1.0)
    alpha, variance = inner.float(), torch.zeros_like(patch[:, 0])
    alpha[image, row, column] = a / (a + b).clamp(min=1e-6)
    variance[image, row, column] = (noise[image] / contrast).clamp(max=0.25)
    return alpha, variance


def _local_mean(patch: Tensor, where: Tensor, window: int) -> Tensor:
    """(n, 3, side, side) mean colour of the marked pixels around each; of all marked ones where none is near."""
    weight = where.float()[:, None]
    sums = torch.cat([patch * weight, weight], dim=1)
    near = functional.avg_pool2d(sums, (window, 1), 1, (window // 2, 0))
    near = functional.avg_pool2d(near, (1, window), 1, (0, window // 2)) * window**2
    whole = sums.sum(dim=(2, 3), keepdim=True)
    chosen = torch.where(near[:, 3:] > 0.5, near, whole)
    return chosen[:, :3] / chosen[:, 3:].clamp(min=1.0)
