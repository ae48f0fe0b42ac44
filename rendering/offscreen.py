"""The process's off-screen renderer: draws meshes as a lens sees them, and reads only what is asked for."""

import atexit
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import move_points, rotation_to, transform
from pps_vision.types import Array, Image
from rendering.context import GL, Context, shaders
from rendering.fidelity import Fidelity
from rendering.lens import Lens
from rendering.meshes import Mesh

_NEAR_M, _FAR_M = 0.02, 8.0
LAMPS = ((0.474, 0.237, 0.848), (0.10, -0.81, 0.58), (-0.72, 0.45, 0.53))  # root frame, unit: key, fill, opposite
STRENGTHS = (0.38, 0.16, 0.12)
_SHADOW_MAP = 1024  # texels a side
_SHADERS = Path(__file__).parent / "shaders"
_DEPTH_ONLY = Fidelity(multisample=False, lights=0)


@dataclass(eq=False)
class Node:
    """A mesh, where it is, and whether light stops at it."""

    mesh: Mesh
    T_root_mesh: Array = field(default_factory=lambda: np.eye(4))
    casts_shadow: bool = True

    @property
    def box_root(self) -> Array:
        """(8, 3) corners of the box around it."""
        low, high = self.mesh.bounds
        corners = [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        return move_points(self.T_root_mesh, corners)


class Offscreen:
    """Draws nodes into framebuffers on the graphics side."""

    def __init__(self) -> None:
        self._context = Context()
        self._programs: dict[tuple[object, ...], Any] = {}
        self._framebuffers: dict[tuple[int, int, int], int] = {}
        self._shadow: tuple[int, int] | None = None  # framebuffer, texture
        self._T_lamp_root: Array = np.eye(4)
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glFrontFace(GL.GL_CW)  # the image's rows run downward

    def set_atlas(self, atlas: Image) -> None:
        """The picture (h, w, 3) that textured meshes are painted with."""
        GL.glActiveTexture(GL.GL_TEXTURE0)
        GL.glBindTexture(GL.GL_TEXTURE_2D, GL.glGenTextures(1))
        height, width = atlas.shape[:2]
        GL.glTexImage2D(
            GL.GL_TEXTURE_2D,
            0,
            GL.GL_RGB8,
            width,
            height,
            0,
            GL.GL_RGB,
            GL.GL_UNSIGNED_BYTE,
            np.ascontiguousarray(atlas),
        )
        GL.glGenerateMipmap(GL.GL_TEXTURE_2D)
        GL.glTexParameteri(GL.GL_TEXTURE_2D, GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR_MIPMAP_NEAREST)

    def cast_shadows(self, nodes: Sequence[Node]) -> None:
        """Draw what the key lamp sees; it stays until the next call."""
        casters = [node for node in nodes if node.casts_shadow]
        self._T_lamp_root = _lamp_over(casters)
        self._bind_shadow_map()
        GL.glClear(GL.GL_DEPTH_BUFFER_BIT)
        program = self._program("shadow")
        GL.glUniformMatrix4fv(program["T_lamp_root"], 1, True, self._T_lamp_root.astype(np.float32))
        GL.glDisable(GL.GL_CULL_FACE)
        GL.glEnable(GL.GL_POLYGON_OFFSET_FILL)
        GL.glPolygonOffset(2.0, 4.0)  # else surfaces shade themselves
        for node in casters:
            GL.glUniformMatrix4fv(program["T_root_mesh"], 1, True, node.T_root_mesh.astype(np.float32))
            node.mesh.draw()
        GL.glDisable(GL.GL_POLYGON_OFFSET_FILL)

    def color(self, nodes: Sequence[Node], lens: Lens, view: View, fidelity: Fidelity, offset_px: Array) -> Image:
        """(height, width, 3) RGB of the nodes, sampled `offset_px` (2,) from the pixels' centres."""
        width, height = (fidelity.supersample * n for n in (lens.camera.width, lens.camera.height))
        plain = self._framebuffer(width, height, 0)
        self._draw(nodes, lens, view, fidelity, offset_px, self._framebuffer(width, height, 4 * fidelity.multisample))
        if fidelity.multisample:
            GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, plain)
            GL.glBlitFramebuffer(0, 0, width, height, 0, 0, width, height, GL.GL_COLOR_BUFFER_BIT, GL.GL_NEAREST)
            GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, plain)
        rgba = np.empty((height, width, 4), np.uint8)  # four bytes a pixel: Mesa copies them as they lie
        GL.glReadPixels(0, 0, width, height, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, rgba)
        if fidelity.supersample > 1:
            rgba = np.asarray(cv2.resize(rgba, (lens.camera.width, lens.camera.height), interpolation=cv2.INTER_AREA))
        return np.asarray(cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB), np.uint8)

    def depth_at(self, nodes: Sequence[Node], lens: Lens, view: View, u: int, v: int) -> float:
        """Distance (m) along the optical axis of what pixel (u, v) shows; the far plane's where nothing is."""
        GL.glEnable(GL.GL_SCISSOR_TEST)  # nothing but that pixel is drawn
        GL.glScissor(u, v, 1, 1)
        target = self._framebuffer(lens.camera.width, lens.camera.height, 0)
        self._draw(nodes, lens, view, _DEPTH_ONLY, np.zeros(2), target)
        GL.glDisable(GL.GL_SCISSOR_TEST)
        value = GL.glReadPixels(u, v, 1, 1, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT)
        return float(_NEAR_M * _FAR_M / (_FAR_M - np.ravel(value)[0] * (_FAR_M - _NEAR_M)))

    def _draw(
        self, nodes: Sequence[Node], lens: Lens, view: View, fidelity: Fidelity, offset_px: Array, target: int
    ) -> None:
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, target)
        GL.glViewport(0, 0, fidelity.supersample * lens.camera.width, fidelity.supersample * lens.camera.height)
        GL.glClear(GL.GL_COLOR_BUFFER_BIT | GL.GL_DEPTH_BUFFER_BIT)
        seen = lens.uniform(offset_px), view.T_camera_root.astype(np.float32)
        for textured in (False, True):  # the room last: what stands before it need not be painted twice
            some = [node for node in nodes if node.mesh.textured == textured]
            if some:
                (GL.glDisable if textured else GL.glEnable)(GL.GL_CULL_FACE)
                self._draw_some(some, self._program("scene", textured, fidelity.lights, fidelity.shadows), seen)

    def _draw_some(
        self, nodes: list[Node], program: Any, seen: tuple[NDArray[np.float32], NDArray[np.float32]]
    ) -> None:
        GL.glUniform1fv(program["lens"], 10, seen[0])
        GL.glUniformMatrix4fv(program["T_camera_root"], 1, True, seen[1])
        GL.glUniformMatrix4fv(program["T_lamp_root"], 1, True, self._T_lamp_root.astype(np.float32))
        for node in nodes:
            GL.glUniformMatrix4fv(program["T_root_mesh"], 1, True, node.T_root_mesh.astype(np.float32))
            node.mesh.draw()

    def _program(self, name: str, textured: bool = False, lights: int = 0, shadows: bool = False) -> dict[str, int]:
        """Compile on first use, and put to use; where its uniforms are."""
        key = name, textured, lights, shadows
        if key not in self._programs:
            switches = _switches(textured, lights, shadows)
            stages = [
                shaders.compileShader(
                    (_SHADERS / f"{name}.{stage}").read_text().replace("core\n", f"core\n{switches}", 1), kind
                )
                for stage, kind in (("vert", GL.GL_VERTEX_SHADER), ("frag", GL.GL_FRAGMENT_SHADER))
            ]
            program = shaders.compileProgram(*stages, validate=False)
            names = ("lens", "planes", "T_camera_root", "T_lamp_root", "T_root_mesh", "atlas", "shadow_map")
            where = {uniform: GL.glGetUniformLocation(program, uniform) for uniform in names}
            GL.glUseProgram(program)
            GL.glUniform2f(where["planes"], _NEAR_M, _FAR_M)
            GL.glUniform1i(where["atlas"], 0)
            GL.glUniform1i(where["shadow_map"], 1)
            self._programs[key] = program, where
        program, where = self._programs[key]
        GL.glUseProgram(program)
        return where

    def _framebuffer(self, width: int, height: int, samples: int) -> int:
        """A colour and a depth image of a size; the same one for the same size."""
        key = width, height, samples
        if key not in self._framebuffers:
            framebuffer = GL.glGenFramebuffers(1)
            GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, framebuffer)
            for where, what in (
                (GL.GL_COLOR_ATTACHMENT0, GL.GL_RGBA8),
                (GL.GL_DEPTH_ATTACHMENT, GL.GL_DEPTH_COMPONENT24),
            ):
                buffer = GL.glGenRenderbuffers(1)
                GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
                GL.glRenderbufferStorageMultisample(GL.GL_RENDERBUFFER, samples, what, width, height)
                GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, where, GL.GL_RENDERBUFFER, buffer)
            self._framebuffers[key] = framebuffer
        return self._framebuffers[key]

    def _bind_shadow_map(self) -> None:
        if self._shadow is None:
            texture, framebuffer = GL.glGenTextures(1), GL.glGenFramebuffers(1)
            GL.glActiveTexture(GL.GL_TEXTURE1)
            GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
            size, depth = _SHADOW_MAP, GL.GL_DEPTH_COMPONENT
            GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, GL.GL_DEPTH_COMPONENT24, size, size, 0, depth, GL.GL_FLOAT, None)
            for name, value in (
                (GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR),
                (GL.GL_TEXTURE_MAG_FILTER, GL.GL_LINEAR),
                (GL.GL_TEXTURE_COMPARE_MODE, GL.GL_COMPARE_REF_TO_TEXTURE),
                (GL.GL_TEXTURE_WRAP_S, GL.GL_CLAMP_TO_BORDER),
                (GL.GL_TEXTURE_WRAP_T, GL.GL_CLAMP_TO_BORDER),
            ):
                GL.glTexParameteri(GL.GL_TEXTURE_2D, name, value)
            GL.glTexParameterfv(GL.GL_TEXTURE_2D, GL.GL_TEXTURE_BORDER_COLOR, np.ones(4, np.float32))  # lit
            GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, framebuffer)
            GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, GL.GL_DEPTH_ATTACHMENT, GL.GL_TEXTURE_2D, texture, 0)
            GL.glDrawBuffer(GL.GL_NONE)
            self._shadow = framebuffer, texture
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._shadow[0])
        GL.glViewport(0, 0, _SHADOW_MAP, _SHADOW_MAP)

    def delete(self) -> None:
        """Give everything back; nothing can be drawn afterwards."""
        self._context.delete()


