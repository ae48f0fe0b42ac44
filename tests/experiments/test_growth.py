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
    assert exponent(sizes, [[100.0, 0, 0], *ms[1:]]) == pytest.approx(
        power
    )  # what costs the same anyway does not count
    assert np.isnan(exponent(sizes[:1], ms[:1]))


def test_what_grows_is_drawn_and_tabled_beside_what_a_result_file_holds_else() -> None:
    cell = {"sizes": [10, 100], "ms": {"slow": [[2.0, 1.0, 3.0], [20.0, 10.0, 30.0]]}, "memory_mb": [50.0, 60.0]}
    of_object = {"sizes": [60, 200], "ms": {"all pixels": [[5.0, 4.0, 6.0], [9.0, 8.5, 9.5]]}}
    axes = {"taxels": cell, "object (pixels across)": of_object}
    numbers = {"study": "growth", "parameters": {"n": 3}, "processor_min": 1.0, "axes": axes}
    tables = Growth().tables(numbers)
    assert [list(row) for row in tables[""].rows] == [
        ["taxels: slow", "10", "2 (1–3)", "100", "20 (10–30)", "1.00"],
        ["taxels: memory in use", "10", "50 MB", "100", "60 MB", "–"],
        ["object (pixels across): all pixels", "60", "5 (4–6)", "200", "9 (8.5–9.5)", "0.49"],
    ]
    assert [list(row) for row in tables["object"].rows] == [["60", "5 (4–6)", "–"], ["200", "**9 (8.5–9.5)**", "≤ 8"]]
    for axis in Growth().chart(numbers).axes:
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
    for one in (back, again):
        assert np.array_equal(one.left, first.left)
        assert np.array_equal(one.right, first.right)
        assert one.joints_left_rad == pytest.approx(first.joints_left_rad)
