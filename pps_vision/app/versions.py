"""The versions that a result depends on."""

import platform
from importlib.metadata import version

PACKAGES = ("numpy", "scipy", "numba", "opencv-contrib-python-headless", "av")
"""What tracking computes with."""


def versions() -> dict[str, str]:
    """Version of this package, of Python, and of the packages that tracking computes with."""
    return {name: version(name) for name in ("pps-vision", *PACKAGES)} | {"python": platform.python_version()}
