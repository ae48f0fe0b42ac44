"""Tables of image points that other detectors have found, of one camera each.

| form | recognised by | names of its points |
|---|---|---|
| DeepLabCut, Lightning Pose (csv) | three or four header rows, the last `coords` | body part, or individual:body part |
| SLEAP (analysis h5, extra `tables`; csv) | datasets `tracks`, `node_names`; columns `NAME.x` | node, or track:node |
| COCO (json) | annotations with `keypoints` or `bbox` | keypoint or "object", of several tracks track_id:keypoint |
| MOTChallenge (txt, csv) | no header; frame, id, left, top, width, height, … | the id; the point is the box's centre |
| wide csv, as Anipose's | columns `NAME_x`, `NAME_y`, perhaps `NAME_score` or `NAME_likelihood` | NAME |
| long csv, detections.csv | columns `u_px`, `v_px` (or u, v; x, y), perhaps name, likelihood | name or track_id |

Pixels are of the recorded image, distortion included; the centre of the first pixel is (0, 0), of MOTChallenge
(1, 1).  Frames are counted as the table does, of MOTChallenge from 0 on.  Stamps are in the unit of their column
(`stamp_s`, `time_ms`), or that which makes a usual rate.
"""

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, NamedTuple

import numpy as np

from pps_vision.errors import InputError, first_line
from pps_vision.files import check_regular, read_bytes
from pps_vision.recordings import TimeUnit
from pps_vision.recordings.tables import csv_rows, numbers
from pps_vision.recordings.times import Times
from pps_vision.types import Array, CameraName

_EXPECTED = (
    "a table of DeepLabCut, Lightning Pose, SLEAP, COCO or MOTChallenge, or a csv with stamp_s, name, u_px and v_px"
)
_HDF5 = b"\x89HDF\r\n\x1a\n"
_STAMP = re.compile(r"(?:stamps?|times?|timestamps?|t)(?:_(s|ms|us|ns))?")
_FRAMES = ("frame", "fnum", "frame_idx", "frame_id", "frame_number", "image_id", "")
_NAMES = ("name", "point", "bodypart", "keypoint", "node", "track_id", "track", "id")
_PIXELS = (("u_px", "v_px"), ("u", "v"), ("x_px", "y_px"), ("x", "y"))
_LIKELIHOODS = ("likelihood", "score", "confidence", "p", "prob")
_COVARIANCE = ("cov_uu_px2", "cov_uv_px2", "cov_vv_px2")
_WIDE = re.compile(r"(.+)[._](x|y|z|score|likelihood|confidence)")


class _Point(NamedTuple):
    """A row of any table; its line if it has one."""

    time: float  # frame or stamp
    name: str
    u: float
    v: float
    likelihood: float = np.nan
    cov: tuple[float, ...] = (np.nan, np.nan, np.nan)
    line: int | None = None


@dataclass(frozen=True)
class PointTable:
    """Image points of one camera: rows are its images in the order of time, columns the names.

    Attributes:
        file: Where it is from.
        names: Names of the points.
        times: (n,) frame numbers, or stamps (s).
        has_stamps: Whether `times` are stamps.
        pixels: (n, names, 2) px, NaN where a point was not found.
        likelihood: (n, names) the detector's own, NaN where it gives none.
        cov_px2: (n, names, 3) covariance uu, uv, vv, NaN where the table gives none.
    """

    file: Path
    names: tuple[str, ...]
    times: Array
    has_stamps: bool
    pixels: Array
    likelihood: Array
    cov_px2: Array


def read_points(file: Path, side: CameraName, unit: TimeUnit | None = None) -> PointTable:
    """Read a table of points; of one that holds both cameras' (detections.csv, coco.json) those of `side`.

    Args:
        file: The table.
        side: Its camera.
        unit: Unit of its stamps, where neither their column's name nor their rate says it.

    Raises:
        InputError: It is of no known form, a field is no number, or a point comes twice in a frame.
    """
    check_regular(file, _EXPECTED)
    with file.open("rb") as stream:
        begin = stream.read(64)
    has_stamps = False
    points: Iterable[_Point]
    if begin.startswith(_HDF5):
        points = _sleap_analysis(file)
    elif begin.lstrip(b"\xef\xbb\xbf \r\n\t")[:1] in (b"{", b"["):
        points = _coco(file, side)
    else:
        points, has_stamps = _csv(file, side, unit)
    return _table(file, points, has_stamps)


