"""The offsets figure, on one robot and its own trials."""

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.pps import offsets
from pps_vision.experiments.pps.offsets import Offsets


def test_offsets_of_a_robot_that_errs_are_found_within_3_mm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offsets, "TRIALS", {"palm": 12})
    figure = Offsets(robots=1, seed=SEED)
    numbers = figure.run()
    assert numbers["all"]["taxels"] >= 1
    assert numbers["all"]["off_median_mm"]["found"] < 3
    assert figure.chart(numbers).axes
    found, true = ([row[key] for row in numbers["taxels"]] for key in ("found_mm", "true_mm"))
    assert np.isfinite(found).all()
    assert np.isfinite(true).all()


def test_no_robots_are_refused() -> None:
    with pytest.raises(ValueError, match="--robots 0"):
        Offsets(robots=0).run()
