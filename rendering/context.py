"""OpenGL without a window: a context on EGL, on the first device that gives one."""

import ctypes
from typing import Any

try:
    from OpenGL import EGL, GL
    from OpenGL.EGL.EXT.device_enumeration import eglQueryDevicesEXT
    from OpenGL.EGL.EXT.platform_base import eglGetPlatformDisplayEXT
    from OpenGL.EGL.EXT.platform_device import EGL_PLATFORM_DEVICE_EXT
    from OpenGL.GL import shaders
except (ImportError, AttributeError, OSError) as error:
    raise ImportError(f"rendering needs OpenGL on EGL ({error}); install Debian's libegl1 and libgl1") from error

__all__ = ["GL", "Context", "shaders"]  # nobody else imports OpenGL: its absence is explained here

_MOST_DEVICES = 16
_CONFIG = (EGL.EGL_SURFACE_TYPE, EGL.EGL_PBUFFER_BIT, EGL.EGL_RENDERABLE_TYPE, EGL.EGL_OPENGL_BIT, EGL.EGL_NONE)
_VERSION = (
    *(EGL.EGL_CONTEXT_MAJOR_VERSION, 3, EGL.EGL_CONTEXT_MINOR_VERSION, 3),
    *(EGL.EGL_CONTEXT_OPENGL_PROFILE_MASK, EGL.EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL.EGL_NONE),
)


class Context:
    """Current from its creation on; OSError where no device gives one."""

    def __init__(self) -> None:
        devices, count = (EGL.EGLDeviceEXT * _MOST_DEVICES)(), EGL.EGLint()
        eglQueryDevicesEXT(_MOST_DEVICES, devices, count)
        reasons = []
        for device in devices[: count.value]:
            self._display = eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, device, None)
            try:
                self._context = self._begin()
                return
            except EGL.EGLError as error:
                reasons.append(f"EGL error {error.err}")
        why = ", ".join(reasons) or "install a driver, Debian's libegl1 and libgl1"
        raise OSError(f"none of {count.value} EGL devices gives an OpenGL 3.3 context: {why}")

    def _begin(self) -> Any:
        EGL.eglInitialize(self._display, None, None)
        config, found = (EGL.EGLConfig * 1)(), EGL.EGLint()
        EGL.eglChooseConfig(self._display, (ctypes.c_int32 * len(_CONFIG))(*_CONFIG), config, 1, found)
        EGL.eglBindAPI(EGL.EGL_OPENGL_API)
        version = (ctypes.c_int32 * len(_VERSION))(*_VERSION)
        context = EGL.eglCreateContext(self._display, config[0], EGL.EGL_NO_CONTEXT, version)
        EGL.eglMakeCurrent(self._display, EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE, context)
        return context

    def delete(self) -> None:
        """Give it back, with all that was made in it."""
        EGL.eglMakeCurrent(self._display, EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE, EGL.EGL_NO_CONTEXT)
        EGL.eglDestroyContext(self._display, self._context)
        EGL.eglTerminate(self._display)
