"""Errors drawn from the covariance that comes with them are found consistent; twice as large ones are not."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawn_study import run_and_draw

from pps_vision.experiments.consistency import QUANTITIES, Consistency, _of_film, covered, values_of
from pps_vision.experiments.independent_cases import CASES
from pps_vision.experiments.independent_films import Film
from pps_vision.experiments.scenarios import Footage
from pps_vision.experiments.sensor_chain import SensorChain
from pps_vision.experiments.study import Values
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.types import Status, StereoFrame, Track3D
from tracking.tracker import TrackerStep

N = 200


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def _values(rng: np.random.Generator, factor: float) -> Values:
    """An approach that ends in a touch, whose every track errs independently, `factor` times what it states."""
    stamps, v = 0.02 * np.arange(N + 1), np.array([-0.1, 0.0, 0.0])
    path = np.outer(4.0 - stamps, -v) + np.array([0.03, 0.0, 0.0])
    velocity = np.tile(v, (N + 1, 1))
    velocity[-1] = 0.0  # it has touched the origin
    A = rng.standard_normal((6, 6)) * np.repeat([2e-4, 2e-3], 3)[:, None]
    cov = np.zeros((12, 12))
    cov[:6, :6] = A @ A.T + np.diag(np.repeat([1e-8, 1e-6], 3))
    steps = []
    for stamp_s, p in zip(stamps, path, strict=True):
        mean = np.zeros((4, 3))
        mean[:2] = np.stack([p, v]) + factor * rng.multivariate_normal(np.zeros(6), cov[:6, :6]).reshape(2, 3)
        track = Track3D(float(stamp_s), mean, cov, 0.03, 0.0, Status.TRACKING)
        steps.append(TrackerStep(track, (), None, np.zeros(3)))
    image, q = np.zeros((2, 2, 3), np.uint8), np.zeros(1)
    frames = tuple(StereoFrame(image, image, float(s), float(s), q, q) for s in stamps)
    seen, boxes = np.ones(N + 1, bool), ((None, None),) * (N + 1)
    recording = Footage(frames, path, velocity, seen, boxes, 0.03, icub_rig(load_icub()), None)
    return values_of(recording, steps)


def test_what_errs_as_it_states_is_consistent(rng: np.random.Generator) -> None:
    honest, vain = ([_values(rng, factor) for _ in range(4)] for factor in (1.0, 2.0))
    assert np.mean([one["nees"] for one in honest]) == pytest.approx(6, rel=0.1)
    assert np.mean([one["nees"] for one in vain]) == pytest.approx(24, rel=0.1)
    for quantity in QUANTITIES:
        found = {s: 100 * np.mean(np.concatenate([one[f"{quantity} {s}"] for one in honest])) for s in (68, 95)}
        assert found[68] == pytest.approx(68, abs=5), quantity
        assert found[95] == pytest.approx(95, abs=2.5), quantity
        assert np.mean(np.concatenate([one[f"{quantity} 95"] for one in vain])) < 0.8


def test_time_to_contact_is_exact_where_the_track_is(rng: np.random.Generator) -> None:
    values = _values(rng, 1e-6)
    assert np.median(values["ttc_percent"]) < 1e-3
    assert len(values["ttc_percent"]) == 25  # the last half second, but for the touch itself and the frame before


@pytest.mark.long
def test_coverage_has_intervals_over_recordings(monkeypatch: pytest.MonkeyPatch) -> None:
    """The study on simulated tracks: every number has an interval that holds it, and a place in chart and table."""
    rng = np.random.default_rng(6)
    monkeypatch.setattr("pps_vision.experiments.scenarios.moving", lambda *_, **__: None)
    values = itertools.cycle([_values(rng, 1.0) for _ in range(5)])
    monkeypatch.setattr("pps_vision.experiments.consistency._run", lambda *_: next(values))
    monkeypatch.setattr("pps_vision.experiments.consistency._of_film", lambda *_: next(values))
    numbers, charts = run_and_draw(Consistency(n=2, cases=("vivid, red", "vivid, blue")))
    value, low, high = numbers["cells"]["rendered"]["all"]["position 95"]
    assert 90 < low < value < high < 99
    assert numbers["cells"]["rendered"]["ball"]["n"] == 18
    assert [axis.get_title() for axis in charts[""].axes] == ["rendered scenes", "independent scenes"]
    assert covered(68, [72.9, 70, 75]) == "72.9 (70–75)"
    assert covered(68, [73.1, 70, 75]) == "**73.1 (70–75)**", "more than 5 points off"
    assert covered(95, [91.9, 90, 93]) == "**91.9 (90–93)**"
    assert covered(95, [98.04, 97, 99]) == "98 (97–99)"
    halves = {source: {half: cell["n"] for half, cell in cells.items()} for source, cells in numbers["halves"].items()}
    assert halves == {"rendered": {"fitted": 18, "held out": 18}, "independent": {"fitted": 4, "held out": 4}}


def test_a_film_that_is_tracked_has_its_errors_inside_its_intervals() -> None:
    case = next(case for case in CASES if case.name == "vivid, red")
    scene = replace(case.base, width=160, height=120, seconds=1.5, start="moving", sensor=SensorChain(read_noise=1.0))
    values = _of_film(case, Film(scene, 300, Path("absent")))
    assert len(values["position 95"]) > 60
    assert np.mean(values["position 95"]) > 0.7