def _table(file: Path, points: Iterable[_Point], has_stamps: bool) -> PointTable:
    """Arrange the points by time and name."""
    found = [point for point in points if np.isfinite(point.u + point.v)]
    if not found:
        raise InputError(file, f"no point with finite pixels; expected {_EXPECTED}")
    if any(point.u % 1 for point in found) and all(0 <= point.u <= 1 and 0 <= point.v <= 1 for point in found):
        raise InputError(file, "all pixels are from 0 to 1; expected pixels, not shares of the image")
    names = tuple(dict.fromkeys(point.name for point in found))
    times, rows = np.unique([point.time for point in found], return_inverse=True)
    columns = [names.index(point.name) for point in found] if len(names) > 1 else [0] * len(found)
    values = np.full((len(times), len(names), 6), np.nan)
    for point, row, column in zip(found, rows.tolist(), columns, strict=True):
        if not np.isnan(values[row, column, 0]):
            problem = f"point {point.name} twice at {'stamp' if has_stamps else 'frame'} {point.time:g}"
            raise InputError(file, f"{problem}; expected each once", point.line)
        values[row, column] = (point.u, point.v, point.likelihood, *point.cov)
    return PointTable(file, names, times, has_stamps, values[..., :2], values[..., 2], values[..., 3:])


def _csv(file: Path, side: CameraName, unit: TimeUnit | None) -> tuple[list[_Point], bool]:
    """The points of a text table, and whether their times are stamps."""
    rows = [(line, row) for line, row in csv_rows(file, _EXPECTED) if any(row)]
    if rows and len(rows[0][1]) == 1:  # MOTChallenge's columns may be separated by spaces
        rows = [(line, row[0].split()) for line, row in rows]
    header = [name.lower() for name in rows[0][1]] if rows else []
    if header[:1] in (["scorer"], ["bodyparts"], ["individuals"]):
        return list(_deeplabcut(file, rows)), False
    if len(header) >= 6 and all(re.fullmatch(r"-?[0-9.]+(?:e[-+]?[0-9]+)?", field) for field in header[:6]):
        return list(_mot(file, rows)), False
    stamps = [name for name in header if _STAMP.fullmatch(name)]
    time = next((header.index(name) for name in (*stamps, *_FRAMES) if name in header), None)
    pixels = next((pair for pair in _PIXELS if set(pair) <= set(header)), None)
    wide = [match for match in map(_WIDE.fullmatch, rows[0][1] if rows else []) if match]
    if time is None or not (pixels or wide):
        raise InputError(file, f"columns {', '.join(header)[:200]}; expected {_EXPECTED}", 1)
    reader = _long(file, rows, time, pixels, side) if pixels else _wide(file, rows, time)
    points = list(reader)
    if stamps:
        own: Any = next(iter(_STAMP.findall(stamps[0])), None)
        values = sorted({point.time for point in points})
        seconds = dict(zip(values, Times(file, tuple(values), (), own or unit).seconds(), strict=True))
        points = [point._replace(time=seconds[point.time]) for point in points]
    return points, bool(stamps)


def _deeplabcut(file: Path, rows: Sequence[tuple[int, list[str]]]) -> Iterator[_Point]:
    """DeepLabCut's and Lightning Pose's csv: header rows `scorer`, perhaps `individuals`, `bodyparts`, `coords`."""
    n_header = next((k + 1 for k, (_, row) in enumerate(rows[:4]) if row[0].lower() == "coords"), 0)
    header = {row[0].lower(): row for _, row in rows[:n_header]}
    if not n_header or "bodyparts" not in header:
        raise InputError(file, "no header rows bodyparts and coords; expected DeepLabCut's three or four", 1)
    parts, coords = header["bodyparts"], [field.lower() for field in header["coords"]]
    individuals = header.get("individuals", [])
    several = len(set(individuals[1:]) - {"", "single"}) > 1
    places: dict[str, dict[str, int]] = {}
    for k, (part, coord) in enumerate(zip(parts, coords, strict=False)):
        name = f"{individuals[k]}:{part}" if several and individuals[k] != "single" else part
        if k and coord in ("x", "y", "likelihood"):
            places.setdefault(name, {})[coord] = k
    first = min((k for place in places.values() for k in place.values()), default=1)
    for line, row in rows[n_header:]:  # labelled images have their path, in one to three fields, for a frame
        frame = _frame(file, next((field for field in row[first - 1 :: -1] if field), ""), line)
        yield from _points(file, line, row, frame, places)


