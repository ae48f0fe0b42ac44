"""Statistics of a tracked path and of its cameras, against the truth where there is one."""

from array import array
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from pps_vision.app.results import Size, TrackNumbers
from pps_vision.recordings.exchange import TrackedPair
from pps_vision.types import Array, Status, Track3D, Truth
from tracking.camera_pose import CameraMotion

_WARM_UP = 10  # frames before errors count
_UNSEEN_S = 1.0  # from the first frame until a scene without fixed points is warned of
_MAX_TRUTH_AGE_S = 0.02  # between the stamps of a track and of its truth
UNSEEN = (
    "nothing in the images shows whether the cameras rest, as they are declared to; if they turn, positions are wrong"
)


class CameraStatistics:
    """Largest errors of the cameras' nominal poses over a recording."""

    def __init__(self, warn: Callable[[str], None] = lambda _: None) -> None:
        self.rotation_deg = 0.0  # largest rotation of cameras that are declared fixed
        self.rotation_deg_s = 0.0  # largest rate of this rotation
        self._warn = warn
        self._last: CameraMotion | None = None
        self._unseen_from_s: float | None = None

    def add(self, motion: CameraMotion, stamp_s: float) -> None:
        """Add a frame; the first rotation of fixed cameras is passed to `warn`, or that nothing shows it."""
        if motion.rotation_rad.any() and not self.rotation_deg:
            self._warn(
                f"the cameras move although declared fixed, at {stamp_s:.2f} s; only their rotation is compensated"
            )
        if motion.is_seen:
            self._unseen_from_s = None
        elif self._unseen_from_s is None:
            self._unseen_from_s = stamp_s
        elif stamp_s - self._unseen_from_s > _UNSEEN_S:
            self._warn(f"{UNSEEN}; expected walls or things with corners in view, or the cameras' joints")
            self._unseen_from_s = np.inf
        self.rotation_deg = max(self.rotation_deg, float(np.rad2deg(np.linalg.norm(motion.rotation_rad))))
        self.rotation_deg_s = max(self.rotation_deg_s, float(np.rad2deg(motion.rate_rad_s)))
        self._last = motion

    def summary(self) -> dict[str, float]:
        """Return the largest rotation and rate, and the delay of the joints at the end with its standard deviation;
        NaN: not seen."""
        is_seen = self._last is None or self._last.is_seen
        return {
            "rotation_deg": self.rotation_deg if is_seen else np.nan,
            "rotation_deg_s": self.rotation_deg_s if is_seen else np.nan,
            "joint_delay_ms": 1000 * self._last.delay_s if self._last else np.nan,
            "joint_delay_std_ms": 1000 * self._last.delay_std_s if self._last else np.nan,
        }


class TruePath:
    """The truth of a recording, to compare tracks with."""

    def __init__(self, truth: Sequence[Truth]) -> None:
        self._rows = sorted(truth, key=lambda row: row.stamp_s)
        self._stamps_s = np.array([row.stamp_s for row in self._rows])

    def errors_of(self, track: Track3D) -> tuple[float, float] | None:
        """Return position and velocity error of a known track, m and m/s; None without a truth at its stamp."""
        index = int(np.searchsorted(self._stamps_s, track.stamp_s))
        neighbours = self._rows[max(0, index - 1) : index + 1]
        if not neighbours:
            return None
        nearest = min(neighbours, key=lambda row: abs(row.stamp_s - track.stamp_s))
        age_s = track.stamp_s - nearest.stamp_s
        if not abs(age_s) < _MAX_TRUTH_AGE_S:
            return None
        error = track.position - (nearest.position + age_s * nearest.velocity)
        return float(np.linalg.norm(error)), float(np.linalg.norm(track.velocity - nearest.velocity))


