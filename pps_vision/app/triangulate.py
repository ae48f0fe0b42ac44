"""Points that another detector has found in both images, to 3D paths: `pps_vision.triangulate`."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from pps_vision.app.clock import numbers
from pps_vision.app.diagnosis import fault_of_unit
from pps_vision.app.points import Pairs, PointParams, estimate_noise, follow_points, reprojection, triangulate_points
from pps_vision.app.results import TrackNumbers, TrackSummary
from pps_vision.app.stamp_delay import ClockParams, Interpolator, PointPath, estimate_delay
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.app.track import TrackArrays, track_arrays
from pps_vision.errors import InputError, expect_kinds
from pps_vision.geometry.camera import StereoRig, sight
from pps_vision.recordings import MAX_SKEW_S, CalibrationOptions, Clock, TimeUnit
from pps_vision.recordings.exchange import TrackedPair
from pps_vision.recordings.point_tables import PointTable, read_points
from pps_vision.recordings.source import CalibrationArguments, Names, expect_skew
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.recordings.times import read_times
from pps_vision.recordings.warnings import Problem, ProblemKind, count_by_kind
from pps_vision.types import Array, Detection2D, Status, Track3D
from tracking import DEFAULT_ORDER
from tracking.kalman import KalmanParams
from tracking.smoother import FilterStep, smooth
from tracking.tracker import full_state

_OUTSIDE = 0.05  # share of points outside the image, which a detector does not place there


class TriangulatedPoints:
    """The 3D paths of named points, in the frame of the left camera.

    Attributes:
        names: Names of the points; number k of `tracks` and files is k + 1.
        stamps_s: (n,) stamps of the pairs.
        noise: Noise of the image points, from their epipolar residuals.
        clock: Delay of the right camera's stamps, None where it was not asked for.
        problems: Images and names without a partner, which are left out.
        stopwatch: Time of triangulation and filter.
    """

    def __init__(
        self,
        left: PointTable,
        right: PointTable,
        rig: StereoRig,
        params: PointParams,
        max_skew_s: float = MAX_SKEW_S,
        clock: ClockParams | None = None,
        points: Sequence[str] = (),
        warnings: Sequence[str] = (),
    ) -> None:
        """Triangulate and filter the `points` (default: all) of two tables with stamps; with `clock` correct their
        delay first; `warnings`: of the input."""
        self.tables = left, right
        self._of_input = warnings
        self.params = params
        self.view = rig.view()
        self.problems: list[Problem] = []
        self.stopwatch = Stopwatch()
        columns = self._columns(left, right, points)
        self.names = tuple(left.names[k] for k, _ in columns)
        paths = [(_path(left, a), _path(right, b)) for a, b in columns]
        self.clock = None if clock is None else estimate_delay(clock, self.view, paths)
        if self.clock and self.clock.is_late:
            right = _resampled(right, left.times + self.clock.at(left.times), left.times)
        rows = _paired(left, right, max_skew_s, self.problems)
        self.stamps_s = 0.5 * (left.times[rows[:, 0]] + right.times[rows[:, 1]])
        with self.stopwatch("total", len(rows)):
            self.points = [_pairs((left, right), rows, both) for both in columns]
            self.noise = estimate_noise(params, self.view, self.points)
            self._positions = [triangulate_points(params, self.view, item, self.noise) for item in self.points]
            filtering = params, self.view.centers, self.stamps_s
            self._steps = [follow_points(*filtering, item, self.noise.correlated_share) for item in self._positions]

    def _columns(self, left: PointTable, right: PointTable, chosen: Sequence[str]) -> list[tuple[int, int]]:
        """Columns of the names in both tables; names of one are left out, unless each table has only one."""
        for table, other in ((left, right), (right, left)):
            if unknown := [name for name in chosen if name not in table.names]:
                raise InputError(table.file, f"no point {unknown[0]}; expected one of {', '.join(table.names)}")
            missing = [name for name in table.names if name not in other.names]
            if missing and not len(left.names) == len(right.names) == 1:
                message = f"{', '.join(missing)} not in {other.file}; expected each name in both"
                self.problems.append(Problem(ProblemKind.UNPAIRED, table.file, None, message, len(missing)))
        if len(left.names) == len(right.names) == 1:
            return [(0, 0)]
        both = [name for name in dict.fromkeys(chosen or left.names) if name in right.names]
        if not both:
            names = f"names {', '.join(right.names)[:100]}, not those of {left.file}: {', '.join(left.names)[:100]}"
            raise InputError(right.file, f"{names}; expected a name that both have")
        return [(left.names.index(name), right.names.index(name)) for name in both]

    def arrays(self, name: str | None = None, smooth: bool = False) -> TrackArrays:
        """Return the path of a point, by default the first; with `smooth` corrected by later measurements (RTS).

        InputError for a name that there is not.
        """
        if name is not None and name not in self.names:
            raise InputError("points", f"no point {name}; expected one of {', '.join(self.names)}")
        return track_arrays(self._tracks(0 if name is None else self.names.index(name), smooth))

    def pairs(self, smooth: bool = False) -> Iterator[TrackedPair]:
        """Yield the tracks of all points at each pair, in the order of their names."""
        tracks = [list(self._tracks(k, smooth)) for k in range(len(self.names))]
        images = self.tables[0].file, self.tables[1].file
        for row in range(len(self.stamps_s)):
            items = [
                TrackedPair(images, track[row], self._detections(k, row), float(self._positions[k].residual_px[row]))
                for k, track in enumerate(tracks)
            ]
            yield replace(items[0], others=tuple(items[1:]))

    def _tracks(self, k: int, smoothed: bool) -> Iterator[Track3D]:
        """The tracks of a point."""
        steps = self._steps[k]
        beliefs = [None if step is None else step.belief for step in steps]
        if smoothed:
            begins = [i for i in range(len(steps)) if steps[i] and (i == 0 or not steps[i - 1])]
            for begin in begins:
                end = next((i for i in range(begin, len(steps)) if not steps[i]), len(steps))
                beliefs[begin:end] = smooth([step for step in steps[begin:end] if step])
        for i, (step, belief, stamp_s) in enumerate(zip(steps, beliefs, self.stamps_s.tolist(), strict=True)):
            if step is None or belief is None:
                was_known = i > 0 and steps[i - 1] is not None
                yield Track3D.unknown(stamp_s, Status.LOST if was_known else Status.SEARCHING, k + 1)
                continue
            ahead = sight(self.view.centers, belief.mean[0])
            state = full_state(belief.mean, belief.cov, step.belief.correlated_cov, ahead, 0.0, self.params.aspect_rad)
            status = Status.TRACKING if _is_measured(step) else Status.COASTING
            yield Track3D(stamp_s, *state, np.nan, np.nan, status, k + 1)

    def _detections(self, k: int, row: int) -> tuple[Detection2D, ...]:
        """The points of a pair in the images that show them."""
        points, cov = self.points[k], self._positions[k].cov_px2
        return tuple(
            Detection2D(
                float(self.stamps_s[row]),
                "right" if side else "left",
                points.pixels[row, side],
                cov[row, side],
                float(points.likelihood[row, side]),
                np.nan,
                (*points.pixels[row, side].tolist(), 0.0, 0.0),
            )
            for side in range(2)
            if np.isfinite(points.pixels[row, side, 0])
        )

    @cached_property
    def numbers(self) -> list[TrackNumbers]:
        """Results of each point: counts, outliers, and the check of each camera by the filter's prediction."""
        return [self._numbers(k) for k in range(len(self.names))]

    def _numbers(self, k: int) -> TrackNumbers:
        steps = self._steps[k]
        positions = self._positions[k]
        known = [i for i, step in enumerate(steps) if step]
        is_measured = np.array([step is not None and _is_measured(step) for step in steps])
        is_found = np.isfinite(positions.residual_px)
        eyes = {"left": self.view.left, "right": self.view.right}
        white = (1 - self.noise.correlated_share) * positions.cov_px2
        checks = {
            name: reprojection(eye, steps, self.points[k].pixels[:, side], white[:, side])
            for side, (name, eye) in enumerate(eyes.items())
        }
        return {
            "track_id": k + 1,
            "name": self.names[k],
            "first_s": float(self.stamps_s[known[0]]) if known else 0.0,
            "last_s": float(self.stamps_s[known[-1]]) if known else 0.0,
            "attended": len(known) if k == 0 else 0,
            "tracking": int(is_measured.sum()),
            "coasting": len(known) - int(is_measured.sum()),
            "outliers": int(positions.is_gated.sum() + np.sum(is_found & ~is_measured)),
            "residual_px": float(np.median(positions.residual_px[is_found])) if is_found.any() else None,
            "reprojection": checks,
        }

    def summary(self) -> TrackSummary:
        """Return the settings and results, for summary.json."""
        statuses = [track.status for track in self._tracks(0, False)]
        noise = self.noise
        content: TrackSummary = {
            "source": str(self.tables[0].file),
            "mode": "points",
            "reduction": 1,
            "device": None,
            "seed": 0,
            "pairs": len(self.stamps_s),
            "frames": len(self.stamps_s),
            "status": {kind.value: statuses.count(kind) for kind in Status},
            "followed_by": {},
            "ms_per_pair": self.stopwatch.summary(),
            "cameras": {"baseline_m": float(np.linalg.norm(self.view.right.center - self.view.left.center))},
            "skipped": count_by_kind(self.problems),
            "warnings": self.warnings,
            "residual_px": self.numbers[0]["residual_px"],
            "tracks": self.numbers,
            "points": {
                "likelihood_up_to": noise.likelihoods[np.isfinite(noise.likelihoods)].tolist(),
                "std": noise.std.tolist(),
                "correlated_share": noise.correlated_share,
                "inside_gate": noise.inside,
                "pairs": noise.pairs,
            },
        }
        if self.clock:
            content["clock"] = numbers(self.clock)
        return content

    @property
    def warnings(self) -> list[str]:
        """Probable mistakes in the points or the calibration."""
        noise = self.noise
        found = list(self._of_input)
        for table, eye in zip(self.tables, (self.view.left, self.view.right), strict=True):
            pixels = table.pixels[np.isfinite(table.pixels[..., 0])]
            size = eye.camera.width, eye.camera.height
            outside = float(np.any((pixels < -0.5) | (pixels > np.array(size) - 0.5), axis=1).mean())
            if outside > _OUTSIDE:
                image = f"{size[0]}×{size[1]} pixels"
                found.append(f"{100 * outside:.0f} % of the points of {table.file} are outside the image of {image}")
        if noise.inside < 0.5 * noise.pairs:
            share = f"{100 * (1 - noise.inside / noise.pairs):.0f} % of {noise.pairs} pairs of points"
            found.append(f"{share} do not fit one 3D point: are names, frames and cameras those of the calibration?")
        if noise.correlated_share > 0.5:
            std_px = float(np.median(noise.std)) * noise.correlated_share**0.5
            how = "in the same way in successive images: calibration, clock (--clock auto), or detector"
            found.append(f"the points of both images miss each other by {std_px:.2g} px (σ) {how}")
        return found