def _points(
    file: Path, line: int, row: Sequence[str], time: float, places: dict[str, dict[str, int]]
) -> Iterator[_Point]:
    """The points of a row, whose fields x, y and perhaps likelihood are at `places` by name."""
    for name, place in places.items():
        if "x" not in place or "y" not in place:
            raise InputError(file, f"point {name} has no x or no y; expected both", 1)
        likelihood = place.get("likelihood", len(row))
        fields = [row[k] if k < len(row) else "" for k in (place["x"], place["y"], likelihood)]
        u, v, score = numbers(file, line, fields)
        yield _Point(time, name, u, v, score, line=line)


def _wide(file: Path, rows: Sequence[tuple[int, list[str]]], time: int) -> Iterator[_Point]:
    """A row for each image, with columns NAME_x and NAME_y or NAME.x and NAME.y; a column `track` tells objects."""
    header = rows[0][1]
    places: dict[str, dict[str, int]] = {}
    for k, match in enumerate(map(_WIDE.fullmatch, header)):
        if match and match[2] == "z":
            raise InputError(file, f"column {match[0]}: the points are in 3D already; expected points of one camera", 1)
        if match:
            places.setdefault(match[1], {})[match[2] if match[2] in "xy" else "likelihood"] = k
    places = {name: place for name, place in places.items() if {"x", "y"} & set(place)}  # not instance.score
    track = header.index("track") if "track" in header else None
    tracks = {row[track] for _, row in rows[1:]} if track is not None else set()
    for line, row in rows[1:]:
        own = {f"{row[track]}:{name}": place for name, place in places.items()} if track is not None else {}
        yield from _points(file, line, row, _time(file, line, row, time), own if len(tracks) > 1 else places)


def _long(
    file: Path, rows: Sequence[tuple[int, list[str]]], time: int, pixels: tuple[str, str], side: CameraName
) -> Iterator[_Point]:
    """A row for each point."""
    header = [name.lower() for name in rows[0][1]]
    name = next((header.index(key) for key in _NAMES if key in header), None)
    camera = header.index("camera") if "camera" in header else None
    likelihood = next((header.index(key) for key in _LIKELIHOODS if key in header), None)
    cov = [header.index(key) for key in _COVARIANCE] if set(_COVARIANCE) <= set(header) else []
    places = [*map(header.index, pixels), *([] if likelihood is None else [likelihood]), *cov]
    for line, row in rows[1:]:
        row = [*row, *[""] * (len(header) - len(row))]
        if camera is None or row[camera] == side:
            u, v, *more = numbers(file, line, [row[k] for k in places])
            score = np.nan if likelihood is None else more.pop(0)
            what = "object" if name is None else row[name]
            yield _Point(_time(file, line, row, time), what, u, v, score, tuple(more) or (np.nan,) * 3, line)


def _mot(file: Path, rows: Sequence[tuple[int, list[str]]]) -> Iterator[_Point]:
    """The centres of MOTChallenge's boxes, whose frames and pixels count from 1."""
    for line, row in rows:
        frame, track, left, top, width, height, score = numbers(file, line, [*row, *[""] * 7][:7])
        if not (float(frame).is_integer() and float(track).is_integer() and frame >= 1):
            raise InputError(file, f"frame {frame:g}, id {track:g}; expected whole numbers, frames from 1", line)
        center = left - 1 + (width - 1) / 2, top - 1 + (height - 1) / 2
        yield _Point(frame - 1, f"{track:.0f}", *center, score, line=line)


