"""One off-screen OpenGL renderer for the process: pyrender on EGL, reading only what is asked for."""

import atexit
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pps_vision.types import Image

try:
    import pyrender
    from OpenGL import GL
    from pyrender.platforms.egl import EGLPlatform
    from pyrender.shader_program import ShaderProgramCache
except (ImportError, AttributeError, OSError) as error:
    raise ImportError(f"rendering needs OpenGL on EGL ({error}); install Debian's libegl1 and libgl1") from error

__all__ = ["Offscreen", "offscreen", "pyrender"]  # nobody else imports pyrender: its absence is explained here

_FLAGS = pyrender.RenderFlags.FLAT | pyrender.RenderFlags.OFFSCREEN


class Offscreen:
    """Draws pyrender scenes into an image kept on the graphics side.

    pyrender's own `OffscreenRenderer` always takes four samples a pixel and always fetches and
    linearises the whole depth image; what is not asked for here is not paid for (more than half).
    """

    def __init__(self) -> None:
        self._platform = EGLPlatform(1, 1)
        self._platform.init_context()
        self._platform.make_current()
        self._renderer = pyrender.Renderer(1, 1)
        self._renderer._program_cache = ShaderProgramCache(shader_dir=str(Path(__file__).parent / "shaders"))
        self._renderer._read_main_framebuffer = lambda scene, flags: None

    def color(self, scene: Any, width: int, height: int, smooth: bool) -> Image:
        """The scene from its main camera, (height, width, 3) RGB; `smooth` edges take four samples a pixel."""
        (self._draw_multisampled if smooth else self._draw)(scene, width, height)
        rgba = np.empty((height, width, 4), np.uint8)  # four bytes a pixel: Mesa copies them as they lie
        GL.glReadPixels(0, 0, width, height, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, rgba)
        return np.asarray(cv2.flip(cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB), 0), np.uint8)

    def depth_at(self, scene: Any, width: int, height: int, u: int, v: int) -> float:
        """Distance (m) along the optical axis of what pixel (u, v) shows; the far plane's where nothing is."""
        self._draw(scene, width, height)
        value = GL.glReadPixels(u, height - 1 - v, 1, 1, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT)
        near, far = scene.main_camera_node.camera.znear, scene.main_camera_node.camera.zfar
        return float(near * far / (far - np.ravel(value)[0] * (far - near)))

    def _draw(self, scene: Any, width: int, height: int) -> None:
        """Draw straight into the framebuffer that is read."""
        renderer = self._renderer
        renderer.viewport_width, renderer.viewport_height = width, height
        renderer._configure_main_framebuffer()  # of this size, before its multisampled twin steps aside
        multisampled = renderer._main_fb_ms
        renderer._main_fb_ms = renderer._main_fb
        try:
            renderer.render(scene, _FLAGS)
        finally:
            renderer._main_fb_ms = multisampled
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, renderer._main_fb)

    def _draw_multisampled(self, scene: Any, width: int, height: int) -> None:
        """Draw with four samples a pixel and average them into the framebuffer that is read."""
        renderer = self._renderer
        renderer.viewport_width, renderer.viewport_height = width, height
        renderer.render(scene, _FLAGS)
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, renderer._main_fb_ms)
        GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, renderer._main_fb)
        GL.glBlitFramebuffer(0, 0, width, height, 0, 0, width, height, GL.GL_COLOR_BUFFER_BIT, GL.GL_NEAREST)
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, renderer._main_fb)

    def free(self) -> None:
        """Drop every mesh and texture from the graphics side; drawing again uploads them anew."""
        self._renderer._update_context(pyrender.Scene(), _FLAGS)

    def delete(self) -> None:
        """Give everything back; nothing can be drawn afterwards."""
        self._renderer.delete()
        self._platform.delete_context()


@cache
def offscreen() -> Offscreen:
    """The process's renderer: creating one takes 200 ms, and more than one gains nothing."""
    screen = Offscreen()
    atexit.register(screen.delete)  # while PyOpenGL still stands; its own finaliser comes too late
    return screen
