"""Pinhole images of nodes, drawn by pyrender.

pyrender binds meshes to one OpenGL context, and deleting an `OffscreenRenderer` terminates the EGL display of all
others in the process.  So a process has one `Renderer`, `shared_renderer()`; each `Eyes` owns its nodes and releases
them.
"""

import atexit
import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import move_points, rotation_to, transform
from pps_vision.types import Array, Image
from rendering.fidelity import Lighting
from rendering.room import atlas, room_surface
from rendering.shapes import Surface

LAMPS = ((0.474, 0.237, 0.848), (0.10, -0.81, 0.58), (-0.72, 0.45, 0.53))  # root frame, unit: key, fill, opposite
STRENGTHS = (0.38, 0.16, 0.12)
AMBIENT = 0.55
_BELOW = 0.12  # ambient light lost on surfaces that face away from the key lamp
_NEAR_M = 0.02
_FAR_M = 8.0
_T_CAMERA_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenGL cameras look along −z, with y up
_GAMMA = 2.2  # of pyrender's shading
_BAKED_STEP = 1 / 512  # quantum of the rotation matrices that light is baked for: below 0.3 of 255 grey levels


@dataclass(eq=False)
class Node:
    """A surface and its pose."""

    surface: Surface
    T_root_node: Array = field(default_factory=lambda: np.eye(4))

    @property
    def box_root(self) -> Array:
        """(8, 3) corners of the box around it."""
        low, high = self.surface.bounds
        corners = [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        return move_points(self.T_root_node, corners)


class Renderer:
    """A pyrender scene and its off-screen renderer; keeps the meshes of nodes drawn before, until they are released."""

    def __init__(self) -> None:
        try:
            self._api: Any = import_module("pyrender")
        except (ImportError, AttributeError, OSError) as error:
            install = "install Debian's libegl1 and libgl1"
            raise ImportError(f"rendering needs OpenGL on EGL ({error}); {install}") from error
        try:
            self._screen = self._api.OffscreenRenderer(1, 1)
        except Exception as error:  # EGL errors, AssertionError or IndexError, depending on the missing library
            reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
            device = os.environ.get("EGL_DEVICE_ID", "0")
            raise OSError(
                f"no OpenGL 4.1 context on EGL device {device} ({reason}); install a driver and Debian's libegl1 and "
                "libgl1, or choose another device by EGL_DEVICE_ID"
            ) from error
        self._scene = self._api.Scene(bg_color=(0, 0, 0, 1), ambient_light=(AMBIENT**_GAMMA,) * 3)
        self._camera = self._api.IntrinsicsCamera(1, 1, 0, 0, _NEAR_M, _FAR_M)
        self._camera_node = self._scene.add(self._camera)
        for lamp, strength in zip(LAMPS, STRENGTHS, strict=True):
            # diffuse reflection of a light of intensity π is 0.96 of the surface's colour; the image is gamma encoded
            intensity = np.pi * ((AMBIENT + strength) ** _GAMMA - AMBIENT**_GAMMA)
            self._scene.add(self._api.DirectionalLight(intensity=intensity), pose=transform(rotation_to(lamp)))
        self._uploaded: dict[Node, tuple[Any, bytes]] = {}  # pyrender's node, and the orientation its light is for
        self._released: list[Node] = []
        self._visible: list[Any] = []
        sampler = self._api.Sampler(minFilter=self._api.GLTF.LINEAR_MIPMAP_NEAREST)
        self._atlas = self._api.Texture(sampler=sampler, source=atlas(), source_channels="RGB")
        self.room = Node(room_surface())

    def color(self, nodes: Iterable[Node], view: View, lighting: Lighting = "baked") -> Image:
        """Return the RGB image (height, width, 3) of the nodes in the `view` of a camera without distortion."""
        mode = self._api.RenderFlags.FLAT if lighting == "baked" else self._api.RenderFlags.NONE
        self._arrange(nodes, view, lighting)
        image, _ = self._screen.render(self._scene, flags=mode)
        return np.ascontiguousarray(image)

    def depth(self, nodes: Iterable[Node], view: View) -> float:
        """Return the depth of the first surface at the image centre, m; inf if there is none."""
        self._arrange(nodes, view, "baked")
        depth = self._screen.render(self._scene, flags=self._api.RenderFlags.DEPTH_ONLY)
        return float(depth[depth.shape[0] // 2, depth.shape[1] // 2]) or np.inf

    def release(self, nodes: Iterable[Node]) -> None:
        """Free the graphics memory of nodes before the next image; drawing them again uploads them again."""
        self._released += nodes  # a finaliser may call this at any time, so OpenGL is not called here

    @property
    def n_uploaded(self) -> int:
        """Number of nodes in graphics memory."""
        return len(self._uploaded)

    def delete(self) -> None:
        """Free everything; nothing can be drawn afterwards."""
        self._screen.delete()

    def _arrange(self, nodes: Iterable[Node], view: View, lighting: Lighting) -> None:
        """Show only `nodes`, from `view`."""
        while self._released:
            removed, _ = self._uploaded.pop(self._released.pop(), (None, b""))
            if removed is not None:
                self._scene.remove_node(removed)
                self._visible = [shown for shown in self._visible if shown is not removed]
        for shown in self._visible:
            shown.mesh.is_visible = False
        self._visible = [self._place(node, lighting) for node in nodes]
        for shown in self._visible:
            shown.mesh.is_visible = True
        c = view.camera
        self._screen.viewport_width = c.width
        self._screen.viewport_height = c.height
        self._camera.fx = c.fx
        self._camera.fy = c.fy
        self._camera.cx = c.cx + 0.5  # pyrender's image starts at the first pixel's corner, ours at its centre
        self._camera.cy = c.cy + 0.5
        self._scene.set_pose(self._camera_node, view.T_root_camera @ _T_CAMERA_OPENGL)

    def _place(self, node: Node, lighting: Lighting) -> Any:
        """Return pyrender's node of a `Node`, posed and lit."""
        baked = lighting == "baked"
        rotation = _BAKED_STEP * np.rint(node.T_root_node[:3, :3] / _BAKED_STEP)
        key = rotation.tobytes() if baked else b""
        shown, shown_key = self._uploaded.get(node, (None, b""))
        if shown is None or shown_key != key:
            if shown is not None:
                self._scene.remove_node(shown)
            light = diffuse_light(node.surface.normals @ rotation.T) if baked else None
            shown = self._scene.add(self._mesh(node.surface, light))
            self._uploaded[node] = shown, key
        self._scene.set_pose(shown, node.T_root_node @ transform(translation=_center(node.surface)))
        return shown

    def _mesh(self, surface: Surface, light: Array | None) -> Any:
        """Return pyrender's mesh with `light` (n,) in its vertex colours; None: shaded by pyrender."""
        is_textured = surface.texture_uv is not None
        color = np.ones_like(surface.positions) if is_textured else surface.colors
        color = color**_GAMMA if light is None else color * light[:, None]
        material = self._api.MetallicRoughnessMaterial(
            metallicFactor=0.0, roughnessFactor=1.0, baseColorTexture=self._atlas if is_textured else None
        )
        vertices = {"positions": surface.positions - _center(surface), "normals": surface.normals, "color_0": color}
        primitive = self._api.Primitive(
            **vertices, texcoord_0=surface.texture_uv, indices=surface.faces, material=material
        )
        return self._api.Mesh([primitive], is_visible=False)  # until all nodes of an image are in place


def diffuse_light(normals_root: Array) -> Array:
    """Return the light (n,) reflected by surfaces with unit normals (n, 3), as a factor on their colour.

    Lambert's law per lamp, plus ambient light, reduced on surfaces that face away from the key lamp.
    """
    facing = normals_root @ np.array(LAMPS).T
    return np.asarray(AMBIENT + np.maximum(facing, 0) @ np.array(STRENGTHS) + _BELOW * np.minimum(facing[:, 0], 0))


def _center(surface: Surface) -> Array:
    """Return the origin (3,) of pyrender's node in the node's frame.

    pyrender sorts nodes by their origins' distances; an object and the hand around it must not share an origin.
    """
    return np.asarray(surface.bounds.mean(axis=0))


@cache
def shared_renderer() -> Renderer:
    """Return the process's renderer."""
    renderer = Renderer()
    atexit.register(renderer.delete)
    return renderer
