"""Outlines of the tracked object in the images of many stereo pairs at once, on torch: the offline path.

    RGB ─► likelihood image ─► patch around its densest blob ─► hard mask ─► coverage ─► moments ─► outline

All but the last step runs for the whole batch on one device, and its results are fetched once per batch.  Every image
is processed by itself, so the results do not depend on the size of the batch.  An image that shows anything but
one whole blob is left to the frame-by-frame tracker, which also rejects an outline that is not where the track
predicts it, or not as large (`Tracker.step`).
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import torch
from kornia.color import rgb_to_hsv
from kornia.filters import gaussian_blur2d
from kornia.geometry.calibration import undistort_points
from kornia.morphology import dilation
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from pps_vision.geometry.camera import Camera
from pps_vision.types import StereoFrame
from tracking.appearance import ColorModel, color_bins
from tracking.kernels import BAND, LEAST_DET, LEVEL_VAR, SMALL_PX, UNIT, Moments
from tracking.marker import MarkerParams
from tracking.outline import Optics, outline_of
from tracking.stereo import Found
from tracking.tracker import Appearance, Tracker, TrackerStep

_PATCH = 64  # px at an image width of 320 px: side of the patch around a blob
_WIDTH = 320
_ROOM = 8  # px of background around a blob in its patch, as much as the outline's colours are taken from
_BLUR_PX = (2 * np.log(2)) ** -0.5  # its three weights are ¼, ½, ¼
_STEP = 2  # blobs are located on every second row and column
_BLOCK = 8  # of these a side, whose density is compared
_LEVELS = 64  # of each of R, G, B in a likelihood table, as in `tracking.appearance`
_ITERATIONS = 60  # of inverting the lens: 1e-9 px with the iCub's lenses; kornia's default of 5 leaves 0.4 px


class BatchTracker:
    """A tracker whose images are searched in batches.

    Args:
        tracker: which the frames advance; its own frame-by-frame search finds and confirms an object first.
        device: on which all images are processed.
    """

    def __init__(self, tracker: Tracker, device: torch.device) -> None:
        self._tracker, self._device = tracker, device
        self._appearance: tuple[Appearance, Appearance] | None = None
        self._batches: list[OutlineBatch] = []

    def steps(self, frames: Sequence[StereoFrame]) -> list[TrackerStep]:
        """The tracker's step at each of the frames, in the order of their stamps."""
        steps: list[TrackerStep] = []
        while rest := frames[len(steps) :]:
            if (appearance := self._tracker.appearance) is None:
                steps.append(self._tracker.step(rest[0]))
                continue
            for frame, found in zip(rest, self._find(appearance, rest), strict=True):
                steps.append(self._tracker.step(frame, found))
                if self._tracker.appearance is not appearance:
                    break
        return steps

    def _find(
        self, appearance: tuple[Appearance, Appearance], frames: Sequence[StereoFrame]
    ) -> list[tuple[Found, Found]]:
        rig = self._tracker.rig
        if appearance is not self._appearance:
            eyes = zip(appearance, (rig.left, rig.right), strict=True)
            self._batches = [OutlineBatch(one, Optics(camera), self._device) for one, camera in eyes]
            self._appearance = appearance
        left = self._batches[0].find(np.stack([frame.left for frame in frames]))
        right = self._batches[1].find(np.stack([frame.right for frame in frames]))
        return list(zip(left, right, strict=True))


