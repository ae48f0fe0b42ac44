"""The CSV tables that pps_vision writes and reads: a header, then numbers with full precision.

An empty field is a number that does not exist, such as the position of an unknown object.  A text that a spreadsheet
would take for a formula begins with an apostrophe, which reading takes off.
"""

import csv
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pps_vision.errors import InputError, first_line
from pps_vision.recordings.text import finite, first_row, number, read_lines
from pps_vision.recordings.warnings import Problem, ProblemKind
from pps_vision.types import Array, Detection2D, Reachability, Track3D, Truth

Box = tuple[float, float, float, float]
"""x, y of the top-left corner, width, height, px."""

DETECTIONS = (
    *("frame", "stamp_s", "camera", "u_px", "v_px", "cov_uu_px2", "cov_uv_px2", "cov_vv_px2", "score", "status"),
    "track_id",
)
COVARIANCE = ("cov_xx_m2", "cov_xy_m2", "cov_xz_m2", "cov_yy_m2", "cov_yz_m2", "cov_zz_m2")
TRAJECTORY = (
    *("stamp_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", *COVARIANCE, "radius_m", "status"),
    *("sigma_x_m", "sigma_y_m", "sigma_z_m", "radius_95_m", "track_id"),
)
GAZE = ("yaw_deg", "pitch_deg", "vergence_deg")
REACHABILITY = (*(f"gaze_{name}" for name in GAZE), "reach_probability", "reach_degree", "reach_status")
ACTIVATION = "activation.csv"
BOXES = ("frame", "x", "y", "w", "h", "score")
TRUTH = (
    *("stamp_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "radius_m"),
    *("u_left_px", "v_left_px", "u_right_px", "v_right_px", "visible_left", "visible_right"),
)
JOINT_OFFSETS = ("joint", "offset_deg")

CHI2_95 = 7.814727903251179  # 95 % of the chi-square distribution with 3 degrees of freedom
_FORMULA = re.compile(r"^(?='*[=+\-@\t\r])")  # the beginning of a text that gets an apostrophe more
_QUOTED = re.compile(r"^'('*[=+\-@\t\r])")
_MAX_OFFSET_DEG = 90.0  # an encoder that is further off is a typing error


def write_table(file: Path, columns: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a header and rows; a float with all its digits, NaN empty, a truth value as 0 or 1."""
    with open_table(file, columns) as add:
        for row in rows:
            add(row)


@contextmanager
def open_table(file: Path, columns: Sequence[str]) -> Iterator[Callable[[Iterable[object]], None]]:
    """A function that writes one row, as `write_table`, below the header of a new table."""
    with file.open("w", newline="", encoding="utf-8", errors="surrogateescape") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(columns)
        yield lambda row: table.writerow([_field(value) for value in row])


def read_table(file: Path, columns: Sequence[str], exact: bool = False) -> list[tuple[int, list[str]]]:
    """Return the line number and the fields of `columns` for each row that is not empty; other columns are ignored.

    A field that is missing at the end of a row is empty; `exact`: spaces around a field belong to it.  InputError where
    the file cannot be read, a column is missing or comes twice, or a row has more fields than the header, as decimal
    commas make.
    """
    rows = csv_rows(file, f"a table of {columns[0]} …", exact)
    header = rows[0][1] if rows else []
    if missing := [name for name in columns if name not in header]:
        raise InputError(file, f"no column {', '.join(missing)}; expected {','.join(columns)}", 1)
    if doubled := [name for name, n in Counter(header).items() if name and n > 1]:
        raise InputError(file, f"column {', '.join(doubled)} again; expected each name once", 1)
    places = [header.index(name) for name in columns]
    for line, row in rows:
        if len(row) > len(header):
            reason = f"{len(row)} fields under {len(header)} columns"
            raise InputError(file, f"{reason}; expected a field for each column, and points in numbers", line)
    return [(line, [row[k] if k < len(row) else "" for k in places]) for line, row in rows[1:] if row]


def csv_rows(file: Path, expected: str, exact: bool = False) -> list[tuple[int, list[str]]]:
    """The number of its last line and the fields of each row, stripped unless `exact`; InputError, ending in
    `expected`, for a file that cannot be read."""
    lines = read_lines(file, expected, "surrogateescape" if exact else "replace")
    reader = csv.reader(f"{line}\n" for line in lines)
    try:
        rows = [(reader.line_num, [_QUOTED.sub(r"\1", field) for field in row]) for row in reader]
    except csv.Error as error:
        raise InputError(file, f"cannot be read: {first_line(error)}; expected {expected}", reader.line_num) from error
    return rows if exact else [(line, [field.strip() for field in row]) for line, row in rows]


def column_names(file: Path) -> list[str]:
    """The fields of a file's first row, the columns' names if it is a table; none where it cannot be read."""
    return [name.strip() for name in next(csv.reader([first_row(file)]), [])]


def numbers(file: Path, line: int, row: Sequence[str]) -> list[float]:
    """The numbers of a row's fields, NaN for an empty one; InputError for another that is no finite number."""
    try:
        return [finite(field) if field and field.lower() != "nan" else np.nan for field in row]
    except ValueError as error:
        raise InputError(file, f"{error}; expected finite numbers", line) from None


def covariances(fields: Array) -> Array:
    """(n, 3, 3) symmetric matrices of the fields (n, 6) of `COVARIANCE`."""
    return np.asarray(fields[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]])


def detection_row(frame: int, detection: Detection2D, track: Track3D) -> tuple[object, ...]:
    """A row of `DETECTIONS`: number of the frame, detection in one image, status and number of its track."""
    cov = detection.cov_px[np.triu_indices(2)]
    place = (*detection.center_px, *cov, detection.score)
    return (frame, detection.stamp_s, detection.camera, *place, track.status, track.track_id)


def trajectory_row(track: Track3D, reach: Reachability | None = None) -> tuple[object, ...]:
    """A row of `TRAJECTORY`, in the root frame; with its reachability of `TRAJECTORY` and `REACHABILITY`.

    radius_95_m is half the longest axis of the ellipsoid that holds the position with 95 %.
    """
    cov = track.cov[:3, :3]
    radius_95 = np.sqrt(CHI2_95 * np.linalg.eigvalsh(cov)[-1]) if np.isfinite(cov).all() else np.nan
    state = (track.stamp_s, *track.position, *track.velocity, *cov[np.triu_indices(3)], track.radius_m, track.status)
    row = (*state, *np.sqrt(np.diag(cov)), radius_95, track.track_id)
    return row if reach is None else (*row, *np.rad2deg(reach.gaze_rad), reach.probability, reach.degree, reach.status)


def attended_rows(rows: Sequence[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """The first row of each pair, which is that of the attended object, of rows that begin with their stamp."""
    stamps = ["", *(fields[0] for _, fields in rows)]
    return [row for row, last in zip(rows, stamps, strict=False) if not last or row[1][0] != last]


def write_boxes(file: Path, boxes: Iterable[tuple[int, Box, float]]) -> None:
    """Write frame number (the first image is 1), box in original pixels, and score."""
    write_table(file, BOXES, ((frame, *box, score) for frame, box, score in boxes))


def write_truth(file: Path, rows: Iterable[Truth]) -> None:
    """Write truth.csv, the true path of a rendered object."""
    with open_table(file, TRUTH) as add:
        for r in rows:
            pixels = (*r.left_px, *r.right_px, r.visible_left, r.visible_right)
            add((r.stamp_s, *r.position, *r.velocity, r.radius_m, *pixels))


def read_truth(file: Path, problems: list[Problem]) -> tuple[Truth, ...]:
    """The rows of truth.csv; a bad row is added to `problems` and skipped."""
    rows = []
    for line, fields in read_table(file, TRUTH):
        try:
            rows.append(_truth(fields))
        except ValueError as error:
            problems.append(Problem(ProblemKind.ROW, file, line, first_line(error)))
    return tuple(rows)


def _truth(fields: list[str]) -> Truth:
    values = np.array([number(field) if field else np.nan for field in fields[:12]])
    if not np.all(np.isfinite(values[:8])):
        raise ValueError("stamp, position, velocity or radius is no number; expected finite ones")
    if not set(fields[12:]) <= {"0", "1"}:
        raise ValueError(f"visible {','.join(fields[12:])}; expected 0 or 1")
    visible = [field == "1" for field in fields[12:]]
    return Truth(float(values[0]), values[1:4], values[4:7], float(values[7]), values[8:10], values[10:12], *visible)


def write_joint_offsets(file: Path, joints: Sequence[str], offsets_rad: Array) -> None:
    """Write the offset to add to each joint's encoder."""
    write_table(file, JOINT_OFFSETS, zip(joints, np.rad2deg(offsets_rad), strict=True))


def read_joint_offsets(file: Path, joints: Sequence[str]) -> Array:
    """(n,) rad for these joints, 0 for those without a row.  InputError where a row names another joint, one again, or
    no offset within ±90°."""
    offsets: dict[str, float] = {}
    for line, (joint, text) in read_table(file, JOINT_OFFSETS):
        if joint not in joints or joint in offsets:
            raise InputError(file, f"joint {joint!r}; expected each of {', '.join(joints)} at most once", line)
        offsets[joint] = _degrees(file, line, joint, text)
        if not abs(offsets[joint]) <= _MAX_OFFSET_DEG:
            raise InputError(file, f"{joint} {text!r}; expected an offset within ±{_MAX_OFFSET_DEG:.0f} degrees", line)
    return np.deg2rad([offsets.get(joint, 0.0) for joint in joints])


def read_gaze(file: Path) -> Array:
    """(N, 3) rad gaze postures: neck yaw, neck pitch, vergence; NaN where the file says so."""
    rows = read_table(file, GAZE)
    degrees = [_degrees(file, line, name, text) for line, row in rows for name, text in zip(GAZE, row, strict=True)]
    return np.deg2rad(np.reshape(degrees, (-1, 3)))


def write_reachability(file: Path, rows: Iterable[Iterable[object]]) -> None:
    """Write gaze postures (degrees), each with 1 or 0 for reachable, probability and degree, empty where unknown."""
    write_table(file, (*GAZE, "reachable", "probability", "degree"), rows)


def _degrees(file: Path, line: int, name: str, text: str) -> float:
    try:
        return math.nan if text.lower() == "nan" else finite(text)
    except ValueError:
        raise InputError(file, f"{name} {text!r}; expected a number of degrees", line) from None


def _field(value: object) -> str:
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else repr(float(value))
    if isinstance(value, str):
        return _FORMULA.sub("'", value)
    return str(int(value)) if isinstance(value, bool | np.bool_) else str(value)


def write_parquet(file: Path, columns: Mapping[str, type], rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows with columns of str, int or float as Apache Parquet (extra `parquet`); None is a missing value."""
    pa = require_pyarrow()
    kinds = {str: pa.string(), int: pa.int64(), float: pa.float64()}
    schema = pa.schema([(name, kinds[kind]) for name, kind in columns.items()])
    encodable = [{key: _encodable(value) for key, value in row.items()} for row in rows]
    pa.parquet.write_table(pa.Table.from_pylist(encodable, schema=schema), file)


def _encodable(value: object) -> object:
    """A text with bytes of a file's name that are no UTF-8 escaped; other values unchanged."""
    return value.encode("utf-8", "backslashreplace").decode() if isinstance(value, str) else value


def require_pyarrow() -> Any:
    """The package that writes Parquet; InputError where it is not installed."""
    try:
        import pyarrow.parquet
    except ImportError as error:
        expected = "the extra: pip install 'pps-vision[parquet]'"
        raise InputError("batch", f"--parquet needs pyarrow; expected {expected}") from error
    return pyarrow
