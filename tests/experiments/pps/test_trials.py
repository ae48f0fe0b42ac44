"""Trials: each ends in the touch that it reports, movements are continuous, rendered trials are nearly exact."""

from pathlib import Path

import numpy as np
import pytest
from data import SEED

from learning.pps.trials import TouchTrial
from pps_vision.experiments.pps.movements import AIMED, Movement, SessionName, movements, start_posture
from pps_vision.experiments.pps.trials import exact_trials, render_trial, rendered_trials
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.robot.skin import TOUCH_RADIUS_M, icub_skin
from pps_vision.types import Array

ROBOT, SKIN = load_icub(), icub_skin()
SESSIONS: tuple[SessionName, ...] = ("motor", "inner", "outer", "palm")


def gaps(trial: TouchTrial) -> Array:
    """(T, n) m from the object's surface to every taxel's centre."""
    taxels = np.array([SKIN.at(ROBOT.at(q))[0] for q in trial.joints_rad])
    found: Array = np.linalg.norm(taxels - trial.positions[:, None], axis=2) - trial.radius_m[:, None]
    return found


@pytest.mark.parametrize("name", SESSIONS)
def test_a_trial_ends_in_the_touch_it_reports(name: SessionName) -> None:
    part, _ = AIMED[name]
    for movement in exact_trials(name, 2, SEED):
        gap = gaps(movement)
        np.testing.assert_array_equal(gap[-1] <= TOUCH_RADIUS_M, movement.touched)
        assert any(SKIN.taxel_ids[i].startswith(part) for i in np.flatnonzero(movement.touched))
        assert gap.min() > -0.006  # nothing penetrates the skin
        on_part = [taxel.startswith(part) for taxel in SKIN.taxel_ids]
        assert gap[0, on_part].min() > 0.10  # it starts beyond most of the receptive field


@pytest.mark.parametrize("name", SESSIONS)
def test_positions_are_the_integral_of_the_velocity(name: SessionName) -> None:
    for movement in exact_trials(name, 2, SEED):
        np.testing.assert_allclose(np.diff(movement.stamps_s), 0.05)
        mean = 0.5 * (movement.velocities[1:] + movement.velocities[:-1])
        np.testing.assert_allclose(np.diff(movement.positions, axis=0), 0.05 * mean, atol=4e-4)
        speed = np.linalg.norm(movement.velocities, axis=1)
        assert 0.08 < speed.max() < 0.35
        assert 0.3 < speed[-1] / speed.max() < 0.95  # slows down before the touch, and still moves then


def test_fingertips_are_where_the_hand_is() -> None:
    for movement in exact_trials("motor", 2, SEED):
        tips = [ROBOT.at(q).point("right_index_tip") for q in movement.joints_rad]
        np.testing.assert_allclose(movement.positions, tips, atol=1e-12)


def test_a_trial_does_not_depend_on_how_many_are_asked_for() -> None:
    names: tuple[SessionName, ...] = ("inner", "motor")
    for name in names:
        one, two = (exact_trials(name, n, SEED)[0].positions for n in (1, 2))
        np.testing.assert_array_equal(one, two)
    (one,), (other,) = (exact_trials("inner", 1, SEED + k) for k in (0, 1))
    assert not np.allclose(other.positions[-1], one.positions[-1])


@pytest.mark.parametrize("name", ["outer", "palm"])
def test_start_postures_are_within_limits_and_turn_the_taxels_to_the_eyes(name: SessionName) -> None:
    q = start_posture(ROBOT, name)
    assert np.all((q >= ROBOT.lower_rad) & (q <= ROBOT.upper_rad))
    positions, normals = SKIN.at(ROBOT.at(q))
    eyes = icub_rig(ROBOT).view(q)
    part, ids = AIMED[name]
    for i in (SKIN.index(f"{part}:{k}") for k in ids):
        for eye in (eyes.left, eyes.right):
            assert normals[i] @ (eye.center - positions[i]) > 0


def errors_mm(movement: Movement, trial: TouchTrial) -> Array:
    """(T,) of the tracked positions, NaN while nothing is tracked."""
    errors: Array = 1000 * np.linalg.norm(trial.positions - movement.trial.positions, axis=1)
    print(f"seed {SEED}, {movement.stimulus}: {np.sqrt(np.nanmean(errors**2)):.1f} mm RMS")
    return errors


def test_a_ball_in_a_hand_is_tracked_and_followed_by_the_eyes() -> None:
    (movement,) = movements("inner", 1, SEED)
    trial = render_trial(movement)
    errors = errors_mm(movement, trial)
    assert np.isfinite(errors[-20:]).mean() > 0.8
    assert np.nanmax(errors[-20:]) < 40
    head = ROBOT.indices(ROBOT.names.gaze_joints)
    assert np.ptp(trial.joints_rad[:, head], axis=0).max() > np.deg2rad(2)
    arms = [i for i in range(ROBOT.n_joints) if i not in head]
    np.testing.assert_array_equal(trial.joints_rad[:, arms], movement.trial.joints_rad[:, arms])


@pytest.mark.long
def test_a_marked_finger_is_rendered_once_and_then_read(tmp_path: Path) -> None:
    (movement,) = movements("visual", 1, SEED)
    (trial,) = rendered_trials("visual", 1, SEED, tmp_path)
    errors = errors_mm(movement, trial)
    assert np.isfinite(errors[-20:]).mean() > 0.8
    assert np.nanmedian(errors) < 5
    (file,) = tmp_path.iterdir()
    before = file.stat().st_mtime_ns
    (second,) = rendered_trials("visual", 1, SEED, tmp_path)
    np.testing.assert_array_equal(second.positions, trial.positions)
    np.testing.assert_array_equal(second.touched, movement.trial.touched)
    assert file.stat().st_mtime_ns == before


def test_impossible_trials_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="session 'foot'"):
        movements("foot", 1, 0)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="0 trials"):
        exact_trials("inner", 0, 0)
    with pytest.raises(ValueError, match="motor"):
        rendered_trials("motor", 1, 0, tmp_path)
