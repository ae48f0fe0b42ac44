"""The search for a moving object in both eyes, on ray-cast scenes."""

from collections import Counter
from contextlib import nullcontext

import numpy as np
from ball_scenes import Sphere, frame

from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import home
from pps_vision.robot.model import Robot
from tracking.acquisition import Acquisition, AcquisitionParams
from tracking.outline import Optics
from tracking.stereo import Association, StereoParams, camera_frames

DT = 0.05


def test_one_eye_that_confirms_a_motion_is_enough(robot: Robot, rig: StereoRig) -> None:
    """A ball on the right eye's line of sight shifts in the left image only; in the right one it just grows."""
    q = home(robot)
    view = rig.view(q)
    optics = Optics(rig.left), Optics(rig.right)
    rng = np.random.default_rng(3)
    acquisition = Acquisition(AcquisitionParams(), optics, None, lambda _: nullcontext(), Counter())
    association = Association.untrained(StereoParams(), rig.left.width)
    found = []
    for k in range(9):
        p = view.right.center + (0.45 - 0.012 * max(k - 4, 0)) * view.right.rays([150.0, 120.0])
        one = frame(rig, q, [Sphere(p, 0.03, (210, 45, 40))], DT * k, rng)
        pair, regions = acquisition.step(camera_frames(one, view), view, DT * k, None, association)
        found.append(pair is not None)
    assert regions[0][0].flow is not None
    assert found == [False] * 8 + [True]
    assert pair is not None
    assert pair[1].flow is None  # not confirmed by flow


def test_of_two_objects_that_move_the_one_with_more_residual_is_taken(robot: Robot, rig: StereoRig) -> None:
    """A small red and a large blue ball, both across the view."""
    q, rng = home(robot), np.random.default_rng(3)
    view = rig.view(q)
    across = view.left.T_root_camera[:3, 1]
    starts = [view.left.center + 0.4 * view.left.rays([u, 100.0]) for u in (80.0, 240.0)]
    optics = Optics(rig.left), Optics(rig.right)
    acquisition = Acquisition(AcquisitionParams(), optics, None, lambda _: nullcontext(), Counter())
    association = Association.untrained(StereoParams(), rig.left.width)
    pairs = []
    for k in range(9):
        small, large = (start + 0.012 * max(k - 4, 0) * across for start in starts)
        balls = [Sphere(small, 0.015, (210, 45, 40)), Sphere(large, 0.035, (40, 60, 210))]
        one = frame(rig, q, balls, DT * k, rng)
        pair, _ = acquisition.step(camera_frames(one, view), view, DT * k, None, association)
        pairs += [pair] if pair else []
    assert pairs
    for pair in pairs:
        assert abs(pair[0].outline.center_px[0] - 240) < 10