def _is_measured(step: FilterStep) -> bool:
    return step.belief.updated_s == step.belief.stamp_s


def _pairs(tables: tuple[PointTable, PointTable], rows: NDArray[np.intp], columns: tuple[int, int]) -> Pairs:
    """The points of one name at the pairs of rows (n, 2)."""
    places = list(zip(tables, rows.T, columns, strict=True))
    uu, uv, vv = np.moveaxis(np.stack([table.cov_px2[row, k] for table, row, k in places], axis=1), -1, 0)
    stated = np.moveaxis(np.array([[uu, uv], [uv, vv]]), (0, 1), (-2, -1))
    is_stated = (uu > 0) & (uu * vv > uv**2)
    return Pairs(
        np.stack([table.pixels[row, k] for table, row, k in places], axis=1),
        np.stack([table.likelihood[row, k] for table, row, k in places], axis=1),
        np.where(is_stated[..., None, None], stated, np.eye(2)),
    )


def _path(table: PointTable, column: int) -> PointPath:
    known = np.isfinite(table.pixels[:, column, 0])
    return PointPath(table.times[known], table.pixels[known, column])


def _resampled(table: PointTable, at_s: Array, stamps_s: Array) -> PointTable:
    """The table at other times by its own stamps, which `stamps_s` (n,) call; of likelihood and covariance the nearest
    row's."""
    rows = _nearest(table.times, at_s)
    pixels = np.full((len(at_s), len(table.names), 2), np.nan)
    for k in range(len(table.names)):
        if len((path := _path(table, k)).stamps_s) > 1:
            pixels[:, k] = Interpolator(path, ClockParams().gap_frames)(at_s)
    likelihood, cov_px2 = table.likelihood[rows], table.cov_px2[rows]
    return replace(table, times=stamps_s, pixels=pixels, likelihood=likelihood, cov_px2=cov_px2)


