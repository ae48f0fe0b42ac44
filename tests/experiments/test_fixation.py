"""The study of fixation: targets that are what they are said to be, and controllers that know more err less."""

import numpy as np
import pytest

from control.fixation import fixation_error
from pps_vision.experiments import fixation
from pps_vision.experiments.fixation import METHODS, Condition, Fixation, _last_above, _motion, _Robot, _start_and_point
from pps_vision.experiments.scenarios import EYES_M
from tracking import kalman


@pytest.fixture(scope="module")
def eyes() -> _Robot:
    return _Robot()


def test_severities_are_in_their_units() -> None:
    usual = Condition()
    assert usual.at("speed", 20) == Condition(speed_m_s=0.2)
    assert usual.at("latency", 50) == Condition(latency_s=0.05)
    assert usual.at("angle", 10) == Condition(start_deg=10)
    assert usual.at("noise", 0.1) == Condition(noise_px=0.1)


def test_what_is_within_its_bound_for_good_is_so_after_the_last_value_above_it() -> None:
    assert _last_above(np.array([3.0, 0.05, 2.0, 0.1, 0.0]), 0.1) == pytest.approx(3 * 0.025)
    assert _last_above(np.array([0.1, 0.1]), 0.1) == 0


@pytest.mark.parametrize("start_deg", [5.0, 30.0])
def test_a_point_to_settle_on_is_in_view_and_so_far_off(eyes: _Robot, start_deg: float) -> None:
    q, point = _start_and_point(eyes, np.random.default_rng(2), start_deg)
    view = eyes.rig.view(q)
    assert view.left.sees(point)
    assert view.right.sees(point)
    assert abs(np.rad2deg(fixation_error(eyes.robot.at(q), point)) - start_deg) <= 2.5


def test_an_approach_comes_to_the_forearm_again_and_again(eyes: _Robot) -> None:
    motion = _motion(eyes, "approach", np.random.default_rng(4), 0.3)
    times = np.arange(0, 12, 0.01)
    path = np.array([motion(t)[0] for t in times])
    taxels, _ = eyes.skin.at(eyes.robot.at(eyes.home))
    gap = np.linalg.norm(path[:, None] - taxels, axis=2).min(axis=1) - 0.03
    assert abs(gap.min()) < 0.002
    assert np.count_nonzero(np.diff((gap < 0.01).astype(int)) == 1) >= 2
    assert np.linalg.norm(path - EYES_M, axis=1).min() > 0.25
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / 0.01
    assert speed[speed > 0.01].max() == pytest.approx(0.3, rel=0.01)


def test_six_joints_settle_and_predict_and_are_best_where_they_know_the_motion(
    eyes: _Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fixation, "_STATIC_S", 1.25)
    study = Fixation(seed=3, n=1, seconds=1.4)
    settled = study._static(eyes, "six joints", Condition(start_deg=10.0))
    assert 0 < settled["eyes_s"][0] <= settled["settled_s"][0] <= 0.75
    assert settled["settled_s"][0] == max(settled["eyes_s"][0], settled["neck_s"][0])
    assert settled["in_time"][0] == 100
    late = Condition(latency_s=0.15)
    names = ("six joints, motion known", "six joints, present known", "six joints", "six joints, latency ignored")
    assert set(names) < set(METHODS)
    rms = [study._moving(eyes, name, late, ("circle",))["rms_deg"][0] for name in names]
    assert rms == sorted(rms)
    assert rms[0] < 0.3 < rms[3]


def test_a_target_is_where_it_will_be_and_stays_where_it_is_seen_if_the_latency_is_ignored(eyes: _Robot) -> None:
    p, v = np.array([-0.4, 0.1, 0.2]), np.array([0.1, 0.0, -0.2])
    belief = kalman.start(kalman.KalmanParams(), 1.0, p, 1e-6 * np.eye(3), v, 1e-6 * np.eye(3))
    at = {name: eyes._target(METHODS[name], belief, lambda t: (p, v), 1.0, 0.05) for name in METHODS}
    aimed, ignored = at["six joints"], at["six joints, latency ignored"]
    assert aimed is not None
    assert ignored is not None
    np.testing.assert_allclose(aimed[0], p + 0.05 * v, atol=1e-5)
    np.testing.assert_allclose(ignored[0], p, atol=1e-9)


def test_of_what_is_not_in_view_at_first_ever_more_is_seen(eyes: _Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fixation, "_FOUND_S", (1.0, 4.0, 15.0))
    found = Fixation(seed=3, n=1)._search(eyes)
    for shares in found.values():
        seen = [share[0] for share in shares.values()]
        assert seen == sorted(seen)
        assert 0 <= seen[0] < seen[-1] <= 100
    assert found["covering"]["15 s"][0] == 100
    assert found["random"]["15 s"][0] < 100
    assert found["covering, from 8 cm on"] != found["covering"]
