"""What the filter chart rests on: baselines that compute the same, flights read right, errors that are the errors."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pps_vision.experiments.baselines.filters import ConstantGain, FilterPyFilter, OpenCVFilter
from pps_vision.experiments.filter import (
    Filter,
    Measurements,
    _smoothed,
    errors,
    flights,
    methods,
)
from pps_vision.experiments.study import median, rms
from tracking import kalman

STD = np.array([1e-4, 1e-4, 3e-4])


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def _approach(rng: np.random.Generator, noise: float = 1.0) -> Measurements:
    """2 s at 10 cm/s towards the origin, which the surface (radius 3 cm) touches at the end."""
    stamps, v = 0.05 * np.arange(41), np.array([-0.08, 0.06, 0.0])
    path = -v * (2.0 - stamps)[:, None] + 0.03 * np.array([0.8, -0.6, 0.0])
    return Measurements(
        stamps_s=stamps,
        positions=path + noise * STD * rng.standard_normal((41, 3)),
        covs=np.tile(np.diag(STD**2), (41, 1, 1)),
        path=path,
        velocity=np.tile(v, (41, 1)),
        distance_m=0.4,
        counts=np.arange(41) >= 10,
        touched=np.zeros(3),
        ttc_s=2.0 - stamps,
        white_share=1.0,
        radius_m=0.03,
    )


def test_baselines_compute_what_ours_does(rng: np.random.Generator) -> None:
    data = _approach(rng)
    params = replace(data.params(), adaptation_rate=0)  # theirs does not follow the innovations
    belief = data.first(params)
    theirs = OpenCVFilter(params, belief), FilterPyFilter(params, belief)
    for stamp_s, z, cov in data.later():
        belief = kalman.update(params, kalman.predict(params, belief, stamp_s), z, cov)
        for one in theirs:
            np.testing.assert_allclose(one.step(stamp_s, z, cov), belief.mean, atol=1e-9)


def test_a_constant_gain_ends_where_the_full_filter_settles(rng: np.random.Generator) -> None:
    """The same variance on all axes and equal steps: after a while there is no difference."""
    data = replace(_approach(rng), covs=np.tile(1e-8 * np.eye(3), (41, 1, 1)))
    params = replace(data.params(), adaptation_rate=0)
    belief = data.first(params)
    steady = ConstantGain(params, belief, 1e-8, 0.05)
    for stamp_s, z, cov in data.later():
        belief = kalman.update(params, kalman.predict(params, belief, stamp_s), z, cov)
        last = steady.step(stamp_s, z, cov)
    np.testing.assert_allclose(last, belief.mean, atol=1e-4)


def test_smoothing_helps_and_order_has_its_price(rng: np.random.Generator) -> None:
    data = [_approach(rng) for _ in range(3)]
    found = {name: [method(one, 0) for one in data] for name, method in methods().items()}

    def error(name: str, metric: str) -> float:
        return rms(np.concatenate([np.asarray(values[metric]) for values in found[name]]))

    raw = 1000 * float(np.linalg.norm(STD))
    for order in (2, 3):
        assert error(f"order {order}, RTS", "velocity_mm_s") < error(f"order {order}", "velocity_mm_s")
        assert error(f"order {order}", "position_mm") < raw
    assert error("order 2", "velocity_mm_s") < error("order 4", "velocity_mm_s")
    assert "velocity_mm_s" not in found["order 1"][0]
    assert error("filterpy", "position_mm") == pytest.approx(error("cv2", "position_mm"))
    exact = methods()["order 3"](_approach(rng, noise=0.0), 0)
    assert median(np.asarray(exact["ttc_percent"])) < 0.1


def test_errors_are_those_of_the_states(rng: np.random.Generator) -> None:
    data = _approach(rng)
    off = np.array([[0.003, 0, 0], [0, 0.02, 0]])
    states = [np.stack([p, v]) + off for p, v in zip(data.path, data.velocity, strict=True)]
    found = errors(data, states)
    np.testing.assert_allclose(found["position_mm"], 3)
    np.testing.assert_allclose(found["velocity_mm_s"], 20)
    assert len(found["position_mm"]) == 31


def _write_flight(folder: Path) -> np.ndarray:
    """A ball in the air (25 Hz) and its images in two cameras, in tt3d's form."""
    stamps, state, path = 0.04 * np.arange(12), np.array([0.1, 1.2, 0.6, 0.2, -5.0, 1.5]), []
    for k in range(12 * 400):
        if k % 400 == 0:
            path.append(state[:3].copy())
        drag = -0.13 * np.linalg.norm(state[3:]) * state[3:]
        state = state + 1e-4 * np.concatenate([state[3:], drag - [0, 0, 9.81]])
    path = np.array(path)
    for name, rvec, tvec in (
        ("side", [1.36, -1.38, 1.14], [0, 0.4, 4.5]),
        ("oblique", [0.96, -1.78, 1.52], [0.1, 0, 4.1]),
    ):
        (folder / name).mkdir(parents=True)
        (folder / f"{name}.yaml").write_text(f"rvec: {rvec}\ntvec: {tvec}\nf: 1200.0\nw: 1280\nh: 720\n")
        K = np.array([[1200, 0, 640], [0, 1200, 360], [0, 0, 1.0]])
        pixels = cv2.projectPoints(path, np.array(rvec), np.array(tvec, float), K, None)[0][:, 0]
        rows = np.column_stack([stamps, path, pixels, np.zeros((12, 2))])
        np.savetxt(folder / name / "001.csv", rows, delimiter=",", header="Timestamp,X,Y,Z,u,v,l,theta", comments="")
    return path


def test_flights_are_triangulated_from_their_images(tmp_path: Path) -> None:
    path = _write_flight(tmp_path / "tt3d")
    (flight,) = flights(tmp_path / "tt3d")
    np.testing.assert_allclose(flight.positions, path, atol=1e-6)
    fourth, second = _smoothed(4, flight, 0), _smoothed(2, flight, 0)
    assert rms(np.asarray(fourth["position_mm"])) < rms(np.asarray(second["position_mm"]))
    assert len(fourth["velocity_mm_s"]) == 0


def test_the_chart_has_a_panel_for_all_data_and_the_table_marks_what_misses_its_goal() -> None:
    numbers = {"ms": [1, 2, 3], "ratio": [1, 1, 1], "position_mm": [1, 1, 2], "velocity_mm_s": [1, 1, 2]}
    cells = {
        name: {method: numbers | {"ttc_percent": ttc} for method in methods()}
        for name, ttc in (("rendered", [1, 1, 1]), ("tt3d", [None, None, None]))
    }
    figure = Filter().chart({"cells": cells})
    assert [axis.get_title() for axis in figure.axes] == ["rendered", "tt3d"]
    assert len(Filter().tables({"cells": cells})["tt3d"].rows) == len(methods())
    for name in ("rendered", "tt3d"):
        cells[name]["order 4, RTS"] = cells[name]["order 4, RTS"] | {"position_mm": [12.2, 12, 13]}
    tables = Filter().tables({"cells": cells})
    of = {name: {row[0]: row[1] for row in tables[name].rows} for name in cells}
    assert of["tt3d"]["order 4, RTS"] == "**12.2 (12–13)**"
    assert of["tt3d"]["order 4"] == of["rendered"]["order 4"] == "1 (1–2)"
    assert of["rendered"]["order 4, RTS"] == "12.2 (12–13)"
