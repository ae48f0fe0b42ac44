"""The state of a scene at other times, and which boxes reach into a view."""

import numpy as np
import pytest

from rendering.scene import PropPose, SceneState


def test_what_moves_is_elsewhere_later_and_earlier():
    x, y, z = np.eye(3)
    state = SceneState(np.array([0.1, 0.2]), x, 2 * y, np.array([1.0, -2.0]), props=(None, PropPose(y, z, np.eye(3))))
    for dt_s in (0.5, -0.5):
        moved = state.moved(dt_s)
        assert moved.q_rad == pytest.approx([0.1 + dt_s, 0.2 - 2 * dt_s])
        assert moved.position == pytest.approx(x + 2 * dt_s * y)
        absent, prop = moved.props
        assert absent is None
        assert prop is not None
        assert prop.position == pytest.approx(y + dt_s * z)
        assert prop.rotation is not None
    still = SceneState(np.array([0.1]), x, props=(PropPose(y),)).moved(1.0)
    assert still.q_rad.tolist() == [0.1]
    assert still.position == pytest.approx(x)
    assert still.props[0] is not None
    assert still.props[0].position == pytest.approx(y)
    assert SceneState(np.array([0.1])).moved(1.0).position is None
