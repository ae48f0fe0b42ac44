"""The renderer of a process: memory held and released, and the message where OpenGL is missing."""

import gc
import os
import subprocess
import sys

import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import transform
from pps_vision.types import Array
from rendering.eyes import Eyes
from rendering.renderer import Node, shared_renderer
from rendering.scene import SceneState
from rendering.shapes import sphere, surface_of
from rendering.stimuli import Stimulus, make_stimulus

PLACE = np.array([-0.36, -0.06, 0.12])


def turned(angle: float) -> Array:
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def uploaded_after_a_frame(eyes: Eyes, state: SceneState) -> int:
    eyes.render(state, 0.0)
    return shared_renderer().n_uploaded


def test_depth_is_the_distance_along_the_axis():
    node = Node(surface_of([sphere(0.1, (1, 0, 0), fineness=5)]), transform(translation=(0, 0, 0.5)))

    def depth(u: int, v: int) -> float:
        return shared_renderer().depth([node], View(Camera(1, 1, 100, 100, 50 - u, 40 - v), np.eye(4)))

    assert depth(50, 40) == pytest.approx(0.4, abs=5e-4)
    assert depth(0, 0) == np.inf
    # off the axis: the first root of |t·ray − center| = r, times the ray's z
    ray = np.array([10 / 100, 5 / 100, 1.0])
    b = ray @ [0, 0, 0.5]
    c = 0.25 - 0.01
    assert depth(60, 45) == pytest.approx((b - np.sqrt(b * b - ray @ ray * c)) / (ray @ ray), abs=1e-3)


def test_what_is_closed_or_forgotten_is_given_back(robot, rig, q):
    with Eyes(robot, rig, make_stimulus("ball")) as lasting:
        lasting.render(SceneState(q, PLACE), 0.0)
        uploaded = uploaded_after_a_frame(lasting, SceneState(q, PLACE))
        with Eyes(robot, rig, make_stimulus("octopus"), "hand") as closed:
            assert uploaded_after_a_frame(closed, SceneState(q, PLACE)) > uploaded
            closed.set_stimulus(make_stimulus("cube"))
            closed.render(SceneState(q, PLACE), 0.0)
        forgotten = Eyes(robot, rig, make_stimulus("cube"))
        forgotten.render(SceneState(q, PLACE), 0.0)
        del forgotten
        gc.collect()
        assert uploaded_after_a_frame(lasting, SceneState(q, PLACE)) == uploaded


def test_a_turned_body_is_lit_as_one_made_so(robot, rig, q):
    """And returns to the same bits when it turns back."""
    cube = make_stimulus("cube")
    parts = make_stimulus("cube").parts
    for part in parts:
        part.mesh.apply_transform(transform(turned(0.7)))
    painted = Stimulus("cube", cube.radius_m, parts)
    with Eyes(robot, rig, cube) as eyes:
        straight = eyes.render(SceneState(q, PLACE), 0.0).left
        rotated = eyes.render(SceneState(q, PLACE, rotation=turned(0.7)), 0.0).left
        again = eyes.render(SceneState(q, PLACE), 0.0).left
        eyes.set_stimulus(painted)
        expected = eyes.render(SceneState(q, PLACE), 0.0).left
    assert np.array_equal(straight, again)
    assert np.abs(rotated.astype(int) - straight).max() > 30
    assert np.abs(rotated.astype(int) - expected).max() <= 1


def test_after_an_error_the_next_image_is_as_if_there_had_been_none():
    """Uploads before an error do not show in later images."""
    renderer = shared_renderer()
    view = View(Camera(64, 48, 60, 60, 31.5, 23.5), np.eye(4))
    near, far_node = (Node(surface_of([sphere(0.1, (1, 0, 0))]), transform(translation=(0, 0, z))) for z in (0.5, 0.9))
    expected = renderer.color([far_node], view)
    broken = Node(far_node.surface)
    broken.T_root_node = np.full((4, 4), "x")
    with pytest.raises(TypeError):
        renderer.color([near, broken], view)
    assert np.array_equal(renderer.color([far_node], view), expected)
    renderer.release([near, far_node])


def test_missing_opengl_is_named_in_one_line():
    hide = """
import ctypes, ctypes.util
real_load, real_find = ctypes.CDLL, ctypes.util.find_library
def no_gl(name): return name is not None and any(lib in str(name) for lib in ("EGL", "libGL", "OpenGL"))
class CDLL(real_load):
    def __init__(self, name, *args, **kwargs):
        if no_gl(name): raise OSError(f"{name}: cannot open shared object file")
        super().__init__(name, *args, **kwargs)
ctypes.CDLL = ctypes.cdll._dlltype = CDLL
ctypes.util.find_library = lambda name: None if name in ("EGL", "GL", "OpenGL") else real_find(name)
from rendering.renderer import shared_renderer
shared_renderer()
"""
    run = subprocess.run([sys.executable, "-c", hide], capture_output=True, text=True)
    assert run.returncode != 0
    last = run.stderr.strip().splitlines()[-1]
    assert last.startswith("ImportError: rendering needs OpenGL")
    assert "install Debian's libegl1 and libgl1" in last


@pytest.mark.parametrize("environment", [{"__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent"}, {"EGL_DEVICE_ID": "77"}])
def test_a_driver_that_gives_no_context_is_named_in_one_line(environment):
    code = "from rendering.renderer import shared_renderer; shared_renderer()"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, **environment}
    )
    last = run.stderr.strip().splitlines()[-1]
    assert last.startswith("OSError: no OpenGL 4.1 context on EGL device")
    assert "libegl1 and libgl1" in last
