"""Triangulations and disparity maps of one recording against its truth."""

from types import SimpleNamespace

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.stereo import BOUNDS, OURS, Pair, Stereo, bounds_mm, methods
from pps_vision.experiments.study import compare
from pps_vision.robot.icub import icub_rig, load_icub

STUDY = Stereo(n=1, seed=SEED, scenes="rendered")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_every_method_is_near_a_textured_ball_and_ours_is_the_nearest() -> None:
    recording = STUDY._pairs("textured", "rendered", SEED, 0.4)
    assert len(recording) > 10
    errors = {name: method(recording, SEED) for name, method in methods().items()}
    assert all(np.mean(values["found"]) > 0.9 for values in errors.values())
    rms = {name: float(np.sqrt(np.mean(np.square(values["error_mm"])))) for name, values in errors.items()}
    assert rms[OURS] < 1.5
    assert rms["whole BM"] < 15
    assert rms["whole SGBM"] < 15
    assert rms[OURS] == min(rms[OURS], rms["whole BM"], rms["whole SGBM"])
    for triangulation in ("midpoint", "linear (OpenCV)", "corrected (OpenCV)"):
        assert rms[triangulation] == pytest.approx(rms[OURS], rel=0.3)


def test_chart_and_table_show_methods_and_distances() -> None:
    values = {name: lambda _, __: {"error_mm": [1.0], "found": [True], "ms": [1.0, 2.0]} for name in methods()}
    cells = compare({"rendered, plain": int}, values, {}, (0,))
    for cell in cells["rendered, plain"].values():
        cell["rms_mm"] = [1.0, 0.5, 2.0]
    over = {name: {"rms_mm": [[1.0, 1.0, 1.0]], "breaks_at": None} for name in methods()}
    distance = {"rendered, plain": {"axis": "distance (m)", "severities": [0.4], "methods": over}}
    bound = {"rendered, plain": {which: [0.25] for which in BOUNDS}}
    charts = STUDY.chart({"cells": cells, "distance": distance, "bound": bound})
    assert {"", "distance"} == set(charts)
    (axis,) = charts["distance"].axes
    assert {OURS, *BOUNDS} <= {line.get_label() for line in axis.lines}
    bound["rendered, plain"] = {which: [0.2, 0.25, 0.3] for which in BOUNDS}
    rows = STUDY.tables({"cells": cells, "bound": bound})[""].rows
    assert [row[:2] for row in rows] == [*([name, "1 (0.5–2)"] for name in methods()), *([w, "0.25"] for w in BOUNDS)]


def test_the_bound_is_what_a_weighted_fit_reaches_and_correlation_of_the_eyes_lowers_it(
    rng: np.random.Generator,
) -> None:
    """Detections of one point, drawn with a known covariance of all four coordinates, triangulated by least squares."""
    view, p = icub_rig(load_icub()).view(np.zeros(load_icub().n_joints)), np.array([-0.4, 0.02, 0.3])
    cov = np.diag([0.04, 0.01, 0.04, 0.01])
    cov[0, 2] = cov[2, 0] = 0.03
    J = np.vstack([eye.project_jacobian(p) for eye in (view.left, view.right)])
    weights = np.linalg.inv(cov)
    recording, errors = [], []
    for error in rng.multivariate_normal(np.zeros(4), cov, size=3000):
        left, right = view.left.project(p) + error[:2], view.right.project(p) + error[2:]
        seen = [SimpleNamespace(center_px=px) for px in (left, right)]
        recording.append(Pair(None, view, *seen, p))  # type: ignore[arg-type]
        errors.append(np.linalg.solve(J.T @ weights @ J, J.T @ weights @ error))
    reached_mm = 1000 * float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1))))
    bounds = bounds_mm([recording, recording[:3]])
    assert bounds[BOUNDS[0]] == pytest.approx(reached_mm, rel=0.03)
    assert bounds[BOUNDS[1]] > 1.3 * bounds[BOUNDS[0]]
