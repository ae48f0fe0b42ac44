"""The process's renderer: depth by geometry, and what it says where OpenGL is missing."""

import os
import subprocess
import sys

import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, View
from rendering.lens import Lens
from rendering.meshes import mesh_of
from rendering.offscreen import Node, offscreen
from rendering.shapes import sphere


def test_depth_is_the_distance_along_the_axis() -> None:
    camera = Camera(101, 81, 100, 100, 50, 40)
    lens, view = Lens(camera), View(camera, np.eye(4))
    node = Node(mesh_of([sphere(0.1, (1, 0, 0), fineness=5)], edge_m=0.1))
    node.T_root_mesh[2, 3] = 0.5
    assert offscreen().depth_at([node], lens, view, 50, 40) == pytest.approx(0.4, abs=5e-4)
    assert offscreen().depth_at([node], lens, view, 0, 0) == pytest.approx(8.0, rel=1e-3)
    # off the axis: the first root of |t·ray − center| = r, times the ray's z
    ray = np.array([10 / 100, 5 / 100, 1.0])
    b, c = ray @ [0, 0, 0.5], 0.25 - 0.01
    t = (b - np.sqrt(b * b - ray @ ray * c)) / (ray @ ray)
    assert offscreen().depth_at([node], lens, view, 60, 45) == pytest.approx(t, abs=1e-3)


def test_one_renderer_a_process() -> None:
    assert offscreen() is offscreen()


def test_missing_opengl_is_named_in_one_line() -> None:
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
import rendering.eyes
"""
    run = subprocess.run([sys.executable, "-c", hide], capture_output=True, text=True)
    assert run.returncode != 0
    last = run.stderr.strip().splitlines()[-1]
    assert last.startswith("ImportError: rendering needs OpenGL")
    assert "install Debian's libegl1 and libgl1" in last


@pytest.mark.parametrize(
    ("environment", "message"),
    [
        ({"__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent"}, "none of 0 EGL devices gives an OpenGL 3.3 context: install"),
        ({"MESA_GL_VERSION_OVERRIDE": "2.1"}, "gives an OpenGL 3.3 context: EGL error"),
    ],
)
def test_a_driver_that_gives_no_context_is_named_in_one_line(environment: dict[str, str], message: str) -> None:
    code = "from rendering.offscreen import offscreen; offscreen()"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, **environment}
    )
    assert run.stderr.strip().splitlines()[-1].startswith("OSError: none of")
    assert message in run.stderr


def test_the_process_ends_quietly() -> None:
    code = "from rendering.offscreen import offscreen; offscreen()"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout + run.stderr == ""
