"""At the edges of reachable space: no NaN, no claim where nothing is known."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from learning.reach.labels import HandModel, ReachOracle
from learning.reach.params import ArmLimits, MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments.babbling import Babbled, babble
from pps_vision.experiments.baselines.revolute_arm import RevoluteArm
from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.icub import load_icub

ROBOT = load_icub()
LIMITS = GazeLimits()
SMALL = MapParams(n_labels=400, round_labels=100, n_babble=5000, lattice=0.12)
ARM = ROBOT.chain(ROBOT.names.arm("right")[:4], "right_palm")


def rng():
    return np.random.default_rng(SEED)


def true(gaze):
    arm = SphericalArm.of(ARM, ArmLimits().lower_rad, ArmLimits().upper_rad)
    return np.isfinite(arm.solve(fixation_points(ROBOT, gaze))[:, 0])


def misjudged(learned):
    gaze = np.random.default_rng(SEED + 1).uniform(LIMITS.lower, LIMITS.upper, (1500, 3))
    return float(np.mean(learned.query(gaze).reachable != true(gaze)))


def told_wrongly(babbled):
    """Share of gaze postures on which inverse kinematics with a taught model is wrong about the true arm."""
    model = RevoluteArm()
    model.learn(babbled.arm_rad, babbled.gaze_rad)
    gaze = np.random.default_rng(SEED + 1).uniform(LIMITS.lower, LIMITS.upper, (400, 3))
    hand = HandModel(model.forward, model.points, model.gaze)
    labels = ReachOracle(ROBOT, "right", SMALL, rng(), hand).label(gaze)
    assert labels.answered.mean() > 0.97
    assert np.isfinite(labels.optimality[labels.reachable]).all()
    return float(np.mean(labels.reachable != true(gaze)))


@pytest.fixture(scope="module")
def learned():
    return train_reachable_map(ROBOT, "right", rng(), SMALL)


def test_on_the_border_it_answers_and_beyond_it_says_so(learned):
    ends = np.stack([LIMITS.lower, LIMITS.upper])
    corners = np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(-1, 3)
    on = learned.query(corners)
    assert on.within_limits.all()
    assert np.isfinite([on.probability, on.degree]).all()
    outwards = np.where(corners == LIMITS.lower, -np.inf, np.inf)
    beyond = learned.query(np.nextafter(corners, outwards))
    assert not beyond.within_limits.any()
    assert not beyond.reachable.any()
    assert np.isnan([beyond.probability, beyond.degree]).all()


@pytest.mark.parametrize("vergence", [0.0, 1e-300, 1e-9, -0.1, np.pi, np.inf, np.nan])
def test_vergence_near_zero_and_other_nonsense(learned, vergence):
    for gaze in ([[0.1, 0.0, vergence]], [[0.1, 0.0, vergence], [0.1, 0.0, 0.3]]):
        verdict = learned.query(gaze)
        assert not verdict.within_limits[0]
        assert not verdict.reachable[0]


def test_singular_arms_are_reached_and_walked_without_nan():
    """The elbow as straight as it goes, and the upper arm along the first axis, where the next turns nothing new."""
    lower = np.array(ArmLimits().lower_rad)
    upper = np.array(ArmLimits().upper_rad)
    arm = rng().uniform(lower, upper, (2000, 4))
    arm[::2, 3] = lower[3]
    arm[1::2, 1] = 0.0
    gaze = gaze_for_points(ROBOT, ARM.positions(arm)[0])
    labels = ReachOracle(ROBOT, "right", SMALL, rng()).label(gaze[np.isfinite(gaze[:, 0])][:200])
    assert labels.answered.mean() > 0.99
    assert labels.reachable.mean() > 0.9  # on the border itself a tenth of a millimetre decides
    assert np.isfinite(labels.optimality[labels.reachable]).all()


def test_an_elbow_read_wrongly_shifts_what_is_told_and_no_more():
    babbled = babble(ROBOT, 2500, rng())
    off = Babbled(babbled.arm_rad + np.deg2rad([0, 0, 0, 1.0]), babbled.gaze_rad, babbled.n_tried)
    assert told_wrongly(off) < 0.03


@pytest.mark.parametrize("joint", [2, 3])
def test_a_joint_that_is_stuck_throughout(joint):
    """With the elbow stuck the hand stays on a sphere: nothing but that sheet is reached, which has no room."""
    limits = ArmLimits()
    lower = np.array(limits.lower_rad)
    upper = np.array(limits.upper_rad)
    lower[joint] = upper[joint] = (lower[joint] + upper[joint]) / 2
    params = replace(SMALL, arm_limits=ArmLimits(tuple(lower), tuple(upper)))
    learned = train_reachable_map(ROBOT, "right", rng(), params)
    gaze = np.random.default_rng(SEED + 5).uniform(LIMITS.lower, LIMITS.upper, (3000, 3))
    truth = np.isfinite(SphericalArm.of(ARM, lower, upper).solve(fixation_points(ROBOT, gaze))[:, 0])
    said = learned.query(gaze)
    assert np.isfinite([said.probability, said.degree]).all()
    wrong = said.reachable != truth
    sure = np.abs(said.probability - 0.5) > 0.49
    print(
        f"joint {joint} stuck: {100 * wrong.mean():.2f} % misjudged, {100 * wrong[sure].mean():.2f} % of the sure ones"
    )
    assert learned.unanswered < 0.02 * SMALL.n_labels
    assert wrong.mean() < 0.03
    assert wrong[sure].mean() < 0.005
