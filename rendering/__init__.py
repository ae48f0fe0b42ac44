"""Scene truth → StereoFrame: what stands for the world when no robot is there."""

import os

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
os.environ.setdefault("PYGLET_HEADLESS", "true")  # else pyrender's import asks for an X library (FACTS §7)
