"""Settings that must stand before the packages are imported."""

import os
import sys
from pathlib import Path

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
sys.path.insert(0, str(Path(__file__).parent))  # `from data import shared_data` in every mirrored folder
