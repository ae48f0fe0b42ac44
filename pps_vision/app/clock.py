"""Delays between the cameras' clocks, and of the joints, by a recording's images: `pps-vision clock`."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from pps_vision.app.stamp_delay import ClockParams, Delay, Interpolator, PointPath, estimate_delay
from pps_vision.geometry.camera import View, reduced_image
from pps_vision.recordings.recording import Pair, Recording, pair_by_stamp
from pps_vision.types import Array, Image
from tracking.camera_pose import APART_S, GAP_S, ROOM_M, JointClock, Reference, channel_maximum

_BACKGROUND = 25  # pairs, spread over the recording, whose median is the background of fixed cameras
_DIFFERS = 5.0  # times the median change of a pixel from the background, and as many grey levels more, is an object
_SMALLEST_PX = 30
_RUN = 10  # images
_WIDTH_PX = 640  # at about which objects are looked for
_TURNS = 240  # turns of each camera, spread over the recording
_ROUNDS = 6
_SAME_S = 2e-4
_RESTS_RAD = 1e-3
_JUST = Delay(0.0, 0.0, 0.0, 0.0, 0.0)


class Clocks(NamedTuple):
    """Delay of the right camera's stamps behind the left one's; that of the joints behind the left images, None
    without a robot."""

    cameras: Delay
    joints: Delay | None = None

    def __str__(self) -> str:
        rows = {"right camera": self.cameras, "joints": self.joints}
        return "\n".join(f"clock of the {name}: {delay}" for name, delay in rows.items() if delay is not None)

    def numbers(self) -> dict[str, object]:
        """For summary.json."""
        return numbers(self.cameras) | ({} if self.joints is None else {"joints": numbers(self.joints)})


def numbers(delay: Delay) -> dict[str, object]:
    """A delay for summary.json."""
    return {
        "delay_ms": 1000 * delay.delay_s,
        "delay_std_ms": 1000 * delay.std_s,
        "drift_ppm": 1e6 * delay.drift,
        "drift_std_ppm": 1e6 * delay.drift_std,
        "corrected": delay.is_late,
        "unobservable": delay.unobservable,
    }


def clocks(recording: Recording, params: ClockParams | None = None) -> Clocks:
    """Estimate the delays of a recording: fixed cameras by a moving object, a robot by the turns of its cameras.

    InputError without a calibration.
    """
    params = params or ClockParams()
    rig = recording.calibrated()
    if recording.robot is None:
        return Clocks(estimate_delay(params, rig.view(), _paths(recording)))
    rotations = np.stack([_poses(recording, side, _JUST)[:, :3, :3] for side in (0, 1)])
    if (np.nanmax(rotations, axis=1) - np.nanmin(rotations, axis=1)).max() < _RESTS_RAD:
        still = Delay(unobservable="the cameras do not turn")
        first, second = recording.pairs[0]
        return Clocks(estimate_delay(params, rig.view(first.joints_rad, second.joints_rad), _paths(recording)), still)
    delays = [_JUST, _JUST]
    for _ in range(_ROUNDS):  # of Gauss–Newton
        last, delays = delays, _joint_delays(params, recording, delays)
        if why := delays[0].unobservable or delays[1].unobservable:
            break
        if max(abs(new.delay_s - old.delay_s) for old, new in zip(last, delays, strict=True)) < _SAME_S:
            return Clocks(_between(*delays), delays[0])
    unknown = Delay(unobservable=why or "no delay of the joints explains how the cameras turn")
    return Clocks(unknown, unknown)


def _between(left: Delay, right: Delay) -> Delay:
    """The delay of the right camera's stamps from the joints' delays behind both cameras' images."""
    stds = float(np.hypot(left.std_s, right.std_s)), float(np.hypot(left.drift_std, right.drift_std))
    delay_s, drift = left.delay_s - right.delay_s, left.drift - right.drift
    return Delay(delay_s, stds[0], drift, stds[1], left.at_s, frame_s=left.frame_s)


