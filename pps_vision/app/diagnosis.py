"""Likely causes of failed or inaccurate tracking, with remedies, for summary.json and the terminal."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np

from pps_vision.app.scene_points import Matched, faults_by_points, faults_of_joints, length, match
from pps_vision.geometry.camera import StereoView
from pps_vision.recordings.image_file import Half
from pps_vision.recordings.recording import Pair, Recording
from pps_vision.types import Image, StereoFrame
from tracking import Mode

_ENOUGH_TRACKED = 0.1  # share of pairs
_SAMPLED = 5  # frames, spread over the recording
_REST = 10  # share of the recording, at its end, that is not sampled: the sample is examined beside it
_MATCHED = 2  # of them every second one is searched for points
_DARK = 12.0  # mean grey level of 255, below which colours are noise
BASELINE_M = (0.005, 2.0)  # of stereo cameras; beyond, the calibration's unit is wrong
_FARTHEST_M = 10.0  # where the axes of cameras far apart meet
_WIDEST_DEG = 150.0  # field of view that a pinhole with distortion describes
_RADIANS = np.pi  # largest reading in degrees that is suspected to be in radians
_CONTINUES = 4.0  # times the usual step between columns; 0.4–3.1 within 80 images, 5.7–32 between stereo images
_IN_COMMON = 40  # features; 0.02–0.04 of 500 in the halves of an image, at least 0.2 in stereo images of boards
_EXPLAINED = 0.8  # median change after motion compensation, relative to before: 0.1–0.5 for a shift, else at least 1
_UNITS_M = (0.001, 0.01, 0.0254, 1.0)  # mm, cm, inch and m, in which boards are measured
_USUAL_BASELINE_M = (0.02, 1.0)  # within which a unit is proposed
_RESIDUAL_PX = 0.5  # median reprojection error; up to 0.07 px in rendered and independent recordings, 2.1 in baseball
_SLOWEST = 1.0  # pairs a second, below which no motion is followed from one to the next
_FASTEST = 1e4  # pairs a second, of high-speed cameras
_MOVED = 30.0  # change of a pixel between successive frames where something moves, grey levels of 255
_COMBED = 0.06  # share of them in combed rows: at most 0.03 in real films, 0.12–0.21 in interlaced ones
_MOVED_SHARE = 2e-4  # of such pixels in the image: a disc of 5 px in 320×240

_WHOLE_IMAGE = 6.0  # median change of the pixels from frame to frame, grey levels of 255: three times that of noise


@dataclass(frozen=True)
class Diagnosis:
    """Counts of the search, likely causes of failure, and remedies."""

    counts: dict[str, int]  # `tracking.acquisition.SearchCounts`
    advice: tuple[str, ...]  # likely causes with what to try, the likeliest first

    def __str__(self) -> str:
        n = Counter(self.counts)
        results = [f"{n['candidates_left']} left and {n['candidates_right']} right candidates for the object"]
        if "motion_left" in self.counts:
            results.insert(0, f"motion in {n['motion_left']} left and {n['motion_right']} right images")
        results += [f"{count} pairs {reason}" for reason, count in _rejections(n).items()]
        return "\n  try ".join([f"searched {n['frames']} frames: {', '.join(results)}", *self.advice])


class FrameSample:
    """A few frames, spread over a recording, `spread` alone and `successive` with the next one; points that both images
    of a frame show are matched, and changes measured, in another thread as soon as frames are there."""

    def __init__(self, recording: Recording) -> None:
        n = len(recording) - len(recording) // _REST
        self._spread = [_stamp_s(recording.pairs[k]) for k in np.unique(np.linspace(0, n - 1, _SAMPLED).astype(int))]
        starts = np.unique(np.linspace(0, n - 2, _SAMPLED).astype(int)) if n > 1 else ()
        self._successive = [(_stamp_s(recording.pairs[k]), _stamp_s(recording.pairs[k + 1])) for k in starts]
        self._wanted = {*self._spread, *(stamp_s for pair in self._successive for stamp_s in pair)}
        self._frames: dict[float, StereoFrame] = {}  # by stamp
        self._thread = ThreadPoolExecutor(1)
        self._matches: dict[float, Future[Matched]] = {}
        self._changes: list[Future[tuple[float, float]]] = []

    @classmethod
    def of(cls, recording: Recording) -> "FrameSample":
        """Decode the frames of a recording."""
        sample = cls(recording)
        pairs = tuple(pair for pair in recording.pairs if _stamp_s(pair) in sample._wanted)
        for frame in replace(recording, pairs=pairs):
            sample.add(frame)
        return sample

    def add(self, frame: StereoFrame) -> None:
        """Keep a frame if it is one of the sample."""
        stamp_s = frame.stamp_s
        if stamp_s in self._wanted:
            self._frames[stamp_s] = frame
        if stamp_s in self._spread[::_MATCHED]:
            self._matches[stamp_s] = self._thread.submit(match, frame.left, frame.right)
        for first_s, second_s in self._successive:
            if stamp_s == second_s and first_s in self._frames:
                self._changes.append(self._thread.submit(_change_between, self._frames[first_s].left, frame.left))

    def match(self, frame: StereoFrame) -> Matched:
        """Return `scene_points.match` of a frame of the sample."""
        matches = self._matches.get(frame.stamp_s)
        return matches.result() if matches else match(frame.left, frame.right)

    @property
    def changes(self) -> list[tuple[float, float]]:
        """Shift (px) and combed share from one left image to the next."""
        return [change.result() for change in self._changes]

    @property
    def spread(self) -> list[StereoFrame]:
        """Frames from the first to the last."""
        return [self._frames[stamp_s] for stamp_s in self._spread if stamp_s in self._frames]

    @property
    def successive(self) -> list[tuple[StereoFrame, StereoFrame]]:
        """Frames with their successors."""
        frames = self._frames
        return [(frames[a], frames[b]) for a, b in self._successive if a in frames and b in frames]


def _stamp_s(pair: Pair) -> float:
    """`StereoFrame.stamp_s` of a pair."""
    return 0.5 * (pair[0].stamp_s + pair[1].stamp_s)


def diagnose(
    recording: Recording,
    mode: Mode,
    counts: Mapping[str, int],
    tracked_share: float,
    turn_deg: tuple[float, float],
    residual_px: float,
    sample: FrameSample | None = None,
) -> Diagnosis | None:
    """Return the likely causes of failed or inaccurate tracking, None if there are none.

    `counts`: `tracking.acquisition.SearchCounts`; `turn_deg`: rotation of cameras that are declared fixed, amplitude
    (deg) and rate (deg/s); `residual_px`: median RMS reprojection error of the track, which a wrong calibration or a
    delay of one camera raises; `sample`: of the recording's frames, if they were decoded already.
    """
    sample = sample or FrameSample.of(recording)
    faults = tuple(faults_of(recording, turn_deg, sample))
    if residual_px > _RESIDUAL_PX:
        faults += (
            f"another calibration, or left and right images of the same moment: what is tracked fits both cameras only "
            f"within {residual_px:.1f} px (median)",
        )
    if tracked_share < _ENOUGH_TRACKED:
        faults += tuple(_by_counts(recording, sample, mode, counts))
    elif not faults:
        return None
    return Diagnosis(dict(counts), faults)


def fault_of_unit(view: StereoView, unit_m: float) -> Iterator[str]:
    """An implausible distance of the cameras, with the units of the calibration, now `unit_m`, that make it usual."""
    baseline = float(np.linalg.norm(view.right.center - view.left.center))
    widest = 2 * _FARTHEST_M * np.sin(view.axes_angle_rad / 2)
    if not BASELINE_M[0] <= baseline <= max(BASELINE_M[1], widest):
        low, high = _USUAL_BASELINE_M
        apart_m = {unit: baseline / unit_m * unit for unit in _UNITS_M}
        units = [f"; --unit-m {unit:g} makes it {length(m)}" for unit, m in apart_m.items() if low <= m <= high]
        yield f"another calibration or --unit-m: the cameras are {length(baseline)} apart{''.join(units)}"


def faults_of(
    recording: Recording, turn_deg: tuple[float, float] = (0.0, 0.0), sample: FrameSample | None = None
) -> Iterator[str]:
    """Faults of the images, the calibration and the joints, independent of the object."""
    sample = sample or FrameSample.of(recording)
    frames = sample.spread
    if not frames:
        return
    if len(recording) == 1:
        yield "a longer recording: there is a single pair"
    elif not _SLOWEST <= recording.fps <= _FASTEST:
        many = "too few to follow a motion from one to the next" if recording.fps < _SLOWEST else "too many"
        yield (
            f"--times-unit, --fps or other stamps: there are {recording.fps:.2g} pairs/s, {many}, if the stamps are "
            "right"
        )
    if all(np.array_equal(frame.left, frame.right) for frame in frames):
        yield "other images: left and right are the same in every frame (the patterns --left and --right?)"
    elif isinstance(image := recording.pairs[0][0], Half) and _one_image(frames, image):
        yield (
            "two videos, or one of a stereo camera, or another --layout: the halves of the images continue each other "
            "and show hardly anything in common, as those of one camera do"
        )
    grey = max(float(np.mean(image)) for frame in frames for image in (frame.left, frame.right))
    if grey < _DARK:
        yield f"more light or exposure: the mean grey level is {grey:.1f} of 255"
    if recording.rig is not None:
        view = recording.rig.view_of(frames[0])
        by_joints = recording.robot is not None
        of_joints = list(faults_of_joints(frames, recording.rig)) if by_joints else []
        yield from of_joints or faults_by_points(frames[::_MATCHED], recording.rig, by_joints, sample.match)
        left = recording.rig.left
        if left.field_of_view_deg > _WIDEST_DEG and not left.fisheye:
            yield f"another calibration: the left camera's field of view is {left.field_of_view_deg:.0f}°"
        yield from fault_of_unit(view, recording.unit_m)
    changes = sample.changes
    if np.median([0.0, *(combed_share for _, combed_share in changes)]) > _COMBED:
        yield (
            "a video without interlacing (ffmpeg -i FILE -vf bwdif OUT): every second row of what moves shows another "
            "moment, though the file does not say so"
        )
    if turn_deg[0] > 0:
        yield (
            f"cameras that rest, or a recording with joints: the cameras move although declared fixed, by up to "
            f"{turn_deg[0]:.2g}° at {turn_deg[1]:.2g}°/s; only their rotation is compensated"
        )
    elif recording.robot is None and (shift_px := _image_shift_px(changes)) > 0:
        yield (
            f"cameras that rest, or a recording with joints: the images shift by {shift_px:.1f} px a frame: "
            "do the cameras move?"
        )
    joints = [q for frame in frames for q in (frame.joints_left_rad, frame.joints_right_rad) if q is not None]
    if joints and np.max(np.abs(np.rad2deg(joints))) <= _RADIANS:
        yield "joints in degrees: no joint in the logs is beyond ±3.14, as if they were in radians"


def _one_image(frames: Sequence[StereoFrame], half: Half) -> bool:
    """Whether left and right images are the halves of one image rather than two views of a scene."""
    wholes = [np.concatenate([f.right, f.left] if half.is_second else [f.left, f.right], half.axis) for f in frames]
    steps = [np.abs(np.diff(w.astype(float), axis=half.axis)).mean(axis=(1 - half.axis, 2)) for w in wholes]
    seams = [step[len(step) // 2] / max(np.median(step), 1.0) for step in steps]
    matches = [len(match(frame.left, frame.right)[0]) for frame in frames]
    return bool(np.median(seams) < _CONTINUES and np.median(matches) < _IN_COMMON)


def _by_counts(recording: Recording, sample: FrameSample, mode: Mode, counts: Mapping[str, int]) -> Iterator[str]:
    """Likely causes from the counts of the search, and from a change of the whole image."""
    successive = sample.successive
    in_both = counts.get("candidates_left", 0) and counts.get("candidates_right", 0)
    if recording.robot is None and _change(successive) > _WHOLE_IMAGE:
        yield "cameras that rest, or a recording with joints: the whole image changes from frame to frame"
    elif not counts.get("frames"):
        yield "other images: every frame is dark, plain or the same as the one before"
    elif mode == "marker" and not in_both:
        yield "--mode generic: no blob of the marker's green is in both images"
    elif mode == "generic" and not counts.get("motion_left"):
        if not successive or (recording.robot is None and _image_shift_px(sample.changes)):
            pass  # it was not searched, and a single pair or the cameras' motion is a fault
        elif _moved_share(successive) < _MOVED_SHARE:
            yield "--mode marker for a green marker, or a faster object: nothing moves against the scene"
        elif _SLOWEST <= recording.fps <= _FASTEST:
            yield "a larger object, nearer or of more contrast: what changes in the images is too little to be followed"
    elif mode == "generic" and not counts.get("motion_right"):
        yield (
            "the calibration and the order of the images: what moves in the left image does not in the right one; "
            "the two may also show different moments"
        )
    rejected = _rejections(counts)
    if rejected:
        most = max(rejected, key=rejected.__getitem__).removeprefix("rejected by ")
        yield {
            "colour": "the same exposure and white balance for both cameras: candidates differ in colour",
            "size": "an object that both cameras see whole: candidates differ in size",
        }.get(
            most,
            f"--left and --right exchanged, or another calibration: candidates are refused by {most}; "
            "left and right may also show different moments",
        )
    elif in_both:
        yield "a longer recording: candidates were found, but not in enough frames in a row"
    elif counts.get("motion_right"):
        yield "an object whose colours stand out from its surroundings: what moves has no outline"


def _rejections(counts: Mapping[str, int]) -> dict[str, int]:
    return {reason: count for reason, count in counts.items() if reason.startswith("rejected by ")}


def _image_shift_px(changes: Sequence[tuple[float, float]]) -> float:
    """Second largest shift between successive left images of fixed cameras."""
    return sorted([0.0, 0.0, *(shift_px for shift_px, _ in changes)])[-2]


def _change_between(first: Image, second: Image) -> tuple[float, float]:
    return _shift_px(first, second), _combed_share(first, second)


def _shift_px(first: Image, second: Image) -> float:
    """Shift between two images (phase correlation, Kuglin and Hines 1975).

    0 for less than half a pixel, and for a shift that does not explain the change of most pixels.
    """
    a, b = (cv2.transform(image.astype(np.float32), np.full((1, 3), 1 / 3)) for image in (first, second))
    window = cv2.createHanningWindow((a.shape[1], a.shape[0]), cv2.CV_32F)
    (x, y), _ = cv2.phaseCorrelate(window * a, window * b)  # its argument `window` modifies the images
    moved = np.roll(a, (round(y), round(x)), axis=(0, 1))
    explains = np.median(np.abs(b - moved)) < _EXPLAINED * np.median(np.abs(b - a))
    return float(np.hypot(x, y)) if explains else 0.0


def _combed_share(first: Image, second: Image) -> float:
    """Share of the changing pixels that are unlike the rows above and below, and like the rows beyond these."""
    before, after = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.int16) for image in (first, second))
    rows = after[2:-2]
    off = np.stack([rows - after[1:-3], rows - after[3:-1]])
    step = (off * np.sign(off[0])).min(axis=0)
    beyond = np.maximum(np.abs(rows - after[:-4]), np.abs(rows - after[4:]))
    combed = (2 * step > _MOVED) & (2 * beyond < step)
    moved = np.abs(rows - before[2:-2]) > _MOVED
    return float(np.mean(combed[moved])) if np.mean(moved) > _MOVED_SHARE else 0.0


def _change(successive: list[tuple[StereoFrame, StereoFrame]]) -> float:
    """Median change of the left image's pixels from a frame to the next, grey levels of 255."""
    changes = [np.median(np.abs(b.left.astype(float) - a.left)) for a, b in successive]
    return float(np.median(changes)) if changes else 0.0


def _moved_share(successive: list[tuple[StereoFrame, StereoFrame]]) -> float:
    """Largest share of the pixels of either image that change from a frame to the next."""
    changes = [
        np.mean(np.abs(getattr(b, side).astype(np.int16) - getattr(a, side)).max(axis=2) > _MOVED)
        for a, b in successive
        for side in ("left", "right")
    ]
    return float(max(changes, default=0.0))
