"""The pipeline with a reachable-space map: its answer in every frame; the arm reaches for reachable objects only.

The loop is closed on kinematics (`known_track`).
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from data import SEED
from known_track import DT, KnownTrack, run, touched_by_all

from control.avoidance import AvoidanceParams
from control.lean import LeanParams
from control.reaching import ReachingParams
from learning.reach.map import ReachableMap
from learning.reach.params import ArmLimits, MapParams
from learning.reach.training import train_reachable_map
from pps_vision.app.pipeline import Pipeline, PipelineParams, PipelineStep
from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.icub import HOME_ARM_RAD, home, load_icub
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array, ReachStatus

ROBOT = load_icub()
SKIN = icub_skin(("left_forearm", "left_palm"))
ARM = ROBOT.indices(ROBOT.names.arm("left"))
TRUTH = SphericalArm.of(
    ROBOT.chain(ROBOT.names.arm("left")[:4], "left_palm"), ArmLimits().lower_rad, ArmLimits().upper_rad
)
REACH = ReachingParams(HOME_ARM_RAD)
AVOID = AvoidanceParams(HOME_ARM_RAD)


def learned(side: str) -> ReachableMap:
    limits = GazeLimits(pitch_rad=(np.deg2rad(-80), np.deg2rad(40)))
    params = MapParams(limits, n_labels=1500, round_labels=500, n_babble=20_000, lattice=0.08)
    return train_reachable_map(ROBOT, side, np.random.default_rng(SEED), params)


@pytest.fixture(scope="module")
def left() -> ReachableMap:
    return learned("left")


@pytest.fixture(scope="module")
def right() -> ReachableMap:
    return learned("right")


def pipeline(
    motion,
    arm: AvoidanceParams | ReachingParams,
    reachable_map: ReachableMap | None,
    max_fp: float = 1e-3,
    leans: bool = False,
) -> Pipeline:
    lean = LeanParams() if leans else None
    params = PipelineParams(arm=arm, lean=lean, max_false_positives=max_fp)
    rng = np.random.default_rng(0)
    return Pipeline(params, ROBOT, SKIN, KnownTrack(motion), touched_by_all(SKIN), rng, reachable_map)


def towards(taxel: str, begin_m: float, end_m: float, speed_m_s: float = 0.06):
    """Along a taxel's normal at home, from one distance to another, and there it stays."""
    points, normals = SKIN.at(ROBOT.at(home(ROBOT)))
    point = points[SKIN.index(taxel)]
    normal = normals[SKIN.index(taxel)]

    def motion(t: float) -> tuple[Array, Array]:
        distance_m = begin_m - speed_m_s * t
        return point + max(distance_m, end_m) * normal, -speed_m_s * normal * (distance_m > end_m)

    return motion


def truly(motion, steps: list[PipelineStep]) -> Array:
    """Whether the hand gets to where the object is, by the arm in closed form."""
    return np.isfinite(TRUTH.solve(np.array([motion(DT * k)[0] for k in range(len(steps))]))[:, 0])


def test_an_object_in_reach_is_reached_for(left):
    motion = towards("left_palm:101", 0.17, 0.08)
    steps, joints = run(pipeline(motion, REACH, left))
    assert truly(motion, steps).all()
    assert all(step.reachability and step.reachability.is_reachable for step in steps)
    modes = [step.response.mode for step in steps]
    assert modes.count("reach") > 20
    moved = ROBOT.at(joints[modes.index("reach") + 10]).point("left_palm") - ROBOT.at(joints[0]).point("left_palm")
    to_object = motion(1.0)[0] - ROBOT.at(joints[0]).point("left_palm")
    assert moved @ to_object / np.linalg.norm(to_object) > 0.03  # ten frames at 10 cm/s


def test_an_object_out_of_reach_is_not(left):
    """Close to the skin near the elbow, where the hand cannot go: the skin feels it coming all the same."""
    motion = towards("left_forearm:27", 0.15, 0.05)
    steps, joints = run(pipeline(motion, REACH, left))
    assert not truly(motion, steps).any()
    assert sum(step.activation.probability.max() > REACH.threshold for step in steps) > 20
    assert {step.reachability.status for step in steps if step.reachability} == {ReachStatus.UNREACHABLE}
    assert not any(step.command.dq_rad_s[ARM].any() for step in steps)
    np.testing.assert_array_equal(joints[:, ARM], np.tile(HOME_ARM_RAD, (len(joints), 1)))


def test_the_torso_leans_until_the_hand_can_touch_and_stands_up_again(left):
    """The object near the elbow, which goes away after 7 s; the same with the arm that avoids: the torso stays."""
    comes = towards("left_forearm:27", 0.15, 0.05)
    torso = ROBOT.indices(ROBOT.names.torso)
    steps, joints = run(pipeline(lambda t: comes(t) if t < 7 else None, REACH, left, leans=True), 13.0)
    at = comes(7.0)[0]
    gaps = np.array([np.linalg.norm(SKIN.at(ROBOT.at(q))[0] - at, axis=1).min() for q in joints])
    leans = np.linalg.norm(joints[:, torso], axis=1)
    assert leans[0] == 0
    assert leans.max() > np.deg2rad(10)
    assert np.abs(np.diff(leans)).max() <= LeanParams().torso_rad_s * DT + 1e-9
    begins = [step.response.mode for step in steps].index("reach")
    assert steps[begins].reachability is not None
    assert steps[begins].reachability.is_reachable
    assert gaps[begins] > 0.07
    assert gaps[: int(7 / DT)].min() < 0.022, "the surface of the object, whose radius is 20 mm"
    assert leans[-1] < np.deg2rad(1)
    avoiding, _ = run(pipeline(comes, AVOID, left, leans=True))
    assert not any(step.command.dq_rad_s[torso].any() for step in avoiding)


