"""Eyes off: the skin learns from the robot's touches of itself, and the arm then avoids its own finger."""

from collections.abc import Iterator

import numpy as np
import pytest
from known_track import frame_at

from control.avoidance import AvoidanceParams
from control.double_touch import DoubleTouch, DoubleTouching
from learning.pps.memory import PPSMemory
from pps_vision.app.fingertip import FingertipTracker
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.experiments.pps.movements import plans
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array, Status

ROBOT = load_icub()
SKIN = icub_skin(("left_forearm", "left_palm"))
ARM = ROBOT.indices(ROBOT.names.arm("left"))
TAXEL = 3
DT = 0.05
TIP = ROBOT.names.index_tips[1]
TRAINED = 10
TESTED = 4


@pytest.fixture(scope="module")
def touches() -> list[DoubleTouch]:
    planned: Iterator[DoubleTouch] = plans(DoubleTouching(ROBOT, SKIN.parts[0]), TAXEL, (5,))
    return [next(planned) for _ in range(TRAINED + TESTED)]


def gaps(q: Array) -> Array:
    return np.linalg.norm(SKIN.at(ROBOT.at(q))[0] - ROBOT.at(q).point(TIP), axis=1)


def touch(memory: PPSMemory, movement: DoubleTouch, obeys: bool) -> tuple[PPSMemory, float, float]:
    """Both arms move as planned, the left one besides as commanded if it `obeys`.

    Returns the memory afterwards, the smallest distance of fingertip and taxels, and that at the first command."""
    home = tuple(movement.joints_rad[0][ARM])
    params = PipelineParams(arm=AvoidanceParams(home, confirmation_s=0.1))
    pipeline = Pipeline(params, ROBOT, SKIN, FingertipTracker(ROBOT), memory, np.random.default_rng(0))  # type: ignore[arg-type]
    aside = np.zeros(ROBOT.n_joints)
    nearest = np.inf
    first = np.nan
    for k, planned in enumerate(movement.joints_rad):
        q = planned + aside
        distance = gaps(q)
        step = pipeline.step(frame_at(DT * k, q), distance < 0.015)
        nearest = min(nearest, float(distance.min()))
        if step.response.mode == "avoid" and np.isnan(first):
            first = float(distance.min())
        if obeys:
            aside[ARM] += DT * step.command.dq_rad_s[ARM]
    return pipeline.finish(), nearest, first


def test_the_arm_avoids_its_own_finger_after_it_has_felt_it(touches: list[DoubleTouch]) -> None:
    untaught = memory = PPSMemory.empty(SKIN)
    for movement in touches[:TRAINED]:
        memory, nearest, _ = touch(memory, movement, obeys=False)
        assert nearest < 0.015
    for movement in touches[TRAINED:]:
        _, nearest, first = touch(memory, movement, obeys=True)
        assert nearest > 0.1
        assert first > 0.15
        _, nearest, first = touch(untaught, movement, obeys=True)
        assert nearest < 0.06, "only links without skin are kept clear, 3 cm of theirs"
        assert first < 0.06


def test_the_fingertip_s_track_is_that_of_the_joints() -> None:
    """A wrist that turns: position within 1 mm, velocity from the last frame within 1 cm/s; none after a gap."""
    tracker = FingertipTracker(ROBOT)
    joint = ROBOT.indices(("right_wrist_pitch",))[0]
    tips = []
    tracks = []
    for k, stamp_s in enumerate((1.0, 1.1, 1.1, 1.6, 2.2)):
        turned = home(ROBOT)
        turned[joint] -= 0.02 * k
        tips.append(ROBOT.at(turned).point(TIP))
        step = tracker.step(frame_at(stamp_s, turned))
        tracks.append(step.track)
        assert (step.detections, step.observation, step.midpoint_root.shape) == ((), None, (3,))
    assert [track.status for track in tracks] == [
        *(Status.SEARCHING, Status.TRACKING, Status.SEARCHING, Status.TRACKING, Status.SEARCHING)
    ]
    for k, elapsed_s in ((1, 0.1), (3, 0.5)):
        np.testing.assert_allclose(tracks[k].mean, [tips[k], (tips[k] - tips[k - 1]) / elapsed_s, [0] * 3, [0] * 3])
        np.testing.assert_allclose(np.sqrt(np.diag(tracks[k].cov)), np.repeat([0.001, 0.01, 0, 0], 3), atol=1e-12)
        assert not (tracks[k].cov - np.diag(np.diag(tracks[k].cov))).any()
