"""Cost of the whole skin: the body has taxels that perceive the ball, and the study draws what it measured."""

import numpy as np
from data import SEED

from pps_vision.experiments.pps import whole_skin
from pps_vision.experiments.pps.whole_skin import WholeSkin, expects, make_body, trial


def test_only_taxels_near_the_ball_are_activated() -> None:
    body = make_body(500, np.random.default_rng(SEED))
    active = expects(body) > 0
    assert 0 < active.sum() < 100
    perceives = np.isfinite(trial(body).samples[30].distance_m)
    assert (perceives[active]).all()


def test_the_study_runs_and_is_drawn(monkeypatch) -> None:
    monkeypatch.setattr(whole_skin, "_TAXELS", (32, 4000))
    study = WholeSkin(seed=SEED, runs=5)
    numbers = study.run()
    assert numbers["activation_ms"][32]["least"] > 0
    assert study.chart(numbers).axes
