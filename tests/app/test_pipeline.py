"""What the pipeline refuses, and what it counts."""

import numpy as np
import pytest

from learning.pps.memory import PPSMemory
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.robot.icub import home, icub_rig, load_icub
from pps_vision.robot.skin import icub_skin
from pps_vision.types import StereoFrame
from tracking.tracker import Tracker, TrackerParams


def pipeline(memory_of: tuple, skin_of: tuple, params: PipelineParams | None = None) -> Pipeline:
    robot, rng = load_icub(), np.random.default_rng(0)
    tracker = Tracker(TrackerParams(), icub_rig(robot), rng)
    memory, skin = PPSMemory.empty(icub_skin(memory_of)), icub_skin(skin_of)
    return Pipeline(params or PipelineParams(), robot, skin, tracker, memory, rng)


def test_a_memory_of_another_skin() -> None:
    with pytest.raises(ValueError, match="16 other taxels; expected the skin's 12"):
        pipeline(("left_forearm", "left_palm"), ("left_forearm",))


def test_a_touch_by_what_nobody_saw_is_counted() -> None:
    one = pipeline(("left_forearm",), ("left_forearm",))
    q, black = home(one.robot), np.zeros((240, 320, 3), np.uint8)
    touched = np.arange(12) == 3
    for k, touch in enumerate((None, touched, None)):
        one.step(StereoFrame(black, black, 0.05 * k, 0.05 * k, q, q), touch)
    memory = one.finish()
    assert one.rejected == {"stale samples": 0, "unseen touches": 1}
    assert memory.counts.sum() == 0


def test_a_message_of_another_skin_is_refused_and_the_next_is_heard() -> None:
    one = pipeline(("left_forearm",), ("left_forearm",))
    q, black = home(one.robot), np.zeros((240, 320, 3), np.uint8)
    frame = StereoFrame(black, black, 0.0, 0.0, q, q)
    with pytest.raises(ValueError, match=r"touched \(5,\); expected the skin's 12 taxels"):
        one.step(frame, np.ones(5, bool))
    assert not one.step(frame, np.zeros(12, bool)).events.touched.any()


def test_a_skin_that_the_avoiding_arm_does_not_carry_moves_nothing() -> None:
    one = pipeline(("right_forearm",), ("right_forearm",))
    q, black = home(one.robot), np.zeros((240, 320, 3), np.uint8)
    step = one.step(StereoFrame(black, black, 0.0, 0.0, q, q), np.ones(12, bool))
    assert not step.command.dq_rad_s.any()


@pytest.mark.parametrize("bimodal", [False, True])
def test_an_arm_touched_in_the_dark_withdraws_if_it_also_feels(bimodal: bool) -> None:
    one = pipeline(("left_forearm",), ("left_forearm",), PipelineParams(bimodal=bimodal))
    q, black = home(one.robot), np.zeros((240, 320, 3), np.uint8)
    positions, normals = one.skin.at(one.robot.at(q))
    for k in range(8):
        step = one.step(StereoFrame(black, black, 0.05 * k, 0.05 * k, q, q), np.arange(12) == 3)
    assert (step.activations > 0).tolist() == [bimodal and i == 3 for i in range(12)]
    away = (one.skin.at(one.robot.at(q + 0.05 * step.command.dq_rad_s))[0] - positions)[3] @ -normals[3]
    assert away > 0.001 if bimodal else not step.command.dq_rad_s.any()