def _coco(file: Path, side: CameraName) -> list[_Point]:
    """COCO's annotations, or a list of results; the frame is an image's frame_id, else the number in its file's name,
    else its id."""
    try:
        content: Any = json.loads(read_bytes(file, _EXPECTED))
        annotations = content if isinstance(content, list) else content["annotations"]
        images = {} if isinstance(content, list) else {image["id"]: image for image in content.get("images", [])}
        categories = [] if isinstance(content, list) else content.get("categories", [])
        keypoints = {category["id"]: category.get("keypoints", []) for category in categories}
        cameras = {image.get("camera") for image in images.values()} >= {"left", "right"}
        several = len({item.get("track_id") for item in annotations}) > 1
        points = []
        for item in annotations:
            image = images.get(item["image_id"], {})
            if cameras and image.get("camera") != side:
                continue
            frame = image.get("frame_id")
            if frame is None:
                frame = _frame(file, str(image.get("file_name", item["image_id"])), None)
            owner = f"{item['track_id']}:" if several else ""
            if "keypoints" in item:
                values = np.reshape(np.array(item["keypoints"], dtype=float), (-1, 3))
                names = keypoints.get(item.get("category_id")) or [str(k) for k in range(len(values))]
                for name, (u, v, score) in zip(names, values.tolist(), strict=True):
                    if score > 0:  # 0: not labelled; 1, 2: occluded, visible (no likelihoods)
                        likelihood = score if isinstance(content, list) else np.nan
                        points.append(_Point(float(frame), owner + name, u, v, likelihood))
            else:
                x, y, width, height = map(float, item["bbox"])
                center = x + (width - 1) / 2, y + (height - 1) / 2
                points.append(_Point(float(frame), owner + "object", *center, float(item.get("score", np.nan))))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        reason = f"no {error}" if isinstance(error, KeyError) else first_line(error)
        raise InputError(file, f"{reason}; expected COCO's images and annotations with keypoints or bbox") from error
    return points


def _sleap_analysis(file: Path) -> Iterator[_Point]:
    """SLEAP's analysis file: `tracks` (tracks, 2, nodes, frames) and `point_scores` (tracks, nodes, frames)."""
    try:
        import h5py
    except ImportError as error:
        raise InputError(file, "needs the extra tables: pip install 'pps-vision[tables]'; or export csv") from error
    with h5py.File(file, "r") as content:
        if not {"tracks", "node_names"} <= set(content):
            way = "a csv of deeplabcut.analyze_videos_converth5_to_csv, or SLEAP's analysis file"
            raise InputError(file, f"holds {', '.join(content)[:80]}; pandas' tables need pickle; expected {way}")
        tracks = np.asarray(content["tracks"])
        nodes = [name.decode() for name in content["node_names"][:].ravel()]
        owners = [name.decode() for name in content["track_names"][:].ravel()] if "track_names" in content else []
        scores = (
            np.asarray(content["point_scores"]) if "point_scores" in content else np.full(tracks[:, 0].shape, np.nan)
        )
    if tracks.shape[1:3] != (2, len(nodes)):
        raise InputError(file, f"tracks are {tracks.shape}; expected (tracks, 2, {len(nodes)} nodes, frames)")
    for track, node, frame in np.argwhere(np.isfinite(tracks[:, 0])).tolist():
        owner = f"{owners[track] if track < len(owners) else track}:" if len(tracks) > 1 else ""
        u, v = tracks[track, :, node, frame].tolist()
        yield _Point(float(frame), owner + nodes[node], u, v, float(scores[track, node, frame]))


def _time(file: Path, line: int, row: Sequence[str], column: int) -> float:
    """The stamp or frame of a row; InputError for none."""
    value = numbers(file, line, [row[column] if column < len(row) else ""])[0]
    if np.isnan(value):
        raise InputError(file, "no frame or stamp; expected a number", line)
    return value


def _frame(file: Path, text: str, line: int | None) -> float:
    """The last number in an image's name, or of a frame; InputError without one."""
    digits = re.findall(r"[0-9]+", PurePath(text).stem if "." in text else text)
    if not digits:
        raise InputError(file, f"image {text!r} has no number; expected that of its frame", line)
    return float(digits[-1])
