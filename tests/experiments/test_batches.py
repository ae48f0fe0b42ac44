"""Batches against frame by frame, on a few pairs."""

import numpy as np
import pytest

from pps_vision.experiments.batches import OBJECTS, SIZES, Batches, agreement


def test_the_detections_agree_and_every_size_is_timed() -> None:
    """Within 0.05 px, the issue's limit, with the lens's distortion and noise of 2/255."""
    numbers = Batches(n=8, recordings=1, repeats=1).run()
    for mode in OBJECTS:
        assert numbers[mode]["agreement"]["max_px"] < 0.05
        assert numbers[mode]["agreement"]["only_in_one"] == 0
        assert numbers[mode]["agreement"]["detections"] >= 10
        assert numbers[mode]["error_batch_px"]["q99_px"] < 0.3
        assert numbers[mode]["sizes_and_threads_at_most_apart_px"] < 1e-3
        for threads in (1, 2):
            rates = numbers[mode][f"cpu, {threads} threads"]
            assert set(rates) == {str(size) for size in SIZES}
            assert all(0 < rate["q25"] <= rate["median"] <= rate["q75"] for rate in rates.values())


def test_what_only_one_has_is_counted() -> None:
    one = np.zeros((3, 2, 2))
    other = one + np.array([3.0, 4.0])
    other[1, 0] = np.nan
    apart = agreement(one, other)
    assert (apart["detections"], apart["only_in_one"], apart["max_px"]) == (6, 1, 5.0)


def test_bad_numbers_are_named() -> None:
    with pytest.raises(ValueError, match="--repeats 0"):
        Batches(repeats=0).run()
