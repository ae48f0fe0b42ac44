"""Figures of the reports show the numbers that they are given, in the units of their labels."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes

from learning.pps.memory import MemoryParams, PPSMemory, activation
from learning.reach.labels import Labels
from learning.reach.lattice import Lattice
from learning.reach.map import ReachableMap
from pps_vision.app.evaluate import Path3D, evaluate
from pps_vision.app.report import figures
from pps_vision.app.report.errors import path_errors
from pps_vision.app.report.path3d import path3d
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array


def lines(axis: Axes) -> list[tuple[Array, Array]]:
    return [(np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)) for line in axis.lines]


def test_a_landscape_is_the_activation_over_the_memorys_ranges() -> None:
    params = MemoryParams()
    counts = np.zeros((2, *params.bins, 2), dtype=np.int64)
    counts[1, 2:4, 0, 0] = 9
    counts[1, :, :, 1] = 3
    memory = PPSMemory(("a:1", "a:2"), np.zeros(2, np.intp), counts, params)
    landscape = figures.landscape(memory, 1)
    assert landscape.shape == (30, 30)
    for i, j in ((0, 0), (10, 4), (29, 29)):
        d = -0.1 + 0.3 * (i + 0.5) / 30
        t = 3.0 * (j + 0.5) / 30
        assert landscape[i, j] == pytest.approx(activation(memory, [d, d], [t, t])[1])
    never, stimulated, _ = figures.landscapes(memory).axes
    assert [text.get_text() for text in never.texts] == ["never stimulated"]
    assert stimulated.get_title() == f"a:2  ({counts[1].sum()} samples)"
    (image,) = stimulated.images
    assert image.get_extent() == [-10, 20, 0, 3]  # cm and s
    np.testing.assert_allclose(np.asarray(image.get_array()), landscape.T)
    assert (image.get_clim(), image.origin) == ((0, 1), "lower")


def test_the_reachable_space_is_drawn_for_the_vergences_within_its_limits() -> None:
    """Reachable where the neck's yaw is positive; vergences of 13°, 17° and 22° lie between 12° and 25°."""
    ends = [tuple(np.deg2rad(pair).tolist()) for pair in ((-40, 60), (-30, 10), (12, 25))]
    lattice = Lattice(GazeLimits(*ends), (9, 7, 5))
    signed = lattice.gaze_rad[:, 0].reshape(lattice.shape)
    labels = Labels(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0), np.zeros(0), np.zeros((0, 3)))
    reachable_map = ReachableMap(
        "left", lattice.limits, signed, 0.5 + 0 * signed, 0.1 + 0 * signed, 0.4, 0.05, 0.0, labels, 0
    )
    figure = figures.reachable_space(reachable_map, load_icub())
    panels = [axis for axis in figure.axes if axis.get_title()]
    titles = [re.fullmatch(r"vergence (\d+)° \((\d+) cm\)", axis.get_title()) for axis in panels]
    assert [int(title[1]) for title in titles if title] == [13, 17, 22]
    assert [int(title[2]) for title in titles if title] == [30, 23, 17]  # eyes 68 mm apart: 3.4 cm / tan(v / 2)
    for axis in panels:
        (image,) = axis.images
        assert image.get_extent() == pytest.approx([-40, 60, -30, 10])
        assert (image.get_clim(), image.origin) == ((0, 1), "lower")
        degree = np.asarray(image.get_array())
        assert degree[:, : int(0.38 * 120)].max() < 0.5 < degree[:, int(0.42 * 120) :].min()
        border = np.vstack([p.vertices for c in axis.collections for p in c.get_paths()])
        assert np.abs(border[:, 0]).max() < 1  # at yaw 0
    assert "the left hand" in figure.get_suptitle()


def test_errors_of_paths_are_in_millimetres_and_sorted_shares() -> None:
    t = np.arange(0, 4, 0.1)
    truth = Path3D("truth", t, np.column_stack([np.sin(t), np.cos(t), t]), np.full((len(t), 3, 3), np.nan))
    off = np.where(np.arange(len(t)) % 2 == 0, 0.002, 0.006)
    path = Path3D("one", t + 7, truth.position + off[:, None] * [1.0, 0.0, 0.0], truth.cov)
    truth = replace(truth, stamps_s=t + 7)
    over_time, share = path_errors([path], truth, [evaluate(path, truth)], align=False).axes
    ((x, y),) = lines(over_time)
    np.testing.assert_allclose(x, t, atol=1e-9)
    np.testing.assert_allclose(y, 1000 * off)
    late = replace(path, stamps_s=path.stamps_s + 0.2)
    ((_, lagging),) = lines(path_errors([late], truth, [evaluate(late, truth, lag=True)], align=False).axes[0])
    assert np.median(lagging) < 8  # 0.2 s late would be more than 200 mm off
    ((x, y),) = lines(share)
    assert (np.diff(x) >= 0).all()
    assert y[0] == pytest.approx(1 / len(x))
    assert y[-1] == 1
    assert y[x < 4].max() == pytest.approx(0.5, abs=0.03)
    (name,) = (text.get_text() for text in over_time.get_legend().texts)
    assert name.startswith("one: RMSE 4.4")


def test_a_path_in_3d_holds_its_points_with_gaps_and_its_ellipsoids() -> None:
    points = np.column_stack([np.linspace(0, 0.3, 9000), np.zeros(9000), np.full(9000, 0.5)])
    points[0:6] = np.nan
    at = points[6:1006]
    cov = np.broadcast_to(np.diag([4e-4, 1e-4, 1e-4]), (1000, 3, 3))
    text = path3d([("green", points), ("grey", points[6:20])], at, cov)
    data = json.loads(re.search(r'id="path-data">(.*?)</script>', text)[1])  # type: ignore[index]
    first, second = data["lines"]
    assert len(first["points"]) == 3000  # every third of 9000, at most 4000
    assert first["points"][:3] == [None, None, points[6].tolist()]
    assert second["points"] == points[6:20].tolist()
    assert first["width"] > second["width"]
    assert [*data["center"], data["size"]] == pytest.approx([0.15, 0.0, 0.5, 0.15], abs=1e-3)
    assert 30 < len(data["ellipsoids"]) <= 40
    assert data["ellipsoids"][0]["at"] == at[0].tolist()
    assert data["ellipsoids"][-1]["at"] == at[-1].tolist()
    lengths = sorted(np.linalg.norm(data["ellipsoids"][0]["axes"], axis=1))
    assert lengths == pytest.approx(2.7955 * np.array([0.01, 0.01, 0.02]), rel=1e-3)
    assert path3d([("green", points[:3])], at[:0], cov[:0]) == "<p>No position is known.</p>"
