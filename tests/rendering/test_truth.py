"""The truth about the stimulus: its pixels by OpenCV, its visibility by placing things in the way."""

import cv2
import numpy as np

from rendering.eyes import Eyes
from rendering.scene import SceneState
from rendering.stimuli import make_stimulus

IN_VIEW = np.array([-0.32, -0.08, 0.12])


def test_pixels_are_opencvs_projection_of_the_centre(robot, rig, q):
    velocity = np.array([0.01, 0.02, 0.03])
    with Eyes(robot, rig, make_stimulus("cube")) as eyes:
        truth = eyes.truth(SceneState(q, IN_VIEW, velocity), 2.5)
    for view, px in ((rig.view(q).left, truth.left_px), (rig.view(q).right, truth.right_px)):
        T = view.T_camera_root
        rvec = cv2.Rodrigues(T[:3, :3])[0]
        camera = view.camera
        expected = cv2.projectPoints(IN_VIEW, rvec, T[:3, 3], camera.K, np.array(camera.distortion))[0]
        assert np.allclose(px, expected.ravel(), atol=1e-6)
    assert truth.stamp_s == 2.5
    assert truth.radius_m == 0.030
    assert np.array_equal(truth.position, IN_VIEW)
    assert np.array_equal(truth.velocity, velocity)
    assert truth.visible_left
    assert truth.visible_right


def test_behind_the_arm_it_is_hidden_and_before_it_it_is_not(robot, rig, q):
    forearm = robot.at(q).point("left_forearm", (0.0, -0.07, 0.012))
    eye = rig.view(q).left.center
    away = (forearm - eye) / np.linalg.norm(forearm - eye)
    with Eyes(robot, rig, make_stimulus("marker")) as eyes:
        behind = eyes.truth(SceneState(q, forearm + 0.06 * away), 0.0)
        in_front = eyes.truth(SceneState(q, forearm - 0.06 * away), 0.0)
    assert rig.view(q).left.sees(forearm)
    assert not behind.visible_left
    assert in_front.visible_left


def test_only_one_eye_may_be_hidden_from(robot, rig, q):
    forearm = robot.at(q).point("left_forearm", (0.0, -0.07, 0.012))
    eye = rig.view(q).left.center
    aside = forearm + 0.020 * rig.view(q).left.T_root_camera[:3, 0]  # near the edge of the left eye's view
    with Eyes(robot, rig, make_stimulus("marker", 0.004)) as eyes:
        truth = eyes.truth(SceneState(q, aside + 0.5 * (aside - eye)), 0.0)
    assert not truth.visible_left
    assert truth.visible_right


def test_a_carrier_hides_it_only_from_its_own_side(robot, rig, q):
    towards_eyes = rig.view(q).left.center - IN_VIEW
    with Eyes(robot, rig, make_stimulus("ball"), "hand") as eyes:
        from_here = eyes.truth(SceneState(q, IN_VIEW, carrier_direction=towards_eyes), 0.0)
        from_there = eyes.truth(SceneState(q, IN_VIEW, carrier_direction=-towards_eyes), 0.0)
    assert not from_here.visible_left
    assert from_there.visible_left


def test_under_the_table_it_is_hidden(robot, rig, q):
    eye = rig.view(q).left.center
    way = IN_VIEW - eye
    under = eye + way * (-0.30 - eye[2]) / way[2]
    with Eyes(robot, rig, make_stimulus("marker")) as eyes:
        assert not eyes.truth(SceneState(q, under), 0.0).visible_left


def test_outside_the_image_it_is_not_visible(robot, rig, q):
    with Eyes(robot, rig, make_stimulus("ball")) as eyes:
        behind_the_head = eyes.truth(SceneState(q, np.array([0.5, 0.0, 0.3])), 0.0)
        beside = eyes.truth(SceneState(q, np.array([-0.3, 0.5, 0.2])), 0.0)
    assert np.isnan(behind_the_head.left_px).all()
    assert not behind_the_head.visible_left
    assert not beside.visible_left


def test_where_there_is_none_all_is_nan(robot, rig, q):
    with Eyes(robot, rig, make_stimulus("ball")) as eyes:
        truth = eyes.truth(SceneState(q), 0.0)
    assert np.isnan([*truth.position, *truth.left_px, *truth.right_px]).all()
    assert not truth.visible_left
    assert not truth.visible_right