class PathStatistics:
    """Counts and errors of a path, and the object's size; `add` keeps 40 bytes of each track."""

    def __init__(self, truth: Sequence[Truth] | TruePath = ()) -> None:
        self.stamps_s: tuple[float, ...] = ()  # of the first and the last track
        self.frames = 0  # number of tracks
        self.status = Counter[Status]()  # number of tracks by status
        self._truth = truth if isinstance(truth, TruePath) else TruePath(truth)
        self._tracking_errors = array("d")  # alternately position and velocity errors
        self._coasting_errors = array("d")
        self._radii = array("d")  # alternately radius and its standard deviation, where tracked
        self._residuals_px = array("d")

    @property
    def tracked_share(self) -> float:
        """Share of tracks with the status tracking."""
        return self.status[Status.TRACKING] / max(1, self.frames)

    @property
    def residual_px(self) -> float:
        """Median RMS reprojection error of the pairs that measured the position; NaN without any."""
        return float(np.median(self._residuals_px)) if self._residuals_px else np.nan

    def add(self, track: Track3D, residual_px: float = np.nan) -> None:
        """Add the next track, and the RMS reprojection error of its pair (NaN: not measured)."""
        self.stamps_s = (*self.stamps_s[:1], track.stamp_s)
        self.frames += 1
        self.status[track.status] += 1
        if track.status == Status.TRACKING:
            self._radii.extend((track.radius_m, track.radius_var_m2**0.5))
        if np.isfinite(residual_px):
            self._residuals_px.append(residual_px)
        if self.frames <= _WARM_UP or not track.is_known:
            return
        if errors := self._truth.errors_of(track):
            (self._tracking_errors if track.status == Status.TRACKING else self._coasting_errors).extend(errors)

    def size(self) -> Size:
        """Return the median diameter of the object where it is tracked, and its 95 % interval, m.

        The size errors of all frames have a common cause (the outline, the calibration), so that the median's error is
        that of a single frame.
        """
        radius_m, std_m = np.median(np.reshape(self._radii, (-1, 2)), axis=0)
        low_m = max(radius_m - 1.96 * std_m, 0.0)
        high_m = radius_m + 1.96 * std_m
        return {"diameter_m": 2 * float(radius_m), "low_95_m": 2 * float(low_m), "high_95_m": 2 * float(high_m)}

    def errors(self) -> dict[str, float]:
        """Return tracked share, RMS and median position error and RMS velocity error after the first ten frames.

        The errors are of the frames with status tracking; `position_rms_all_mm` is of all frames with a position,
        predicted ones (coasting) included.
        """
        tracking = np.reshape(self._tracking_errors, (-1, 2))
        coasting = np.reshape(self._coasting_errors, (-1, 2))
        n = self.frames - _WARM_UP
        return {
            "tracked_share": len(tracking) / n if n > 0 else np.nan,
            "position_rms_mm": 1000 * _rms(tracking[:, 0]),
            "position_rms_all_mm": 1000 * _rms(np.concatenate([tracking[:, 0], coasting[:, 0]])),
            "position_median_mm": 1000 * float(np.median(tracking[:, 0])) if len(tracking) else np.nan,
            "velocity_rms_m_s": _rms(tracking[:, 1]),
        }


class TracksStatistics:
    """Statistics of the attended object's path, and of each known track by its number."""

    def __init__(self, truth: Sequence[Truth] = ()) -> None:
        self._truth = TruePath(truth)
        self._has_truth = bool(truth)
        self.attended = PathStatistics(self._truth)
        self._tracks: dict[int, PathStatistics] = {}
        self._attended = Counter[int]()

    def __len__(self) -> int:
        return len(self._tracks)

    def add(self, pair: TrackedPair) -> None:
        """Add the tracks of the next pair."""
        self.attended.add(pair.track, pair.residual_px)
        for item in pair.objects:
            track = item.track
            if not track.is_known:
                continue
            path = self._tracks.setdefault(track.track_id, PathStatistics(self._truth))
            path.add(track, item.residual_px)
            self._attended[track.track_id] += item is pair

    def summary(self) -> list[TrackNumbers]:
        """Return the results of every track, the longest attended first."""
        return [self._numbers(track_id) for track_id, _ in self._attended.most_common()]

    def _numbers(self, track_id: int) -> TrackNumbers:
        path = self._tracks[track_id]
        numbers: TrackNumbers = {
            "track_id": track_id,
            "first_s": path.stamps_s[0],
            "last_s": path.stamps_s[-1],
            "attended": self._attended[track_id],
            "tracking": path.status[Status.TRACKING],
            "coasting": path.status[Status.COASTING],
            "residual_px": path.residual_px,
        }
        if path.tracked_share:
            numbers["object"] = path.size()
        if self._has_truth:
            numbers["errors"] = path.errors()
        return numbers


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan
