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
    assert [region.flow for region in regions[1]] == [None]  # flow does not confirm it
    assert found == [False] * 8 + [True]
