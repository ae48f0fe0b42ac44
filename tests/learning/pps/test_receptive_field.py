"""D and TTC against cases worked out by hand, and against rigid motions of the whole scene."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from learning.pps.receptive_field import ReceptiveField, perceive

FIELD = ReceptiveField()
UP = np.array([0.0, 0.0, 1.0])
MOTIONS = [(0, 0, -0.05), (0, 0, 0), (0, 0, 0.05), (0.1, 0, 0)]


def one(d, v, field=FIELD, **options):
    D, TTC = perceive(field, [[0, 0, 0]], [UP], d, v, **options)
    return float(D[0]), float(TTC[0])


@pytest.mark.parametrize(
    ("d", "v", "expected"),
    [
        ((0, 0, 0.10), (0, 0, -0.05), (0.10, 2.0)),  # head on
        ((0, 0, 0.10), (0, 0, 0.05), (0.10, -2.0)),  # receding
        ((0, 0, 0.10), (0.05, 0, 0), (0.10, np.inf)),  # tangential
        ((0, 0, 0.10), (0, 0, 0), (0.10, np.inf)),  # still
        ((0, 0, -0.02), (0, 0, 0.05), (-0.02, 0.4)),  # behind, coming through the skin
        ((0, 0, -0.02), (0, 0, -0.05), (-0.02, -0.4)),  # behind, going away
        ((0.05, 0, 0), (-0.1, 0, 0), (0.05, 0.5)),  # along the skin, D counts as positive there
        ((0, 0, 0), (0, 0, -0.05), (0.0, 0.0)),  # on the taxel
        ((0, 0, 0), (0, 0, 0), (0.0, 0.0)),
        ((0, 0.03, 0.04), (0, 0, -0.1), (0.05, 0.625)),  # ‖d‖ 5 cm, closing at 0.1·0.8
    ],
)
def test_cases_worked_out_by_hand(d, v, expected):
    assert one(d, v) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("d", "inside"),
    [
        ((0, 0, 0.199), True),
        ((0, 0, 0.201), False),  # too far
        ((0.069, 0, 0), True),
        ((0.071, 0, 0), False),  # beside the base
        ((0.157, 0, 0.10), True),  # 0.07 + 0.10·tan 41.41° = 0.1582
        ((0.160, 0, 0.10), False),
        ((0, 0, -0.099), False),  # behind the apex, 0.07/tan 41.41° = 0.0794 below the skin
        ((0, 0, -0.079), True),
    ],
)
def test_the_cone_is_cut_by_the_skin(d, inside):
    D, TTC = one(d, (0, 0, -0.1))
    assert np.isnan(D) == np.isnan(TTC) == (not inside)


@pytest.mark.parametrize(
    ("distance_to", "height_m", "v", "radius_m", "expected"),
    [
        ("surface", 0.10, (0, 0, -0.05), 0.03, (0.07, 1.4)),
        ("surface", 0.02, (0, 0, -0.05), 0.03, (-0.01, 0.0)),
        ("centre", 0.10, (0, 0, -0.05), 0.03, (0.10, 2.0)),
        ("surface", 0.10, (0, 0, -0.05), None, (0.10, 2.0)),  # a point
        *(("surface", 0.03, v, 0.03, (0.0, 0.0)) for v in MOTIONS),  # what touches does so now, however it moves
        *(("surface", 0.025, v, 0.03, (-0.005, 0.0)) for v in MOTIONS),
        ("surface", 0.24, (0, 0, -0.1), 0.05, (0.19, 1.9)),  # a large object's surface, as far as the field reaches
        ("surface", 0.26, (0, 0, -0.1), 0.05, (np.nan, np.nan)),
        ("centre", 0.24, (0, 0, -0.1), 0.05, (np.nan, np.nan)),
    ],
)
def test_surface_instead_of_centre(distance_to, height_m, v, radius_m, expected):
    field = ReceptiveField(distance_to=distance_to)
    options = {} if radius_m is None else {"radius_m": radius_m}
    assert one((0, 0, height_m), v, field, **options) == pytest.approx(expected, abs=1e-12, nan_ok=True)


@pytest.mark.parametrize(
    ("sigmas", "v", "ttc_s"),
    [(1.0, -0.021, 0.1 / 0.021), (1.0, -0.019, np.inf), (1.0, 0.019, np.inf), (2.0, -0.039, np.inf)],
)
def test_a_closing_speed_within_its_noise_is_no_approach(sigmas, v, ttc_s):
    """Only the noise along the line of sight matters."""
    cov = np.diag([1.0, 1.0, 0.02**2])
    assert one((0, 0, 0.1), (0, 0, v), ReceptiveField(min_closing_sigmas=sigmas), cov_v=cov)[1] == pytest.approx(ttc_s)


def test_an_unknown_stimulus_is_not_perceived():
    assert np.isnan(one((np.nan, 0, 0.1), (0, 0, -0.1))).all()
    assert np.isnan(one((0, 0, 0.1), (np.nan, 0, -0.1))).all()


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_moving_everything_together_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng).as_matrix()
    shift = rng.normal(size=3)
    x = rng.uniform(-0.1, 0.1, (6, 3))
    n = rng.normal(size=(6, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    p = rng.uniform(-0.1, 0.1, 3)
    v = rng.normal(size=3)
    cov = np.diag([0.1, 0.02, 0.3])
    still = perceive(FIELD, x, n, p, v, cov_v=cov)
    after = perceive(
        FIELD, x @ turn.T + shift, n @ turn.T, turn @ p + shift, turn @ v, cov_v=turn @ cov @ turn.T
    )  # fmt: skip
    np.testing.assert_allclose(after, still, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"half_angle_rad": 2.0}, "angle between 0 and 90"),
        ({"base_radius_m": -0.01}, "angle between 0 and 90"),
        ({"length_m": 0.0}, "angle between 0 and 90"),
        ({"distance_to": "edge"}, "expected centre or surface"),
    ],
)
def test_an_impossible_cone_is_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        ReceptiveField(**wrong)
    assert ReceptiveField(base_radius_m=0.0).base_radius_m == 0  # a cone with its apex on the taxel


def test_a_whole_skin_perceives_as_its_taxels_do_alone():
    """Far taxels are sorted out first, which must change nothing, with and without the radius taken off."""
    rng = np.random.default_rng(8)
    x = rng.uniform(-0.4, 0.4, (500, 3))
    n = rng.normal(size=(500, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    for field in (FIELD, ReceptiveField(distance_to="surface")):
        together = perceive(field, x, n, [0.05, 0, 0], [-0.1, 0, 0.02], 0.04, np.eye(3) * 1e-4)
        alone = [perceive(field, x[i : i + 1], n[i : i + 1], [0.05, 0, 0], [-0.1, 0, 0.02], 0.04, np.eye(3) * 1e-4)
                 for i in range(500)]  # fmt: skip
        np.testing.assert_allclose(together, np.concatenate(alone, axis=1), rtol=1e-12)
        assert 5 < np.isfinite(together[0]).sum() < 250
