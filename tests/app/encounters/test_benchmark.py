"""PPS-Bench: a controller of one's own beside another, on the same objects, with intervals and a page."""

import json
from itertools import product
from typing import get_args

import pytest

from pps_vision.app.encounters.benchmark import benchmark
from pps_vision.app.encounters.encounter import Condition
from pps_vision.app.encounters.registry import NONE
from pps_vision.app.encounters.tracks import Perception
from pps_vision.recordings import REPORT

RESTLESS = """
import numpy as np
def new(scene):
    return lambda activations, track, posture: 0.2 * np.isin(np.arange(scene.robot.n_joints), scene.arm[:1])
"""


def test_a_restless_arm_and_one_at_rest_share_the_score(tmp_path, monkeypatch):
    """The arm at rest leaves every harmless object alone and is touched by every other one."""
    (tmp_path / "restless.py").write_text(RESTLESS)
    monkeypatch.chdir(tmp_path)
    rates = benchmark(tmp_path / "out", 1, 2, (NONE, "restless:new", NONE), 1, share=0.01)
    for of in rates.values():
        assert of[NONE].harmless[0] == 100
        assert of[NONE].hazards[0] == 0
        ends = of[NONE].harmless[1] / 2, 50 + of[NONE].hazards[2] / 2  # each of the two shares can only be off one way
        assert of[NONE].score == pytest.approx([50, *ends])
        assert of["restless:new"].harmless[0] == 0
    rows = json.loads((tmp_path / "out" / "encounters.json").read_text())["encounters"]
    kinds = set(get_args(Condition)) - {"reach"}
    met = [(row["condition"], row["perception"], row["controller"]) for row in rows]
    assert set(met) == set(product(kinds, get_args(Perception), (NONE, "restless:new")))
    assert len(met) == len(set(met))
    assert "restless:new" in (tmp_path / "out" / REPORT).read_text()
