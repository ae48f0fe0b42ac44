"""The harness against numbers known in advance."""

import numpy as np
import pytest

from pps_vision.experiments.study import (
    Axis,
    Break,
    Metric,
    compare,
    compare_severities,
    interval,
    mean,
    percent,
    percent_of,
    rms,
)

METRICS = {"rms": Metric("error", rms), "found_percent": Metric("found", percent)}


def test_every_method_is_measured_on_every_recording() -> None:
    calls = []

    def method(recording: float, seed: int) -> dict[str, list[float]]:
        calls.append((recording, seed))
        return {"error": [recording, -recording], "found": [1, 0]}

    numbers = compare({"a": lambda seed: 10.0 * seed, "b": float}, {"ours": method}, METRICS, (1, 2))
    assert calls == [(10.0, 1), (20.0, 2), (1.0, 1), (2.0, 2)]
    assert numbers["a"]["ours"]["rms"] == pytest.approx([np.sqrt(250), 10, 20])
    assert numbers["b"]["ours"]["found_percent"] == pytest.approx([50, 50, 50])
    assert numbers["a"]["ours"]["n"] == 2


def test_intervals_are_of_independent_units() -> None:
    """100 copies of a value within a recording add nothing; 40 recordings give the normal interval of their mean."""
    rng = np.random.default_rng(1)
    values = rng.normal(3, 2, 40)
    copied = interval([np.full(100, value) for value in values])
    assert copied == pytest.approx(interval([[value] for value in values]))
    half = 1.96 * values.std(ddof=1) / np.sqrt(40)
    assert copied == pytest.approx([values.mean(), values.mean() - half, values.mean() + half], abs=0.15)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(2)
    held = [low <= 0 <= high for _, low, high in (interval(rng.normal(size=(30, 1)), mean) for _ in range(200))]
    assert np.mean(held) == pytest.approx(0.94, abs=0.045)


def test_percentages_have_wilsons_interval() -> None:
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
def test_a_method_breaks_at_the_first_severity_past_the_bound(
    above: bool, bound: float, expected: float | None
) -> None:
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
