"""The state of a scene at other times, and which boxes reach into a view."""

import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import transform
from rendering.scene import Placed, SceneState, _reach_into


def test_what_moves_is_elsewhere_later_and_earlier() -> None:
    x, y, z = np.eye(3)
    state = SceneState(np.array([0.1, 0.2]), x, 2 * y, np.array([1.0, -2.0]), props=(None, Placed(y, z, np.eye(3))))
    for dt_s in (0.5, -0.5):
        moved = state.moved(dt_s)
        assert moved.q_rad == pytest.approx([0.1 + dt_s, 0.2 - 2 * dt_s])
        assert moved.position == pytest.approx(x + 2 * dt_s * y)
        absent, prop = moved.props
        assert absent is None
        assert prop is not None
        assert prop.position == pytest.approx(y + dt_s * z)
        assert prop.rotation is not None
    still = SceneState(np.array([0.1]), x, props=(Placed(y),)).moved(1.0)
    assert still.q_rad.tolist() == [0.1]
    assert still.position == pytest.approx(x)
    assert still.props[0] is not None
    assert still.props[0].position == pytest.approx(y)
    assert SceneState(np.array([0.1])).moved(1.0).position is None


@pytest.mark.parametrize(
    ("center", "half", "expected"),
    [
        ((0.0, 0.0, 1.0), 0.1, True),
        ((-1.0, 0.0, 1.0), 0.1, False),
        ((1.0, 0.0, 1.0), 0.1, False),
        ((0.0, -1.0, 1.0), 0.1, False),
        ((0.0, 1.0, 1.0), 0.1, False),
        ((0.0, 0.0, -1.0), 0.1, False),
        ((-0.5, 0.4, 1.0), 0.1, True),  # across a corner of the view
        ((0.62, 0.0, 1.0), 0.1, True),  # its far edge only
        ((0.68, 0.0, 1.0), 0.1, False),
        ((0.0, 0.52, 1.0), 0.1, True),
        ((0.0, 0.56, 1.0), 0.1, False),
        ((0.0, 0.0, 0.0), 2.0, True),  # the eye is in it
    ],
)
def test_a_box_is_drawn_if_it_reaches_into_the_view(
    center: tuple[float, float, float], half: float, expected: bool
) -> None:
    """Of an eye turned and moved, by the box's corners in its frame: x/z up to ±0.5, y/z up to ±0.4."""
    pose = transform(np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]), (0.3, -0.2, 0.1))
    corners = np.array(center) + half * np.array(list(np.ndindex(2, 2, 2))) * 2 - half
    box = np.array([corners @ pose[:3, :3].T + pose[:3, 3]])
    view = View(Camera(32, 24, 30.0, 30.0, 15.5, 11.5), pose)
    assert _reach_into(view, (-0.5, -0.4, 0.5, 0.4), box).tolist() == [expected]
