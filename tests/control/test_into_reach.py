"""Torso, head and hand, with a map and a relation that are plain geometry."""

from dataclasses import dataclass

import numpy as np
import pytest

from control import fixation, into_reach
from control.fixation import FixationParams, fixation_error, gaze_at
from control.into_reach import IntoReachParams, IntoReachState, Learned
from learning.reach.torso_gaze import TorsoFrame
from pps_vision.robot.gaze import GazeLimits, fixated_gaze, fixation_points, gaze_for_points
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array, Mask

# a coarse lattice and long steps: the exact geometry that stands in for what is learned takes its time
ROBOT, PARAMS, DT = load_icub(), IntoReachParams(lattice_rad=np.deg2rad(8)), 0.1
FRAME = TorsoFrame(ROBOT)
TORSO, ARM = ROBOT.indices(("torso_yaw", "torso_pitch")), ROBOT.indices(ROBOT.names.right_arm)
CENTER, RADIUS = np.array([-0.32, 0.08, 0.25]), 0.10  # what is to be reachable, as it lies for an upright torso
ASIDE, FAR = CENTER + np.array([0.0, 0.18, 0.0]), CENTER - np.array([0.35, 0.0, 0.0])
GOAL = np.deg2rad([-40.0, 30.0, 10.0, 60.0])
START = ROBOT.clamp(np.zeros(ROBOT.n_joints))


@dataclass(frozen=True)
class Ball:
    reachable: Mask
    degree: Array


def ball(radius: float) -> Learned:
    """A map of a ball, and what turns truly do to the gaze."""

    def judge(gaze: Array) -> Ball:
        known = np.isfinite(gaze).all(axis=1)
        off = np.full(len(gaze), np.nan)
        off[known] = np.linalg.norm(fixation_points(ROBOT, gaze[known]) - CENTER, axis=1)
        return Ball(off < radius, 0.5 + radius - off)

    def keeps(gaze: Array, torso: Array, turns: Array) -> Array:
        point = FRAME.to_root(torso[None], fixation_points(ROBOT, gaze[None]))
        around = FRAME.from_upright(torso + turns, np.repeat(point, len(turns), axis=0))
        return gaze_for_points(ROBOT, around)

    return Learned(judge, keeps, lambda _: (GOAL, 0.0))


def run(learned: Learned, point: Array, seconds: float = 10.0, seen=lambda t: True):
    """Modes, postures and commands until it is there or gives up."""
    q, state, rows = gaze_at(ROBOT, START, point), IntoReachState(), []
    for k in range(int(seconds / DT)):
        posture = ROBOT.at(q)
        gaze = fixated_gaze(posture) if seen(k * DT) else None
        state, command = into_reach.step(PARAMS, learned, state, posture, gaze, DT, k * DT)
        rows.append((state.mode, q, command.dq_rad_s))
        if state.mode in ("there", "out of reach"):
            break
        dq = command.dq_rad_s + fixation.step(FixationParams(), posture, point, dt_s=DT).dq_rad_s
        q = q + DT * dq
        assert np.all((q >= ROBOT.lower_rad - 1e-3) & (q <= ROBOT.upper_rad + 1e-3))
    return rows


def test_what_lies_aside_is_brought_into_reach_and_the_arm_goes_to_its_goal():
    rows = run(ball(RADIUS), ASIDE)
    modes = [mode for mode, _, _ in rows]
    assert [m for k, m in enumerate(modes) if k == 0 or m != modes[k - 1]] == [
        "judging", "turning", "judging", "reaching", "there",
    ]  # fmt: skip
    q = rows[-1][1]
    around = FRAME.from_upright(q[None, TORSO], ASIDE[None])[0]
    assert np.linalg.norm(around - CENTER) < RADIUS + 1e-6
    np.testing.assert_allclose(q[ARM], [*GOAL, 0, 0, 0], atol=np.deg2rad(0.3))
    assert max(fixation_error(ROBOT.at(q), ASIDE) for _, q, _ in rows) < np.deg2rad(0.5)
    assert max(np.abs(dq[TORSO]).max() for _, _, dq in rows) <= np.deg2rad(15) + 1e-9
    neck = ROBOT.indices(ROBOT.names.gaze_joints[:2])
    turning = [dq for mode, _, dq in rows if mode == "turning"]
    reaching = [dq for mode, _, dq in rows if mode == "reaching"]
    assert max(np.abs(dq[ARM]).max() for dq in reaching) == pytest.approx(PARAMS.arm_rad_s)
    assert max(np.abs(dq[neck]).max() for dq in turning) == pytest.approx(PARAMS.gaze_rad_s)


