"""The table that `render --max-image-error` chooses from, measured again; and the chart of what is measured."""

from contextlib import ExitStack
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np
import pytest

from pps_vision.app.render import Render
from pps_vision.experiments.fidelity import Fidelity
from pps_vision.experiments.fidelity_images import compare, draws_of
from pps_vision.experiments.pyrender_peer import PyrenderPeer, is_installed
from pps_vision.recordings.yarp import open_yarp
from pps_vision.types import Array, Image
from rendering.fidelity import MEASURED
from rendering.fidelity import Fidelity as Drawn
from rendering.sensor import Sensor

QUICK = {str(k): MEASURED[k].fidelity for k in (0, 1, 2)}
FINE = Drawn(supersample=4)  # nearly the reference, and much cheaper


def test_the_table_says_what_is_measured() -> None:
    scenes = [next(Fidelity().scenes("marker", 0, 1.0))]
    measured = compare("marker", scenes, QUICK, FINE, Sensor())
    for name, result in measured.items():
        assert result["error"] == pytest.approx(MEASURED[int(name)].error_levels, rel=0.2)
    assert measured["0"]["median_ms"] < measured["2"]["median_ms"]


def test_a_way_to_draw_compared_with_itself_has_no_error() -> None:
    scenes = [next(Fidelity().scenes("ball", 0, 1.0))]
    same = compare("ball", scenes, {"same": QUICK["1"]}, QUICK["1"], Sensor())["same"]
    assert same["error"] == same["rim_error"] == same["whole_error"] == 0
    assert same["ssim"] == pytest.approx(1)


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


@pytest.mark.skipif(not is_installed(), reason="pyrender is not installed (extra: bench)")
def test_pyrender_draws_the_same_scene_as_we_do_and_is_timed_in_its_own_process() -> None:
    """Same places, paint and light: within the ball every pixel, its centre, and the walls in the mean."""
    t, state = next(Fidelity().scenes("ball", 0, 1.0))
    with ExitStack() as stack:
        ours, *_ = draws_of(stack, "ball", {"ours": Drawn(supersample=2)}, {}, Sensor())["ours"](state, t)
    with PyrenderPeer("ball", 2.0) as peer:
        began = perf_counter()
        theirs, first_ms, _ = peer.timed_render(state, t)
        again, ms, cpu_ms = peer.timed_render(state, t)
        assert 0 < ms < first_ms < 1000 * (perf_counter() - began)
        assert cpu_ms > 1
        assert np.array_equal(theirs.left, again.left)
    with pytest.raises(OSError, match="pyrender"):
        peer.timed_render(state, t)
    for one, other in ((ours.left, theirs.left), (ours.right, theirs.right)):
        assert np.abs(one.astype(float) - other).mean() < 3
        red, red_there = _redness(one), _redness(other)
        assert (red > 50).sum() > 500
        assert np.allclose(_middle(red), _middle(red_there), atol=0.05)
        inside = cv2.erode((red > 50).astype(np.uint8), np.ones((9, 9))) > 0
        assert np.abs(one[inside].astype(float) - other[inside]).max() < 4


def _redness(image: Image) -> Array:
    """How much redder than anything in the room each pixel is."""
    red, green, blue = np.moveaxis(image.astype(float), -1, 0)
    return np.clip(red - 2 * np.maximum(green, blue), 0, None)


def _middle(weight: Array) -> Array:
    v, u = np.indices(weight.shape)
    return np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()
