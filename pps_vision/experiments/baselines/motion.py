"""Baselines of the motion trigger: optical flow, frame differences, background models.

Each has one level above which it fires, which the study chooses.  All look at the same central part of the image (R's
grid at its own 75 %) and join what they find to regions in the same way.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, View
from pps_vision.types import Image
from tracking.ego_motion import EgoMotion

BoxPx = tuple[int, int, int, int]  # x, y of the top-left corner, width, height
Flow = Callable[[NDArray[np.uint8], NDArray[np.uint8]], NDArray[np.float32]]  # grey, grey → (h, w, 2) px

ROOM_M = 1.2  # how far away the flow of a moving eye is expected from
_CENTRAL, _MIN_AREA_PX, _JOIN_PX = 0.92, 16, 4
_STEP, _WINDOW, _LEVELS, _CENTRAL_R = 6, 15, 5, 0.75  # of R's grid (its motionCUT module)
_MIN_NEIGHBOURS, _MIN_NODES = 4, 10


class MotionTrigger(Protocol):
    """Finds what moves in one camera's images."""

    def step(self, image: Image, view: View) -> list[BoxPx]:
        """Where it moves."""
        ...


def regions(on: NDArray[np.bool_]) -> list[BoxPx]:
    """Boxes of what hangs together, nearly, in the central part of a map (h, w) of what is on."""
    height, width = on.shape
    mx, my = round((1 - _CENTRAL) / 2 * width), round((1 - _CENTRAL) / 2 * height)
    central = np.ascontiguousarray(on[my : height - my, mx : width - mx]).view(np.uint8)
    if np.count_nonzero(central) < _MIN_AREA_PX:
        return []
    side = 2 * _JOIN_PX + 1
    joined = cv2.morphologyEx(central, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(joined)
    area = np.bincount(np.asarray(labels)[central > 0], minlength=len(stats))
    found = np.flatnonzero(area[1:] >= _MIN_AREA_PX) + 1
    return [(int(stats[k, 0]) + mx, int(stats[k, 1]) + my, int(stats[k, 2]), int(stats[k, 3])) for k in found]


def grey_of(image: Image) -> NDArray[np.uint8]:
    """(h, w) brightness."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


class ResidualGrid:
    """R's trigger: nodes whose patch pyramidal Lucas–Kanade cannot find again (mean difference, grey levels)."""

    def __init__(self, level: float) -> None:
        self._level = level
        self._before: NDArray[np.uint8] | None = None

    def step(self, image: Image, view: View) -> list[BoxPx]:
        """Blobs of more than 10 nodes that have 4 of 8 neighbours on."""
        now, before = grey_of(image), self._before
        self._before = now
        if before is None:
            return []
        height, width = now.shape
        m = (1 - _CENTRAL_R) / 2
        y, x = np.mgrid[int(m * height) : int((1 - m) * height) : _STEP, int(m * width) : int((1 - m) * width) : _STEP]
        nodes = np.stack([x, y], axis=-1).astype(np.float32).reshape(-1, 1, 2)
        _, found, residual = cv2.calcOpticalFlowPyrLK(
            before, now, nodes, np.empty_like(nodes), winSize=(_WINDOW, _WINDOW), maxLevel=_LEVELS - 1
        )
        on = ((residual > self._level) | (found == 0)).reshape(x.shape).astype(np.uint8)
        neighbours = cv2.filter2D(on, -1, np.ones((3, 3)), borderType=cv2.BORDER_CONSTANT) - on
        kept = on * (np.asarray(neighbours) >= _MIN_NEIGHBOURS).view(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(kept)
        corner = x[0, 0] - _STEP // 2, y[0, 0] - _STEP // 2
        return [
            (int(corner[0] + _STEP * a), int(corner[1] + _STEP * b), int(_STEP * w), int(_STEP * h))
            for a, b, w, h, area in np.asarray(stats)[1:]
            if area > _MIN_NODES
        ]


class FlowMinusEgo:
    """Dense flow less what the eye's own motion makes of a scene `ROOM_M` away, above a level in px."""

    def __init__(self, flow: Flow, camera: Camera, level: float) -> None:
        self._flow, self._ego, self._level = flow, EgoMotion(camera), level
        self._before: tuple[NDArray[np.uint8], View] | None = None
        self._here = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).astype(
            np.float32
        )

    def step(self, image: Image, view: View) -> list[BoxPx]:
        """Regions that move by themselves."""
        now, before = grey_of(image), self._before
        self._before = now, view
        if before is None:
            return []
        moved = self._flow(now, before[0])
        if not self._ego.is_still(before[1], view):
            moved = moved - (self._ego.maps(before[1], view, 1 / ROOM_M) - self._here)
        return regions(np.asarray(cv2.magnitude(moved[..., 0], moved[..., 1])) > self._level)


class Difference:
    """What is brighter or darker than in the last image by a level; `warped`: than that image seen from here."""

    def __init__(self, camera: Camera, level: float, warped: bool) -> None:
        self._ego, self._level, self._warped = EgoMotion(camera), level, warped
        self._before: tuple[NDArray[np.uint8], View] | None = None

    def step(self, image: Image, view: View) -> list[BoxPx]:
        """Regions that changed."""
        now, before = np.asarray(cv2.blur(grey_of(image), (3, 3)), dtype=np.uint8), self._before
        self._before = now, view
        if before is None:
            return []
        old, new = before[0], now
        if self._warped and not self._ego.is_still(before[1], view):
            old = self._ego.warp(old, before[1], view, 1 / ROOM_M)
            new = np.where(old == 0, old, now)
        return regions(np.asarray(cv2.absdiff(new, old)) > self._level)


class BackgroundModel:
    """OpenCV's mixture of Gaussians or nearest neighbours for every pixel."""

    def __init__(self, model: cv2.BackgroundSubtractor) -> None:
        self._model = model

    def step(self, image: Image, view: View) -> list[BoxPx]:
        """Regions that are not background."""
        return regions(np.asarray(self._model.apply(image)) > 0)


def dis(preset: int) -> Flow:
    """OpenCV's dense inverse search."""
    method = cv2.DISOpticalFlow.create(preset)
    return lambda a, b: np.asarray(method.calc(a, b, np.empty(0)), dtype=np.float32)


def farneback(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.float32]:
    """OpenCV's, with the parameters of its tutorial."""
    return np.asarray(cv2.calcOpticalFlowFarneback(a, b, np.empty(0), 0.5, 3, 15, 3, 5, 1.2, 0), dtype=np.float32)


FLOWS: dict[str, Callable[[], Flow]] = {
    "DIS ultrafast": lambda: dis(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST),
    "DIS fast": lambda: dis(cv2.DISOPTICAL_FLOW_PRESET_FAST),
    "DIS medium": lambda: dis(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM),
    "Farneback": lambda: farneback,
}


@dataclass(frozen=True)
class Candidate:
    """A trigger to be made for a camera at one of its `levels`."""

    make: Callable[[Camera, float], MotionTrigger]
    levels: tuple[float, ...]


_GREY, _PX = (4, 6, 8, 12, 16, 24, 32, 48, 64), (0.5, 0.75, 1, 1.5, 2, 3, 4, 6)


def _flow_baseline(name: str) -> Candidate:
    return Candidate(lambda camera, level: FlowMinusEgo(FLOWS[name](), camera, level), _PX)


TRIGGERS: dict[str, Candidate] = {
    "LK residual grid (R)": Candidate(lambda _, level: ResidualGrid(level), (2, 3, 4, 6, 8, 12, 16, 24)),
    **{f"{name} − ego": _flow_baseline(name) for name in FLOWS},
    "frame difference": Candidate(lambda camera, level: Difference(camera, level, warped=False), _GREY),
    "difference, warped": Candidate(lambda camera, level: Difference(camera, level, warped=True), _GREY),
    "MOG2": Candidate(
        lambda _, level: BackgroundModel(cv2.createBackgroundSubtractorMOG2(100, level, False)), (16, 25, 50, 100, 400)
    ),
    "KNN": Candidate(
        lambda _, level: BackgroundModel(cv2.createBackgroundSubtractorKNN(100, level, False)), (400, 800, 1600, 6400)
    ),
}
