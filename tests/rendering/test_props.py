"""Further things in the scene, visible, occluding and blurred like all else, and the room around the robot."""

import numpy as np
import pytest
import trimesh

from pps_vision.geometry.se3 import rotation_to
from rendering.eyes import Eyes
from rendering.scene import PropPose, SceneState
from rendering.sensor import Sensor
from rendering.shapes import Part, board
from rendering.stimuli import GREEN, Stimulus, make_stimulus

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


def test_a_patch_is_as_large_as_it_is_turned(robot, rig, q):
    """Seen face on its pixels span the solid angle of a disc; at 60° half of it; from its edge next to none."""
    eye = rig.view(q).left
    facing = rotation_to(eye.center - PLACE)
    whole = np.pi * 0.015**2 / np.sum((eye.center - PLACE) ** 2)
    level = None
    disc = Part(trimesh.creation.cylinder(0.015, 0.001, sections=48), GREEN)
    with Eyes(robot, rig, Stimulus("marker", 0.015, (disc,))) as eyes:
        for turned, share in ((0.0, 1.0), (60.0, 0.5), (90.0, 0.0)):
            c = np.cos(np.deg2rad(turned))
            s = np.sin(np.deg2rad(turned))
            rotation = facing @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
            image = eyes.render(SceneState(q, PLACE, rotation=rotation), 0.0).left.astype(int)
            green = image[..., 1] - image[..., ::2].max(axis=2)
            level = level or green.max() / 2  # a pixel counts where half of it is green
            assert eye.camera.solid_angle_map()[green > level].sum() / whole == pytest.approx(share, abs=0.06)
