"""The experiments of reachable space on small sizes: they run, draw, and name bad input."""

import numpy as np
import pytest

from learning.reach.babbling import Babbled
from pps_vision.experiments.baselines.regressors import Neighbours
from pps_vision.experiments.reach.failures import CASES as FAULTS
from pps_vision.experiments.reach.failures import METHODS, BabblingFailures
from pps_vision.experiments.reach.forward_model import ForwardModelError
from pps_vision.experiments.reach.in_loop import InLoop, _Run, _shares
from pps_vision.experiments.reach.lwpr import CASES, CrossFunction, nmse, taught
from pps_vision.experiments.reach.regressors import Regressors, Replayed, measure


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def test_the_cross_function_without_adapting(rng: np.random.Generator) -> None:
    """With a tenth of the samples it is nearly where the authors' library ends."""
    model, seconds = taught(CASES["not adapting"], rng, share=0.1)
    assert nmse(model) < 0.09
    assert seconds > 0


def test_a_regressor_is_measured(rng: np.random.Generator) -> None:
    """Neighbours that are the test postures themselves miss nothing; narrow fields leave much open, and it shows."""
    arm = rng.uniform(-0.5, 0.5, (300, 4))
    gaze = np.concatenate([arm[:, :2], np.full((300, 1), 0.3)], axis=1)
    train, test = Babbled(arm[:200], gaze[:200], 0), Babbled(arm[200:], gaze[200:], 0)
    near = measure(lambda: Neighbours(1), train, train)
    assert near.rmse_deg == pytest.approx(0, abs=1e-4)
    assert (near.unanswered, near.fields) == (0, None)
    assert near.kib > 0
    local = measure(lambda: Replayed(2000.0, rng), train, test)
    assert local.unanswered > 0.5
    assert local.fields is not None


def test_the_first_severity_of_a_fault_is_none_and_the_worst_is_one(rng: np.random.Generator) -> None:
    arm, gaze = rng.uniform(-0.3, 0.3, (1500, 4)), rng.uniform(0.2, 0.4, (1500, 3))
    for _, severities, fault in FAULTS.values():
        mild, worst = (fault(Babbled(arm, gaze, 0), severity, rng) for severity in (severities[0], severities[-1]))
        np.testing.assert_array_equal(mild.arm_rad, arm)
        np.testing.assert_allclose(mild.gaze_rad, gaze)
        assert (
            len(worst.arm_rad) < 1500 or np.abs(worst.arm_rad - arm).max() + np.abs(worst.gaze_rad - gaze).max() > 0.1
        )


def test_charts_draw_what_was_measured() -> None:
    case = {"fields": [50, 52], "nmse": [0.02, 0.03], "authors_fields": [54, 58], "authors_nmse": [0.019, 0.022]}
    cases = {name: case if name == "adapting" else {**case, "authors_fields": None} for name in CASES}
    assert len(CrossFunction().chart({"cases": cases}).axes[0].patches) == len(CASES)
    numbers = {"samples": [100, 200], "rmse_deg": {"LWPR": [2.0, 1.0]}, "unanswered": {"LWPR": [0.5, 0.0]}}
    numbers |= {"paper_deg": 0.84, "goals_deg": {"best": 0.02}}
    assert ForwardModelError().chart(numbers).axes[0].get_legend() is not None
    found = {"rmse_deg": [0.1, None], "unanswered": [0, 1], "breaks_at": 2.0}
    fault = {"axis": "σ", "severities": [0.0, 2.0], "methods": dict.fromkeys(METHODS, found)}
    assert len(BabblingFailures().chart({"cases": {"noise": fault}}).axes) == 1
    one = {"rmse_deg": 0.1, "unanswered": 0.2, "query_us": 3.0, "kib": 4.0, "fields": 7}
    figure = Regressors().chart({"samples": 9, "regressors": {"a": one, "b": {**one, "rmse_deg": 0.2, "fields": None}}})
    assert "7 fields (20.0% unanswered)" in [text.get_text() for text in figure.axes[0].texts]


def test_in_the_loop_shares_are_over_runs_and_what_no_gaze_fixates_is_not_reachable(rng: np.random.Generator) -> None:
    """A run of four frames, one said wrongly; a run of one, that cannot be fixated, rightly not called reachable."""
    yes, no, nan = True, False, np.nan
    one = _Run(
        *map(np.array, ([yes, no, yes, no], [0.9, 0.6, 0.7, 0.1], [yes, no, no, no], [0.9, 0.4, 0.7, 0.1], [yes] * 4))
    )
    other = _Run(*map(np.array, ([yes], [nan], [no], [nan], [no])))
    found = _shares([one, other], rng)
    assert (found["frames"], found["truly_reachable_frames"]) == (5, 2)
    assert (found["not_fixated_frames"], found["not_fixated_rightly"]) == (1, 1)
    for name, right, fp, fn in (
        ("likelier", 87.5, 1, 0),
        ("strict", 87.5, 0, 1),
        ("likelier_at_the_true_place", 100, 0, 0),
    ):
        way = found[name]
        assert (way["right"], way["false_positives"], way["false_negatives"]) == (right, fp, fn)  # type: ignore[index]
        assert way["right_95"][0] <= right <= way["right_95"][1]  # type: ignore[index]
    gaze = {"closed form": {"median_ms": 0.03, "worst_rad": 4e-15}, "iterative": {"median_ms": 4.0, "worst_rad": 3e-7}}
    assert len(InLoop().chart({**found, "gaze": gaze}).axes) == 2


def test_bad_input_is_named() -> None:
    for experiment in (CrossFunction(n=0), InLoop(n=0)):
        with pytest.raises(ValueError, match="--n 0"):
            experiment.run()
    with pytest.raises(ValueError, match="--n-replays 0"):
        ForwardModelError(n_replays=0).run()
