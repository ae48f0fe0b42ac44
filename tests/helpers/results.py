"""A folder as `track` writes it, of a made-up path."""

from itertools import starmap
from pathlib import Path

import numpy as np
from tracks import track_at

from pps_vision.app.report.overlay import save_jpeg
from pps_vision.app.results import TrackSummary
from pps_vision.app.versions import versions
from pps_vision.recordings.atomic_write import write_json
from pps_vision.recordings.tables import (
    DETECTIONS,
    REACHABILITY,
    TRAJECTORY,
    detection_row,
    trajectory_row,
    write_table,
)
from pps_vision.types import Activation, Detection2D, Reachability, ReachStatus, Status, Track3D

N = 40
ODD_NAMES = [
    *("a", "javascript:alert(1)", "a#b", "a?b", "a%41b", "<b>", '"onerror="x', "a&amp;b", "{{ 7*7 }}"),
    *("..a", " a ", "ä\udcff", "=1+1\n"),
]
"""Names of folders that a page must show as text and link to."""


def write_results(folder: Path) -> Path:
    """A helix before the cameras, lost once, with truth, detections, reachability, activations and two key frames."""
    (folder / "keyframes").mkdir(parents=True)
    tracks = []
    detections = []
    truth = []
    reach = []
    felt = []
    for k in range(N):
        t = 0.05 * k
        angle = 0.3 * k
        position = np.array([0.1 * np.cos(angle), 0.1 * np.sin(angle), 0.8 - 0.01 * k])
        truth.append((t, *position))
        reach.append(Reachability(t, np.zeros(3), k / N, k / N, ReachStatus.REACHABLE))
        felt.append(Activation(t, ("arm:1", "arm:2", "hand:1"), np.array([0, k / N, 1 - k / N])))
        if k in (0, 20):
            tracks.append(Track3D.unknown(t, Status.LOST if k else Status.SEARCHING))
            continue
        cov = 1e-4 * np.diag(np.r_[1, 1, 4, np.ones(9)])
        status = Status.COASTING if k == 19 else Status.TRACKING
        tracks.append(track_at(position + 0.002, (0, 0, -0.2), t, cov, status=status))
        for camera in ("left", "right"):
            detection = Detection2D(
                t, camera, np.array([160 + 90 * position[0], 120.0]), np.eye(2), 0.9, 0.1, (0, 0, 9, 9)
            )
            detections.append((k, detection, tracks[-1]))
    write_table(folder / "trajectory.csv", TRAJECTORY + REACHABILITY, map(trajectory_row, tracks, reach))
    rows = ((item.stamp_s, *item.probability) for item in felt)
    write_table(folder / "activation.csv", ("stamp_s", *felt[0].taxel_ids), rows)
    write_table(folder / "detections.csv", DETECTIONS, starmap(detection_row, detections))
    source = folder / "source"
    source.mkdir()
    write_table(source / "truth.csv", ("stamp_s", "x_m", "y_m", "z_m"), truth)
    status = {item.value: sum(track.status == item for track in tracks) for item in Status}
    summary: TrackSummary = {
        **{"source": str(source), "mode": "generic", "reduction": 1, "seed": 3, "device": None},
        **{"pairs": N, "frames": N, "status": status, "followed_by": {}, "skipped": {}, "warnings": []},
        "ms_per_pair": {"total": {"q25_ms": 1.0, "median_ms": 1.5, "q75_ms": 2.0, "runs": N}},
        "cameras": {"rotation_deg": 0.1},
        "versions": versions(),
        "reach": {"max_fp": 0.001, "reachable": N},
        "diagnosis": {"counts": {}, "advice": ["a <longer> baseline"]},
        "command": "pps-vision track rec --seed 3 --out out",
    }
    write_json(folder / "summary.json", summary)
    for k in range(2):
        save_jpeg(folder / "keyframes" / f"{k}.jpg", np.full((120, 320, 3), (40, 90 + 60 * k, 160), np.uint8))
    return folder
