"""While nothing is tracked: what moves in both eyes and looks the same is an object (R Fig 13, left half)."""

import itertools
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pps_vision.geometry.camera import StereoView, View
from pps_vision.types import Array, Mask
from tracking.acquire import AcquireParams, Candidate, acquire
from tracking.background import Background
from tracking.marker import Found, MarkerParams, find_markers
from tracking.motion_trigger import MotionTrigger, Region2D, TriggerParams
from tracking.outline import Optics, Outline
from tracking.stereo import Association, CameraFrame, CameraFrames

OwnBody = Callable[[Array, View], Mask]  # joints (rad), an eye's view → where the robot sees itself
Stages = Callable[[Literal["trigger", "image", "triangulation", "filter"]], AbstractContextManager[object]]
Regions = tuple[list[Region2D], list[Region2D]]


@dataclass(frozen=True)
class SearchParams:
    """Of what moves in each eye, two are one object when
    their colours are `min_likeness` alike (Bhattacharyya) and their sizes differ by no more than
    `max_ratio`, or `max_ratio_grey`: without colour an outline is rougher.  With less than
    `min_strength` of the evidence for what moves most, a pair is not the object, though that be no pair yet."""

    min_likeness: float = 0.7
    max_ratio: float = 1.2
    max_ratio_grey: float = 1.8
    min_strength: float = 0.2
    trigger: TriggerParams = field(default_factory=TriggerParams)
    acquire: AcquireParams = field(default_factory=AcquireParams)


class Search:
    """Finds a moving object anywhere in both images; `step` takes frames in the order of their stamps."""

    def __init__(
        self,
        params: SearchParams,
        optics: tuple[Optics, Optics],
        own_body: OwnBody | None,
        stages: Stages,
    ) -> None:
        self.params, self.own_body, self.stages = params, own_body, stages
        self._optics = optics
        self._triggers = tuple(MotionTrigger(params.trigger, one.camera) for one in optics)

    def step(
        self,
        cameras: CameraFrames,
        view: StereoView,
        stamp_s: float,
        scenes: tuple[Background, Background] | None,
        association: Association,
    ) -> tuple[tuple[Candidate, Candidate] | None, Regions]:
        """The object in both eyes, if there is one, and what moves in each; `scenes` tell object from
        background where there is no colour."""
        with self.stages("trigger"):
            left = self._moving(0, cameras[0], True)
            # what one eye does not see move is nothing to look for, and what it does needs no second confirmation
            right = self._moving(1, cameras[1], bool(left), confirm=False)
        if not (left and right):
            return None, (left, right)
        with self.stages("image"):
            pair = self._best_pair(
                association,
                view,
                self._candidates(0, cameras[0], left, scenes),
                self._candidates(1, cameras[1], right, scenes),
                stamp_s,
                scenes is not None,
            )
        return pair and _with_both_colors(*pair), (left, right)

    def _moving(self, eye: int, camera: CameraFrame, ask: bool, confirm: bool = True) -> list[Region2D]:
        """What moves in one eye; where nobody asks, its image is only remembered."""
        joints, own_body = camera.joints_rad, self.own_body
        own = None if own_body is None or joints is None else lambda: own_body(joints, camera.view)
        if not ask:
            self._triggers[eye].remember(camera.image, camera.view, camera.stamp_s, own)
            return []
        return self._triggers[eye].step(camera.image, camera.view, camera.stamp_s, own, confirm)

    def _candidates(
        self, eye: int, camera: CameraFrame, regions: list[Region2D], scenes: tuple[Background, Background] | None
    ) -> list[Candidate]:
        """Objects behind the strongest moving regions."""
        evidence = scenes[eye].evidence(camera.image, camera.view) if scenes else None
        found = (acquire(self.params.acquire, camera.image, r, self._optics[eye], evidence) for r in regions)
        return [candidate for candidate in found if candidate is not None]

    def _best_pair(
        self,
        association: Association,
        view: StereoView,
        left: list[Candidate],
        right: list[Candidate],
        stamp_s: float,
        grey: bool,
    ) -> tuple[Candidate, Candidate] | None:
        """The two candidates that are one object, with most evidence; colours must agree too."""
        strongest = (max((one.evidence for one in eye), default=0.0) for eye in (left, right))
        best, most = None, self.params.min_strength * float(np.sqrt(np.prod(list(strongest))))
        most_ratio = self.params.max_ratio_grey if grey else self.params.max_ratio
        for a, b in itertools.product(left, right):
            likeness = 1.0 if grey else a.model.similarity(b.model.object)  # eyes differ in exposure
            ratio = a.outline.angular_radius_rad / b.outline.angular_radius_rad
            evidence = likeness * float(np.sqrt(a.evidence * b.evidence))
            if evidence <= most or likeness < self.params.min_likeness or max(ratio, 1 / ratio) > most_ratio:
                continue
            if association.observe(view, a.outline, b.outline, stamp_s):
                best, most = (a, b), evidence
        return best


def _with_both_colors(a: Candidate, b: Candidate) -> tuple[Candidate, Candidate]:
    """Each with the colours that either eye saw: what it shows the one now it may show the other later."""
    seen = 0.5 * (a.model.object + b.model.object)
    return replace(a, model=replace(a.model, object=seen)), replace(b, model=replace(b.model, object=seen))


def search_marker(
    params: MarkerParams,
    cameras: CameraFrames,
    view: StereoView,
    stamp_s: float,
    optics: tuple[Optics, Optics],
    association: Association,
    found: tuple[Found, Found],
) -> tuple[Outline, Outline] | None:
    """The marker anywhere in both images, of those `found` already if any; None where no two blobs are one thing."""
    lefts, rights = (
        find_markers(params, camera.image, one) if known is None else known
        for camera, one, known in zip(cameras, optics, found, strict=True)
    )
    for a, b in itertools.product(lefts, rights):
        if association.observe(view, a, b, stamp_s):
            return a, b
    return None
