"""The parameters of the encounters' baselines are those that the tuning study found."""

import json
from pathlib import Path

from pps_vision.app.encounters.registry import BASELINES
from pps_vision.app.encounters.tuned import TUNED


def test_tuned_parameters_are_those_of_the_tuning_study() -> None:
    file = Path(__file__).parents[2] / "docs" / "results" / "encounters.json"
    best = {name: of for name, of in json.loads(file.read_text())["tuning"]["best"].items() if name in BASELINES}
    assert {name: {k: v for k, v in of.items() if k != "score"} for name, of in best.items()} == TUNED
    for name, baseline in BASELINES.items():
        assert all(low <= TUNED[name][k] <= high for k, (low, high) in baseline.ranges.items())