class OutlineBatch:
    """Find an object in many images of one camera.

    Args:
        appearance: the marker's hue and smallest area, or the object's colours.
        optics: of the camera that took the images.
        device: on which all images are processed.
    """

    def __init__(self, appearance: Appearance, optics: Optics, device: torch.device) -> None:
        self._appearance, self._optics, self._device = appearance, optics, device
        self._side = _PATCH * max(round(optics.camera.width / _WIDTH), 1)
        if isinstance(appearance, MarkerParams):
            self._least_px, table = appearance.min_area_px, marker_table(appearance)
        else:
            self._least_px, table = SMALL_PX, color_table(appearance)
        self._table = table.to(device)
        self._weights = lens_weights(optics.camera, device)

    @torch.inference_mode()
    def find(self, images: NDArray[np.uint8]) -> list[Found]:
        """Outlines of the object in each of `images` (n, height, width, 3) RGB."""
        camera = self._optics.camera
        if images.shape[1:] != (camera.height, camera.width, 3) or min(images.shape[1:3]) < self._side:
            return [None] * len(images)
        pixels = torch.from_numpy(images).to(self._device)
        corner, inside, total = self._locate(pixels)
        patch, weights = _cut(pixels, corner, self._side), _cut_map(self._weights, corner, self._side)
        marked = self._mask(patch)
        blob = middle_blob(marked)
        border = blob.clone()
        border[:, _ROOM:-_ROOM, _ROOM:-_ROOM] = False
        seen = moments(*coverage(patch.permute(0, 3, 1, 2).float(), blob), weights)
        single = (blob.sum(dim=(1, 2)) >= self._least_px) & ~border.any(dim=(1, 2))
        single &= seen[:, _AREA] >= 1
        if isinstance(self._appearance, MarkerParams):
            others = (marked & ~blob).sum(dim=(1, 2)) + _STEP**2 * (total - inside)
            single &= others < self._least_px
        rows = torch.cat([seen, corner, single[:, None], total[:, None]], dim=1).cpu().numpy()
        return [self._found(row) for row in rows]

    def _found(self, row: NDArray[np.float64]) -> Found:
        *seen, left, top, single, total = row.tolist()
        if not total:
            return []
        if not single:
            return None
        x, y, width, height = (int(number) for number in seen[-4:])
        direction, omega, cov = (seen[0], seen[1], seen[2]), seen[3], tuple(seen[4:14])
        one = Moments(direction, omega, cov, seen[_AREA], (x, y, width, height))
        outline = outline_of(one, (int(left), int(top)), self._optics)
        return None if outline is None else [outline]

    def _locate(self, pixels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Corner x, y (n, 2) of the patch around the densest blob; the likelihood of the sampled pixels summed over the
        patch, and over the image (n,)."""
        hits = likelihood(pixels[:, ::_STEP, ::_STEP], self._table)
        hits = hits * (hits > 0.5)
        density = functional.avg_pool2d(hits[:, None], _BLOCK, ceil_mode=True)
        best = density.flatten(1).argmax(dim=1)
        spot = torch.stack([best % density.shape[3], best // density.shape[3]], dim=1) * _BLOCK + _BLOCK // 2
        inside = _within(hits, spot, self._side // (2 * _STEP))
        y, x = (torch.arange(size, device=self._device, dtype=torch.float32) for size in hits.shape[1:])
        middle = torch.stack([inside.sum(dim=1) @ x, inside.sum(dim=2) @ y], dim=1)
        middle = middle * _STEP / inside.sum(dim=(1, 2)).clamp(min=1)[:, None]
        most = torch.tensor([pixels.shape[2] - self._side, pixels.shape[1] - self._side], device=self._device)
        corner = torch.minimum((middle.round().long() - self._side // 2).clamp(min=0), most)
        inside = _within(hits, (corner + self._side // 2) // _STEP, self._side // (2 * _STEP))
        return corner, inside.sum(dim=(1, 2)), hits.sum(dim=(1, 2))

    def _mask(self, patch: Tensor) -> Tensor:
        """(n, h, w) whether each pixel of the patches (n, h, w, 3) is the object's, as frame by frame (`threshold`,
        `ImageTracker`), but for the closing there, which moves no outline by more than 0.01 px."""
        if isinstance(self._appearance, MarkerParams):
            return is_marker(patch.permute(0, 3, 1, 2), self._appearance)
        smooth = gaussian_blur2d(likelihood(patch, self._table)[:, None], (3, 3), (_BLUR_PX, _BLUR_PX))
        return smooth[:, 0] > 0.5


def hsv(rgb: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Hue in [0, 180), saturation and value in [0, 255] of RGB pixels (…, 3, h, w), rounded as OpenCV's are."""
    hue, saturation, value = rgb_to_hsv(rgb.float() / 255).unbind(dim=-3)
    return (
        torch.floor(hue * (90 / np.pi) + 0.5) % 180,
        torch.floor(255 * saturation + 0.5),
        torch.floor(255 * value + 0.5),
    )


