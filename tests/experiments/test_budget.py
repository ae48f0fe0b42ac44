"""The study of `track --max-error-mm` on short recordings."""

import json

import pytest

from pps_vision.experiments import budget
from pps_vision.experiments.budget import Budget


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
    assert {"", "requests"} == set(study.tables(numbers)) == set(study.chart(numbers))
