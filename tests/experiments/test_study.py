"""The harness against numbers known in advance."""

import numpy as np
import pytest

from pps_vision.app.intervals import percent_of
from pps_vision.experiments.study import Axis, Break, Metric, compare_severities, interval, mean


def test_intervals_are_of_independent_units():
    """100 copies of a value within a recording add nothing; 40 recordings give the normal interval of their mean."""
    rng = np.random.default_rng(1)
    values = rng.normal(3, 2, 40)
    copied = interval([np.full(100, value) for value in values])
    assert copied == pytest.approx(interval([[value] for value in values]))
    half = 1.96 * values.std(ddof=1) / np.sqrt(40)
    assert copied == pytest.approx([values.mean(), values.mean() - half, values.mean() + half], abs=0.15)


def test_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(2)
    held = [low <= 0 <= high for _, low, high in (interval(rng.normal(size=(30, 1)), mean) for _ in range(100))]
    assert np.mean(held) == pytest.approx(0.94, abs=0.06)


def test_percentages_have_wilsons_interval():
    """(p + z²/2n ± z √(p(1 − p)/n + z²/4n²)) / (1 + z²/n) for 8 of 10, with z = 1.96."""
    z = 1.959964
    p = 0.8
    n = 10
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    ends = [100 * (p + z**2 / (2 * n) + sign * half) / (1 + z**2 / n) for sign in (-1, 1)]
    assert percent_of(8, 10) == pytest.approx([80, *ends], abs=1e-4)
    assert np.isnan(percent_of(0, 0)).tolist() == [True] * 3


@pytest.mark.parametrize(
    ("above", "bound", "expected"), [(True, 2.5, 3), (True, 3, 5), (False, -2.5, None), (True, 9, None)]
)
def test_a_method_breaks_at_the_first_severity_past_the_bound(above, bound, expected):
    numbers = compare_severities(
        lambda seed, severity: severity,
        Axis("noise", (0, 1, 3, 5)),
        {"ours": lambda recording, seed: {"error": [recording]}, "lost": lambda recording, seed: {"error": []}},
        {"error": Metric("error", mean)},
        (0, 1),
        Break("error", bound, above),
    )
    assert numbers["methods"]["ours"]["breaks_at"] == expected
    assert numbers["methods"]["lost"]["breaks_at"] == 0, "a method without a value is broken"
    assert [value for value, _, _ in numbers["methods"]["ours"]["error"]] == [0, 1, 3, 5]
