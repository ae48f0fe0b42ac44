"""A tool in the hand, learned from the hand's touches."""

from dataclasses import replace

import numpy as np
import pytest

from control.fixation import gaze_at
from learning.pps.joint_offsets import TouchTrial
from learning.pps.memory import PPSMemory, activation, count_samples
from learning.pps.tool import ToolTouch, attributed, touch_beyond, with_tool
from pps_vision.robot.icub import icub_setup
from pps_vision.robot.skin import icub_skin
from pps_vision.types import TaxelEvents

SKIN = icub_skin(("left_forearm", "left_palm"))
N = len(SKIN.taxel_ids)
PALM = SKIN.part_index == 1
TIP = np.array([0.15, 0.0, 0.0])
RADIUS_M = 0.03
HELD = [ToolTouch(1, TIP + 0.01 * k, towards) for k, towards in enumerate(np.eye(3))]


def test_touches_near_each_other_make_one_place_of_the_part_that_felt_them():
    single = [ToolTouch(1, -TIP, TIP), ToolTouch(0, TIP, TIP)]
    memory = with_tool(PPSMemory.empty(SKIN), SKIN, HELD + single)
    tip = memory.skin_of(SKIN).parts[-1]
    assert (tip.frame, memory.taxel_ids[N:]) == (SKIN.parts[1].frame, ("left_palm_tool:0",))
    assert memory.skin_of(SKIN).taxel_ids == memory.taxel_ids
    np.testing.assert_allclose(tip.positions_m[0], TIP + 0.01)
    np.testing.assert_allclose(tip.normals[0], np.ones(3) / np.sqrt(3))
    again = with_tool(memory, SKIN, HELD[:1] + 2 * single[:1])
    assert again.places[:, 6].tolist() == [4, 2]
    assert again.taxel_ids[:-1] == memory.taxel_ids
    assert with_tool(memory, SKIN, []) is memory


def test_a_new_place_expects_what_its_body_part_does_and_the_skin_what_it_did():
    memory = PPSMemory.empty(SKIN)
    for _ in range(9):
        memory = count_samples(memory, *np.full((2, N), 0.05), PALM, 0.0)
    P = activation(with_tool(memory, SKIN, HELD), *np.full((2, N + 1), 0.05), 0.0)
    np.testing.assert_array_equal(P[:N], activation(memory, *np.full((2, N), 0.05), 0.0))
    assert P[N] > 0.5


@pytest.mark.parametrize(
    ("skin_m", "tip_m", "owner"),
    [
        (0.02, 0.01, "palm"),
        (-0.02 - 2 * RADIUS_M, 0.01, "palm"),  # behind it, by `perceive`
        (np.nan, np.nan, "palm"),  # an object that was not seen
        (0.12, 0.01, "tip"),
        (np.nan, 0.01, "tip"),
        (0.12, 0.09, "none"),
    ],
)
def test_a_touch_that_no_taxel_is_near_to_is_that_of_the_tool(skin_m, tip_m, owner):
    memory = with_tool(PPSMemory.empty(SKIN), SKIN, HELD)
    D = np.append(np.full(N, skin_m), tip_m)
    felt = TaxelEvents(1.0, memory.taxel_ids, D, np.ones(N + 1), np.append(PALM, False), radius_m=RADIUS_M)
    palm, tip = owner == "palm", owner == "tip"
    np.testing.assert_array_equal(attributed(memory, felt).touched, np.append(PALM & palm, tip))
    without = replace(felt, distance_m=D[:N], touched=PALM)
    assert attributed(PPSMemory.empty(SKIN), without) is without


@pytest.mark.parametrize(("gap_m", "is_beyond"), [(0.02, False), (0.07, False), (0.15, True), (1.5, False)])
def test_what_a_body_error_explains_is_no_tool(gap_m, is_beyond):
    """Neither is what a hand cannot hold."""
    setup = icub_setup(SKIN)
    part = SKIN.parts[1]
    T = setup.robot.at(setup.home_rad).T_root(part.frame)
    along = np.array([1.0, 0.0, 0.0])
    foremost = part.positions_m[part.positions_m[:, 0].argmax()]
    center = T[:3, :3] @ (foremost + (gap_m + RADIUS_M) * along) + T[:3, 3]
    q = gaze_at(setup.robot, setup.home_rad, center)
    for towards in (along, np.array([0.0, 0.6, -0.8])):  # of an object at rest, and of one that moves
        v = -0.1 * T[:3, :3] @ towards if towards is not along else np.zeros(3)
        moving = v[None], np.zeros((1, 3, 3)), np.array([RADIUS_M])
        trial = TouchTrial(np.zeros(1), q[None], center[None], *moving, PALM)
        touch = touch_beyond(setup.robot, setup.rig, SKIN, trial, np.zeros(setup.robot.n_joints))
        assert (touch is not None) == is_beyond
        if touch is not None:
            assert touch.part == 1
            nearest = foremost + (gap_m + RADIUS_M) * along - RADIUS_M * towards
            np.testing.assert_allclose(touch.point, nearest, atol=0.005)
