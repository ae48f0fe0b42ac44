"""The choice of the cheapest tracker, on trackers whose errors are known beforehand."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from data import SEED
from scipy.stats import chi2

from pps_vision.app import budget
from pps_vision.app.budget import CONFIGURATIONS, Configuration, cheapest, configurations
from pps_vision.types import Observation3D, Status, StereoFrame, Track3D
from tracking.kalman import KalmanParams
from tracking.tracker import TrackerParams, TrackerStep

STD_M, DT_S = 0.001, 0.05
WHITE_STD_M = STD_M * KalmanParams().white_share ** 0.5  # the rest of an error stays, and no innovation shows it
MIDPOINT = np.array([5.0, 0.0, 0.0])
CHEAP, DEAR = TrackerParams(confirm_frames=2), TrackerParams(confirm_frames=4)


@dataclass
class Scripted:
    """A tracker that reports `std_m` from its eleventh frame on and sees a point on a path with STD_M of noise; blind
    if it is no number.  In the frames `coasts` it coasts and knows nothing.
    """

    std_m: float
    acceleration: float
    coasts: range = range(0)

    def __post_init__(self) -> None:
        self.k, self.rng = 0, np.random.default_rng(SEED)

    def step(self, _: object) -> TrackerStep:
        t, self.k = DT_S * self.k, self.k + 1
        if not np.isfinite(self.std_m):
            return TrackerStep(Track3D.unknown(t), (), None, np.zeros(3))
        p = np.add(MIDPOINT, [0.4 + 0.5 * self.acceleration * t * t, 0.05 * t, 0.0])
        seen = Observation3D(t, p + self.rng.normal(0, WHITE_STD_M, 3), STD_M**2 * np.eye(3), 0.03, 1e-8, 0.0)
        mean, cov = np.zeros((4, 3)), np.zeros((12, 12))
        status = Status.COASTING if self.k - 1 in self.coasts else Status.TRACKING
        variance = 1.0 if status == Status.COASTING or self.k <= 10 else self.std_m**2 / 3
        mean[0], cov[:3, :3], cov[3:6, 3:6] = p, variance * np.eye(3), np.eye(3)
        return TrackerStep(Track3D(t, mean, cov, 0.03, 1e-8, status), (), seen, MIDPOINT)


def choose(asked_mm: float, cheap_std_m: float, dear_std_m: float, acceleration: float = 0.0):
    tried = (Configuration("cheap", CHEAP, 2.0), Configuration("dear", DEAR, 1.0))
    frames: Iterable[StereoFrame] = [None] * 80  # type: ignore[list-item]
    stds = {CHEAP: cheap_std_m, DEAR: dear_std_m}
    return cheapest(frames, asked_mm, lambda p: Scripted(stds[p], acceleration), tried)  # type: ignore[arg-type,return-value]


@pytest.mark.parametrize(
    ("asked_mm", "cheap_mm", "dear_mm", "name", "meets"),
    [
        (5.0, 2.0, 1.0, "cheap", True),  # twice as wrong as it says: 4 mm
        (3.0, 2.0, 1.0, "dear", True),
        (0.5, 2.0, 1.0, "dear", False),
        (0.5, 0.4, 1.0, "cheap", False),  # 0.8 mm is nearer than 1
        (5.0, np.nan, 1.0, "dear", True),  # the cheap one never has it
    ],
)
def test_the_cheapest_that_will_do(asked_mm: float, cheap_mm: float, dear_mm: float, name: str, meets: bool) -> None:
    choice = choose(asked_mm, cheap_mm / 1000, dear_mm / 1000)
    assert (choice.configuration.name, choice.meets) == (name, meets)
    assert name == "cheap" or len(choice.probes) == 2


def test_where_nothing_is_seen_the_default_is_used_and_that_is_said() -> None:
    default = Configuration("default", TrackerParams(), 1.0)
    blind = cheapest([None] * 5, 1.0, lambda _: Scripted(np.nan, 0.0), (default,))  # type: ignore[list-item,arg-type,return-value]
    assert (blind.configuration, blind.meets) == (default, False)
    assert "tracks the object" in blind.reason


def test_the_filter_is_of_the_lowest_order_that_the_motion_allows() -> None:
    steady, bent = choose(5, 0.001, 0.001), choose(5, 0.001, 0.001, acceleration=3.0)
    assert steady.configuration.params.kalman == KalmanParams.of_order(2)
    assert bent.configuration.params.kalman.order == 3
    jumping = choose(5, 0.001, 0.001, acceleration=1e4)  # no order expects that: the one by default stays
    assert jumping.configuration.params.kalman == KalmanParams()


@pytest.mark.parametrize("factor", [0.999, 1.001])
def test_an_order_will_do_whose_innovations_are_within_95_percent(
    monkeypatch: pytest.MonkeyPatch, factor: float
) -> None:
    """Of the 49 that come after the first ten, each of three dimensions."""
    highest = chi2.ppf(0.975, 3 * 49) / 49
    monkeypatch.setattr(budget, "_innovations", lambda params, seen: [99.0] * 10 + [factor * highest] * 49)
    chosen = choose(5, 0.001, 0.001).configuration.params
    assert chosen.kalman == (KalmanParams.of_order(2) if factor < 1 else CHEAP.kalman)


@pytest.mark.parametrize(("n_coasting", "meets"), [(5, True), (6, False)])
def test_what_is_tracked_in_nine_of_ten_pairs_will_do(n_coasting: int, meets: bool) -> None:
    """Of the fifty that come after the first ten."""
    one = Configuration("one", TrackerParams(), 1.0)
    tracker = Scripted(0.001, 0.0, range(20, 20 + n_coasting))
    choice = cheapest([None] * 80, 5.0, lambda _: tracker, (one,))  # type: ignore[list-item,arg-type,return-value]
    assert choice.meets == meets
    (probe,) = choice.probes
    assert probe.tracked_share == pytest.approx(1 - n_coasting / 50)
    assert probe.expected_mm == pytest.approx(1.0)
    assert tracker.k == 60
    assert choice.summary()["tried"] == [probe.__dict__]


def test_an_object_is_waited_for_600_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """The median of its times, 2 ms a pair, is that of the pairs from the first detection on."""
    ticks = iter(np.arange(0.0, 99.0, 0.002))
    monkeypatch.setattr(budget, "process_time", lambda: float(next(ticks)))
    one, blind, seen = Configuration("one", TrackerParams(), 1.0), Scripted(np.nan, 0.0), Scripted(0.001, 0.0)
    choices = [
        cheapest([None] * 700, 5.0, lambda _, tracker=tracker: tracker, (one,))  # type: ignore[list-item,misc]
        for tracker in (blind, seen)
    ]
    assert blind.k == 600
    assert np.isnan(choices[0].probes[0].ms_per_pair)
    assert choices[1].probes[0].ms_per_pair == pytest.approx(2.0)


@pytest.mark.parametrize("n", [8, 10])
def test_of_ten_pairs_nothing_can_be_told(n: int) -> None:
    one = Configuration("one", TrackerParams(), 1.0)
    choice = cheapest([None] * n, 5.0, lambda _: Scripted(0.001, 0.0), (one,))  # type: ignore[list-item,arg-type,return-value]
    assert (choice.meets, choice.configuration) == (False, one)
    assert choice.reason == "none of 1 tracks the object in the first seconds; the default"


@pytest.mark.parametrize("asked_mm", [0.0, -1.0, np.nan])
def test_an_error_that_cannot_be_asked_for(asked_mm: float) -> None:
    with pytest.raises(ValueError, match=r"max-error-mm.*expected a positive number"):
        choose(asked_mm, 0.001, 0.001)


@pytest.mark.parametrize(("width_px", "reductions"), [(0, {1}), (319, {1}), (320, {1, 2}), (640, {1, 2, 4})])
def test_no_image_is_reduced_to_less_than_160_pixels(width_px: int, reductions: set[int]) -> None:
    tried = configurations(width_px)
    assert {c.params.reduction for c in tried} == reductions
    assert [c.name for c in CONFIGURATIONS if c in tried] == [c.name for c in tried]  # the fastest first, as there


def test_the_ratios_it_counts_on_are_no_smaller_than_those_that_were_measured() -> None:
    """Of the worst kind of scene that a configuration tracks, and not more than three times as large."""
    cells = json.loads((Path(__file__).parents[2] / "docs" / "results" / "budget.json").read_text())["cells"]
    for configuration in CONFIGURATIONS:
        of_scenes = [cell[configuration.name] for cell in cells.values() if configuration.name in cell]
        worst = max(one["true_over_reported"][0] for one in of_scenes if one["near_percent"][0] >= 90)
        assert worst <= configuration.true_over_reported <= 3 * worst