def test_what_leaves_reach_is_given_up_at_once_and_a_lost_object_too(left):
    leaves = towards("left_forearm:15", 0.19, 0.08, 0.06)
    steps, _ = run(pipeline(leaves, REACH, left), 2.5)
    assert truly(leaves, steps)[0]
    assert not truly(leaves, steps)[-1]
    stays = towards("left_palm:101", 0.17, 0.08)
    lost, _ = run(pipeline(lambda t: stays(t) if t < 1 else None, REACH, left))
    for frames, given_up in ((steps, "return"), (lost, "hold")):
        modes = [step.response.mode for step in frames]
        reached = [step.reachability is not None and step.reachability.is_reachable for step in frames]
        assert modes.index(given_up) == len(reached) - reached[::-1].index(True), "in the first frame out of reach"
        assert all(may for may, mode in zip(reached, modes, strict=True) if mode == "reach")
        assert "reach" not in modes[modes.index(given_up) :]


@pytest.mark.parametrize("taxel", ["left_palm:101", "left_forearm:27"])
def test_avoidance_does_not_ask_the_map(left, taxel):
    motion = towards(taxel, 0.15, 0.05)
    with_map, without = (run(pipeline(motion, AVOID, reachable_map))[0] for reachable_map in (left, None))
    assert "avoid" in [step.response.mode for step in with_map]
    for a, b in zip(with_map, without, strict=True):
        np.testing.assert_array_equal(a.command.dq_rad_s, b.command.dq_rad_s)
        assert b.reachability is None


def test_an_arm_that_is_to_reach_needs_its_own_map(left):
    for reachable_map, arm in ((None, "no arm"), (replace(left, side="right"), "right")):
        with pytest.raises(ValueError, match=f"reachable-space map of {arm}; expected one of the left arm"):
            pipeline(towards("left_palm:101", 0.17, 0.08), REACH, reachable_map)
    pipeline(towards("left_palm:101", 0.17, 0.08), AVOID, replace(left, side="right"))


def test_of_two_hands_the_one_that_reaches_the_object_better_reaches_for_it(left, right):
    """Objects that come down before the left palm, the right one, and between them, where one sways by 4 cm; one at the
    left elbow, which only the right hand reaches; one too far for both, to which the torso leans only if it may; and
    one behind the right forearm, where that arm is in the left hand's way until the torso turns for the right hand."""
    skin = icub_skin()

    def hands(motion, leans: bool = False, seconds: float = 3.0) -> tuple[list[str], Array]:
        """The hand that reaches in each frame, "" if none does, and the joints."""
        params = PipelineParams(arm=REACH, other_arm=replace(REACH, side="right"), lean=LeanParams() if leans else None)
        tracker, memory = KnownTrack(motion), touched_by_all(skin)
        pipeline = Pipeline(params, ROBOT, skin, tracker, memory, np.random.default_rng(0), left, right)
        steps, joints = run(pipeline, seconds)
        modes = [[response.mode == "reach" for response in step.responses] for step in steps]
        assert not any(map(all, modes))
        return ["left" if reach[0] else "right" if reach[1] else "" for reach in modes], joints

    def down(t: float, y_m: float, sway_m: float = 0.0) -> tuple[Array, Array]:
        rate = 2 * np.pi * 0.5
        position = np.array([-0.3, y_m + sway_m * np.sin(rate * t), max(0.2 - 0.1 * t, 0.12)])
        return position, np.array([0.0, sway_m * rate * np.cos(rate * t), -0.1 * (t < 0.8)])

    for y_m, side in ((-0.2, "left"), (0.2, "right")):
        used, joints = hands(lambda t, y_m=y_m: down(t, y_m))
        assert set(used) - {""} == {side}
        palm = ROBOT.at(joints[-1]).point(f"{side}_palm")
        assert np.linalg.norm(palm - down(3.0, y_m)[0]) < 0.05
    between, _ = hands(lambda t: down(t, 0.0, 0.04))
    assert len(set(between) - {""}) == 1
    assert between.count("") < len(between) / 2
    assert set(hands(towards("left_forearm:27", 0.15, 0.05))[0]) - {""} == {"right"}

    def too_far(t: float) -> tuple[Array, Array]:
        x_m = min(-0.45 + 0.1 * t, -0.36)
        return np.array([x_m, -0.1, 0.0]), np.array([0.1 * (t < 0.9), 0.0, 0.0])

    used, joints = hands(too_far)
    assert set(used) == {""}
    np.testing.assert_array_equal(joints[:, ARM], np.tile(HOME_ARM_RAD, (len(joints), 1)))
    assert set(hands(too_far, leans=True)[0]) - {""} == {"left"}

    begin, end = np.array([-0.21, -0.04, 0.085]), np.array([-0.17, 0.07, 0.06])
    path_m = np.linalg.norm(end - begin)

    def behind(t: float) -> tuple[Array, Array]:
        velocity = 0.06 * (end - begin) / path_m
        return (begin + velocity * t, velocity) if 0.06 * t < path_m else (end, np.zeros(3))

    used, joints = hands(behind, leans=True, seconds=12.0)
    changes = [side for side, following in pairwise([*used, ""]) if side and side != following]
    assert changes[-2:] == ["left", "right"]
    assert np.linalg.norm(ROBOT.at(joints[-1]).point("right_palm") - end) < 0.05
