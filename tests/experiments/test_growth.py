"""The study of cost as it grows."""

from pathlib import Path

import numpy as np
import pytest

import pps_vision as pv
from pps_vision.experiments.growth import Growth, exponent, to_and_fro


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_the_exponent_of_a_power_law(power: float) -> None:
    sizes = [10, 100, 1000]
    ms = [[3.0 * size**power, 0.0, np.inf] for size in sizes]
    assert exponent(sizes, ms) == pytest.approx(power)
    assert exponent(sizes, [[100.0, 0, 0], *ms[1:]]) == pytest.approx(power), "of the two largest sizes"
    assert np.isnan(exponent(sizes[:1], ms[:1]))


def test_the_chart_names_the_exponent_beside_other_keys_of_a_result_file() -> None:
    cell = {"sizes": [10, 100], "ms": {"slow": [[2.0, 1.0, 3.0], [20.0, 10.0, 30.0]]}, "memory_mb": [50.0, 60.0]}
    (axis,) = Growth().chart({"study": "growth", "processor_min": 1.0, "axes": {"taxels": cell}}).axes
    assert axis.get_legend_handles_labels()[1] == ["slow: 1.00"]
    assert axis.get_xscale() == axis.get_yscale() == "log"


def test_a_recording_played_to_and_fro_is_one(tmp_path: Path) -> None:
    short = pv.render("ball", "circle", tmp_path / "short", seconds=0.5)
    n = len(short.pairs)
    to_and_fro(tmp_path / "short", tmp_path / "long", 2 * n + 3)
    long = pv.open_recording(tmp_path / "long")
    assert len(long.pairs) == 2 * n + 3
    assert not long.problems
    stamps_s = np.array([pair[0].stamp_s for pair in long.pairs])
    assert np.diff(stamps_s) == pytest.approx(np.median(np.diff(stamps_s)), rel=0.05)
    first, back, again = (list(long)[k] for k in (2, 2 * n - 3, 2 * n + 2))
    for frame in (back, again):
        assert np.array_equal(frame.left, first.left)
        assert np.array_equal(frame.right, first.right)
        assert frame.joints_left_rad == pytest.approx(first.joints_left_rad)
