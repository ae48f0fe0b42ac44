"""Batches against frame by frame, on a few pairs."""

import pytest

from pps_vision.experiments.batches import SIZES, Batches


def test_the_paths_are_the_same_and_every_size_is_timed() -> None:
    numbers = Batches(n=6, repeats=1).run()
    assert numbers["paths_at_most_apart_mm"] < 0.1
    assert set(numbers["cpu"]) == {str(size) for size in SIZES}
    assert all(0 < rate["q25"] <= rate["median"] <= rate["q75"] for rate in numbers["cpu"].values())


def test_bad_numbers_are_named() -> None:
    with pytest.raises(ValueError, match="--repeats 0"):
        Batches(repeats=0).run()
