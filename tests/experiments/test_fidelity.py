"""Fidelity of the renderer against its ray-cast reference, and the scale a user asks for."""

from pathlib import Path

import numpy as np
import pytest

from pps_vision.app.render import record
from pps_vision.app.render_params import RenderParams
from pps_vision.experiments.fidelity import BLURRED, OBJECTS, SHARP, Fidelity
from pps_vision.recordings.open import open_recording
from rendering.fidelity import Fidelity as Drawn


def test_a_finer_scale_is_nearer_to_the_ray_cast_image_and_slower() -> None:
    scales = {"1": Drawn(), "1.5": Drawn(scale=1.5), "2": Drawn(scale=2)}
    measured = Fidelity().images("marker", (0,), scales)["marker"]
    errors = [measured[name]["object_error"][0] for name in scales]
    assert errors == sorted(errors, reverse=True)
    assert 1 < errors[-1] < errors[0] < 6  # grey levels
    assert measured["1"]["ms"][1] < measured["2"]["ms"][1]


def test_charts_and_table_show_every_way_to_draw() -> None:
    cell = {"ms": [1.0, 2.0, 3.0], "object_error": [2.0, 1.0, 3.0], "rim_error": [2.0, 1.0, 3.0]}
    images = {name: dict.fromkeys(SHARP, cell) for name in OBJECTS} | {"moving ball": dict.fromkeys(BLURRED, cell)}
    tracked = {"error_mm": [0.5, 0.4, 0.6]}
    tracking = {name: dict.fromkeys(SHARP, tracked) for name in OBJECTS}
    study, numbers = Fidelity(), {"images": images, "tracking": tracking}
    assert [axis.get_title() for axis in study.chart(numbers).axes] == list(OBJECTS)
    tables = study.tables(numbers)
    assert [row[0] for row in tables[""].rows] == list(SHARP)
    assert [row[0] for row in tables["blur"].rows] == list(BLURRED)


def test_render_draws_at_the_scale_it_is_asked_for(tmp_path: Path) -> None:
    fine, usual = (RenderParams("ball", "circle", tmp_path / str(k), seconds=0.1, seed=3, scale=k) for k in (2.0, 1.0))
    for render in (fine, usual):
        record(render)
    one, other = (open_recording(render.out) for render in (fine, usual))
    assert np.array_equal(one.truth[0].position, other.truth[0].position)
    error = np.sqrt(np.mean((next(iter(one)).left.astype(float) - next(iter(other)).left) ** 2))
    assert 0.5 < error < 9  # grey levels
    with pytest.raises(ValueError, match=r"expected scale 0\.5–2"):
        record(RenderParams("ball", "circle", tmp_path / "none", scale=3.0))
    assert not (tmp_path / "none").exists()
