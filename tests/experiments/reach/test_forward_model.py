"""Forward models against samples whose answer is known."""

import numpy as np
import pytest
from drawn_study import run_and_draw

from learning.reach.babbling import Babbled
from pps_vision.experiments.reach import forward_model
from pps_vision.experiments.reach.forward_model import METHODS, ForwardModel, learn_and_time


class Exact:
    """Knows the gaze of the samples below; answers half of them."""

    def learn(self, arm_rad: np.ndarray, gaze_rad: np.ndarray) -> None:
        pass

    def __call__(self, arm_rad: np.ndarray) -> np.ndarray:
        return np.where(arm_rad[:, :1] > 0, arm_rad[:, :3] + np.deg2rad(0.5), np.nan)


def test_error_and_unanswered_share_of_a_known_model() -> None:
    arm = np.random.default_rng(1).uniform(-0.5, 0.5, (300, 4))
    both = Babbled(arm, arm[:, :3], 300)
    (row,) = learn_and_time(Exact(), [both], both)
    assert row["rmse_deg"] == pytest.approx(0.5)
    assert row["unanswered_percent"] == pytest.approx(100 * np.mean(arm[:, 0] <= 0))
    assert row["ms"] == sorted(row["ms"])


def test_the_mean_of_sets_has_the_interval_of_their_errors() -> None:
    rows = [{"rmse_deg": error, "update_ms": 2.0, "ms": [1.0, error, 9.0]} for error in (1.0, 2.0, 6.0)]
    found = forward_model.mean_row(rows)
    assert found["rmse_deg"] == 3
    assert found["ms"] == [1, 3, 9]
    assert 1 <= found["rmse_95_deg"][0] < 3 < found["rmse_95_deg"][1] <= 6


def test_the_revolute_model_is_exact_and_lwpr_nearly_as_good_as_in_the_paper(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("model of revolute joints", "LWPR, each sample once")
    monkeypatch.setattr(forward_model, "METHODS", {name: METHODS[name] for name in names})
    study = ForwardModel(4, n=1, sizes=(200, 1600))
    numbers, _ = run_and_draw(study)
    exact, lwpr = (numbers["methods"][name] for name in names)
    assert exact[-1]["rmse_deg"] < 1e-3
    assert lwpr[-1]["rmse_deg"] < min(1.2, lwpr[0]["rmse_deg"])
    assert [row[0] for row in study.tables(numbers)[""].rows] == list(names)
