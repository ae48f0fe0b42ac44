"""Score boxes in images against the true ones: `pps-vision evaluate --boxes`.

For one object, success and precision of OTB (Wu et al. 2013): the share of frames whose overlap exceeds a threshold,
and whose centre is within a distance. For any number of objects, misses, false boxes and identity switches of CLEAR MOT
(Bernardin and Stiefelhagen 2008).
"""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from pps_vision.errors import InputError
from pps_vision.recordings.tables import BOXES, column_names, read_table
from pps_vision.recordings.text import number, read_lines
from pps_vision.types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OVERLAPS = np.linspace(0, 1, 21)  # thresholds of the success curve
DISTANCES_PX = np.arange(51)  # thresholds of the precision curve
_MATCHED = 0.5  # least overlap of a match in MOTChallenge
_EXPECTED = "frame,x,y,w,h,score; MOTChallenge's rows; or a row of 4 (x, y, w, h) or 8 (polygon) numbers; frames from 1"


@dataclass(frozen=True)
class Boxes:
    """The boxes (x, y, width, height, px) of numbered tracks, by frame."""

    name: str
    frames: Mapping[int, Mapping[int, Array]]


@dataclass(frozen=True)
class BoxScore:
    """Agreement of boxes with the true ones; measures of a single object are NaN where there are more."""

    name: str
    boxes: int  # true boxes
    mean_iou: float  # overlap, 0 where there is no box
    success_auc: float  # area under the success curve
    precision_20px: float  # share of frames whose centre is within 20 px
    center_median_px: float  # over the frames with a box
    missed_share: float  # share of true boxes without a match
    false_share: float  # boxes without a match over true boxes
    id_switches: int
    mota: float  # 1 − (missed + false + switches) / true boxes


def read_boxes(file: Path, first_px: int | None = None) -> Boxes:
    """Read boxes.csv, MOTChallenge's rows, or a true box a row as OTB and VOT write them; frames count from 1.

    A row of NaN or of a box without area is a frame without a box.  InputError for a row that cannot be read.
    `first_px`: coordinate of the first pixel's corner in rows without a header; by default 1 for MOTChallenge and rows
    of four numbers (OTB and LaSOT were annotated in Matlab), 0 for polygons (VOT's TraX protocol).
    """
    frames: dict[int, dict[int, Array]] = defaultdict(dict)
    if column_names(file) == list(BOXES):
        rows = [(line, [*fields[:1], "1", *fields[1:5]]) for line, fields in read_table(file, BOXES)]
        first_px = 0
    else:
        rows, usual_px = _rows(file)
        first_px = usual_px if first_px is None else first_px
    for line, fields in rows:
        try:
            frame, track, *box = (number(field) for field in fields)
            if not (frame.is_integer() and track.is_integer() and frame >= 1):
                raise ValueError(f"frame {frame:g}, track {track:g}")
        except ValueError as error:
            raise InputError(file, f"{error}; expected {_EXPECTED}", line) from None
        if len(box) == 8:
            corners = np.reshape(box, (4, 2))
            box = [*corners.min(axis=0), *np.ptp(corners, axis=0)]
        if not np.all(np.isfinite(box)) or min(box[2:]) <= 0:
            continue
        if int(track) in frames[int(frame)]:
            raise InputError(file, f"track {track:g} twice in frame {frame:g}; expected each once", line)
        frames[int(frame)][int(track)] = np.array(box) - (first_px, first_px, 0, 0)
    if not any(frames.values()):
        raise InputError(file, f"no box; expected {_EXPECTED}")
    return Boxes(str(file), frames)


def _rows(file: Path) -> tuple[list[tuple[int, list[str]]], int]:
    """Rows of frame, track, x, y, w, h (or the 8 numbers of a polygon), and the first pixel's usual coordinate."""
    split = [(line, re.split(r"[,\s]+", row.strip())) for line, row in enumerate(read_lines(file, _EXPECTED), start=1)]
    split = [(line, fields) for line, fields in split if fields != [""]]
    counts = {len(fields) for _, fields in split}
    if counts <= {4, 8}:
        boxes = [(line, [str(k), "1", *row]) for k, (line, row) in enumerate(split, start=1)]
        return boxes, int(counts == {4})
    if short := [line for line, fields in split if len(fields) < 6]:
        raise InputError(file, f"fewer than 6 numbers; expected {_EXPECTED}", short[0])
    return [(line, fields[:6]) for line, fields in split], 1


def overlaps(boxes: ArrayLike, others: ArrayLike) -> Array:
    """(n, m) intersection over union of boxes (n, 4) and others (m, 4)."""
    a = np.reshape(boxes, (-1, 1, 4))
    b = np.reshape(others, (1, -1, 4))
    sides = np.minimum(a[..., :2] + a[..., 2:], b[..., :2] + b[..., 2:]) - np.maximum(a[..., :2], b[..., :2])
    shared = np.prod(np.clip(sides, 0, None), axis=2)
    return shared / (np.prod(a[..., 2:], axis=2) + np.prod(b[..., 2:], axis=2) - shared)


