"""The soak's own instruments: what is held is counted, and a short run neither grows nor drifts."""

from collections import deque

import numpy as np
import pytest

from pps_vision.experiments.soak import Soak, _held


def test_what_grows_is_seen_to_grow() -> None:
    class Hoarder:
        def __init__(self) -> None:
            self.kept: deque[np.ndarray] = deque()

    hoarder = Hoarder()
    before = _held(hoarder)
    hoarder.kept.extend(np.zeros(100) for _ in range(5))
    after = _held(hoarder)
    assert after[0] - before[0] == 5
    assert after[1] - before[1] == 5 * 800


def test_a_marker_neither_grows_nor_drifts() -> None:
    numbers = Soak(frames=400)._soak("marker")
    assert numbers["known_share"] == 1.0
    first, last = numbers["objects_held_first_last"]
    assert last <= first + 20
    assert numbers["position_std_mm_last"] == pytest.approx(numbers["position_std_mm_first"], rel=0.2)
    assert numbers["position_error_mm_last"] < 2.0


def test_less_than_five_laps_tell_nothing() -> None:
    with pytest.raises(ValueError, match="--frames 100"):
        Soak(frames=100).run()
