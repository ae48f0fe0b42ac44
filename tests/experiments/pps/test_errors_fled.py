"""What presses on and what passes beside do as they say; flights are counted, by robot and by case."""

from typing import Any

import numpy as np
import pytest
from data import SEED

from learning.memory import PPSMemory
from pps_vision.experiments.pps import errors_fled
from pps_vision.experiments.pps.errors import Belief, only
from pps_vision.experiments.pps.errors_fled import ErrorsFled, passing_beside, pressing
from pps_vision.experiments.pps.flight import Fleeing
from pps_vision.experiments.pps.lives import CASES
from pps_vision.robot.icub import home
from pps_vision.robot.skin import TOUCH_RADIUS_M, icub_skin, touched_taxels

SKIN = icub_skin()
RADIUS_M = 0.035


@pytest.fixture(scope="module")
def belief() -> Belief:
    """A robot without errors."""
    return Belief.draw(only(), SKIN, np.random.default_rng(SEED))


def test_what_presses_on_goes_deeper_and_what_passes_beside_touches_nothing(belief: Belief) -> None:
    rng = np.random.default_rng(SEED)
    path = Fleeing(belief, SKIN, PPSMemory.empty(SKIN)).approach("left_forearm:27", RADIUS_M, 0.1, rng)
    fast = pressing(path, 0.5, 0.03)
    assert np.linalg.norm(fast.end - path.end) == pytest.approx(0.03)
    assert fast(0.1)[0] == pytest.approx(path(0.5)[0])
    taxels = SKIN.at(belief.true_robot.at(home(belief.true_robot)))[0]
    assert touched_taxels(taxels, fast.end, RADIUS_M).any()
    beside = pressing(passing_beside(path, taxels, RADIUS_M, 0.03, rng), 0.5, 0.03)
    centres = np.array([beside(t)[0] for t in np.linspace(0, beside.contact_s, 200)])
    gap = np.linalg.norm(centres[:, None] - taxels, axis=2).min() - RADIUS_M - TOUCH_RADIUS_M
    assert 0.03 < gap < 0.06
    np.testing.assert_allclose(beside(0.0)[1], fast(0.0)[1])


def summary() -> dict[str, Any]:
    """Three robots, two paths each: touched never, always, on every second path, never; none flees what passes."""
    met = np.zeros((len(CASES), 3, 2, 3))
    met[1, ..., 0] = 1
    met[2, :, 0, 0] = 1
    return errors_fled._summary(dict(zip(CASES, met, strict=True)))


def test_flights_are_counted_and_drawn() -> None:
    found = summary()
    of, changes = found["cases"], found["changes"]["touched"]
    assert [of[case]["touched"]["n"] for case in CASES] == [0, 6, 3, 0]
    assert of["joints learned too"]["fled_beside"]["n"] == 0
    assert changes["errors"] == {"mean": 1.0, "interval_95": [1.0, 1.0]}
    assert [changes[case]["mean"] for case in CASES[2:]] == [-0.5, -1.0]
    assert of["no errors"]["touched"]["share_95"] == pytest.approx([0, 0.3903], abs=1e-3)  # z²/(n + z²)
    assert len(ErrorsFled().chart({"off_mm": [[30.0, 10.0]] * 3, **found}).axes) == 2


def test_costs_are_by_robot() -> None:
    values = dict(zip(CASES, np.array([[0.9, 0.9], [0.7, 0.9], [0.8, 0.9], [0.9, 0.9]]), strict=True))
    cost = errors_fled._changes(values)["errors"]
    assert cost["mean"] == pytest.approx(-0.1)
    assert cost["interval_95"] == pytest.approx([-0.2, 0.0])


def test_no_robots_are_refused() -> None:
    with pytest.raises(ValueError, match="--robots 1"):
        ErrorsFled(robots=1).run()
