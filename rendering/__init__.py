"""Scene truth → StereoFrame: what stands for the world when no robot is there."""

import os

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
