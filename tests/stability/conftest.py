"""The ray-cast scenes of the tracker's tests."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "tracking")]  # `from raycast import …`
