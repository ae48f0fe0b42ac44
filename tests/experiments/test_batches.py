"""Batches against frame by frame, on a few pairs."""

import numpy as np
import pytest
from drawn_study import run_and_draw

from pps_vision.experiments import batches
from pps_vision.experiments.batches import ALONE, Batches, differences


@pytest.mark.long
def test_the_detections_agree_and_every_size_is_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within 0.05 px, with the lens's distortion and noise of 2/255."""
    monkeypatch.setattr(batches, "SIZES", (1, 4))
    monkeypatch.setattr(batches, "TURNS", 1)
    numbers, _ = run_and_draw(Batches(n=1, seconds=0.4))
    assert set(numbers["cells"]) == {"marker", "ball"}
    for cells in numbers["cells"].values():
        assert {ALONE, *(f"cpu, {size} pairs" for size in (1, 4))} <= set(cells)
        for cell in cells.values():
            assert cell["apart_px"][0] < 0.05
            assert cell["only_in_one"][0] == 0
            assert 0 < cell["error_px"][0] < 0.3
            assert cell["ratio"][0] > 0


def test_what_only_one_has_is_counted() -> None:
    one = np.zeros((3, 2, 2))
    other = one + np.array([3.0, 4.0])
    other[1, 0] = np.nan
    found = differences(one, other, one)
    assert (found["only_in_one"].sum(), found["apart_px"].max(), found["error_px"].max()) == (1, 5.0, 0.0)
    assert len(found["apart_px"]) == 5
