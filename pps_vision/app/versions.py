"""The versions that a result depends on."""

import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path


def versions() -> dict[str, str]:
    """Version of this package, of Python, and of the packages that tracking computes with."""
    packages = ("pps-vision", "numpy", "scipy", "numba", "opencv-contrib-python-headless", "av")
    return {name: version(name) for name in packages} | {"python": platform.python_version()}


def machine(commit_name: str) -> dict[str, str]:
    """Machine, package versions and commit of a measurement."""
    file = Path("/proc/cpuinfo")
    lines = file.read_text().splitlines() if file.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    processor = models[0] if models else platform.processor() or platform.machine()
    packages = ("pps-vision", "numpy", "opencv-contrib-python-headless", "torch", "pin", "scikit-robot-pyrender")
    return {
        "processor": f"{processor}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
        "commit": commit_name,
    }


def commit() -> str:
    """The last commit that changed code (not tests), "-dirty" where it differs from it; unknown without a checkout."""
    root = Path(__file__).parents[2]
    try:
        git = ["git", "-C", str(root)]
        code = ["--", "*.py", ":!tests"]
        log = [*git, "log", "-1", "--format=%h", *code]
        last = subprocess.check_output(log, text=True, stderr=subprocess.DEVNULL)
        changed = subprocess.check_output([*git, "status", "--porcelain", *code], text=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return last.strip() + ("-dirty" if changed else "")
