"""Disturbances of a recording, each of a given severity: light, sensor noise, cameras and drivers.

`fine` is a recording at a multiple of the final rate, so that images and joints of other moments are available.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Literal, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.films.recordings import Footage
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.types import Array, Image, Mask, StereoFrame
from rendering.sensor import Sensor, expose

EyeFault = Literal["black", "frozen"]
T = TypeVar("T")


def at_rate(fine: Footage, every: int) -> Footage:
    """Keep every n-th frame."""
    return picked(fine, np.arange(0, len(fine.frames), every))


def noisy(recording: Footage, sigma: float, rng: np.random.Generator) -> Footage:
    """Add Gaussian noise of `sigma` grey levels, independent per pixel and channel."""
    sensor = Sensor(noise_sigma=sigma)
    return _each_image(recording, lambda image, _: expose(sensor, image.astype(np.float32), rng))


def exposed(recording: Footage, stops: Callable[[float], float]) -> Footage:
    """Change both eyes' light by `stops` (powers of 2), a function of the time."""
    return _each_image(
        recording, lambda image, stamp_s: expose(Sensor(exposure=2 ** stops(stamp_s)), image.astype(np.float32), None)
    )


def desaturated(recording: Footage, share: float) -> Footage:
    """Keep a share of the colours' saturation; 0 is grey."""

    def fade(image: Image, _: float) -> Image:
        grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
        return np.asarray(cv2.addWeighted(image, share, grey, 1 - share, 0), dtype=np.uint8)

    return _each_image(recording, fade)


def faded(recording: Footage, empty: Footage, contrast: float) -> Footage:
    """Blend the object with its background: `contrast` 1 is the recording, 0 the empty one."""

    def blend(image: Image, background: Image) -> Image:
        return np.asarray(cv2.addWeighted(image, contrast, background, 1 - contrast, 0), dtype=np.uint8)

    return each_frame(
        recording,
        empty.frames,
        lambda frame, bare: replace(frame, left=blend(frame.left, bare.left), right=blend(frame.right, bare.right)),
    )


def dropped(recording: Footage, share: float, rng: np.random.Generator) -> Footage:
    """Drop a random share of the pairs; never the first."""
    arrives = rng.random(len(recording.frames)) >= share
    arrives[0] = True
    return picked(recording, np.flatnonzero(arrives))


def stale_joints(fine: Footage, every: int, delay_s: float) -> Footage:
    """Make the joints of every frame `delay_s` old."""
    recording = at_rate(fine, every)
    return _with_joints(recording, fine, recording.stamps_s - delay_s)


def right_late(fine: Footage, every: int, delay_s: float) -> Footage:
    """Make the right image `delay_s` older than the left, with the same stamp and joints."""
    recording = at_rate(fine, every)
    late = _frames_at(fine, recording.stamps_s - delay_s)
    return each_frame(recording, late, lambda frame, old: replace(frame, right=old.right))


def eyes_fail(recording: Footage, kind: EyeFault, failed: Mask, both: bool = False) -> Footage:
    """Make the right eye, or both, black or frozen (its last image under new stamps) where it `failed` (n,)."""
    shown = recording.frames[0]

    def fail(frame: StereoFrame, fails: bool) -> StereoFrame:
        nonlocal shown
        if fails:
            right = shown.right if kind == "frozen" else np.zeros_like(frame.right)
            left = shown.left if kind == "frozen" else np.zeros_like(frame.left)
            frame = replace(frame, right=right, left=left if both else frame.left)
        shown = frame
        return frame

    return replace(each_frame(recording, failed, fail), visible=recording.visible & ~failed)


def miscalibrated(recording: Footage, share: float, rng: np.random.Generator) -> Footage:
    """Give the tracker intrinsics with errors of ± `share`, signs at random.

    Focal lengths err by this share, principal points by this share of half the image's size.
    """

    def off(c: Camera) -> Camera:
        fx, fy, cx, cy = share * rng.choice([-1.0, 1.0], 4)
        center = {"cx": c.cx + cx * c.width / 2, "cy": c.cy + cy * c.height / 2}
        return replace(c, fx=c.fx * (1 + fx), fy=c.fy * (1 + fy), **center)

    rig = recording.rig
    return replace(recording, rig=StereoRig(off(rig.left), off(rig.right), rig.eye_poses))


def picked(recording: Footage, k: NDArray[np.integer]) -> Footage:
    """Keep the frames with these numbers."""
    return replace(
        recording,
        frames=tuple(recording.frames[int(i)] for i in k),
        position=recording.position[k],
        velocity=recording.velocity[k],
        visible=recording.visible[k],
        boxes=tuple(recording.boxes[int(i)] for i in k),
    )


def each_frame(recording: Footage, values: Iterable[T], change: Callable[[StereoFrame, T], StereoFrame]) -> Footage:
    """Change every frame by its value."""
    frames = [change(frame, value) for frame, value in zip(recording.frames, values, strict=True)]
    return replace(recording, frames=tuple(frames))


def _each_image(recording: Footage, change: Callable[[Image, float], Image]) -> Footage:
    """Change every image by its stamp."""
    return each_frame(
        recording,
        recording.frames,
        lambda f, _: replace(f, left=change(f.left, f.stamp_left_s), right=change(f.right, f.stamp_right_s)),
    )


def _with_joints(recording: Footage, fine: Footage, stamps_s: Array) -> Footage:
    return each_frame(
        recording,
        _frames_at(fine, stamps_s),
        lambda f, source: replace(f, joints_left_rad=source.joints_left_rad, joints_right_rad=source.joints_right_rad),
    )


def _frames_at(fine: Footage, stamps_s: Array) -> list[StereoFrame]:
    nearest = np.abs(fine.stamps_s[None, :] - stamps_s[:, None]).argmin(axis=1)
    return [fine.frames[int(k)] for k in nearest]
