"""What every kind of encounter does to an arm at rest."""

import numpy as np
import pytest
from data import ARM7

from pps_vision.app.encounters.encounter import (
    BEYOND_M,
    GRAZE_M,
    HARMLESS,
    HAZARDS,
    NEAR_M,
    PASS_M,
    PRESS_M,
    Encounter,
    EncounterScene,
    draw,
    felt,
)
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import CONTROLLERS, NONE, OURS
from pps_vision.app.encounters.tracks import track_of
from pps_vision.app.encounters.training import learn
from pps_vision.experiments.films.raycast import ball_row, first_hits
from pps_vision.geometry.se3 import rotation_to
from pps_vision.recordings.robot_file import read_robot
from pps_vision.robot.skin import TOUCH_RADIUS_M, Skin, SkinPart, icub_skin
from pps_vision.types import Array

RADIUS_M = 0.035
REACH_M = RADIUS_M + TOUCH_RADIUS_M


def gaps(scene: EncounterScene, encounter: Encounter) -> tuple[Array, Array]:
    """Times, and the object's distance left until it touches the arm at rest."""
    times = np.arange(0, encounter.seconds, 0.002)
    taxels, _ = scene.skins[encounter.side].at(scene.robot.at(encounter.q_rad))
    path = np.array([encounter.motion(t)[0] for t in times])
    return times, np.linalg.norm(path[:, None] - taxels, axis=2).min(axis=1) - encounter.radius_m - TOUCH_RADIUS_M


def test_the_arm_of_another_robot_is_touched_without_avoidance_and_not_with_it():
    """A seven-joint arm before two fixed cameras, after ten objects that touched its skin and ten that passed."""
    scene = EncounterScene(read_robot(ARM7))
    assert scene.targets == (("right", "forearm"),)
    memory = learn(scene, "right", 3, share=0.2).probability
    for condition in HAZARDS:
        encounter = draw(scene, condition, 0, seed=3)
        tracks = track_of(scene, encounter, np.random.default_rng(3))
        names = (NONE, OURS)
        results = [simulate_encounter(scene, memory, encounter, name, CONTROLLERS[name].new, tracks) for name in names]
        assert [result.touched for result in results] == [True, False]
        assert results[0].touched_part == "forearm"


@pytest.mark.parametrize("condition", HAZARDS)
@pytest.mark.parametrize("number", [1, 5])
def test_an_arm_at_rest_is_touched_when_the_encounter_says(scene, condition, number):
    encounter = draw(scene, condition, number, seed=3)
    times, left = gaps(scene, encounter)
    assert times[np.argmax(left <= 0)] == pytest.approx(encounter.contact_s, abs=0.003)
    if condition == "stop":
        assert -0.004 < left.min() < 0
    elif condition == "graze":
        assert GRAZE_M[0] - 1e-3 < left.min() + TOUCH_RADIUS_M < GRAZE_M[1] + 1e-3
    elif condition == "press":
        assert -PRESS_M - 0.004 < left.min() < -0.01
    else:
        on = encounter.motion(encounter.seconds)[0] - encounter.motion(encounter.contact_s)[0]
        assert np.linalg.norm(on) == pytest.approx(BEYOND_M, abs=0.01)


@pytest.mark.parametrize("condition", HARMLESS)
def test_harmless_objects_touch_nothing(scene, condition):
    passes = {"harmless_passing": PASS_M, "harmless_near": NEAR_M}
    for number in (0, 4):
        encounter = draw(scene, condition, number, seed=3)
        left = gaps(scene, encounter)[1] + TOUCH_RADIUS_M
        assert encounter.contact_s == np.inf
        assert left.min() > TOUCH_RADIUS_M
        if condition in passes:
            low, high = passes[condition]
            assert low - 1e-4 < left.min() < high + 1e-3
            assert left.min() < left[[0, -1]].min() - 0.02, "it comes nearer and leaves"


def test_an_encounter_depends_on_its_seed_and_number_alone(scene):
    first = draw(scene, "press", 7, seed=3)
    again = draw(EncounterScene(), "press", 7, seed=3)
    second = draw(scene, "press", 8, seed=3)
    np.testing.assert_array_equal(first.q_rad, again.q_rad)
    np.testing.assert_array_equal(first.motion(0.3)[0], again.motion(0.3)[0])
    assert (first.side, first.part, first.stimulus) != (second.side, second.part, second.stimulus)
    assert draw(scene, "press", 7, seed=4).speed_m_s != first.speed_m_s


def test_what_a_body_hides_is_counted_ray_by_ray(scene):
    """A ball above, beside and behind the left forearm: the share hidden by the sphere at its end, by ray casting."""
    posture = scene.robot.at(draw(scene, "stop", 0, 3).q_rad)
    body = next(body for body in scene.robot.bodies if body.name == "left_forearm_1")
    middle = (posture.T_root(body.frame) @ body.T_frame_body)[:3, 3]
    (size,) = body.size_m
    eye = scene.rig.view(posture.q_rad).midpoint
    ahead = (middle - eye) / np.linalg.norm(middle - eye)
    assert scene.hidden_share(posture, eye, middle - 0.1 * ahead, 0.03) == 0, "before it"
    behind = middle + (0.01 + size + 0.03) * ahead
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    turn = rotation_to(behind - eye)
    rim = behind + 0.8 * 0.03 * (np.cos(angles)[:, None] * turn[:, 0] + np.sin(angles)[:, None] * turn[:, 1])
    hits = first_hits(eye, np.array([behind, *rim]) - eye, ball_row(middle, size)[None])[1] >= 0
    assert np.mean(hits) > 0.5
    assert scene.hidden_share(posture, eye, behind, 0.03) >= np.mean(hits)


def test_a_touch_of_a_held_stick_is_felt_by_all_of_the_hand_and_by_nothing_else():
    skin = icub_skin(("left_forearm", "left_palm"))
    palm = skin.parts[1]
    stick = SkinPart("left_stick", palm.frame, (0, 1), palm.positions_m[:2] + 0.1, palm.normals[:2])
    surface = Skin((*skin.parts, stick))
    n = len(skin.taxel_ids)
    touches = np.eye(n + 2, dtype=bool)
    np.testing.assert_array_equal(felt(surface, skin, touches[3]), touches[3, :n])
    np.testing.assert_array_equal(felt(surface, skin, touches[n]), skin.part_index == 1)
