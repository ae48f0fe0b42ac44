"""Run a study as `bench` does: its numbers as read from JSON, its charts and its tables."""

import json
from typing import Any

from matplotlib.figure import Figure

from pps_vision.experiments.study import Study
from pps_vision.recordings.atomic_write import plain


def run_and_draw(study: Study) -> tuple[dict[str, Any], dict[str, Figure]]:
    """Return the numbers and the charts by name, every chart with axes and every table with rows as its header."""
    numbers = json.loads(json.dumps(plain(study.run())))
    drawn = study.chart(numbers)
    charts = {"": drawn} if isinstance(drawn, Figure) else dict(drawn)
    assert all(figure.axes for figure in charts.values())
    for table in study.tables(numbers).values():
        assert table.rows
        assert all(len(row) == len(table.header) and all(isinstance(cell, str) for cell in row) for row in table.rows)
    return numbers, charts
