"""What presses on and what passes beside do as they say; flights are counted; an offset that is known is found."""

from typing import Any

import numpy as np
import pytest
from data import SEED

from learning.memory import MemoryParams, PPSMemory
from learning.touch_trial import TouchTrial
from pps_vision.experiments.pps import errors_fled
from pps_vision.experiments.pps.compensation import CASES
from pps_vision.experiments.pps.errors import Belief, only
from pps_vision.experiments.pps.errors_fled import WAYS, ErrorsFled, passing_beside, pressing
from pps_vision.experiments.pps.flight import Fleeing
from pps_vision.geometry.se3 import move_points
from pps_vision.robot.icub import home
from pps_vision.robot.skin import TOUCH_RADIUS_M, icub_skin, touched_taxels
from pps_vision.types import Array

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


def test_what_is_taken_off_is_where_the_arm_expects_it(belief: Belief) -> None:
    """Seen through an offset of 30 cm an object is nowhere near; with the offset known it is fled."""
    counts = np.zeros((len(SKIN.taxel_ids), 8, 4, 2), np.int64)
    counts[..., 0] = 5
    sure = PPSMemory(SKIN.taxel_ids, SKIN.part_index, counts, MemoryParams())
    rng = np.random.default_rng(SEED)
    path = Fleeing(belief, SKIN, sure).approach("left_forearm:15", RADIUS_M, 0.1, rng)
    assert not Fleeing(belief, SKIN, sure).meet(path, RADIUS_M, rng).touched
    assert Fleeing(belief, SKIN, sure, (0.3, 0.0, 0.0)).meet(path, RADIUS_M, rng).touched


def test_an_offset_of_all_that_is_seen_is_found_and_taken_off(belief: Belief) -> None:
    """Objects that lie on taxels, in the forearm's frame, all seen 2, 1, −3 cm beside: the map is of the truth."""
    part, frame = SKIN.parts[0], SKIN.parts[0].frame
    q = home(belief.true_robot)
    T = belief.true_robot.at(q).T_root(frame)
    beside = np.array([0.02, 0.01, -0.03])

    def trial(i: int, aside: Array) -> TouchTrial:
        end = part.positions_m[i] + RADIUS_M * part.normals[i] + aside
        path = move_points(T, end + np.array([0.08, 0.04, 0.0])[:, None] * part.normals[i])
        touched = SKIN.part_index == 0
        touched[touched] = np.arange(touched.sum()) == i
        v = np.tile(-0.1 * T[:3, :3] @ part.normals[i], (3, 1))
        cov, radius = np.zeros((3, 3, 3)), np.full(3, RADIUS_M)
        return TouchTrial(np.arange(3) * 0.4, np.tile(q, (3, 1)), path, v, cov, radius, touched, "")

    n = len(part.ids)
    moved, true = (tuple(trial(k % n, aside) for k in range(60)) for aside in (beside, np.zeros(3)))
    np.testing.assert_allclose(errors_fled._aside((belief, moved)), beside * 60 / 61, atol=1e-6)
    memory, aside = errors_fled._taught((belief, moved), True)
    as_it_is, nothing = errors_fled._taught((belief, true), False)
    np.testing.assert_array_equal(nothing, 0)
    wrong = errors_fled._taught((belief, moved), False)[0].counts
    assert np.abs(memory.counts - as_it_is.counts).sum() < 0.3 * np.abs(wrong - as_it_is.counts).sum()
    np.testing.assert_allclose(aside, beside * 60 / 61, atol=1e-6)


def summary() -> dict[str, Any]:
    """Three robots, two paths each: touched never, always, on every second path; none flees what passes."""
    met = np.zeros((3, 2, 3))
    always, half = met.copy(), met.copy()
    always[..., 0] = 1
    half[:, 0, 0] = 1
    return errors_fled._summary(dict(zip(CASES, (met, always, half), strict=True)))


def test_flights_are_counted_and_drawn() -> None:
    of = summary()
    assert [of[case]["touched"]["n"] for case in CASES] == [0, 6, 3]
    assert of["after learning"]["fled_beside"]["n"] == 0
    assert of["touched"]["errors_cost"] == {"mean": 1.0, "interval_95": [1.0, 1.0]}
    assert of["touched"]["learning_changes"]["mean"] == -0.5
    assert of["no errors"]["touched"]["share_95"] == pytest.approx([0, 0.3903], abs=1e-3)  # z²/(n + z²)
    numbers = {"aside_mm": [[1.0, 2.0, 3.0]] * 3, "ways": dict.fromkeys(WAYS, of)}
    assert len(ErrorsFled().chart(numbers).axes) == 3


def test_costs_are_by_robot() -> None:
    values = dict(zip(CASES, np.array([[0.9, 0.9], [0.7, 0.9], [0.8, 0.9]]), strict=True))
    cost = errors_fled._cost(values)
    assert cost["errors_cost"]["mean"] == pytest.approx(-0.1)
    assert cost["errors_cost"]["interval_95"] == pytest.approx([-0.2, 0.0])


def test_no_robots_are_refused() -> None:
    with pytest.raises(ValueError, match="--robots 1"):
        ErrorsFled(robots=1).run()
