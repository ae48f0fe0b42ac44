"""The suite: every controller avoids a slow object, others plug in, an interrupted run goes on."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tracks import track_at

from pps_vision.app.encounters import suite
from pps_vision.app.encounters.baselines import depth_space, nearest_rates
from pps_vision.app.encounters.controllers import ArmScene
from pps_vision.app.encounters.encounter import Encounter, EncounterScene, draw
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import ASKING, NAMES, NONE, TRUE, new_controller
from pps_vision.app.encounters.tracks import ERRORS, measured_error, track_of, true_track_of
from pps_vision.app.encounters.training import Memories
from pps_vision.app.encounters.tuned import TUNED
from pps_vision.app.simulation import Side
from pps_vision.errors import InputError
from pps_vision.types import Array, Reachability, ReachStatus, Track3D
from rendering.names import StimulusName

PLUGIN = """
from pathlib import Path
import numpy as np
def new(scene):
    with open("calls", "a") as calls:
        calls.write("x")
    if Path("calls").read_text() == "xx" and Path("interrupt").exists():
        raise KeyboardInterrupt
    def act(activations, track, posture):
        dq = np.zeros(scene.robot.n_joints)
        dq[scene.arm[0]] = 0.2 * (track.is_known and np.linalg.norm(track.velocity) > 0.01)
        return dq
    return act
"""


@pytest.fixture(scope="module")
def slow(scene: EncounterScene) -> Encounter:
    """A ball at less than 15 cm/s that would touch the inner left forearm."""
    encounters = (draw(scene, "stop", 12 * k, 3) for k in range(20))
    return next(e for e in encounters if e.speed_m_s < 0.15 and e.side == "left")


@pytest.mark.parametrize("name", [n for n in NAMES if n not in (NONE, "depth space")])
def test_controllers_avoid_a_slow_object(
    scene: EncounterScene, memories: dict[Side, Memories], slow: Encounter, name: str
) -> None:
    """It would touch; limits and self-collision distance are kept.  Not so the depth-space baseline: as tuned, with a
    short range, it avoids half of such objects."""
    tracks = true_track_of(slow) if name == TRUE else track_of(scene, slow, np.random.default_rng(1))
    at_rest = simulate_encounter(scene, memories["left"], slow, NONE, new_controller(NONE), tracks)
    assert at_rest.touched
    assert at_rest.commands == 0
    assert at_rest.lead_s is None
    result = simulate_encounter(scene, memories["left"], slow, name, new_controller(name), tracks)
    assert not result.touched
    assert result.distance_m > 0.005
    assert result.lead_s is not None
    assert 0.2 < result.lead_s < slow.contact_s
    assert result.faults == ()
    assert result.self_distance_m >= 0.0199


@pytest.mark.parametrize("stimulus", ["ball", "octopus"])
def test_tracks_err_as_much_as_was_measured(scene: EncounterScene, slow: Encounter, stimulus: StimulusName) -> None:
    encounter = replace(slow, stimulus=stimulus)
    truth = np.array([t.position for t in true_track_of(encounter)])[10:]
    lines = truth - scene.head(encounter.q_rad)
    lines /= np.linalg.norm(lines, axis=1, keepdims=True)
    tracks = [track_of(scene, encounter, np.random.default_rng(k)) for k in range(40)]
    errors = np.array([np.array([t.position for t in track])[10:] - truth for track in tracks])
    along = np.sum(errors * lines, axis=2)
    across = np.linalg.norm(errors - along[..., None] * lines, axis=2)
    for axis, error in enumerate((along, across / np.sqrt(2))):
        stays, new = ERRORS[stimulus].constant_m[axis], ERRORS[stimulus].random_m[axis]
        assert 0.6 * stays < np.sqrt(np.mean(error**2)) < 1.4 * np.hypot(stays, new)


def test_errors_of_an_encounter_are_measured_as_they_were_made() -> None:
    """An error that stays and one that is new in every frame, larger along the line of sight than across it."""
    rng = np.random.default_rng(0)
    lines = rng.standard_normal((1, 3)) + 1e-3 * rng.standard_normal((4000, 3))
    lines /= np.linalg.norm(lines, axis=1, keepdims=True)
    sideways = np.cross(lines, [0.0, 0.0, 1.0])
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    noise = rng.standard_normal((2, 4000, 1))
    errors = (5e-3 + 1e-3 * noise[0]) * lines + (2e-3 + 0.1e-3 * noise[1]) * sideways
    errors[::50] = np.nan  # not seen
    measured = measured_error(errors, lines)
    assert measured.constant_m == pytest.approx((5e-3, 2e-3 / np.sqrt(2)), rel=0.02)
    assert measured.random_m[0] == pytest.approx(1e-3, rel=0.05)
    assert measured.random_m[1] < 0.1e-3, "the deviate is one along a line, not in the plane"


def test_a_controller_plugs_in_and_an_interrupted_run_goes_on(tmp_path: Path, monkeypatch) -> None:
    """The plugged-in controller interrupts the run in the second encounter; the first is not simulated again."""
    (tmp_path / "theirs.py").write_text(PLUGIN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(suite, "_PART", 1)
    folder = tmp_path / "unfinished"
    arguments: tuple[Any, ...] = (folder, {"stop": 2}, 3, (NONE, "theirs:new"), 1, 0.01)
    Path("interrupt").touch()
    with pytest.raises(KeyboardInterrupt):
        suite.run_suite(*arguments)
    Path("interrupt").unlink()
    rows = suite.run_suite(*arguments)
    assert Path("calls").read_text() == "xxx", "one, an interrupted one, and one more"
    assert not folder.exists()
    assert [(row["number"], row["controller"]) for row in rows] == [
        (k, name) for k in range(2) for name in (NONE, "theirs:new")
    ]
    assert all(row["commands"] == 0 for row in rows[::2])
    assert all(row["commands"] > 5 for row in rows[1::2])
    with pytest.raises(InputError, match="theirs:old"):
        suite.run_suite(folder, {"stop": 1}, 3, ("theirs:old",), 1, 0.01)


def test_the_depth_space_baseline_avoids_near_and_occluding_objects(
    scene: EncounterScene, memories: dict[Side, Memories], slow: Encounter
) -> None:
    """A ball 3 cm from a taxel, and one that hides the taxel from the left eye halfway, push it; one far aside or
    unknown does not.  The taxel leaves the ball in the eye's view."""
    skin = scene.skins["left"]
    arm = scene.arm("left")
    arm_scene = ArmScene(scene.robot, skin, "left", slow.q_rad, scene.self_collision, memories["left"].of_distance)
    posture = scene.robot.at(slow.q_rad)
    taxels, normals = skin.at(posture)
    k = skin.index(slow.taxel)
    J = skin.jacobians(posture, arm)[k]
    eye = posture.T_root(scene.robot.names.left_eye)[:3, 3]

    def velocity(center: Array) -> Array:
        act = depth_space(arm_scene, {**TUNED["depth space"], "range_m": 0.2})
        dq = act(np.zeros(len(taxels)), track_at(center, 0.1 * (taxels[k] - center)), posture)
        assert not np.any(np.delete(dq, arm))
        return np.asarray(J @ dq[arm])

    ball = taxels[k] + 0.06 * normals[k]
    assert velocity(ball) @ (taxels[k] - ball) > 0
    assert np.linalg.norm(velocity((eye + taxels[k]) / 2)) > 1e-4
    assert not velocity(ball + np.array([0.0, 1.0, 0.0])).any()
    at_rest = depth_space(arm_scene, TUNED["depth space"])(np.zeros(len(taxels)), Track3D.unknown(0.0), posture)
    assert not at_rest.any()


