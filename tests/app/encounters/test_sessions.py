"""R's sessions: the palm's path is kept while the skin is active, and drawn; the activations shown move the arm."""

import numpy as np
import pytest

from pps_vision.app.encounters.encounter import Arena
from pps_vision.app.encounters.kinematic import Frame
from pps_vision.app.encounters.training import Memories
from pps_vision.app.encounters.tuned import TUNED
from pps_vision.app.simulation import Side
from pps_vision.experiments.encounters_sessions import EncountersSessions, _at_rest, _awaiting, _path, _ranges


def test_the_palms_path_is_kept_four_times_a_second_while_an_activation_exceeds_the_threshold(arena: Arena) -> None:
    robot, elbow = arena.robot, arena.arm("left")[3]
    frames = []
    for k in range(13):
        q = _awaiting(robot)
        q[elbow] += 0.01 * k
        frames.append(Frame(0.05 * k, q, np.zeros(2), np.array([0.0, 0.5 if k >= 5 else 0.3]), 0.0, touching=False))
    expected = [1000 * robot.at(frames[k].q_rad).point("left_palm") for k in (5, 10)]
    np.testing.assert_allclose(_path(robot, "left", frames), expected, atol=0.5)
    assert _path(robot, "left", frames[:5]) == []


@pytest.mark.parametrize("name", ["ours, wrist at rest", "distance only"])
def test_a_session_shows_what_moves_the_arm(arena: Arena, memories: dict[Side, Memories], name: str) -> None:
    """One approach: the arm begins to move when an activation that is shown has exceeded the threshold; ours stays
    within the sphere and on the path that is kept."""
    found = EncountersSessions(seed=3)._session(arena, memories, "stop", name, 0.1)
    (shown,) = found["frames"]["left"]
    first = int(np.argmax(np.array(shown["speed_m_s"]) > 1e-3))
    since = int(np.argmax(np.array(shown["activations"]).max(axis=1) > TUNED["distance only"]["threshold"]))
    waits_s = shown["t_s"][first] - shown["t_s"][since]
    if name == "distance only":
        assert waits_s == pytest.approx(TUNED[name]["confirmation_s"], abs=0.051)
        assert found["paths_mm"] == {}
        return
    assert 0 <= waits_s < 0.5, "until the object has come nearer"
    (path,), (low, high) = found["paths_mm"]["left"], found["arms"]["left"]["palm_m"]
    assert len(path) >= 3
    assert np.all(np.array(path) >= 1000 * np.array(low) - 1)
    assert np.all(np.array(path) <= 1000 * np.array(high) + 1)
    figures = EncountersSessions().chart(
        {"rest_m": _at_rest(arena.robot), **dict.fromkeys(("avoidance", "reaching", "distance only"), found)}
    )
    space, *planes = figures["paths"].axes
    drawn = [line.get_xydata() for line in planes[0].lines]
    assert any(np.array_equal(line, np.array(path)[:, [1, 2]] / 1000) for line in drawn)
    assert "0.2 m from rest" in [text.get_text() for text in space.get_legend().get_texts()]


def test_a_session_in_which_nothing_moves_the_arm_has_no_ranges(arena: Arena) -> None:
    q = _awaiting(arena.robot)
    quiet = [Frame(0.05 * k, q, np.zeros(2), np.array([0.1, 0.3]), 0.0, touching=False) for k in range(4)]
    found = _ranges(arena, "left", [quiet])
    assert np.shape(found["joints_deg"]) == (2, 7)
    assert np.isnan(found["joints_deg"]).all()
    assert np.isnan(found["palm_m"]).all()
    assert found["farthest_m"] == 0
