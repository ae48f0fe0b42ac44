"""The stereo methods on a few rendered scenes, against where the ball really is."""

from pathlib import Path

import numpy as np
import pytest
from data import shared_data

from pps_vision.experiments.motorcycle import motorcycle
from pps_vision.experiments.stereo import Stereo


def test_the_centroid_needs_no_texture_and_disparity_does(tmp_path: Path) -> None:
    experiment = Stereo(n=2, frames=9, depths_m=(0.4,), vergences_deg=(30.0,), data=tmp_path, seed=1)
    numbers = experiment.run()
    textured, plain = (numbers[f"depth_{kind}"]["0.4"]["methods"] for kind in ("textured", "plain"))  # type: ignore[index]
    for methods in (textured, plain):
        assert methods["centroid (ours)"]["rms_mm"] < 2.0
    assert textured["whole BM"]["rms_mm"] < 10.0
    assert plain["region BM"]["found"] < 0.5
    for head in ("still", "moving"):
        assert numbers["marker"][head]["0.4"]["of_bound"] < 1.3  # type: ignore[index]
        assert numbers["ball_0.3_m"][head]["rms_mm"] < 1.0  # type: ignore[index]
    assert numbers["motorcycle"] == f"skipped: no {tmp_path / 'motorcycle'}"
    assert set(experiment.chart(numbers)) == {"depth", "speed", "tracked"}


def test_too_little_to_measure_is_refused() -> None:
    with pytest.raises(ValueError, match="--n 1"):
        Stereo(n=1).run()


def test_on_real_images_the_maps_are_as_bad_as_others_found() -> None:
    """bad-2 of SGBM: 6.3 % of matched pixels, 20.9 % with unmatched, by others' parameters."""
    numbers = motorcycle(shared_data("motorcycle"), 40, np.random.default_rng(0))
    whole = numbers["maps"]["SGBM"]
    assert 0.04 < whole["bad2_of_matched"] < 0.09
    assert 0.15 < whole["bad2_of_all"] < 0.25
    assert set(numbers["windows"]) == {"whole BM", "whole SGBM", "BM in windows", "SGBM in windows"}
