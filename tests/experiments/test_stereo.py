"""Triangulations and disparity maps of one recording against its truth."""

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.stereo import OURS, Stereo, methods
from pps_vision.experiments.study import compare

STUDY = Stereo(n=1, seed=SEED, scenes="rendered")


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
    figure = STUDY.chart({"cells": cells, "distance": distance})
    assert len(figure.axes) == 2
    assert [row[:2] for row in STUDY.tables({"cells": cells})[""].rows] == [[name, "1 (0.5–2)"] for name in methods()]
