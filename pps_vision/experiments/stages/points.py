"""Image points of a detector to 3D paths (`triangulate`): error and coverage beside linear triangulation and a median.

Smooth paths before two cameras, whose points have Gaussian errors of 0.5 px, tails of t with 3 degrees of freedom, 10 %
outliers (within a quarter of the image's sides) or a likelihood that tells the noise or the contrary; and the flights
of tt3d.  The baseline stands for Anipose's steps (linear triangulation, then a median filter over 5 or 13 pairs);
aniposelib itself is not installed.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from pps_vision.app.points import PointParams
from pps_vision.app.track import TrackArrays
from pps_vision.app.triangulate import TriangulatedPoints
from pps_vision.experiments.charts import cells_chart
from pps_vision.experiments.stages.filter import camera_of
from pps_vision.experiments.study import Method, Metric, Values, compare, mean, median
from pps_vision.experiments.tables import Table, estimate
from pps_vision.experiments.timing import timed
from pps_vision.geometry.camera import Camera, StereoRig, StereoView
from pps_vision.geometry.se3 import transform
from pps_vision.recordings.point_tables import PointTable
from pps_vision.recordings.tables import CHI2_95
from pps_vision.types import Array

DEFAULT = "smoothed"
KINDS = ("Gaussian", "outliers", "heavy tails", "outliers, heavy tails", "likelihood tells", "likelihood lies")
_N = 400  # pairs of a path, at 30 a second
_STD_PX = 0.5
_METRICS = {"median_mm": Metric("error_mm", median), "coverage_95": Metric("inside", lambda x: 100 * mean(x))}
_CAMERA = Camera(640, 480, 500, 500, 320, 240, (-0.1, 0.02, 0.0, 0.0, 0.0))
_RIG = StereoRig.fixed(_CAMERA, _CAMERA, transform(None, np.array([0.12, 0.0, 0.0])))
Points = tuple[PointTable, PointTable, StereoRig, Array]
"""Tables of both cameras, the cameras, and the true path (n, 3) m."""
chart = cells_chart("median_mm", "median position error (mm)", ("median of 5", "median of 13", "linear"), DEFAULT)


def run(study: Any) -> dict[str, Any]:
    """Return by kind and method: time of a pair, median error and coverage of the 95 % ellipsoids."""
    scenarios = {kind: partial(simulated, kind) for kind in KINDS}
    seeds = range(study.seed, study.seed + 5 * study.n)
    cells = compare(scenarios, methods(), _METRICS, seeds)
    folder = study.data / "tt3d"
    if not folder.exists():
        return {"cells": cells, "not_measured": f"tt3d: no {folder}"}
    flights = [_flight(file) for file in sorted((folder / "side").glob("*.csv"))]
    return {"cells": cells | compare({"tt3d": flights.__getitem__}, methods(), _METRICS, range(len(flights)))}


def table(numbers: dict[str, Any]) -> Table:
    """Errors and coverage of all methods."""
    header = ["points", *(f"{name} (mm)" for name in methods()), "filter, 95 % holds (%)", "smoothed, 95 % holds (%)"]
    rows = [
        [
            kind,
            *(estimate(cells[name]["median_mm"]) for name in methods()),
            *(estimate(cells[name]["coverage_95"]) for name in ("filter", DEFAULT)),
        ]
        for kind, cells in numbers["cells"].items()
    ]
    return Table(header, rows)


def methods() -> dict[str, Method]:
    """Return the methods by name."""
    ways: dict[str, Method] = {"filter": partial(_ours, False), DEFAULT: partial(_ours, True)}
    ways |= {"linear": partial(_linear, 1), **{f"median of {width}": partial(_linear, width) for width in (5, 13)}}
    return {name: partial(_timed, way) for name, way in ways.items()}


def _timed(way: Method, points: Points, seed: int) -> Values:
    """The values of a method with its processor time for each pair."""
    values, ms = timed(partial(way, points, seed))
    return {**values, "ms": [ms / len(points[-1])]}


def simulated(kind: str, seed: int) -> Points:
    """Points of a smooth path about 0.7 m before two cameras, with errors of a kind."""
    rng = np.random.default_rng(seed)
    t = np.arange(_N) / 30
    path = np.tile([0.0, 0.0, 0.7], (_N, 1))
    for _ in range(3):
        size, rate, phase = rng.uniform(0.015, 0.055, 3), rng.uniform(0.1, 0.9, 3), rng.random(3)
        path += size * np.sin(2 * np.pi * (rate * t[:, None] + phase))
    view = _RIG.view()
    pixels = np.stack([view.left.project(path), view.right.project(path)])
    likelihood = rng.beta(5, 1.5, (2, _N)) if "likelihood" in kind else np.full((2, _N), np.nan)
    scale = {"likelihood tells": 4 * (1.05 - likelihood), "likelihood lies": 4 * (0.05 + likelihood)}.get(kind, 1.0)
    noise = rng.standard_t(3, pixels.shape) if "tails" in kind else rng.standard_normal(pixels.shape)
    error = _STD_PX * np.reshape(scale, (-1, _N if np.ndim(scale) else 1, 1)) * noise
    outlier = (rng.random((2, _N)) < 0.1) & ("outliers" in kind or kind == "likelihood lies")
    error[outlier] = rng.uniform(-0.25, 0.25, (outlier.sum(), 2)) * (_CAMERA.width, _CAMERA.height)
    likelihood = np.where(outlier & np.isfinite(likelihood), 0.99, likelihood)
    left, right = (_table(t, *side) for side in zip(pixels + error, likelihood, strict=True))
    return left, right, _RIG, path


def _table(stamps_s: Array, pixels: Array, likelihood: Array) -> PointTable:
    cov = np.full((len(pixels), 1, 3), np.nan)
    return PointTable(Path("points"), ("point",), stamps_s, True, pixels[:, None], likelihood[:, None], cov)


def _flight(side_file: Path) -> Points:
    """A noisy flight of tt3d."""
    folder = side_file.parents[1]
    left, right = (camera_of(folder / f"{name}.yaml") for name in ("side", "oblique"))
    rows = [np.genfromtxt(folder / name / side_file.name, delimiter=",", names=True) for name in ("side", "oblique")]
    tables = [_table(x["Timestamp"], np.stack([x["u"], x["v"]], 1), np.full(len(x), np.nan)) for x in rows]
    poses = left.T_root_camera, right.T_root_camera
    rig = StereoRig(left.camera, right.camera, lambda _: poses)
    return tables[0], tables[1], rig, np.stack([rows[0][name] for name in "XYZ"], axis=1)


def _ours(smooth: bool, points: Points, seed: int) -> Values:
    left, right, rig, path = points
    arrays: TrackArrays = TriangulatedPoints(left, right, rig, PointParams()).arrays(smooth=smooth)
    error = arrays.position - path
    known = np.isfinite(error[:, 0])
    nees = np.einsum("ni,nij,nj->n", error[known], np.linalg.inv(arrays.cov[known, :3, :3]), error[known])
    return {"error_mm": 1000 * np.linalg.norm(error[known], axis=1), "inside": nees <= CHI2_95}


def _linear(width: int, points: Points, seed: int) -> Values:
    """Linear triangulation (DLT), then a median filter of each coordinate over `width` pairs."""
    left, right, rig, path = points
    view: StereoView = rig.view()
    rows = []
    for eye, table_ in ((view.left, left), (view.right, right)):
        x, y, z = eye.camera.bearings(table_.pixels[:, 0]).T
        P = eye.T_camera_root
        rows += [(x / z)[:, None] * P[2] - P[0], (y / z)[:, None] * P[2] - P[1]]
    h = np.linalg.svd(np.stack(rows, axis=1))[2][:, -1]
    position = h[:, :3] / h[:, 3:]
    filtered = median_filter(position, (width, 1), mode="nearest")
    return {"error_mm": 1000 * np.linalg.norm(filtered - path, axis=1), "inside": []}
