"""Versions, machine and commit that results name."""

import os
import platform

import numpy as np
import scipy

from pps_vision.app import versions


def test_versions_are_those_of_the_packages_themselves():
    packages = versions.versions()
    expected = {"numpy": np.__version__, "scipy": scipy.__version__, "python": platform.python_version()}
    assert expected.items() <= packages.items()
    machine = versions.machine("abc1234")
    assert machine["commit"] == "abc1234"
    assert all(machine[key] == packages[key] for key in ("numpy", "python", "pps-vision"))
    assert machine["processor"].endswith(f", {os.cpu_count()} cores")
