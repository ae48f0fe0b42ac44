"""Scene state → StereoFrame: rendered eye views in place of a robot's cameras."""

import os

# pyrender reads it when it is imported: draw off screen
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
