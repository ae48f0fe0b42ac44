"""Contents and faults of a recording, without tracking: `pps-vision info`."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pps_vision.app.clock import clocks
from pps_vision.app.diagnosis import faults_of
from pps_vision.app.scene_points import length, side_of
from pps_vision.recordings.recording import Recording
from pps_vision.recordings.warnings import count_by_kind

_GAP = 1.5  # times the median interval
_CLOCK_S = 10.0  # from its beginning, in which the clocks are compared
_LOOKED_AT = 200  # pairs, spread over the recording, whose camera poses are compared
_RESTING_DEG = 0.05  # turn of a camera below which it rests: the resolution of an encoder


@dataclass(frozen=True)
class RecordingInfo:
    """Contents of a recording; `warnings` name missing or implausible data, and remedies."""

    source: str
    pairs: int
    image_size: tuple[int, int]  # width and height of the left images, px
    right_size: tuple[int, int]
    duration_s: float
    pairs_per_s: float  # by the median interval; NaN for a single pair
    gaps: int  # intervals of more than 1.5 times the median one
    longest_interval_s: float
    skew_median_ms: float  # stamp of the right image minus that of the left one
    skew_largest_ms: float
    clocks: str  # delays of the right camera and of the joints, by the images of at most 10 s; empty: no calibration
    robot: bool  # whether it holds the joints of a robot
    cameras_turn_deg: float  # largest turn of the left camera from its first pose by the joints, 0 where there are none
    baseline_m: float  # distance of the cameras; NaN without a calibration
    right_camera: str  # where it lies from the left one: "to the right of", "below", …
    focal_px: float
    field_of_view_deg: float  # horizontal, of the left camera
    touches: int
    truth_rows: int
    skipped: dict[str, int]
    calibration_at: str  # where a calibration is expected; empty with one
    notes: tuple[str, ...]  # how the files were read
    warnings: tuple[str, ...]

    def __str__(self) -> str:
        left, right = (f"{width}×{height}" for width, height in (self.image_size, self.right_size))
        sizes = left if left == right else f"{left} and {right}"
        rows = [
            f"{self.source}: {self.pairs} pairs of {sizes} pixels, {self.duration_s:.2f} s at "
            f"{self.pairs_per_s:.4g} pairs/s",
            f"intervals: longest {1000 * self.longest_interval_s:.1f} ms, {self.gaps} gaps",
            f"right minus left stamp: median {self.skew_median_ms:+.2f} ms, largest {self.skew_largest_ms:.2f} ms "
            "(only stamps are compared: the rows of the clocks compare the images)",
            *self.clocks.splitlines(),
        ]
        if np.isfinite(self.baseline_m):
            rows.append(
                f"cameras: the right one lies {length(self.baseline_m)} {self.right_camera} the left one (measure it: "
                "all lengths scale with it), "
                f"focal length {self.focal_px:.1f} px, field of view {self.field_of_view_deg:.0f}°"
            )
        else:
            rows.append(f"missing: calibration; expected {self.calibration_at}")
        turn = self.cameras_turn_deg
        moved = f"with joints, by which the left camera turns up to {turn:.2f}°" if self.robot else "declared fixed"
        rows += [f"motion of the cameras: {moved}", f"touches: {self.touches}; rows of truth: {self.truth_rows}"]
        rows += [*self.notes, *(f"skipped: {n} {kind}" for kind, n in self.skipped.items() if n)]
        return "\n".join([*rows, *(f"warning: {warning}" for warning in self.warnings)])


def info(recording: Recording) -> RecordingInfo:
    """Return the contents of a recording; a few images are read, and the first 10 s."""
    left, right = (np.array([pair[side].stamp_s for pair in recording.pairs]) for side in (0, 1))
    steps = np.diff(left)
    skews_ms = 1000 * (right - left)
    usual_s = float(np.median(steps)) if len(steps) else np.nan
    baseline_m = focal_px = field_deg = np.nan
    right_camera = ""
    if recording.rig is not None:
        view = recording.rig.view(recording.pairs[0][0].joints_rad, recording.pairs[0][1].joints_rad)
        baseline_m = float(np.linalg.norm(view.right.center - view.left.center))
        right_camera = side_of(view)
        focal_px = recording.rig.left.fx
        field_deg = recording.rig.left.field_of_view_deg
    gaps = int(np.sum(steps > _GAP * usual_s))
    advice = tuple(_advice(recording, float(np.median(skews_ms)), usual_s, gaps))
    return RecordingInfo(
        source=recording.name,
        pairs=len(recording),
        image_size=recording.image_sizes[0],
        right_size=recording.image_sizes[1],
        duration_s=float(left[-1] - left[0]),
        pairs_per_s=1 / usual_s if usual_s > 0 else np.nan,
        gaps=gaps,
        longest_interval_s=float(np.max(steps)) if len(steps) else np.nan,
        skew_median_ms=float(np.median(skews_ms)),
        skew_largest_ms=float(np.max(np.abs(skews_ms))),
        clocks=str(clocks(recording.part(stop_s=_CLOCK_S, roi=recording.roi))) if recording.rig else "",
        robot=recording.robot is not None,
        cameras_turn_deg=_turn_deg(recording),
        baseline_m=baseline_m,
        right_camera=right_camera,
        focal_px=focal_px,
        field_of_view_deg=field_deg,
        touches=sum(bool(touch.taxel_ids) for touch in recording.touches),
        truth_rows=len(recording.truth),
        skipped=count_by_kind(recording.problems),
        calibration_at="" if recording.rig else recording.calibration_at,
        notes=recording.notes,
        warnings=(*recording.warnings, *(f"try {action}" for action in advice)),
    )


def _advice(recording: Recording, skew_ms: float, usual_s: float, gaps: int) -> Iterator[str]:
    """Remedies for implausible stamps, and for the faults of the recording."""
    if abs(skew_ms) > 250 * usual_s:  # a quarter of an interval
        yield f"cameras triggered together: the right image is {skew_ms:+.1f} ms from the left one"
    if gaps:
        yield f"a recorder that keeps up: {gaps} intervals are longer than {_GAP} times the median one"
    yield from faults_of(recording)


def _turn_deg(recording: Recording) -> float:
    """Largest turn of the left camera from its first pose."""
    if recording.robot is None:
        return 0.0
    chosen = np.unique(np.linspace(0, len(recording) - 1, _LOOKED_AT).astype(int))
    R = np.array([recording.robot.eye_poses(recording.pairs[k][0].joints_rad)[0][:3, :3] for k in chosen])
    cosines = (np.trace(R[0].T @ R, axis1=1, axis2=2) - 1) / 2
    turn_deg = float(np.rad2deg(np.arccos(np.clip(cosines.min(), -1, 1))))
    return turn_deg if turn_deg > _RESTING_DEG else 0.0
