"""The study of cost as it grows."""

from pathlib import Path

import numpy as np
import pytest

import pps_vision as pv
from pps_vision.experiments.growth import to_and_fro


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
