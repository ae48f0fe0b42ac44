"""The study of `track --max-error-mm` on short recordings."""

import json

import pytest

from pps_vision.experiments import budget
from pps_vision.experiments.budget import Budget


def test_the_default_states_its_error_on_rendered_balls_and_keeps_a_wide_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(budget, "_OBJECTS", ("ball",))
    study = Budget(n=1, seconds=2.0, scenes="rendered")
    numbers = json.loads(json.dumps(study.run()))
    ball = numbers["cells"]["rendered, ball"]["120 particles"]
    assert ball["near_percent"][0] == 100
    assert 0.2 < ball["true_over_reported"][0] < 4
    assert numbers["requests"]["rendered, ball"]["10 mm"]["promised"][0] == 1
    assert numbers["requests"]["rendered, ball"]["10 mm"]["kept"][0] == 1
    assert numbers["requests"]["rendered, ball"]["0.3 mm"]["kept"][0] != 0  # NaN where it promises nothing
    assert {"", "requests"} == set(study.tables(numbers))
    assert study.chart(numbers).axes
