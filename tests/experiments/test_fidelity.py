"""The table that `render --max-image-error` chooses from, measured again; and the chart of what is measured."""

from pathlib import Path

import numpy as np
import pytest

from pps_vision.app.render import Render
from pps_vision.experiments.fidelity import Fidelity
from pps_vision.experiments.fidelity_images import compare
from pps_vision.recordings.yarp import open_yarp
from rendering.fidelity import MEASURED
from rendering.sensor import Sensor

QUICK = {str(k): MEASURED[k].fidelity for k in (0, 1, 2)}


def test_the_table_says_what_is_measured() -> None:
    scenes = [next(Fidelity().scenes("marker", 0, 1.0))]
    measured = compare("marker", scenes, QUICK, Sensor(), samples=3)
    for name, result in measured.items():
        assert result["error"] == pytest.approx(MEASURED[int(name)].error_levels, rel=0.2)
    assert measured["0"]["median_ms"] < measured["2"]["median_ms"]


def test_senseless_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="bench fidelity: --n 0"):
        Fidelity(n=0).run()


def test_render_draws_as_finely_as_it_is_asked_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    coarse, usual = (
        Render("ball", "circle", tmp_path / str(asked), seconds=0.1, seed=3, max_image_error=asked)
        for asked in (MEASURED[0].error_levels, None)
    )
    for render in (coarse, usual):
        render.run()
    assert str(MEASURED[0]) in capsys.readouterr().out
    one, other = (open_yarp(render.out) for render in (coarse, usual))
    assert np.array_equal(one.truth[0].position, other.truth[0].position)
    error = np.sqrt(np.mean((next(iter(one)).left.astype(float) - next(iter(other)).left) ** 2))
    assert 1 < error < 2 * MEASURED[0].error_levels
    with pytest.raises(ValueError, match=r"image error 0\.1 grey levels; expected"):
        Render("ball", "circle", tmp_path / "none", max_image_error=0.1).run()
    assert not (tmp_path / "none").exists()
