"""A tool in the hand, from what the hand feels."""

import numpy as np

from learning.pps.memory import PPSMemory, activation, count_samples
from learning.pps.tool import Tools, extend
from pps_vision.robot.skin import icub_skin
from pps_vision.types import TaxelEvents

SKIN = icub_skin(("left_forearm", "left_palm"))
N = len(SKIN.taxel_ids)
PALM = SKIN.part_index == 1
TIP = np.array([0.15, 0.0, 0.0])


def felt(distance_m, touched=PALM):
    n = len(distance_m)
    return TaxelEvents(
        1.0, tuple(map(str, range(n))), distance_m, np.ones(n), np.resize(touched, n) & (np.arange(n) < N)
    )


def test_a_touch_that_no_taxel_is_near_to_is_that_of_a_tool():
    tools = Tools(SKIN)
    for distance_m in (np.full(N, 0.02), np.full(N, np.nan)):
        np.testing.assert_array_equal(tools.own_touches(felt(distance_m)), PALM)
    assert not tools.own_touches(felt(np.full(N, 0.12))).any()


def test_touches_near_each_other_make_one_place_of_the_part_that_felt_them():
    tools = Tools(SKIN)
    for k, towards in enumerate(np.eye(3)):
        tools = tools.with_touch(1, TIP + 0.01 * k, 2 * towards)
    tip = tools.extended.parts[-1]
    assert (tip.frame, len(tools.extended.parts)) == (SKIN.parts[1].frame, 3)
    np.testing.assert_allclose(tip.positions_m[0], TIP + 0.01)
    np.testing.assert_allclose(tip.normals[0], np.ones(3) / np.sqrt(3))
    assert len(tools.with_touch(1, -TIP, TIP).extended.parts) == len(tools.with_touch(0, TIP, TIP).extended.parts) == 4
    for tip_m, at_tip in ((0.01, True), (0.09, False), (np.nan, False)):
        events = tools.attributed(felt(np.append(np.full(N, 0.12), tip_m)))
        np.testing.assert_array_equal(events.touched, np.append(np.zeros(N, bool), at_tip))


def test_a_new_place_expects_what_its_body_part_does():
    tools = Tools(SKIN).with_touch(1, TIP, TIP)
    memory = PPSMemory.empty(SKIN)
    for _ in range(9):
        memory = count_samples(memory, *np.full((2, N), 0.05), PALM, 0.0)
    P = activation(extend(memory, tools), *np.full((2, N + 1), 0.05), 0.0)
    np.testing.assert_array_equal(P[:N], activation(memory, *np.full((2, N), 0.05), 0.0))
    assert P[N] > 0.5
