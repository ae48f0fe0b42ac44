"""Following a coloured object in one camera's images, first box given (no calibration needed)."""

from dataclasses import dataclass, field, replace

import numpy as np

from pps_vision.geometry.camera import Camera
from pps_vision.types import Image
from tracking.eye import EyeParams, EyeTracker
from tracking.outline import Optics
from tracking.particles import Prior

BoxPx = tuple[float, float, float, float]  # x, y of the top-left corner, width, height


@dataclass(frozen=True, slots=True)
class BoxDetection:
    """Where the object is (x, y, width, height px) and how well it fits, 0–1; 0 where it was not seen
    and the box is the last one."""

    box_px: BoxPx
    score: float


@dataclass(frozen=True)
class ColorTrackerParams:
    """How the object is followed; grey images are followed by value alone.  A box is around what shows:
    nothing is completed."""

    eye: EyeParams = field(default_factory=EyeParams)


class ColorTracker:
    """Follows one object: `start` with the first image and box, then `step` per image."""

    def __init__(self, params: ColorTrackerParams, rng: np.random.Generator) -> None:
        self.params, self.rng = params, rng
        self._eye: EyeTracker | None = None
        self._last = BoxDetection((0.0, 0.0, 0.0, 0.0), 0.0)
        self._misses = 0

    def start(self, image: Image, box_px: BoxPx) -> BoxDetection:
        """Learn the object in `box_px` of the first RGB image; ValueError where the box is no part of it."""
        height, width = image.shape[:2]
        x, y, w, h = box_px
        if not (w >= 2 and h >= 2 and x >= 0 and y >= 0 and x + w <= width and y + h <= height):
            raise ValueError(f"first box {x:g} {y:g} {w:g} {h:g}: expected a box inside the {width}×{height} image")
        self._eye = EyeTracker(replace(self.params.eye, notched=False), flat_optics(width, height), self.rng)
        self._eye.start(image, box_px)
        self._last = BoxDetection(box_px, 1.0)
        return self._last

    def step(self, image: Image) -> BoxDetection:
        """The object in the next image."""
        if self._eye is None:
            raise ValueError("step before start; the tracker needs a first image and box")
        seen = self._eye.step(image) or self._eye.step(image, self._wider())
        self._misses = 0 if seen else self._misses + 1
        box = seen.box_px if seen else self._last.box_px
        self._last = BoxDetection(box, seen.score if seen else 0.0)
        return self._last

    def _wider(self) -> Prior:
        """Anywhere around the last box, the farther the longer it has not been seen."""
        x, y, w, h = self._last.box_px
        side = float(np.sqrt(w * h))
        return Prior(np.array([x + (w - 1) / 2, y + (h - 1) / 2]), side * min(1.0 + 0.3 * self._misses, 4.0), 1.0)


def flat_optics(width: int, height: int) -> Optics:
    """For an unknown camera: a lens of about 30°, without distortion.  (A much longer one, to which every
    pixel counts the same, leaves angles too small for single precision.)"""
    focal = 2.0 * max(width, height)
    return Optics(Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2))
