"""Scene state → StereoFrame: rendered eye views in place of a robot's cameras."""

import os

# pyrender and pyglet read these when they are imported: draw off screen; ask for no display, nor for X's libraries,
# which a bare Debian lacks
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
os.environ.setdefault("PYGLET_HEADLESS", "true")