def per_frame(track: Boxes, truth: Boxes) -> tuple[Array, Array]:
    """Overlap and distance of the centres (px; 0 and infinite without a box) in every frame with a true box;
    InputError for several boxes in a frame."""
    results: list[tuple[float, float]] = []
    for frame, true in sorted(truth.frames.items()):
        for boxes in (truth, track):
            if (n := len(boxes.frames.get(frame, {}))) > 1:
                raise InputError(boxes.name, f"{n} boxes in frame {frame}; expected one for a success curve")
        for a in true.values():
            b = next(iter(track.frames.get(frame, {}).values()), None)
            distance_px = np.inf if b is None else float(np.linalg.norm(a[:2] - b[:2] + (a[2:] - b[2:]) / 2))
            results.append((0.0 if b is None else float(overlaps(a, b)[0, 0]), distance_px))
    table: Array = np.reshape(results, (-1, 2))
    return table[:, 0], table[:, 1]


def success(iou: Array) -> Array:
    """(21,) share of frames whose overlap exceeds `OVERLAPS`."""
    return np.mean(iou[:, None] > OVERLAPS, axis=0)


def precision(distance_px: Array) -> Array:
    """(51,) share of frames whose centre is within `DISTANCES_PX`."""
    return np.mean(distance_px[:, None] <= DISTANCES_PX, axis=0)


def evaluate_boxes(track: Boxes, truth: Boxes) -> BoxScore:
    """Score boxes."""
    single = all(len(frame) <= 1 for boxes in (track, truth) for frame in boxes.frames.values())
    iou, distance = per_frame(track, truth) if single else (np.array([np.nan]), np.array([np.nan]))
    n, missed, false, switches = _clear(track, truth)
    with_box = distance[np.isfinite(distance)]
    return BoxScore(
        track.name,
        n,
        mean_iou=float(np.mean(iou)),
        success_auc=float(np.mean(success(iou))) if single else np.nan,
        precision_20px=float(precision(distance)[20]) if single else np.nan,
        center_median_px=float(np.median(with_box)) if len(with_box) else np.nan,
        missed_share=missed / n,
        false_share=false / n,
        id_switches=switches,
        mota=1 - (missed + false + switches) / n,
    )


def _clear(track: Boxes, truth: Boxes) -> tuple[int, int, int, int]:
    """True boxes, missed, false, and identity switches: matches go on while they overlap, others are the best ones."""
    n = missed = false = switches = 0
    last: dict[int, int] = {}
    for frame in sorted(truth.frames.keys() | track.frames.keys()):
        true = truth.frames.get(frame, {})
        tracked = track.frames.get(frame, {})
        n += len(true)
        followed = {name: last[name] for name in true if last.get(name) in tracked}
        matched = {a: b for a, b in followed.items() if overlaps(true[a], tracked[b])[0, 0] >= _MATCHED}
        names = [name for name in true if name not in matched]
        others = [name for name in tracked if name not in matched.values()]
        iou = overlaps([true[name] for name in names], [tracked[name] for name in others])
        allowed = iou >= _MATCHED
        for i, j in zip(*linear_sum_assignment(np.where(allowed, -iou, 1e3)), strict=True):
            if allowed[i, j]:
                switches += names[i] in last and last[names[i]] != others[j]
                matched[names[i]] = others[j]
        last |= matched
        missed += len(true) - len(matched)
        false += len(tracked) - len(matched)
    return n, missed, false, switches


def box_curves(tracks: Sequence[Boxes], truth: Boxes) -> "Figure":
    """Success and precision curves (Wu et al. 2013)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4), layout="constrained")
    of_overlap, of_distance = figure.subplots(1, 2, sharey=True)
    for boxes in tracks:
        iou, distance_px = per_frame(boxes, truth)
        of_overlap.plot(OVERLAPS, success(iou), label=f"{boxes.name}: area {np.mean(success(iou)):.3f}")
        within = precision(distance_px)
        of_distance.plot(DISTANCES_PX, within, label=f"{boxes.name}: {within[20]:.3f} at 20 px")
    of_overlap.set(xlabel="overlap threshold", ylabel="share of frames above it (success)", ylim=(0, 1), xlim=(0, 1))
    of_distance.set(xlabel="distance of the centres (px)", ylabel="share of frames within it (precision)", xlim=(0, 50))
    for axis in (of_overlap, of_distance):
        axis.grid(alpha=0.25)
        axis.legend(fontsize=7)
    return figure
