"""What the filter chart rests on: peers that compute the same, flights read right, errors that are the errors."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pps_vision.experiments import filter_methods as methods
from pps_vision.experiments.filter import Filter, compare, flight_filters, rendered_filters
from pps_vision.experiments.filter_scenes import Sequence, flights
from tracking.smoother import follow, smooth

STD = np.array([1e-4, 1e-4, 3e-4])


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def _approach(rng: np.random.Generator, noise: float = 1.0) -> Sequence:
    """2 s at 10 cm/s towards the origin, which the surface (radius 3 cm) touches at the end."""
    stamps, v = 0.05 * np.arange(41), np.array([-0.08, 0.06, 0.0])
    path = -v * (2.0 - stamps)[:, None] + 0.03 * np.array([0.8, -0.6, 0.0])
    return Sequence(
        name="approach",
        stamps_s=stamps,
        positions=path + noise * STD * rng.standard_normal((41, 3)),
        covs=np.tile(np.diag(STD**2), (41, 1, 1)),
        path=path,
        velocity=np.tile(v, (41, 1)),
        distance_m=0.4,
        jumped=np.zeros(41, bool),
        touched=np.zeros(3),
        ttc_s=2.0 - stamps,
        white_share=1.0,
        radius_m=0.03,
    )


def test_peers_compute_what_ours_does(rng: np.random.Generator) -> None:
    sequence = _approach(rng)
    ours = methods.Ours(4, sequence)
    ours.params = params = replace(ours.params, adaptation_rate=0)  # theirs does not follow the innovations
    begin = ours.belief
    filters = ours, methods.OpenCV(sequence), methods.FilterPy(sequence)
    for stamp_s, z, cov in zip(sequence.stamps_s[1:], sequence.positions[1:], sequence.covs[1:], strict=True):
        own, *peers = (one.step(float(stamp_s), z, cov) for one in filters)
        for theirs in peers:
            np.testing.assert_allclose(theirs, own, atol=1e-9)
    back = smooth(follow(params, begin, methods.measured(sequence)))
    np.testing.assert_allclose(methods.smoothed_filterpy(sequence), [one.mean for one in back], atol=1e-9)


def test_a_constant_gain_ends_where_the_full_filter_settles(rng: np.random.Generator) -> None:
    """The same variance on all axes and equal steps: after a while there is no difference."""
    sequence = _approach(rng)
    even = replace(sequence, covs=np.tile(1e-8 * np.eye(3), (41, 1, 1)))
    full, steady = methods.Ours(4, even), methods.Steady(even)
    full.params = replace(full.params, adaptation_rate=0)
    for stamp_s, z, cov in zip(even.stamps_s[1:], even.positions[1:], even.covs[1:], strict=True):
        ours, theirs = full.step(float(stamp_s), z, cov), steady.step(float(stamp_s), z, cov)
    np.testing.assert_allclose(theirs, ours, atol=1e-4)


def test_looking_back_helps_and_order_has_its_price(rng: np.random.Generator) -> None:
    numbers = compare([_approach(rng) for _ in range(3)], *rendered_filters(), settled=10)
    raw = numbers["as measured"]["position_rms_mm"]
    assert raw == pytest.approx(1000 * np.linalg.norm(STD), rel=0.1)
    for order in (2, 3):
        assert numbers[f"order {order}, RTS"]["velocity_rms_mm_s"] < numbers[f"order {order}"]["velocity_rms_mm_s"]
        assert numbers[f"order {order}"]["position_rms_mm"] < raw
    assert numbers["order 2"]["velocity_rms_mm_s"] < numbers["order 4"]["velocity_rms_mm_s"]
    assert numbers["order 3"]["ttc_median_percent"] < 5
    exact = compare([_approach(rng, noise=0.0)], *rendered_filters(), settled=10)
    assert exact["order 3"]["ttc_median_percent"] < 0.1
    figures = Filter().chart({"rendered": numbers, "tt3d": "skipped"})
    assert [len(figure.axes) for figure in figures.values()] == [3, 3]


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
    numbers = compare([flight], *flight_filters(), settled=0)
    assert numbers["flight, RTS"]["position_rms_mm"] < numbers["order 2, RTS"]["position_rms_mm"]


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="--n 0"):
        Filter(n=0).run()