def test_what_is_within_reach_needs_no_turn():
    rows = run(ball(RADIUS), CENTER)
    assert "turning" not in {mode for mode, _, _ in rows}
    assert not any(np.any(dq[TORSO]) for _, _, dq in rows)


def test_what_no_turn_brings_into_reach_moves_nothing():
    rows = run(ball(0.01), FAR)
    assert rows[-1][0] == "out of reach"
    assert not any(np.any(dq) for _, _, dq in rows)


def test_out_of_sight_it_stops_and_goes_on_when_it_is_seen_again():
    rows = run(ball(RADIUS), ASIDE, seen=lambda t: not 0.8 < t < 1.4)
    hidden = [(mode, dq) for k, (mode, _, dq) in enumerate(rows) if 0.8 < k * DT < 1.4]
    assert all(mode == "unseen" and not np.any(dq) for mode, dq in hidden)
    assert "turning" in [mode for mode, _, _ in rows[:8]]
    assert rows[-1][0] == "there"


def test_a_hand_that_would_miss_is_not_sent():
    learned = ball(RADIUS)
    missing = Learned(learned.judge, learned.keeps, lambda _: (GOAL, 0.02))
    rows = run(missing, CENTER)
    assert rows[-1][0] == "out of reach"
    assert not any(np.any(dq) for _, _, dq in rows)


def test_what_moves_away_meanwhile_is_judged_again():
    learned, posture = ball(RADIUS), ROBOT.at(gaze_at(ROBOT, START, CENTER))
    gaze = fixated_gaze(posture)
    reaching = IntoReachState("reaching", 1.0, None, gaze, GOAL)
    assert into_reach.step(PARAMS, learned, reaching, posture, gaze, DT, 1.1)[0].mode == "reaching"
    state, command = into_reach.step(PARAMS, learned, reaching, posture, gaze + np.deg2rad(3), DT, 1.1)
    assert state.mode == "judging"
    assert not np.any(command.dq_rad_s)


@pytest.mark.parametrize(("degree", "goes_on"), [(0.51, True), (0.5, False), (np.nan, False)])
def test_a_hand_on_its_way_stops_when_the_map_no_longer_says_reachable(degree, goes_on):
    learned, posture = ball(RADIUS), ROBOT.at(gaze_at(ROBOT, START, CENTER))
    doubting = Learned(lambda gaze: Ball(np.array([False]), np.array([degree])), learned.keeps, learned.hand_to)
    gaze = fixated_gaze(posture)
    reaching = IntoReachState("reaching", 1.0, None, gaze, GOAL)
    state, command = into_reach.step(PARAMS, doubting, reaching, posture, gaze, DT, 1.1)
    assert (state.mode, bool(np.any(command.dq_rad_s))) == ("reaching" if goes_on else "judging", goes_on)


def test_the_torso_ends_near_where_the_plan_ends():
    rows = run(ball(RADIUS), ASIDE)
    gaze = fixated_gaze(ROBOT.at(rows[0][1]))
    way = into_reach.plan(PARAMS, ball(RADIUS), ROBOT, gaze, np.zeros(2))
    assert way is not None
    np.testing.assert_allclose(way[-1], rows[-1][1][TORSO], atol=PARAMS.lattice_rad)


def test_a_gaze_beyond_the_limits_is_nan():
    looking_down = GazeLimits(pitch_rad=(np.deg2rad(-40), np.deg2rad(-20)))
    posture = ROBOT.at(gaze_at(ROBOT, START, [-0.4, 0.0, 0.34]))
    assert np.isnan(fixated_gaze(posture, looking_down)).all()
    assert fixated_gaze(posture)[1] == pytest.approx(0, abs=0.05)


