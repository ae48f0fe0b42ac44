"""The five charts draw what they are given, losses included."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from pps_vision.experiments.charts import (
    pareto_front,
)
from pps_vision.experiments.study import catalogue
from pps_vision.experiments.tables import read_numbers

KNOWN, DOCS = catalogue(), Path(__file__).parents[2] / "docs"
SLOW = "independent", "encounters_sessions"


def test_the_front_holds_what_no_other_beats() -> None:
    assert pareto_front([1, 2, 3, 4, 2], [5, 3, 4, np.nan, 9]) == [0, 1]
    assert pareto_front([1, 2, 3], [np.nan, 3, 3]) == [1], "no error is no point; the slower of equals is beaten"


@pytest.mark.parametrize("study", [pytest.param(s, marks=[pytest.mark.long] * (s in SLOW)) for s in KNOWN])
def test_the_documents_charts_follow_from_the_results(study: str) -> None:
    """Every figure of a study in the documents is drawn from its numbers."""
    drawn = KNOWN[study]().chart(read_numbers(DOCS / "results" / f"{study}.json"))
    charts = {"": drawn} if isinstance(drawn, Figure) else drawn
    files = {f"{study}_{part}.png" if part else f"{study}.png" for part in charts}
    others = tuple(name for name in KNOWN if name.startswith(f"{study}_"))
    published = {file.name for file in (DOCS / "figures").glob(f"{study}*.png") if not file.name.startswith(others)}
    assert published <= files
    for figure in charts.values():
        assert any(axis.lines or axis.collections or axis.patches or axis.images for axis in figure.axes)
