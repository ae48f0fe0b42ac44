"""What is said in the loop against a known truth."""

from types import SimpleNamespace

import numpy as np
import pytest
from drawn_study import run_and_draw

from learning.reach.babbling import gaze_at_hand, random_arms
from learning.reach.map import MapPrediction
from pps_vision.experiments.reach import in_loop
from pps_vision.experiments.reach.in_loop import _LIMITS, InLoop, judge
from pps_vision.robot.icub import load_icub
from pps_vision.types import Reachability, ReachStatus

ROBOT = load_icub()


def said(status: ReachStatus, probability: float) -> Reachability:
    return Reachability(0.0, np.full(3, np.nan), probability, probability, status)


def test_verdicts_are_counted_at_the_true_position() -> None:
    """Where kinematics has the left palm is reachable; 2 m ahead nothing is; behind the head nothing is fixated."""
    arms = random_arms(200, np.random.default_rng(1))
    arm = arms[np.isfinite(gaze_at_hand(ROBOT, "left", arms, _LIMITS)[:, 0])][0]
    q = np.zeros(ROBOT.n_joints)
    q[ROBOT.indices(ROBOT.names.arm("left")[:4])] = arm
    near = ROBOT.at(q).point(ROBOT.names.palms[0])
    truth = np.array([near, near, [-2.0, 0.0, 0.3], [0.5, 0.0, 0.3], near])
    rows = (
        said(ReachStatus.REACHABLE, 0.9),
        said(ReachStatus.UNREACHABLE, 0.6),
        said(ReachStatus.REACHABLE, 0.9),
        said(ReachStatus.NOT_FIXATED, np.nan),
        said(ReachStatus.UNKNOWN, np.nan),
    )
    learned = SimpleNamespace(query=lambda gaze: MapPrediction(*[np.isfinite(gaze[:, 0])] * 4))
    values = judge(ROBOT, learned, SimpleNamespace(reachability=rows, truth_m=truth))
    assert len(values["frames"]) == 4
    np.testing.assert_array_equal(values["truly_reachable"], [True, True, False, False])
    np.testing.assert_array_equal(values["right"], [True, False, False, True])
    np.testing.assert_array_equal(values["false_positives"], [False, False, True, False])
    np.testing.assert_array_equal(values["false_negatives"], [False, True, False, False])
    np.testing.assert_array_equal(values["not_fixated"], [False, False, False, True])


def test_a_run_in_which_nothing_is_tracked_counts_for_nothing() -> None:
    log = SimpleNamespace(
        reachability=[Reachability.without_answer(0.0, ReachStatus.UNKNOWN)], truth_m=np.zeros((1, 3))
    )
    learned = SimpleNamespace(query=lambda gaze: MapPrediction(*[np.isfinite(gaze[:, 0])] * 4))
    assert {len(values) for values in judge(ROBOT, learned, log).values()} == {0}


@pytest.mark.long
def test_a_short_run_is_measured_and_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """One rendered path of 0.6 s from within reach, with a coarse map."""
    monkeypatch.setattr(in_loop, "_SECONDS", 0.6)
    monkeypatch.setattr(in_loop, "_N_TIMED", 10)
    study = InLoop(3, n=1, n_labels=400)
    numbers, _ = run_and_draw(study)
    assert 0 < numbers["frames"] <= 12
    assert numbers["right"][0] > 50
    assert all(low <= high for low, _, high in numbers["processor_ms"].values())