def is_marker(rgb: Tensor, params: MarkerParams) -> Tensor:
    """Whether each of the RGB pixels (n, 3, h, w) has the marker's hue, saturation and value."""
    hue, saturation, value = hsv(rgb)
    least_saturation, least_value = np.rint(params.ranges[0][0][1:])  # inRange rounds its limits
    within = torch.zeros_like(hue, dtype=torch.bool)
    for low, high in params.ranges:
        within |= (hue >= np.rint(low[0])) & (hue <= np.rint(high[0]))
    return within & (saturation >= least_saturation) & (value >= least_value)


def _levels() -> Tensor:
    """(1, 64, 64·64, 3) the middle of every cell of a likelihood table."""
    level = torch.arange(_LEVELS, dtype=torch.uint8) * (256 // _LEVELS) + 128 // _LEVELS
    return torch.cartesian_prod(level, level, level).view(1, _LEVELS, _LEVELS**2, 3)


def marker_table(params: MarkerParams) -> Tensor:
    """(262144,) 1 for every colour R6G6B6 that has the marker's hue, else 0."""
    return is_marker(_levels().permute(0, 3, 1, 2), params).float().flatten()


def color_table(model: ColorModel) -> Tensor:
    """(262144,) probability that a pixel of each colour R6G6B6 belongs to the object (back-projection)."""
    return torch.from_numpy(model.table()[color_bins(_levels()[0].numpy())]).flatten()


def likelihood(pixels: Tensor, table: Tensor) -> Tensor:
    """(n, h, w) likelihood images of RGB images (n, h, w, 3) uint8 by a table of all colours."""
    r, g, b = (pixels >> 2).int().unbind(dim=-1)
    index = (r << 12) + (g << 6) + b
    return table.index_select(0, index.flatten()).view(index.shape)


@lru_cache(maxsize=8)
def lens_weights(camera: Camera, device: torch.device) -> Tensor:
    """(4, height, width) solid angle of each pixel times its viewing direction, and its solid angle, sr; float64."""
    v, u = torch.meshgrid(
        torch.arange(camera.height, dtype=torch.float64), torch.arange(camera.width, dtype=torch.float64), indexing="ij"
    )
    K, lens, unit = (
        part.to(device) for part in (torch.from_numpy(camera.K), torch.from_numpy(camera.lens), torch.eye(3))
    )
    pixels = torch.stack([u, v], dim=-1).view(1, -1, 2).to(device)
    xy = undistort_points(pixels, K[None], lens[None], unit.double()[None], _ITERATIONS)
    xy = xy.view(camera.height, camera.width, 2)
    rays = functional.normalize(functional.pad(xy, (0, 1), value=1.0), dim=-1)
    down, across = torch.gradient(rays, dim=(0, 1))
    angle = torch.linalg.vector_norm(torch.linalg.cross(across, down), dim=-1)
    return torch.cat([(rays * angle[..., None]).permute(2, 0, 1), angle[None]])


def _within(hits: Tensor, spot: Tensor, reach: int) -> Tensor:
    """`hits` (n, h, w), 0 but for −reach ≤ x − spot < reach, and alike for y; `spot` (n, 2)."""
    y, x = (torch.arange(size, device=hits.device) for size in hits.shape[1:])
    along, down = x - spot[:, :1], y - spot[:, 1:]
    return hits * ((along >= -reach) & (along < reach))[:, None, :] * ((down >= -reach) & (down < reach))[:, :, None]


def _grid(corner: Tensor, side: int) -> tuple[Tensor, Tensor]:
    """Rows (n, side, 1) and columns (n, 1, side) of the patches at the corners (n, 2)."""
    along = torch.arange(side, device=corner.device)
    return corner[:, 1, None, None] + along[:, None], corner[:, 0, None, None] + along


def _cut(images: Tensor, corner: Tensor, side: int) -> Tensor:
    """(n, side, side, 3) patches at the corners (n, 2) of images (n, h, w, 3)."""
    image = torch.arange(len(corner), device=corner.device)[:, None, None]
    return images[image, *_grid(corner, side)]


def _cut_map(weights: Tensor, corner: Tensor, side: int) -> Tensor:
    """(n, 4, side, side) patches at the corners (n, 2) of one map (4, h, w)."""
    return weights[:, *_grid(corner, side)].movedim(0, 1)


def middle_blob(mask: Tensor) -> Tensor:
    """The component (8 neighbours) of the marked pixel nearest to the middle of each mask (n, h, w), its holes
    (4 neighbours) filled."""
    starts = mask & ~functional.pad(mask, (1, 0))[..., :-1]
    one_run = (starts.sum(dim=2) <= 1).all(dim=1)  # in every row: no hole, so Euler's number is that of components
    others = (~one_run | (euler_number(mask) != 1)).nonzero()[:, 0]
    return mask.index_copy(0, others, _filled(_connected(mask[others]))) if len(others) else mask


def _connected(mask: Tensor) -> Tensor:
    y, x = (torch.arange(size, device=mask.device) - (size - 1) / 2 for size in mask.shape[1:])
    far = torch.where(mask, y[:, None] ** 2 + x**2, torch.inf).flatten(1)
    nearest = functional.one_hot(far.argmin(dim=1), far.shape[1]).view(mask.shape)
    return _flooded(nearest.bool() & mask, mask, torch.ones(3, 3))


def _filled(mask: Tensor) -> Tensor:
    edge = ~mask
    edge[:, 1:-1, 1:-1] = False
    return ~_flooded(edge, ~mask, torch.tensor([[0.0, 1, 0], [1, 1, 1], [0, 1, 0]]))


def euler_number(mask: Tensor) -> Tensor:
    """(n,) components (8 neighbours) less holes of masks (n, h, w), from their 2×2 windows (Gray 1971)."""
    windows = functional.pad(mask.int(), (1, 1, 1, 1))
    a, b, c, d = windows[:, :-1, :-1], windows[:, :-1, 1:], windows[:, 1:, :-1], windows[:, 1:, 1:]
    count = a + b + c + d
    diagonal = (a == d) & (b == c) & (a != b)
    votes = (count == 1).int() - (count == 3).int() - 2 * diagonal.int()
    return votes.sum(dim=(1, 2)) // 4


def _flooded(seed: Tensor, mask: Tensor, kernel: Tensor) -> Tensor:
    """(n, h, w) what of the masks is connected to the seeds (n, h, w) by steps of a 3×3 kernel."""
    whole, reached, kernel = mask.float()[:, None], seed.float()[:, None], kernel.to(mask.device)
    while True:
        before = reached
        for _ in range(4):  # whether that is all is asked seldom: each time a device has to wait
            reached = dilation(reached, kernel) * whole
        if torch.equal(before, reached):
            return reached[:, 0] > 0.5


def box_sums(values: Tensor, radius: int) -> Tensor:
    """Sums of values (…, h, w) within `radius` px to all sides.

    Banded matrices sum whole numbers exactly on every device; a convolution (kornia's `box_blur`) is rounded to TF32
    on CUDA, and takes longer on the CPU.
    """
    y, x = (torch.arange(size, device=values.device) for size in values.shape[-2:])
    rows, columns = (((k[:, None] - k).abs() <= radius).to(values.dtype) for k in (y, x))
    return rows @ values @ columns


def grown(mask: Tensor, radius: int) -> Tensor:
    """Masks (n, h, w) grown by `radius` px to all sides."""
    return box_sums(mask.float(), radius) > 0.5


def coverage(patch: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """Share of each pixel that the object covers, and its variance (n, h, w), as `outline.cover` has them; of patches
    (n, 3, h, w) in [0, 255] and their masks (n, h, w)."""
    alpha, variance = torch.zeros_like(patch[:, 0]), torch.zeros_like(patch[:, 0])
    large = mask.sum(dim=(1, 2)) > SMALL_PX
    for band, these in ((1, ~large), (BAND, large)):
        which = these.nonzero()[:, 0]
        if len(which):
            alpha[which], variance[which] = _coverage(patch[which], mask[which], band)
    return alpha, variance


def _coverage(patch: Tensor, mask: Tensor, band: int) -> tuple[Tensor, Tensor]:
    inner = ~grown(~mask, band)
    inner = torch.where(inner.any(dim=(1, 2))[:, None, None], inner, mask)
    outer = ~grown(mask, band)
    image, row, column = (~(inner | outer)).nonzero(as_tuple=True)
    F, B = (_local_mean(patch, where, 2 * band + 2)[image, :, row, column] for where in (inner, outer))
    pixels, bound = patch[image, :, row, column].double(), UNIT**2  # where the colours are alike, det is a small rest
    ff, bb, fb = (F * F).sum(1) + bound, (B * B).sum(1) + bound, (F * B).sum(1) + bound
    fi, bi = (F * pixels).sum(1) + bound, (B * pixels).sum(1) + bound
    det = (ff * bb - fb * fb).clamp(min=LEAST_DET)
    a, b = ((bb * fi - fb * bi) / det).clamp(min=0), ((ff * bi - fb * fi) / det).clamp(min=0)
    rest = (pixels - a[:, None] * F - b[:, None] * B).square().mean(dim=1)
    total = torch.zeros(len(patch), device=patch.device, dtype=rest.dtype).index_add_(0, image, rest)
    noise = total / torch.bincount(image, minlength=len(patch)).clamp(min=1) + LEVEL_VAR
    contrast = (F - B).square().sum(dim=1).clamp(min=1.0)
    alpha, variance = inner.to(patch.dtype), torch.zeros_like(patch[:, 0])
    alpha[image, row, column] = (a / (a + b).clamp(min=1e-6)).to(patch.dtype)
    variance[image, row, column] = (noise[image] / contrast).clamp(max=0.25).to(patch.dtype)
    return alpha, variance


def _local_mean(patch: Tensor, where: Tensor, radius: int) -> Tensor:
    """(n, 3, h, w) mean colour of the marked pixels within `radius` of each, of all where none is; float64."""
    weight = where.to(patch.dtype)[:, None]
    sums = torch.cat([patch * weight, weight], dim=1)
    near = box_sums(sums, radius)
    whole = sums.sum(dim=(2, 3), keepdim=True)
    chosen = torch.where(near[:, 3:] > 0.5, near, whole)
    return chosen[:, :3].double() / chosen[:, 3:].clamp(min=1.0)


_UPPER = torch.triu_indices(4, 4)
_AREA = 14  # column of `moments`


def moments(alpha: Tensor, variance: Tensor, weights: Tensor) -> Tensor:
    """(n, 19) numbers of `kernels.Moments` one after another, float64, of coverage and variance (n, h, w) and the
    lens's weights there (n, 4, h, w); the box's corner is relative to the patch."""
    shares, lens = alpha.double().flatten(1), weights.double().flatten(2)
    first = torch.bmm(lens, shares[..., None])[..., 0]
    second = torch.bmm(lens * variance.double().flatten(1)[:, None], lens.mT)
    upper = second[:, _UPPER[0], _UPPER[1]]
    return torch.cat([first, upper, torch.stack([shares.sum(dim=1), *_box(alpha > 0.5)], dim=1)], dim=1)


def _box(mask: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """x, y, width, height (n,) of the boxes around masks (n, h, w); of size 0 where nothing is marked."""
    (x, width), (y, height) = (_extent(mask.any(dim=dim)) for dim in (1, 2))
    return x, y, width, height


def _extent(line: Tensor) -> tuple[Tensor, Tensor]:
    """First marked element and the length up to the last (n,) of lines (n, k)."""
    first, last = line.int().argmax(dim=1), line.shape[1] - line.flip(1).int().argmax(dim=1)
    return first, torch.where(line.any(dim=1), last - first, 0)
