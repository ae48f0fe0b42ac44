"""An encounter through rendered eyes ends as without rendering, and what is compared is counted."""

from dataclasses import replace

import numpy as np
import pytest

from pps_vision.app.encounters.encounter import Arena, draw
from pps_vision.app.encounters.kinematic import meet
from pps_vision.app.encounters.registry import OURS, new_controller
from pps_vision.app.encounters.rendered import meet_rendered
from pps_vision.app.encounters.tracks import track_of
from pps_vision.app.encounters.training import Memories
from pps_vision.app.simulation import Side
from pps_vision.experiments.encounters_rendered import compared, summary


@pytest.mark.long
def test_a_fast_ball_is_met_alike_with_and_without_rendering(arena: Arena, memories: dict[Side, Memories]) -> None:
    encounter = next(
        e
        for e in (draw(arena, "stop", 24 * k, 5) for k in range(20))
        if e.speed_m_s > 0.2  # a ball, left arm
    )
    without = meet(
        arena,
        memories["left"],
        encounter,
        OURS,
        new_controller(OURS),
        track_of(arena, encounter, np.random.default_rng(0)),
    )
    seen = meet_rendered(arena, memories["left"], encounter, 2.0, 5)
    assert seen.known > 0.5
    assert seen.error_m < 0.01
    assert seen.outcome.touched == without.touched
    assert seen.outcome.commands > 5
    assert abs(seen.outcome.distance_m - without.distance_m) < 0.02
    found = summary([compared(seen, without)])
    assert found["rates"]["stop"]["difference"][0] == 0
    assert found["rates"]["stop"]["n"] == 1
    assert found["differing"] == []
    assert found["stop, slow"]["n"] == 0, "it is fast"
    nearer = replace(without, touched=True, distance_m=without.distance_m - 0.012, first_command_s=None, lead_s=None)
    (row,) = summary([compared(replace(seen, outcome=nearer), without)])["differing"]
    assert without.lead_s is not None
    assert "distances left 12 mm apart" in row["because"]
    assert f"lead – and {without.lead_s:.2f} s" in row["because"]
