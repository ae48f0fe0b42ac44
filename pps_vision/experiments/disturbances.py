"""What can go wrong between the world and the tracker: each disturbs footage by a given severity.

Light comes first, then the sensor's noise, then what cameras and drivers do to finished images; `fine` is footage
at a multiple of the rate that is wanted, so that images and joints of other moments are at hand.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.footage import Footage
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.types import Array, Image, Mask, StereoFrame
from rendering.sensor import Sensor, expose

EyeFault = Literal["black", "frozen"]


def at_rate(fine: Footage, every: int) -> Footage:
    """Every so many frames."""
    return _picked(fine, np.arange(0, len(fine.frames), every))


def noisy(footage: Footage, sigma: float, rng: np.random.Generator) -> Footage:
    """Gaussian noise of `sigma` grey levels, independent per pixel and channel."""
    sensor = Sensor(noise_sigma=sigma)
    return _each_image(footage, lambda image, _: expose(sensor, _light(image), rng))


def exposed(footage: Footage, stops: Callable[[float], float]) -> Footage:
    """Both eyes' light changed by `stops` (powers of 2) that depend on the time."""
    return _each_image(
        footage, lambda image, stamp_s: expose(Sensor(exposure=2 ** stops(stamp_s)), _light(image), None)
    )


def desaturated(footage: Footage, kept: float) -> Footage:
    """Only a share of the colours' saturation kept; 0 is grey."""

    def fade(image: Image, _: float) -> Image:
        grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
        return np.asarray(cv2.addWeighted(image, kept, grey, 1 - kept, 0), dtype=np.uint8)

    return _each_image(footage, fade)


def faded(footage: Footage, empty: Footage, contrast: float) -> Footage:
    """The object mixed with what is behind it: `contrast` 1 is itself, 0 is nothing to see."""

    def mixed(with_it: Image, without: Image) -> Image:
        return np.asarray(cv2.addWeighted(with_it, contrast, without, 1 - contrast, 0), dtype=np.uint8)

    frames = [
        replace(frame, left=mixed(frame.left, bare.left), right=mixed(frame.right, bare.right))
        for frame, bare in zip(footage.frames, empty.frames, strict=True)
    ]
    return replace(footage, frames=tuple(frames))


def blurred(fine: Footage, every: int, frames_open: int) -> Footage:
    """Motion blur: each image the mean of `frames_open` successive fine ones around its stamp."""
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


def dropped(footage: Footage, share: float, rng: np.random.Generator) -> Footage:
    """A random share of the pairs never arrives; the first does."""
    arrives = rng.random(len(footage.frames)) >= share
    arrives[0] = True
    return _picked(footage, np.flatnonzero(arrives))


def repeated(footage: Footage, share: float, rng: np.random.Generator) -> Footage:
    """A random share of the pairs shows the last images again, under the new stamp and joints."""
    stale = rng.random(len(footage.frames)) < share
    return _held(footage, stale, stale)


def jittered(fine: Footage, every: int, std_s: float, rng: np.random.Generator) -> Footage:
    """Stamps that are wrong, and with them the joints that are looked up at them; they still rise."""
    footage = at_rate(fine, every)
    half_s = 0.45 * float(np.median(np.diff(footage.stamps_s)))
    wrong = np.clip(std_s * rng.standard_normal(len(footage.frames)), -half_s, half_s)
    return _restamped(footage, fine, footage.stamps_s + wrong)


def stale_joints(fine: Footage, every: int, delay_s: float) -> Footage:
    """The joints that come with an image are `delay_s` old."""
    footage = at_rate(fine, every)
    frames = [
        replace(frame, joints_left_rad=old.joints_left_rad, joints_right_rad=old.joints_right_rad)
        for frame, old in zip(footage.frames, _frames_at(fine, footage.stamps_s - delay_s), strict=True)
    ]
    return replace(footage, frames=tuple(frames))


