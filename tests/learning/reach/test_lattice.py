"""The lattice against its definition, and maps on it whose values are known everywhere."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from learning.reach.babbling import crossing
from learning.reach.labels import Labels
from learning.reach.lattice import Lattice, isotropic
from learning.reach.map import ReachableMap, both
from pps_vision.errors import InputError
from pps_vision.robot.gaze import GazeLimits

LIMITS = GazeLimits()
NO_LABELS = Labels(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0), np.zeros(0), np.zeros((0, 3)))


def random_gaze(n):
    return np.random.default_rng(SEED).uniform(LIMITS.lower, LIMITS.upper, (n, 3))


def reachable_map(signed, shape=(9, 10, 60), **changes):
    """A map whose signed distance is a function of isotropic coordinates, linear in each."""
    values = signed(isotropic(Lattice(LIMITS, shape).gaze_rad)).reshape(shape)
    good = np.full(shape, 0.6)
    off = np.full(shape, 0.05)
    return replace(ReachableMap("left", LIMITS, values, good, off, 0.1, 0.02, 0.01, NO_LABELS, 0), **changes)


def test_a_step_in_vergence_is_a_share_of_the_viewing_distance():
    gaze = random_gaze(50)
    coordinates = isotropic(gaze)
    np.testing.assert_array_equal(coordinates[:, :2], gaze[:, :2])
    np.testing.assert_allclose(coordinates[:, 2], -np.log(2 * np.linalg.norm(crossing(gaze), axis=1)), atol=1e-12)


@pytest.mark.parametrize("spacing", [0.04, 0.1, 0.37])
def test_a_lattice_is_the_coarsest_with_steps_no_longer_than_asked(spacing):
    extent = isotropic(LIMITS.upper) - isotropic(LIMITS.lower)
    steps = np.array(Lattice.of_spacing(LIMITS, spacing).shape) - 1
    assert np.all(extent / steps <= spacing + 1e-12)
    assert np.all(extent / (steps - 1) > spacing)


def test_points_lie_at_equal_steps_between_the_limits():
    lattice = Lattice(LIMITS, (3, 4, 5))
    points = isotropic(lattice.gaze_rad).reshape(3, 4, 5, 3)
    np.testing.assert_allclose(lattice.gaze_rad[[0, -1]], [LIMITS.lower, LIMITS.upper])
    for axis in range(3):
        steps = np.diff(points[..., axis], axis=axis)
        np.testing.assert_allclose(steps, steps.flat[0])


def test_interpolation_is_exact_for_what_is_linear_in_each_coordinate():
    """Also at the limits themselves."""

    def values(gaze):
        a, b, c = isotropic(gaze).T
        return np.stack([1 + a - 2 * b + 3 * c + a * b * c, a * c - b])

    lattice = Lattice(LIMITS, (3, 4, 5))
    corners = np.array(np.meshgrid(*zip(LIMITS.lower, LIMITS.upper, strict=True))).reshape(3, -1).T
    gaze = np.concatenate([random_gaze(500), corners])
    fields = values(lattice.gaze_rad).reshape(2, *lattice.shape)
    np.testing.assert_allclose(lattice.interpolate(fields, gaze), values(gaze), atol=1e-12)


def test_a_degree_is_between_0_and_1_and_reachable_is_what_is_more_likely_than_not():
    learned = reachable_map(lambda at: 0.1 * at[:, 0])
    beyond = replace(learned, optimality=1.4 + 0 * learned.optimality, error_m=0.3 + 0 * learned.error_m)
    gaze = random_gaze(500)
    np.testing.assert_array_equal(beyond.query(gaze).degree, np.where(gaze[:, 0] > 0, 1.0, 0.0))
    np.testing.assert_array_equal(learned.query(gaze).reachable, gaze[:, 0] > 0)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
def test_the_threshold_allows_the_false_positives_asked_for(share):
    """By the map's own probabilities at gaze postures drawn evenly in angles, not in lattice coordinates."""
    learned = reachable_map(lambda at: 0.03 * (at[:, 2] + 1.2 + at[:, 0]), (30, 3, 80))
    threshold = learned.threshold(share)
    p = learned.query(random_gaze(200_000)).probability
    allowed = (1 - p)[p > threshold].sum() / (1 - p).sum()
    assert threshold >= 0.5
    assert allowed == pytest.approx(share, rel=0.15) if threshold > 0.5 else allowed <= share


def test_thresholds_have_bounds():
    learned = reachable_map(lambda at: 0.03 * at[:, 0])
    assert learned.threshold(0.999) == 0.5
    for share in (0.0, 1.0):
        with pytest.raises(InputError, match="above 0 and below 1"):
            learned.threshold(share)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"max_error_m": 0.0}, "above 0"),
        ({name: np.zeros((1, 4, 5)) for name in ("signed_distance", "optimality", "error_m")}, "at least 2"),
    ],
)
def test_maps_that_could_not_be_asked_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        reachable_map(lambda at: at[:, 0], **changes)


def test_every_number_is_saved(tmp_path):
    learned = reachable_map(
        lambda at: at[:, 1], expected_error=0.03, unanswered=7, end_point="left_forearm:27", measure="isotropy"
    )
    labels = Labels(random_gaze(3), np.array([True, False, True]), np.arange(3.0), np.arange(3.0) + 3, random_gaze(3))
    replace(learned, labels=labels).save(tmp_path / "map.npz")
    again = ReachableMap.load(tmp_path / "map.npz")
    for name in ("side", "limits", "max_error_m", "softness", "expected_error", "unanswered", "end_point", "measure"):
        assert getattr(again, name) == getattr(learned, name), name
    for name in ("signed_distance", "optimality", "error_m"):
        np.testing.assert_array_equal(getattr(again, name), getattr(learned, name))
    for name in ("gaze_rad", "reachable", "error_m", "optimality", "border_rad"):
        np.testing.assert_array_equal(getattr(again.labels, name), getattr(labels, name))
    pair = both(again, replace(again, side="right"))
    assert (pair.end_point, pair.measure) == ("left_forearm:27", "isotropy")
