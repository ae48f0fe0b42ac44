"""Compiled functions where numba's cache cannot be written."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pps_vision

CODE = """
import numpy as np
from pps_vision.geometry.camera import Camera
pixel = Camera(320, 240, 300.0, 300.0, 159.5, 119.5).project(np.array([0.02, 0.01, 0.5]))
print(pps_vision.__file__, bool(np.allclose(pixel, [171.5, 125.5])))
"""


def test_without_a_writable_cache_it_compiles_in_memory_and_says_so_once(tmp_path):
    """A file in the place of every folder that numba would write to, since permissions do not bind the superuser."""
    source = Path(pps_vision.__file__).parent
    shutil.copytree(source, tmp_path / "pps_vision", ignore=shutil.ignore_patterns("__pycache__", "experiments"))
    for folder in (tmp_path / "pps_vision").rglob("*"):
        if folder.is_dir():
            (folder / "__pycache__").touch()
    (tmp_path / "pps_vision" / "__pycache__").touch()
    (tmp_path / "home").touch()
    home = {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": str(tmp_path / "home"), "PYTHONPATH": str(tmp_path)}
    env = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | home
    code = "import pps_vision\n" + CODE
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, cwd=tmp_path)
    assert process.stdout.split() == [str(tmp_path / "pps_vision" / "__init__.py"), "True"], process.stderr
    assert process.stderr.count("functions are compiled anew at every start") == 1