def corrected(recording: Recording, late: Clocks) -> Recording:
    """The recording with the right images' stamps, and the joints, by one clock, paired anew; images without joints
    then are left out."""
    if not any(delay is not None and delay.is_late for delay in late):
        return recording
    left, right = ([pair[side] for pair in recording.pairs] for side in (0, 1))
    right_s = _stamps(recording, 1)
    shift_s = late.cameras.at(right_s) if late.cameras.is_late else np.zeros(len(right))
    right = [replace(file, stamp_s=stamp_s) for file, stamp_s in zip(right, (right_s - shift_s).tolist(), strict=True)]
    pairs: Sequence[Pair] = pair_by_stamp(left, right, 0.55 / recording.fps, recording.problems)
    if late.joints is not None:
        joints = _joints(recording)
        late_s = late.joints if late.joints.is_late else _JUST
        stamps_s = np.array([[file.stamp_s for file in pair] for pair in pairs])
        q = np.stack([joints(stamps_s[:, side] + late_s.at(stamps_s[:, side])) for side in (0, 1)], axis=1)
        pairs = [
            (replace(a, joints_rad=q_left), replace(b, joints_rad=q_right))
            for (a, b), (q_left, q_right) in zip(pairs, q, strict=True)
            if np.isfinite(q_left).all() and np.isfinite(q_right).all()
        ]
    return replace(recording, pairs=tuple(pairs))


def _paths(recording: Recording) -> list[tuple[PointPath, PointPath]]:
    """Path of the largest moving object in the left and the right images of cameras that rest."""
    k = max(1, round(recording.image_size[0] / _WIDTH_PX))
    chosen = np.unique(np.linspace(0, len(recording) - 1, _BACKGROUND).astype(int))
    sampled = list(replace(recording, pairs=tuple(recording.pairs[k] for k in chosen)))
    images = [[_smooth(image, k) for image in side] for side in zip(*((f.left, f.right) for f in sampled), strict=True)]
    backgrounds = [np.median(side, axis=0).astype(np.uint8) for side in images]
    samples: tuple[list[tuple[float, ...]], list[tuple[float, ...]]] = ([], [])
    for frame in recording:
        sides = (frame.left, frame.stamp_left_s), (frame.right, frame.stamp_right_s)
        for rows, background, (image, stamp_s) in zip(samples, backgrounds, sides, strict=True):
            rows.append((stamp_s, *_moving(_smooth(image, k), background)))
    return [(_steady(np.array(samples[0]), k), _steady(np.array(samples[1]), k))]


def _steady(rows: Array, k: int) -> PointPath:
    """The path by stamp, centre and size (px) in images (n, 4), reduced `k` times, where no other object takes
    the place of the largest: the velocity does not change by the object's size a frame, for `_RUN` images."""
    stamps_s, centers, size = rows[:, 0], rows[:, 1:3], rows[:, 3]
    jump = np.linalg.norm(np.diff(centers, 2, axis=0), axis=1)
    goes_on = np.concatenate([[False], jump < size[1:-1], [False]])  # False for NaN
    edges = np.flatnonzero(np.diff(np.concatenate([[0], goes_on, [0]])))
    chosen = np.zeros(len(rows), bool)
    for begin, end in edges.reshape(-1, 2).tolist():
        chosen[begin:end] = end - begin >= _RUN
    return PointPath(stamps_s[chosen], k * (centers[chosen] + 0.5) - 0.5)


def _smooth(image: Image, reduction: int) -> Image:
    return np.asarray(cv2.GaussianBlur(reduced_image(image, reduction), (0, 0), 1.0), np.uint8)