def _stamped(table: PointTable, fps: float | None, file: Path | None, unit: TimeUnit | None) -> PointTable:
    """The table with stamps for its frames, at a rate or from a file; InputError without either."""
    if table.has_stamps:
        return table
    if fps:
        return replace(table, times=table.times / fps, has_stamps=True)
    if file is None:
        raise InputError(table.file, "has frames, no stamps; expected --fps RATE or --times FILE")
    seconds = np.array(read_times(file, unit).seconds())
    first, last = table.times[[0, -1]]
    frames = table.times.astype(int)
    if not 0 <= first <= last < len(seconds) or np.any(frames != table.times):
        problem = f"{len(seconds)} stamps, frames {first:g} to {last:g} in {table.file}"
        raise InputError(file, f"{problem}; expected a stamp for each frame, whole numbers from 0")
    return replace(table, times=seconds[frames], has_stamps=True)


def _paired(left: PointTable, right: PointTable, max_skew_s: float, problems: list[Problem]) -> NDArray[np.intp]:
    """Rows (n, 2) of both tables that are each other's nearest in time; InputError if there are none."""
    a, b = left.times, right.times
    nearest = _nearest(b, a)
    is_pair = (_nearest(a, b)[nearest] == np.arange(len(a))) & (np.abs(b[nearest] - a) <= max_skew_s)
    rows = np.stack([np.flatnonzero(is_pair), nearest[is_pair]], axis=1)
    if not len(rows):
        reason = f"no image within {max_skew_s:g} s of one in {left.file}"
        raise InputError(right.file, f"{reason}; expected the same frames or stamps in both")
    for table in (left, right):
        if alone := len(table.times) - len(rows):
            message = f"{alone} images without a partner in the other table"
            problems.append(Problem(ProblemKind.UNPAIRED, table.file, None, message, alone))
    return rows


