"""The baselines of the image tracker, NanoTrack with and without its files."""

from pathlib import Path

import numpy as np
import pytest
from data import SEED
from nano import write_weights

from pps_vision.errors import InputError
from pps_vision.experiments.stages import Stages, image_tracker
from pps_vision.experiments.stages.image_tracker import BoxedFilm, methods

N = 6


@pytest.fixture
def film() -> BoxedFilm:
    """A red block that moves over a grey wall."""
    rng = np.random.default_rng(SEED)
    images = np.clip(90 + rng.normal(0, 4, (N, 90, 120, 3)), 0, 255).astype(np.uint8)
    for k, image in enumerate(images):
        image[30 + k : 50 + k, 20 + 3 * k : 44 + 3 * k] = (230, 60, 30)
    return BoxedFilm(tuple(images), tuple((20.0 + 3 * k, 30.0 + k, 24.0, 20.0) for k in range(N)), 0.0)


def test_the_hue_blob_is_the_block(film):
    assert np.min(methods()["hue blob"](film, 0)["iou"]) > 0.9


@pytest.mark.filterwarnings("ignore")
def test_nanotrack_takes_part_with_its_files(film, tmp_path, monkeypatch):
    weights = write_weights(tmp_path / "weights", monkeypatch)
    monkeypatch.setenv("PPS_VISION_NANO", str(weights))
    assert np.min(methods()["NanoTrack"](film, 0)["iou"]) > 0.3
    (weights / "my_head.onnx").unlink()
    with pytest.raises(InputError, match=r"weights: found none; expected one file \*head\*\.onnx of NanoTrack"):
        methods()["NanoTrack"](film, 0)


@pytest.mark.long
def test_without_its_files_the_result_says_so(tmp_path: Path, monkeypatch):
    monkeypatch.delenv("PPS_VISION_NANO", raising=False)
    study = Stages(n=1, seconds=0.2, scenes="independent", data=tmp_path)
    numbers = image_tracker.run(study)
    assert "NanoTrack: PPS_VISION_NANO is not set; expected the folder" in numbers["not_measured"]
    rows = image_tracker.table(numbers).rows
    assert [row[0] for row in rows] == list(methods())
    assert all("%" in text for row in rows for text in row[1:])