def right_late(fine: Footage, every: int, delay_s: float, stamped: bool) -> Footage:
    """The right image is `delay_s` older than the left; `stamped`: it says so, and brings its own joints."""
    footage = at_rate(fine, every)
    olds = _frames_at(fine, footage.stamps_s - delay_s)
    frames = [replace(frame, right=old.right) for frame, old in zip(footage.frames, olds, strict=True)]
    if not stamped:
        return replace(footage, frames=tuple(frames))
    frames = [
        replace(frame, stamp_right_s=frame.stamp_s - delay_s, joints_right_rad=old.joints_right_rad)
        for frame, old in zip(frames, olds, strict=True)
    ]
    position = fine.position[_nearest(fine, np.array([frame.stamp_s for frame in frames]))]
    return replace(footage, frames=tuple(frames), position=position)


def eyes_fail(footage: Footage, kind: EyeFault, from_s: float, to_s: float, both: bool = False) -> Footage:
    """The right eye, or both, black or frozen (its last image under new stamps) for a time."""
    out = (footage.stamps_s >= from_s) & (footage.stamps_s < to_s)
    left = out if both else np.zeros_like(out)
    failing = _held(footage, left, out) if kind == "frozen" else _blackened(footage, left, out)
    return replace(failing, seen=footage.seen & ~out)


def right_flickers(footage: Footage, share: float, rng: np.random.Generator) -> Footage:
    """The right eye is black in a random share of the frames; not in the first."""
    out = rng.random(len(footage.frames)) < share
    out[0] = False
    return _blackened(footage, np.zeros_like(out), out)


def miscalibrated(footage: Footage, share: float, rng: np.random.Generator) -> Footage:
    """The tracker is told intrinsics that are off by ± `share`, the sign of each at random: focal lengths
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

    rig = footage.rig
    return replace(footage, rig=StereoRig(off(rig.left), off(rig.right), rig.eye_poses))


def _picked(footage: Footage, k: NDArray[np.integer]) -> Footage:
    frames = tuple(footage.frames[int(i)] for i in k)
    return replace(footage, frames=frames, position=footage.position[k], seen=footage.seen[k])


def _each_image(footage: Footage, change: Callable[[Image, float], Image]) -> Footage:
    frames = [
        replace(f, left=change(f.left, f.stamp_left_s), right=change(f.right, f.stamp_right_s)) for f in footage.frames
    ]
    return replace(footage, frames=tuple(frames))


def _light(image: Image) -> Array:
    """Grey levels as what fell on the sensor."""
    return image.astype(np.float32)


def _nearest(fine: Footage, stamps_s: Array) -> NDArray[np.integer]:
    return np.abs(fine.stamps_s[None, :] - stamps_s[:, None]).argmin(axis=1)


def _frames_at(fine: Footage, stamps_s: Array) -> list[StereoFrame]:
    return [fine.frames[int(k)] for k in _nearest(fine, stamps_s)]


def _restamped(footage: Footage, fine: Footage, stamps_s: Array) -> Footage:
    frames = [
        replace(
            frame,
            stamp_left_s=float(stamp),
            stamp_right_s=float(stamp),
            joints_left_rad=then.joints_left_rad,
            joints_right_rad=then.joints_right_rad,
        )
        for frame, stamp, then in zip(footage.frames, stamps_s, _frames_at(fine, stamps_s), strict=True)
    ]
    return replace(footage, frames=tuple(frames))


def _held(footage: Footage, left: Mask, right: Mask) -> Footage:
    """The last image shown again where a mask (n,) says so."""
    frames = [footage.frames[0]]
    for frame, hold_left, hold_right in zip(footage.frames[1:], left[1:], right[1:], strict=True):
        if hold_left:
            frame = replace(frame, left=frames[-1].left)
        if hold_right:
            frame = replace(frame, right=frames[-1].right)
        frames.append(frame)
    return replace(footage, frames=tuple(frames))


def _blackened(footage: Footage, left: Mask, right: Mask) -> Footage:
    frames = [
        replace(
            frame,
            left=np.zeros_like(frame.left) if no_left else frame.left,
            right=np.zeros_like(frame.right) if no_right else frame.right,
        )
        for frame, no_left, no_right in zip(footage.frames, left, right, strict=True)
    ]
    return replace(footage, frames=tuple(frames))