def _nearest(values: Array, to: Array) -> NDArray[np.intp]:
    """Index (m,) of the nearest of rising `values` (n,) for each of `to` (m,)."""
    after = np.clip(np.searchsorted(values, to), 1, max(len(values) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(values) - 1)
    return np.where(np.abs(values[before] - to) <= np.abs(values[after] - to), before, after)


def triangulate(
    left: Path | str,
    right: Path | str,
    *,
    calib: Names,
    size: tuple[int, int] | None = None,
    fps: float | None = None,
    times: Names = (),
    times_unit: TimeUnit | None = None,
    max_skew_s: float = MAX_SKEW_S,
    points: Sequence[str] = (),
    clock: Clock = "stamps",
    order: int = DEFAULT_ORDER,
    params: PointParams | None = None,
    **options: Unpack[CalibrationArguments],
) -> TriangulatedPoints:
    """Triangulate and filter the points that another detector has found in the images of two fixed cameras.

    Args:
        left: Table of the left camera: DeepLabCut, Lightning Pose, SLEAP, COCO, MOTChallenge, csv
            (`pps_vision.recordings.point_tables` says how).
        right: Table of the right camera.
        calib: Calibration, in one file or several.
        size: Width and height of the images, where the calibration does not state it, or they are of another.
        fps: Frames per second, for tables of frames.
        times: Stamps of the frames from 0 on, in one file, or one for each camera.
        times_unit: Unit of the stamps, where the files do not say it.
        max_skew_s: Largest difference of the stamps of a pair.
        points: Names of the points to use; default: all that both tables have.
        clock: "auto": estimate the delay and the drift of the right camera's stamps from the points, and correct them.
        order: Order of the Kalman filter, 1–4.
        params: All parameters; replaces `order`.
        options: As `CalibrationOptions`.

    Raises:
        InputError: A table or calibration cannot be read, or both tables share no name or no time.
    """
    kinds = CalibrationArguments.__annotations__ | triangulate.__annotations__
    expect_kinds("triangulate", locals() | options, kinds)
    expect_skew(max_skew_s)
    tables = read_points(Path(left), "left", times_unit), read_points(Path(right), "right", times_unit)
    files = [Path(calib)] if isinstance(calib, Path | str) else [Path(file) for file in calib]
    images = ([str(left)], [str(right)])
    left_camera, right_camera, T_left_right = read_stereo_calibration(
        files, size, CalibrationOptions(**options), images
    )
    rig = StereoRig.fixed(left_camera, right_camera, T_left_right)
    stamp_files = [Path(times)] if isinstance(times, Path | str) else [Path(file) for file in times]
    if not (len(stamp_files) <= (0 if fps else 2) and (fps is None or 0 < fps < np.inf)):
        given = f"--fps {fps}, {len(stamp_files)} files of --times"
        raise InputError("triangulate", f"{given}; expected a positive rate, or one file or two")
    is_one_clock = len(stamp_files) < 2 and not any(table.has_stamps for table in tables)
    first, second = stamp_files[0] if stamp_files else None, stamp_files[-1] if stamp_files else None
    stamped = (_stamped(tables[0], fps, first, times_unit), _stamped(tables[1], fps, second, times_unit))
    params = params or PointParams(KalmanParams.of_order(order))
    clock_params = ClockParams() if clock == "auto" else None
    warnings = [f"try {fault}" for fault in fault_of_unit(rig.view(), options.get("unit_m", 1.0))]
    if own := [str(table.file) for table in tables if table.has_stamps and (fps or stamp_files)]:
        warnings.append(f"--{'fps' if fps else 'times'} not used: {own[0]} has stamps of its own")
    chosen = (points,) if isinstance(points, str) else points
    skew_s = 0.0 if is_one_clock else max_skew_s
    return TriangulatedPoints(*stamped, rig, params, skew_s, clock_params, chosen, warnings)