def _lamp_over(nodes: Sequence[Node]) -> Array:
    """`T_lamp_root` to the unit cube that just holds the nodes, the key lamp looking along its third axis."""
    R = rotation_to(-np.array(LAMPS[0])).T
    boxes = np.concatenate([node.box_root for node in nodes]) @ R.T
    low, high = boxes.min(axis=0), boxes.max(axis=0)
    scale = 1 / (high - low)
    return transform(scale[:, None] * R, -low * scale)


def ambient_light(lights: int) -> float:
    """The light from everywhere beside so many lamps: the same in all, in the mean."""
    return 0.685 if lights == 0 else 0.62 - 0.25 * sum(STRENGTHS[1:lights])


def _switches(textured: bool, lights: int, shadows: bool) -> str:
    """What the shaders are compiled for."""
    lamps = ", ".join(f"vec3{lamp}" for lamp in LAMPS[:lights])
    strengths = ", ".join(map(str, STRENGTHS[:lights]))
    return (
        f"#define N_LAMPS {lights}\n#define LAMPS {lamps}\n#define STRENGTHS {strengths}\n"
        f"#define AMBIENT {ambient_light(lights)}\n" + "#define TEXTURED\n" * textured + "#define SHADOWS\n" * shadows
    )


@cache
def offscreen() -> Offscreen:
    """The process's renderer: creating one takes time, and more than one gains nothing."""
    screen = Offscreen()
    atexit.register(screen.delete)  # while PyOpenGL still stands; its own finaliser comes too late
    return screen
