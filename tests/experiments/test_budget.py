"""The study of `track --max-error-mm` on short recordings."""

import json

import pytest

from pps_vision.experiments import budget
from pps_vision.experiments.budget import Budget


@pytest.mark.long
def test_fewer_pixels_cost_less_and_err_more_and_what_is_promised_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "ASKED_MM", (0.3, 10.0))
    monkeypatch.setattr(budget, "TURNS", 3)
    study = Budget(n=1, seconds=2.0, only="independent, ball, 640")
    numbers = json.loads(json.dumps(study.run()))
    ball = numbers["cells"]["independent, ball, 640×480"]
    quarter, whole = ball["pixels 4 × 4"], ball["all pixels"]
    assert whole["near_percent"][0] == 100
    assert 0.2 < whole["true_over_reported"][0] < 4
    assert quarter["ratio"][0] < 0.95
    assert quarter["rms_mm"][0] > 1.5 * whole["rms_mm"][0]
    requests = numbers["requests"]["independent, ball, 640×480"]
    assert requests["10 mm"]["promised"][0] == 1
    assert requests["10 mm"]["kept"][0] == 1
    assert requests["0.3 mm"]["kept"][0] != 0  # NaN where it promises nothing
    (small,), (large,) = numbers["choices"]["independent, ball, 640×480"].values()
    assert small["configuration"] == "all pixels"
    assert (large["promised"], large["error_mm"] <= 10) == (True, True)
    assert {"", "requests", "tally"} == set(study.tables(numbers))
    assert [axis.get_title() for axis in study.chart(numbers).axes] == ["independent scenes"]


def test_requests_are_counted_by_what_became_of_them() -> None:
    """Two recordings: one is promised at 3 mm and fails; the other is refused at 1 mm, needlessly."""

    def one(configuration: str, promised: bool, error_mm: float | None) -> dict[str, object]:
        return {"configuration": configuration, "promised": promised, "error_mm": error_mm, "median_ms": 2.0}

    choices = {
        "rendered, ball": {"1 mm": [one("all pixels", False, 0.9)], "3 mm": [one("pixels 2 × 2", True, 3.1)]},
        "real, ball": {"1 mm": [one("all pixels", False, 1.1)], "3 mm": [one("all pixels", False, None)]},
    }
    study = Budget()
    rows = study.tables({"cells": {}, "requests": {}, "choices": choices})["tally"].rows
    assert rows == [
        ["rendered", "2", "0 of 1", "1 of 1", "0 of 1"],
        ["real", "2", "0 of 0", "0 of 2", "1 of 1"],
        ["all", "4", "0 of 1", "1 of 3", "1 of 2"],
    ]
    figure = study.chart({"choices": choices})
    marks = {
        (axis.get_title(), line.get_xdata()[0]): (line.get_color(), line.get_markerfacecolor())
        for axis in figure.axes
        for line in axis.lines
        if len(line.get_xdata())
    }
    assert marks["rendered scenes", 3.0] == ("tab:orange", "tab:orange")
    assert marks["rendered scenes", 1.0] == marks["real scenes", 3.0] == ("tab:blue", "white"), "open: not promised"