def test_what_the_map_calls_unreachable_is_not_attempted(scene: EncounterScene, memories: dict[Side, Memories]) -> None:
    encounter = draw(scene, "reach", 0, 3)
    tracks = track_of(scene, encounter, np.random.default_rng(1))
    arguments = scene, memories["left"], encounter, ASKING, new_controller(ASKING), tracks
    stamps_s: list[float] = []

    def unreachable(q_rad: Array, track: Track3D) -> Reachability:
        stamps_s.append(track.stamp_s)
        return Reachability.without_answer(track.stamp_s, ReachStatus.UNREACHABLE)

    assert simulate_encounter(*arguments).commands > 0, "without a map"
    assert simulate_encounter(*arguments, reachability=unreachable).commands == 0  # type: ignore[arg-type]
    assert stamps_s == [track.stamp_s for track in tracks]


def test_rates_under_soft_rows_by_hand() -> None:
    """A row that can be kept is, one beyond the limits is as far as they allow, of opposite ones the mean remains."""
    room = np.full(2, -1.0), np.full(2, 1.0)
    wanted, row = np.array([0.5, 0.2]), np.array([[1.0, 0.0]])
    np.testing.assert_allclose(nearest_rates(wanted, room, row, np.array([2.0])), wanted, atol=1e-9)
    np.testing.assert_allclose(nearest_rates(wanted, room, row, np.array([-0.3])), [-0.3, 0.2], atol=1e-3)
    np.testing.assert_allclose(nearest_rates(wanted, room, row, np.array([-3.0])), [-1.0, 0.2], atol=1e-3)
    opposite = np.vstack([row, -row])
    np.testing.assert_allclose(nearest_rates(wanted, room, opposite, np.array([-0.4, -0.6])), [0.1, 0.2], atol=1e-3)