def smallest_turn() -> float:
    """The least turn (rad) of the torso after which what lies aside is within the ball, on a grid of 1°."""
    turns = np.deg2rad(np.stack(np.meshgrid(np.arange(-45, 46), np.arange(-10, 31)), axis=-1).reshape(-1, 2))
    points = FRAME.from_upright(turns, np.repeat(ASIDE[None], len(turns), axis=0))
    return float(np.linalg.norm(turns[np.linalg.norm(points - CENTER, axis=1) < RADIUS], axis=1).min())


def test_the_way_is_the_shortest():
    """Whatever the map's degree is on the way: here it falls towards what is reachable."""
    plain = ball(RADIUS)

    def judge(gaze: Array) -> Ball:
        verdict = plain.judge(gaze)
        return Ball(verdict.reachable, np.where(verdict.reachable, 0.9, -verdict.degree))

    learned = Learned(judge, plain.keeps, plain.hand_to)
    gaze = fixated_gaze(ROBOT.at(gaze_at(ROBOT, START, ASIDE)))
    way = into_reach.plan(PARAMS, learned, ROBOT, gaze, np.zeros(2))
    assert way is not None
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).sum() < smallest_turn() + 2 * PARAMS.lattice_rad
    rows = run(learned, ASIDE)
    assert rows[-1][0] == "there"
    turned = np.linalg.norm(np.diff([q[TORSO] for _, q, _ in rows], axis=0), axis=1).sum()
    assert turned < smallest_turn() + 2 * PARAMS.lattice_rad


def test_what_is_nowhere_reachable_for_certain_is_tried_where_it_is_likely():
    """The map calls no gaze reachable, and inverse kinematics gets there."""
    plain = ball(RADIUS)
    learned = Learned(
        lambda gaze: Ball(np.zeros(len(gaze), bool), plain.judge(gaze).degree), plain.keeps, plain.hand_to
    )
    rows = run(learned, ASIDE)
    assert rows[-1][0] == "there"
    around = FRAME.from_upright(rows[-1][1][None, TORSO], ASIDE[None])[0]
    assert np.linalg.norm(around - CENTER) < RADIUS, "the degree exceeds 0.5 within the ball"


def test_a_planned_gaze_keeps_a_margin_from_where_the_map_knows_nothing():
    """The map ends so near to the gaze of the first plan that the next plan goes another way."""
    plain, margin = ball(RADIUS), np.deg2rad(4.0)
    params = IntoReachParams(lattice_rad=np.deg2rad(8), margin_rad=margin)
    gaze = fixated_gaze(ROBOT.at(gaze_at(ROBOT, START, ASIDE)))

    def gazes(way: Array) -> Array:
        return plain.keeps(gaze, way[0], way - way[0])

    first = into_reach.plan(params, plain, ROBOT, gaze, np.zeros(2))
    assert first is not None
    end = gazes(first)[:, 2].max() + np.deg2rad(1.0)  # of vergence, in the first plan's margin

    def judge(gaze: Array) -> Ball:
        verdict, known = plain.judge(gaze), gaze[:, 2] < end
        return Ball(verdict.reachable & known, np.where(known, verdict.degree, np.nan))

    second = into_reach.plan(params, Learned(judge, plain.keeps, plain.hand_to), ROBOT, gaze, np.zeros(2))
    if second is not None:
        assert gazes(second)[1:, 2].max() < end - margin + np.deg2rad(0.1)
    assert second is None or not np.array_equal(first, second)


def test_plans_stay_within_the_torsos_limits():
    torso = ROBOT.upper_rad[TORSO] - 0.01
    plain = ball(RADIUS)
    way = into_reach.plan(PARAMS, plain, ROBOT, gaze_for_points(ROBOT, ASIDE[None])[0], torso)
    assert way is not None
    assert len(way) > 1
    assert np.all((way >= ROBOT.lower_rad[TORSO]) & (way <= ROBOT.upper_rad[TORSO]))
