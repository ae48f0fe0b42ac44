"""What tracking writes: detections.csv, trajectory.csv, boxes.csv and summary.json.

An empty field is a number that does not exist: nothing was known at that stamp.
The functions write where they are told; `outputs` makes the whole appear at once.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from pps_vision.recordings.tables import write_table
from pps_vision.types import Detection2D, Reachability, Status, Track3D

Box = tuple[float, float, float, float]  # x, y of the top-left corner, width, height, px

DETECTION_COLUMNS = (
    *("frame", "stamp_s", "camera", "u_px", "v_px", "cov_uu_px2", "cov_uv_px2", "cov_vv_px2", "score", "status"),
)
TRAJECTORY_COLUMNS = (
    *("stamp_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s"),
    *("cov_xx_m2", "cov_xy_m2", "cov_xz_m2", "cov_yy_m2", "cov_yz_m2", "cov_zz_m2", "radius_m", "status"),
)
REACHABILITY_COLUMNS = (
    *("gaze_yaw_deg", "gaze_pitch_deg", "gaze_vergence_deg", "reach_probability", "reach_degree", "reach_status"),
)
BOX_COLUMNS = ("frame", "x", "y", "w", "h", "score")

_UPPER = np.triu_indices(3)


def write_detections(file: Path, detections: Iterable[tuple[int, Detection2D, Status]]) -> None:
    """detections.csv: the frame's number, what was seen in one eye, and the tracker's status then."""
    rows = (
        (frame, seen.stamp_s, seen.camera, *seen.center_px, *seen.cov_px[np.triu_indices(2)], seen.score, status)
        for frame, seen, status in detections
    )
    write_table(file, DETECTION_COLUMNS, rows)


def write_trajectory(file: Path, tracks: Iterable[Track3D], reachability: Sequence[Reachability] = ()) -> None:
    """trajectory.csv: position, velocity and the position's covariance in the root frame; then, where given of each
    track, its reachability, with the gaze that fixates it in degrees."""
    rows: Iterable[tuple[object, ...]] = (
        (track.stamp_s, *track.position, *track.velocity, *track.cov[:3, :3][_UPPER], track.radius_m, track.status)
        for track in tracks
    )
    if not reachability:
        write_table(file, TRAJECTORY_COLUMNS, rows)
        return
    more = ((*np.rad2deg(reach.gaze_rad), reach.probability, reach.degree, reach.status) for reach in reachability)
    both = ((*row, *reach) for row, reach in zip(rows, more, strict=True))
    write_table(file, TRAJECTORY_COLUMNS + REACHABILITY_COLUMNS, both)


def write_boxes(file: Path, boxes: Iterable[tuple[int, Box, float]]) -> None:
    """boxes.csv: frame (the first file is 1), the box in original pixels, and its score."""
    write_table(file, BOX_COLUMNS, ((frame, *box, score) for frame, box, score in boxes))


def write_summary(file: Path, summary: Mapping[str, object]) -> None:
    """summary.json: NumPy numbers, arrays and paths as plain ones, NaN and infinity as null."""
    file.write_text(json.dumps(plain(summary), indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def plain(value: object) -> object:
    """A value as JSON will have it."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
