"""Disturbances of a recording, each of a given severity: light, then the sensor's noise, then cameras and drivers.

`fine` is a recording at a multiple of the wanted rate, so that images and joints of other moments are at hand.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.scenarios import Footage
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.types import Array, Image, StereoFrame
from rendering.sensor import Sensor, expose

EyeFault = Literal["black", "frozen"]


def at_rate(fine: Footage, every: int) -> Footage:
    """Keep every so many frames."""
    return _picked(fine, np.arange(0, len(fine.frames), every))


def noisy(recording: Footage, sigma: float, rng: np.random.Generator) -> Footage:
    """Add Gaussian noise of `sigma` grey levels, independent per pixel and channel."""
    sensor = Sensor(noise_sigma=sigma)
    return _each_image(recording, lambda image, _: expose(sensor, _light(image), rng))


def exposed(recording: Footage, stops: Callable[[float], float]) -> Footage:
    """Change both eyes' light by `stops` (powers of 2) that depend on the time."""
    return _each_image(
        recording, lambda image, stamp_s: expose(Sensor(exposure=2 ** stops(stamp_s)), _light(image), None)
    )


def desaturated(recording: Footage, kept: float) -> Footage:
    """Keep only a share of the colours' saturation; 0 is grey."""

    def fade(image: Image, _: float) -> Image:
        grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
        return np.asarray(cv2.addWeighted(image, kept, grey, 1 - kept, 0), dtype=np.uint8)

    return _each_image(recording, fade)


def faded(recording: Footage, empty: Footage, contrast: float) -> Footage:
    """Mix the object with its background: `contrast` 1 is itself, 0 is nothing to see."""

    def mixed(with_it: Image, without: Image) -> Image:
        return np.asarray(cv2.addWeighted(with_it, contrast, without, 1 - contrast, 0), dtype=np.uint8)

    frames = [
        replace(frame, left=mixed(frame.left, bare.left), right=mixed(frame.right, bare.right))
        for frame, bare in zip(recording.frames, empty.frames, strict=True)
    ]
    return replace(recording, frames=tuple(frames))


def blurred(fine: Footage, every: int, frames_open: int) -> Footage:
    """Blur by motion: each image is the mean of `frames_open` successive fine ones around its stamp."""
    k = np.arange(every, len(fine.frames) - every, every)
    around = np.arange(frames_open) - (frames_open - 1) // 2

    def mean(images: list[Image]) -> Image:
        return np.rint(np.mean(images, axis=0, dtype=np.float32)).astype(np.uint8)

    shots = [[fine.frames[i + j] for j in around] for i in k]
    kept = _picked(fine, k)
    frames = [
        replace(frame, left=mean([f.left for f in shot]), right=mean([f.right for f in shot]))
        for frame, shot in zip(kept.frames, shots, strict=True)
    ]
    return replace(kept, frames=tuple(frames))


def dropped(recording: Footage, share: float, rng: np.random.Generator) -> Footage:
    """Drop a random share of the pairs; never the first."""
    arrives = rng.random(len(recording.frames)) >= share
    arrives[0] = True
    return _picked(recording, np.flatnonzero(arrives))


def jittered(fine: Footage, every: int, std_s: float, rng: np.random.Generator) -> Footage:
    """Add noise to the stamps, and take the joints of the wrong stamps; stamps still rise."""
    recording = at_rate(fine, every)
    half_s = 0.45 * float(np.median(np.diff(recording.stamps_s)))
    wrong = np.clip(std_s * rng.standard_normal(len(recording.frames)), -half_s, half_s)
    stamps_s = recording.stamps_s + wrong
    frames = [
        replace(
            frame,
            stamp_left_s=float(stamp_s),
            stamp_right_s=float(stamp_s),
            joints_left_rad=then.joints_left_rad,
            joints_right_rad=then.joints_right_rad,
        )
        for frame, stamp_s, then in zip(recording.frames, stamps_s, _frames_at(fine, stamps_s), strict=True)
    ]
    return replace(recording, frames=tuple(frames))


def stale_joints(fine: Footage, every: int, delay_s: float) -> Footage:
    """Make the joints of every frame `delay_s` old."""
    recording = at_rate(fine, every)
    frames = [
        replace(frame, joints_left_rad=old.joints_left_rad, joints_right_rad=old.joints_right_rad)
        for frame, old in zip(recording.frames, _frames_at(fine, recording.stamps_s - delay_s), strict=True)
    ]
    return replace(recording, frames=tuple(frames))


def right_late(fine: Footage, every: int, delay_s: float) -> Footage:
    """Make the right image `delay_s` older than the left, under the same stamp and joints."""
    recording = at_rate(fine, every)
    olds = _frames_at(fine, recording.stamps_s - delay_s)
    frames = [replace(frame, right=old.right) for frame, old in zip(recording.frames, olds, strict=True)]
    return replace(recording, frames=tuple(frames))


def eyes_fail(recording: Footage, kind: EyeFault, from_s: float, to_s: float, both: bool = False) -> Footage:
    """Make the right eye, or both, black or frozen (its last image under new stamps) for a time."""
    out = (recording.stamps_s >= from_s) & (recording.stamps_s < to_s)
    frames: list[StereoFrame] = []
    for frame, fails in zip(recording.frames, out, strict=True):
        if fails:
            last = frames[-1] if frames else frame
            black = np.zeros_like(frame.right), np.zeros_like(frame.left)
            right, left = (last.right, last.left) if kind == "frozen" else black
            frame = replace(frame, right=right, left=left if both else frame.left)
        frames.append(frame)
    return replace(recording, frames=tuple(frames), seen=recording.seen & ~out)


def miscalibrated(recording: Footage, share: float, rng: np.random.Generator) -> Footage:
    """Tell the tracker intrinsics that are off by ± `share`, the sign of each at random: focal lengths
    of their size, principal points of half the image's."""

    def off(camera: Camera) -> Camera:
        fx, fy, cx, cy = share * rng.choice([-1.0, 1.0], 4)
        half = camera.width / 2, camera.height / 2
        return replace(
            camera,
            fx=camera.fx * (1 + fx),
            fy=camera.fy * (1 + fy),
            cx=camera.cx + cx * half[0],
            cy=camera.cy + cy * half[1],
        )

    rig = recording.rig
    return replace(recording, rig=StereoRig(off(rig.left), off(rig.right), rig.eye_poses))


def _picked(recording: Footage, k: NDArray[np.integer]) -> Footage:
    return replace(
        recording,
        frames=tuple(recording.frames[int(i)] for i in k),
        position=recording.position[k],
        velocity=recording.velocity[k],
        seen=recording.seen[k],
        boxes=tuple(recording.boxes[int(i)] for i in k),
    )


def _each_image(recording: Footage, change: Callable[[Image, float], Image]) -> Footage:
    frames = [
        replace(f, left=change(f.left, f.stamp_left_s), right=change(f.right, f.stamp_right_s))
        for f in recording.frames
    ]
    return replace(recording, frames=tuple(frames))


def _light(image: Image) -> Array:
    """Grey levels as what fell on the sensor."""
    return image.astype(np.float32)


def _frames_at(fine: Footage, stamps_s: Array) -> list[StereoFrame]:
    nearest = np.abs(fine.stamps_s[None, :] - stamps_s[:, None]).argmin(axis=1)
    return [fine.frames[int(k)] for k in nearest]
