"""What the hand hides: believed where it was, and for how long; by kinematics, with tracks made up."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from control import fixation, into_reach, last_seen
from control.fixation import FixationParams, gaze_at
from control.into_reach import IntoReachParams, IntoReachState, Learned
from control.last_seen import LastSeenParams
from pps_vision.robot.gaze import fixated_gaze
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array, Mask, Status, Track3D

ROBOT, DT = load_icub(), 0.05
PLACE, AWAY_M_S = np.array([-0.3, 0.1, 0.25]), np.array([0.0, 0.1, 0.0])
LOST_S = 1.5


def track(stamp_s: float, position: Array = PLACE, velocity=(0.0, 0.0, 0.0), std_m_s: float = 0.002) -> Track3D:
    """Seen to 0.2 mm."""
    mean, cov = np.zeros((4, 3)), np.zeros((12, 12))
    mean[0], mean[1] = position, velocity
    cov[:6, :6] = np.diag([2e-4**2] * 3 + [std_m_s**2] * 3)
    return Track3D(stamp_s, mean, cov, 0.03, 1e-6, Status.TRACKING)


@dataclass(frozen=True)
class Always:
    reachable: Mask
    degree: Array


def reach(seconds: float, arm_rad_s: float) -> list[tuple[float, str, Array]]:
    """Time, mode and what all joints are told: an object at rest, lost at `LOST_S`, that then goes away unseen."""
    learned = Learned(
        lambda gaze: Always(np.ones(len(gaze), bool), np.ones(len(gaze))),
        lambda gaze, torso, turns: np.tile(gaze, (len(turns), 1)),
        lambda gaze: (np.deg2rad([-70.0, 60.0, 30.0, 90.0]), 0.0),
    )
    params = replace(IntoReachParams(), arm_rad_s=arm_rad_s)
    q, state, last, told = gaze_at(ROBOT, ROBOT.clamp(np.zeros(ROBOT.n_joints)), PLACE), IntoReachState(), None, []
    for k in range(int(seconds / DT)):
        t = k * DT
        now = track(t) if t < LOST_S else Track3D.unknown(t, Status.LOST if t < LOST_S + DT else Status.SEARCHING)
        last, believed = last_seen.step(LastSeenParams(), last, now, hidden=False)
        posture = ROBOT.at(q)
        gaze = None if believed is None else fixated_gaze(posture)
        state, command = into_reach.step(params, learned, state, posture, gaze, DT, t)
        dq = command.dq_rad_s
        if believed is not None:
            dq = dq + fixation.step(FixationParams(), posture, believed.position, believed.velocity, DT, t).dq_rad_s
        told.append((t, state.mode, dq))
        q = ROBOT.clamp(q + DT * dq)
    return told


def test_the_hand_goes_on_blind_and_gets_there():
    told = reach(seconds=5.0, arm_rad_s=np.deg2rad(60))
    assert next(mode for t, mode, _ in told if t > LOST_S) == "reaching"
    assert "there" in {mode for _, mode, _ in told}


def test_what_goes_away_unseen_is_not_chased_for_longer_than_the_bound():
    told = reach(seconds=6.0, arm_rad_s=np.deg2rad(12))  # too slow to get there in time
    ends = LOST_S + LastSeenParams().longest_s
    assert all(mode == "reaching" and np.any(dq) for t, mode, dq in told if LOST_S < t < ends - 2 * DT)
    assert all(mode == "unseen" and not np.any(dq) for t, mode, dq in told if t > ends + DT)
    assert "there" not in {mode for _, mode, _ in told}


@pytest.mark.parametrize("wrong", [{"rest_m_s": np.nan}, {"longest_s": -1.0}, {"most_std_m": -0.01}])
def test_limits_that_are_none_are_refused(wrong):
    with pytest.raises(ValueError, match="expected no limit below 0"):
        LastSeenParams(**wrong)


@pytest.mark.parametrize(
    ("seen", "lasts_s"),
    [
        (track(0.0), 2.5),
        (track(0.0, velocity=AWAY_M_S), 0.0),  # last seen moving
        (track(0.0, std_m_s=0.02), 0.5),  # 1 cm after half a second
    ],
)
def test_how_long_it_is_believed(seen, lasts_s):
    last, believed = last_seen.step(LastSeenParams(), None, seen, hidden=False)
    assert believed is seen
    known = []
    for t in np.arange(0.1, 5.0, 0.1):
        last, believed = last_seen.step(LastSeenParams(), last, Track3D.unknown(t), hidden=False)
        if believed is not None:
            known.append(t)
            assert believed.status == Status.COASTING
            np.testing.assert_array_equal(believed.position, PLACE)
    assert max(known, default=0.0) == pytest.approx(lasts_s, abs=0.11)


def test_what_is_partly_hidden_confirms_nothing_and_a_free_view_elsewhere_does():
    """A track that the hand drags along is not believed; the object found again in the open is."""
    last, _ = last_seen.step(LastSeenParams(), None, track(0.0), hidden=False)
    dragged = track(0.1, PLACE + 0.03)
    last, believed = last_seen.step(LastSeenParams(), last, dragged, hidden=True)
    np.testing.assert_array_equal(believed.position, PLACE)
    elsewhere = track(3.0, PLACE + 0.2)
    last, believed = last_seen.step(LastSeenParams(), last, elsewhere, hidden=False)
    assert believed is elsewhere


def test_nothing_seen_is_nothing_to_act_on():
    assert last_seen.step(LastSeenParams(), None, Track3D.unknown(0.0), hidden=False) == (None, None)
    assert last_seen.step(LastSeenParams(), None, track(0.0), hidden=True) == (None, None)
