"""What must hold at the edges of reachable space: no NaN in what is claimed, no claim where nothing is known."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from learning.babbling import Babbled, babble
from learning.reachable_training import ArmLimits, HandModel, MapParams, ReachOracle, train_reachable_map
from learning.turning_joints import TurningJoints
from pps_vision.robot.chain import Chain
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.spherical_arm import SphericalArm

ROBOT, LIMITS = load_icub(), GazeLimits()
SMALL = MapParams(n_labels=400, round_labels=100, n_babble=5000, lattice=0.12)
ARM = Chain.of(ROBOT, ROBOT.names.arm("right")[:4], "right_palm")


def rng():
    return np.random.default_rng(SEED)


def true(gaze):
    arm = SphericalArm.of(ARM, ArmLimits().lower_rad, ArmLimits().upper_rad)
    return np.isfinite(arm.solve(fixation_points(ROBOT, gaze))[:, 0])


def misjudged(learned):
    gaze = np.random.default_rng(SEED + 1).uniform(LIMITS.lower, LIMITS.upper, (1500, 3))
    return float(np.mean(learned.query(gaze).reachable != true(gaze)))


def taught(babbled):
    model = TurningJoints()
    model.learn(babbled.arm_rad, babbled.gaze_rad)
    return HandModel(model.forward, model.points, model.gaze)


def told_wrongly(hand):
    """Share of gaze postures on which inverse kinematics with this model is wrong about the true arm."""
    gaze = np.random.default_rng(SEED + 1).uniform(LIMITS.lower, LIMITS.upper, (400, 3))
    labels = ReachOracle(ROBOT, "right", SMALL, rng(), hand).label(gaze)
    assert labels.answered.mean() > 0.97
    assert np.isfinite(labels.optimality[labels.reachable]).all()
    return float(np.mean(labels.reachable != true(gaze)))


@pytest.fixture(scope="module")
def learned():
    return train_reachable_map(ROBOT, "right", rng(), SMALL)


@pytest.fixture(scope="module")
def babbled():
    return babble(ROBOT, "right", 2500, rng())


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


def test_targets_behind_the_head_and_at_the_eyes_are_not_fixated():
    left, right = ROBOT.eye_poses(np.zeros(ROBOT.n_joints))
    eyes = (left + right)[:3, 3] / 2
    points = eyes + np.array([[0.3, 0, 0], [0.0, 0, 0.5], [0.0, 0, 0], [np.nan, 0, 0]])  # the robot looks along −x
    assert np.isnan(gaze_for_points(ROBOT, points)).all()


def test_singular_arms_are_reached_and_walked_without_nan():
    """The elbow as straight as it goes, and the upper arm along the first axis, where the next turns nothing new."""
    lower, upper = np.array(ArmLimits().lower_rad), np.array(ArmLimits().upper_rad)
    arm = rng().uniform(lower, upper, (3000, 4))
    arm[:1000, 3], arm[1000:2000, 1] = lower[3], 0.0
    gaze = gaze_for_points(ROBOT, ARM.positions(arm)[0])
    labels = ReachOracle(ROBOT, "right", SMALL, rng()).label(gaze[np.isfinite(gaze[:, 0])][:400])
    assert labels.answered.mean() > 0.99
    assert labels.reachable.mean() > 0.9  # on the border itself a tenth of a millimetre decides
    assert np.isfinite(labels.optimality[labels.reachable]).all()


def test_an_elbow_read_wrongly_shifts_what_is_told_and_no_more(babbled):
    off = Babbled(babbled.arm_rad + np.deg2rad([0, 0, 0, 1.0]), babbled.gaze_rad, babbled.n_tried)
    assert told_wrongly(taught(off)) < 0.03


@pytest.mark.parametrize("percent", [1, 5])
def test_flipped_labels_do_little_more_than_their_share(learned, percent):
    labels = learned.labels
    flip = rng().random(len(labels.gaze_rad)) < percent / 100
    wrong = replace(
        labels,
        reachable=labels.reachable ^ flip,
        optimality=np.where(flip, 0.5, labels.optimality),
        border_rad=np.where(flip[:, None], np.nan, labels.border_rad),
    )
    few = replace(SMALL, n_labels=60, round_labels=30)
    again = train_reachable_map(
        ROBOT, "right", np.random.default_rng(SEED + 2), few, into=replace(learned, labels=wrong)
    )
    verdict = again.query(labels.gaze_rad)
    assert np.isfinite([verdict.probability, verdict.degree]).all()
    before, after = misjudged(learned), misjudged(again)
    print(f"{percent} % flipped: {100 * before:.2f} → {100 * after:.2f} % misjudged")
    assert after < before + 3 * percent / 100


def test_babbling_that_often_fails_still_teaches(babbled):
    """Half of what could be fixated is not; in a tenth of the rest something else is, in another the encoder sticks."""
    random = np.random.default_rng(SEED + 3)
    kept = random.random(len(babbled.arm_rad)) < 0.5
    arm, gaze = babbled.arm_rad[kept], babbled.gaze_rad[kept]
    wrong, stuck = random.random((2, len(gaze))) < 0.1
    gaze[wrong] = random.uniform(LIMITS.lower, LIMITS.upper, (wrong.sum(), 3))
    arm[stuck, 3] = np.deg2rad(60)
    assert told_wrongly(taught(Babbled(arm, gaze, babbled.n_tried))) < 0.01


def test_what_inverse_kinematics_cannot_answer_is_counted_not_called_unreachable():
    """A forward model that knows nothing in one half of what it is asked."""

    def half_known(q):
        x, J = ARM.positions(q)
        x[q[:, 0] > np.deg2rad(-45)] = np.nan
        return x, J

    # starts only where it is known, so that the tree of babbled hands can stand
    lower, upper = np.array(ArmLimits().lower_rad), np.array(ArmLimits().upper_rad)
    tried = rng().uniform(lower, [np.deg2rad(-45), *upper[1:]], (3000, 4))
    hand = replace(HandModel.of(ROBOT, half_known), tried=tried)
    learned = train_reachable_map(ROBOT, "right", rng(), SMALL, hand)
    assert learned.unanswered > 0
    assert learned.unanswered + len(learned.labels.gaze_rad) == SMALL.n_labels
    assert learned.labels.answered.all()
