"""Settings that must stand before the packages are imported."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
sys.path.insert(0, str(Path(__file__).parent))  # `from data import shared_data` in every mirrored folder


@pytest.fixture(autouse=True)
def _no_figure_stays_open() -> Iterator[None]:
    """Charts that a test drew and nobody saved."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