def _moving(image: Image, background: Image) -> tuple[float, float, float]:
    """Centre and size (square root of the area) of the largest region that differs from the background, px;
    NaN where it is small or the border cuts it."""
    change = channel_maximum(cv2.absdiff(image, background))
    limit = _DIFFERS * (1 + float(np.median(change)))
    mask = cv2.morphologyEx((change > limit).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    _, _, stats, centers = cv2.connectedComponentsWithStats(mask)
    stats[0] = 0  # the background
    best = int(np.argmax(stats[:, cv2.CC_STAT_AREA]))
    x, y, w, h, area = stats[best].tolist()
    height, width = change.shape
    if area < _SMALLEST_PX or x == 0 or y == 0 or x + w == width or y + h == height:
        return np.nan, np.nan, np.nan
    return (*centers[best].tolist(), area**0.5)


def _joints(recording: Recording, side: int = 0) -> Interpolator:
    """The joints (m, n) at stamps (m,), interpolated over the left or the right images; NaN where there are none."""
    log = zip(*((pair[side].stamp_s, pair[side].joints_rad) for pair in recording.pairs), strict=True)
    return Interpolator(PointPath(*map(np.array, log)), GAP_S * recording.fps)


def _stamps(recording: Recording, side: int) -> Array:
    """Stamps (n,) of the left or the right images."""
    return np.array([pair[side].stamp_s for pair in recording.pairs])


def _poses(recording: Recording, side: int, late: Delay) -> Array:
    """Poses T_root_camera (n, 4, 4) of a camera by joints that are late; NaN where there are none."""
    rig = recording.calibrated()
    stamps_s = _stamps(recording, side)
    q = _joints(recording, side)(stamps_s + late.at(stamps_s))
    return np.stack([rig.eye_poses(row)[side] if np.isfinite(row).all() else np.full((4, 4), np.nan) for row in q])


def _joint_delays(params: ClockParams, recording: Recording, delays: Sequence[Delay]) -> list[Delay]:
    """Delays of the joints behind the left and the right images, by turns of the cameras between images that follow
    each other soon, linearised about earlier `delays`."""
    rig = recording.calibrated()
    poses = [_poses(recording, side, delay) for side, delay in enumerate(delays)]
    rates = [_rates(_stamps(recording, side), T) for side, T in enumerate(poses)]
    stamps_s = _stamps(recording, 0)
    later = np.searchsorted(stamps_s, stamps_s + APART_S - 1e-6)
    first = np.flatnonzero(later < len(stamps_s))
    is_near = stamps_s[later[first]] - stamps_s[first] <= GAP_S
    is_known = np.isfinite([rate[first] + rate[later[first]] for rate in rates]).all(axis=(0, 2))
    turns = np.stack([first, later[first]], axis=1)[is_near & is_known]
    at_s = float(stamps_s.mean())
    clocks = [JointClock(rig.left.focal_px, (params.range_s, params.drift_std)) for _ in delays]
    for i, j in turns[np.unique(np.linspace(0, len(turns) - 1, min(_TURNS, len(turns))).astype(int))].tolist():
        frames = list(replace(recording, pairs=(recording.pairs[i], recording.pairs[j])))
        if len(frames) < 2:
            continue
        cameras = (rig.left, rig.right)
        for clock, side, camera, T, rate in zip(clocks, ("left", "right"), cameras, poses, rates, strict=True):
            reference = Reference(camera, getattr(frames[0], side), T[i])
            if not reference.has_corners:
                continue
            view = View(camera, T[j])
            if off := reference.misalignment(getattr(frames[1], side), view, ROOM_M, np.zeros(3)):
                change = rate[j] - view.T_camera_root[:3, :3] @ T[i, :3, :3] @ rate[i]
                clock.update(stamps_s[j], off, np.column_stack([change, (stamps_s[j] - at_s) * change]))
    return [_updated(params, *both, at_s, 1 / recording.fps) for both in zip(clocks, delays, strict=True)]


def _rates(stamps_s: Array, poses: Array) -> Array:
    """Angular velocities (n, 3) rad/s in the camera's frame at poses (n, 4, 4); NaN at the ends and beside NaN."""
    rates = np.full((len(poses), 3), np.nan)
    for k in range(1, len(poses) - 1):
        if np.isfinite(turn := poses[k - 1, :3, :3].T @ poses[k + 1, :3, :3]).all():
            rates[k] = cv2.Rodrigues(turn)[0].ravel() / (stamps_s[k + 1] - stamps_s[k - 1])
    return rates


def _updated(params: ClockParams, clock: JointClock, last: Delay, at_s: float, frame_s: float) -> Delay:
    """The delay after a round of turns."""
    if clock.n < params.fewest:
        return Delay(unobservable=f"{clock.n} turns of a camera by its images; expected {params.fewest}")
    (delay_s, drift), cov = clock.estimate
    std_s, drift_std = np.sqrt(np.diag(cov)).tolist()
    if std_s > params.most_std_frames * frame_s:
        why = "the cameras hardly turn, or at a constant rate"
        return Delay(unobservable=f"{why}: ± {1000 * std_s:.2g} ms (σ)")
    return Delay(last.delay_s + delay_s, std_s, last.drifts * last.drift + drift, drift_std, at_s, frame_s=frame_s)
