"""Touch trials: what they claim to touch is touched, paths are human-like, and watching them tells nearly the truth."""

import numpy as np
import pytest
from data import SEED

from learning.pps.touch_trial import TouchTrial
from pps_vision.experiments.pps import touch_films
from pps_vision.experiments.pps.touch_movements import Movement, home_of, movements
from pps_vision.experiments.pps.touch_trials import touch_trials
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.robot.skin import TOUCH_RADIUS_M, icub_skin

ROBOT, SKIN = load_icub(), icub_skin()
RIG = icub_rig(ROBOT)
PARTS = {"inner": "left_forearm", "outer": "left_forearm", "palm": "right_palm", "motor": "left_forearm"}


@pytest.fixture(scope="module")
def made() -> dict[str, tuple[Movement, ...]]:
    return {name: movements(name, 2, SEED) for name in PARTS}


def gaps(movement: Movement) -> np.ndarray:
    """(T, n) from the object's surface to every taxel's centre."""
    taxels = np.array([SKIN.at(ROBOT.at(q))[0] for q in movement.joints_rad])
    return np.linalg.norm(taxels - movement.positions[:, None], axis=2) - movement.radius_m


@pytest.mark.parametrize("name", PARTS)
def test_a_trial_ends_in_the_touch_it_reports(made, name):
    for movement in made[name]:
        assert movement.aimed.startswith(PARTS[name])
        gap = gaps(movement)
        np.testing.assert_array_equal(gap[-1] <= TOUCH_RADIUS_M, movement.touched)
        assert any(SKIN.taxel_ids[i].startswith(PARTS[name]) for i in np.flatnonzero(movement.touched))
        assert gap.min() > -0.006  # nothing passes through the skin
        part = [taxel.startswith(PARTS[name]) for taxel in SKIN.taxel_ids]
        assert gap[0, part].min() > 0.10  # and it comes from beyond most of the receptive field


@pytest.mark.parametrize("name", PARTS)
def test_what_moves_moves_as_its_velocity_says_without_a_jump(made, name):
    for movement in made[name]:
        steps = np.diff(movement.positions, axis=0)
        np.testing.assert_allclose(np.diff(movement.stamps_s), 0.05)
        mean = 0.5 * (movement.velocities[1:] + movement.velocities[:-1])
        np.testing.assert_allclose(steps, 0.05 * mean, atol=4e-4)
        speed = np.linalg.norm(movement.velocities, axis=1)
        assert 0.08 < speed.max() < 0.35
        assert 0.3 < speed[-1] / speed.max() < 0.95  # slows down to the touch, and is still moving then


def test_near_misses_never_touch_and_pass_near():
    for movement in movements("inner", 2, SEED, touching=False):
        assert not movement.touched.any()
        assert TOUCH_RADIUS_M < gaps(movement).min() < 0.10


def test_fingertips_are_where_the_hand_is(made):
    for movement in made["motor"]:
        tips = [ROBOT.at(q).point("right_index_tip") for q in movement.joints_rad]
        np.testing.assert_allclose(movement.positions, tips, atol=1e-12)


def test_trials_do_not_depend_on_how_many_are_asked_for(made):
    for name in ("inner", "motor"):
        (one,) = movements(name, 1, SEED)
        np.testing.assert_array_equal(one.positions, made[name][0].positions)
    (other,) = movements("inner", 1, SEED + 1)
    assert not np.allclose(other.positions[-1], made["inner"][0].positions[-1])


def test_known_trials_are_the_truth(made):
    (trial,) = touch_trials("outer", 1, SEED)
    movement = made["outer"][0]
    np.testing.assert_array_equal(trial.positions, movement.positions)
    np.testing.assert_array_equal(trial.touched, movement.touched)
    assert not trial.velocity_covs.any()
    assert np.all(trial.radius_m == movement.radius_m)


@pytest.mark.parametrize("name", ["outer", "palm"])
def test_postures_are_within_limits_and_show_what_they_await(name):
    q = home_of(ROBOT, name)
    assert np.all((q >= ROBOT.lower_rad) & (q <= ROBOT.upper_rad))
    positions, normals = SKIN.at(ROBOT.at(q))
    eyes = RIG.view(q)
    part = [i for i, taxel in enumerate(SKIN.taxel_ids) if taxel in {f"left_forearm:{k}" for k in (87, 75, 39, 51)}]
    part = part if name == "outer" else [i for i, t in enumerate(SKIN.taxel_ids) if t.startswith("right_palm")]
    for i in part:
        for eye in (eyes.left, eyes.right):
            assert normals[i] @ (eye.center - positions[i]) > 0  # faces the eyes


def errors_mm(movement: Movement, trial: TouchTrial) -> np.ndarray:
    """(T,) of the tracked positions, NaN while nothing is tracked; says how it went."""
    errors = 1000 * np.linalg.norm(trial.positions - movement.positions, axis=1)
    seen = np.isfinite(errors)
    rms = np.sqrt(np.mean(errors[seen] ** 2))
    print(f"seed {SEED}, {movement.stimulus}: seen {seen.mean():.0%}, {rms:.1f} mm RMS")
    return errors


def test_a_hand_with_a_ball_is_watched_by_eyes_that_follow(made):
    movement = made["inner"][0]
    trial = touch_films.film(movement)
    errors = errors_mm(movement, trial)
    assert np.isfinite(errors[-20:]).mean() > 0.8
    assert np.nanmax(errors[-20:]) < 40
    head = ROBOT.indices(ROBOT.names.gaze_joints)
    assert np.ptp(trial.joints_rad[:, head], axis=0).max() > np.deg2rad(2)
    arms = [i for i in range(ROBOT.n_joints) if i not in head]
    np.testing.assert_array_equal(trial.joints_rad[:, arms], movement.joints_rad[:, arms])


def test_a_marked_finger_is_watched_once_and_then_read(tmp_path):
    (movement,) = movements("visual", 1, SEED)
    (trial,) = touch_films.watched([movement], tmp_path)
    errors = errors_mm(movement, trial)
    assert np.isfinite(errors[-20:]).mean() > 0.8
    assert np.nanmedian(errors) < 5
    (file,) = tmp_path.iterdir()
    before = file.stat().st_mtime_ns
    (again,) = touch_films.watched([movement], tmp_path)
    np.testing.assert_array_equal(again.positions, trial.positions)
    np.testing.assert_array_equal(again.touched, movement.touched)
    assert file.stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("foot", 1, 0), "trials 'foot'"),
        (("inner", 0, 0), "0 trials"),
        (("motor", 1, 0, True), "motor"),
        (("inner", 1, 0, True), "folder"),
        (("visual", 1, 0, False, None, False), "near misses"),
    ],
)
def test_what_cannot_be_is_refused(arguments, what):
    with pytest.raises(ValueError, match=what):
        touch_trials(*arguments)
