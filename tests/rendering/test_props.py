"""Further things in the scene, visible, occluding and blurred like all else, and the room around the robot."""

import numpy as np
import pytest

from pps_vision.geometry.se3 import rotation_to
from rendering.eyes import Eyes
from rendering.scene import PropPose, SceneState
from rendering.sensor import Sensor
from rendering.shapes import board
from rendering.stimuli import make_stimulus

PLACE = np.array([-0.36, -0.06, 0.12])
ASIDE = np.array([-0.34, 0.06, 0.14])


def test_a_distractor_looks_like_the_same_thing_as_a_stimulus(robot, rig, q):
    ball = make_stimulus("ball")
    cube = make_stimulus("cube")
    velocity = np.array([0.0, 0.4, 0.0])
    sensor = Sensor(blur_s=0.04)
    assert rig.view(q).left.sees(ASIDE, margin_px=20)
    with Eyes(robot, rig, ball, sensor=sensor, props=(cube.parts,)) as eyes:
        together = eyes.render(SceneState(q, PLACE, props=(PropPose(ASIDE, velocity),)), 0.0)
    with Eyes(robot, rig, cube, sensor=sensor, props=(ball.parts,)) as eyes:
        exchanged = eyes.render(SceneState(q, ASIDE, velocity, props=(PropPose(PLACE),)), 0.0)
    assert np.array_equal(together.left, exchanged.left)
    assert np.array_equal(together.right, exchanged.right)


def test_a_board_hides_what_is_behind_it(robot, rig, q):
    eye = rig.view(q).left
    between = 0.5 * (PLACE + eye.center)
    facing = rotation_to(eye.center - PLACE)
    halfway = between + 0.05 * facing[:, 0]  # its edge on the line of sight
    with Eyes(robot, rig, make_stimulus("ball"), props=((board(0.1, 0.2),),)) as eyes:
        red = {}
        for name, place in (("free", None), ("half", halfway), ("hidden", between)):
            props = (None if place is None else PropPose(place, rotation=facing),)
            state = SceneState(q, PLACE, props=props)
            image = eyes.render(state, 0.0).left.astype(int)
            red[name] = np.count_nonzero(image[..., 0] - image[..., 1:].max(axis=2) > 60)
            if name != "half":
                assert eyes.truth(state, 0.0).visible_left == (name == "free")
    assert red["hidden"] == 0
    assert red["half"] == pytest.approx(0.5 * red["free"], rel=0.05)


def test_props_that_are_not_placed_are_not_there(robot, rig, q):
    state = SceneState(q, PLACE)
    with Eyes(robot, rig, make_stimulus("ball")) as eyes:
        bare = eyes.render(state, 0.0).left
    with Eyes(robot, rig, make_stimulus("ball"), props=((board(0.1, 0.2),),)) as eyes:
        assert np.array_equal(eyes.render(state, 0.0).left, bare)
        with pytest.raises(ValueError, match="places 2 props; there are 1"):
            eyes.render(SceneState(q, PLACE, props=(None, None)), 0.0)
