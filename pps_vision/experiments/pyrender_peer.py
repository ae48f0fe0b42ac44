"""The renderer that people would pick instead, as a peer of ours: pyrender, through its public interface only.

What it is given, so that like is compared with like: our meshes, textures and culling, and our light, baked into the
vertices' colours and drawn unlit (its own shading has highlights and a gamma, and takes longer).  The lens's distortion
is a `cv2.remap` of a pinhole image that is wide enough and `scale` times as fine as the eye's; walls need no cutting.
It takes four samples a pixel, always: no public switch turns them off.  It runs in a process of its own, which is timed
there: either renderer wants its context to be current, and the one that ends first ends the display of both.
"""

import os
from importlib.util import find_spec
from multiprocessing import get_context
from time import perf_counter, process_time
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np

from pps_vision.geometry.camera import View
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.types import Array, Image, StereoFrame
from rendering.fidelity import Fidelity
from rendering.lens import Lens
from rendering.names import StimulusName
from rendering.offscreen import LAMPS, STRENGTHS, Node, ambient_light
from rendering.room import atlas, room_meshes
from rendering.scene import SceneState, Stage
from rendering.stimuli import make_stimulus

_NEAR_M, _FAR_M = 0.02, 8.0
_TURNED = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenGL's camera looks along −z, y up
_UNCUT_M = 100.0
_ANSWER_S = 120.0  # how long the process may take to start and draw


def is_installed() -> bool:
    """Whether there is a pyrender to compare with (the extra `bench`)."""
    return find_spec("pyrender") is not None


class PyrenderPeer:
    """`PyrenderEyes` in a process of its own.  Use as a context manager, which ends it."""

    def __init__(self, stimulus: StimulusName, scale: float) -> None:
        spawn = get_context("spawn")
        self._pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_serve, args=(theirs, stimulus, scale), daemon=True)
        self._process.start()
        theirs.close()

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the process; it holds nothing that would have to be given back."""
        self._process.kill()
        self._process.join()

    def timed_render(self, state: SceneState, stamp_s: float) -> tuple[StereoFrame, float, float]:
        """The pair, and how many milliseconds of the clock and of processors it took there; OSError where
        nothing comes back."""
        try:
            self._pipe.send((state, stamp_s))
            if not self._pipe.poll(_ANSWER_S):
                raise OSError(f"pyrender's process has not drawn a pair within {_ANSWER_S:g} s")
            drawn: tuple[StereoFrame, float, float] = self._pipe.recv()
        except (EOFError, ConnectionError) as error:
            raise OSError("pyrender's process has ended, and draws nothing") from error
        return drawn


def _serve(pipe: Any, stimulus: StimulusName, scale: float) -> None:
    """Draw what comes through the pipe."""
    os.environ["PYGLET_HEADLESS"] = "true"  # else pyrender's import asks for a display
    eyes = PyrenderEyes(stimulus, scale)
    while True:
        state, stamp_s = pipe.recv()
        wall, cpu = perf_counter(), process_time()
        frame = eyes.render(state, stamp_s)
        pipe.send((frame, 1000 * (perf_counter() - wall), 1000 * (process_time() - cpu)))


class PyrenderEyes:
    """What `rendering.eyes.Eyes` does without noise and blur, drawn by pyrender.  The light stays that of the first
    pair, which is right while nothing but the head turns and the object does not rotate."""

    def __init__(self, stimulus: StimulusName, scale: float) -> None:
        import pyrender

        self._api, robot = pyrender, load_icub()
        self._rig = icub_rig(robot)
        self._lenses = Lens(self._rig.left), Lens(self._rig.right)
        self._stage = Stage(robot, make_stimulus(stimulus), "none", (), Fidelity())
        self._room = [Node(mesh) for mesh in room_meshes(_UNCUT_M)]
        self._screen = pyrender.OffscreenRenderer(*np.max([_canvas(lens, scale) for lens in self._lenses], axis=0))
        self._scene: Any = pyrender.Scene(bg_color=(0, 0, 0, 1))
        self._drawn: dict[Node, Any] = {}
        self._cameras, self._maps = [], []
        for lens in self._lenses:
            fx, fy, cx, cy = pinhole = _pinhole(lens, scale)
            camera = pyrender.IntrinsicsCamera(fx, fy, cx + 0.5, cy + 0.5, _NEAR_M, _FAR_M)  # FACTS, 7
            self._cameras.append(self._scene.add(camera))
            self._maps.append(_remap(lens, pinhole))

    def render(self, state: SceneState, stamp_s: float) -> StereoFrame:
        """Both eyes' images at one stamp."""
        self._stage.arrange(state)
        if not self._drawn:
            self._begin()
        for node, drawn in self._drawn.items():
            self._scene.set_pose(drawn, node.T_root_mesh)
        view = self._rig.view(state.q_rad)
        left, right = (self._look(k, eye) for k, eye in enumerate((view.left, view.right)))
        return StereoFrame(left, right, stamp_s, stamp_s, state.q_rad, state.q_rad)

    def _begin(self) -> None:
        """Hand over all that there is."""
        for node in self._room:
            self._scene.add(self._mesh(node))
        for node in self._stage.there:
            if not node.mesh.textured:
                self._drawn[node] = self._scene.add(self._mesh(node))

    def _look(self, k: int, view: View) -> Image:
        seen = set(self._stage.in_view(view, self._lenses[k]))
        for node, drawn in self._drawn.items():
            drawn.mesh.is_visible = node in seen
        self._scene.set_pose(self._cameras[k], view.T_root_camera @ _TURNED)
        self._scene.main_camera_node = self._cameras[k]
        pinhole, _ = self._screen.render(self._scene, flags=self._api.RenderFlags.FLAT)
        return np.asarray(cv2.remap(np.ascontiguousarray(pinhole), *self._maps[k], cv2.INTER_LINEAR), np.uint8)

    def _mesh(self, node: Node) -> Any:
        """Our mesh, with the light that falls on it where it is."""
        api, texture, places = self._api, None, None
        positions, normals, paint = np.split(node.mesh.vertices, 3, axis=1)
        light = _light(normals @ node.T_root_mesh[:3, :3].T)[:, None]
        if node.mesh.textured:
            sampler = api.Sampler(minFilter=api.GLTF.LINEAR_MIPMAP_NEAREST)
            texture = api.Texture(sampler=sampler, source=atlas(), source_channels="RGB")
            places, paint = np.column_stack([paint[:, 0], 1 - paint[:, 1]]), np.ones_like(paint)
        material = api.MetallicRoughnessMaterial(baseColorTexture=texture, doubleSided=node.mesh.textured)
        shape = {"positions": positions, "normals": normals, "indices": node.mesh.faces}
        return api.Mesh([api.Primitive(**shape, texcoord_0=places, color_0=paint * light, material=material)])


def _light(normals_root: Array) -> Array:
    """(n,) the light on surfaces that face along `normals_root` (n, 3): what our vertex shader says, no shadows."""
    facing = normals_root @ np.array(LAMPS).T
    below: Array = 0.12 * np.minimum(facing[:, 0], 0)
    return ambient_light(len(LAMPS)) + np.maximum(facing, 0) @ np.array(STRENGTHS) + below


def _canvas(lens: Lens, scale: float) -> tuple[int, int]:
    """Width and height of a pinhole image that holds all the lens sees, `scale` times as fine as it in the middle."""
    left, top, right, bottom = lens.slopes
    fx, fy = scale * lens.camera.fx, scale * lens.camera.fy
    return int(np.ceil((right - left) * fx)), int(np.ceil((bottom - top) * fy))


def _pinhole(lens: Lens, scale: float) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy (px, integers are pixel centres) of that image."""
    left, top, _, _ = lens.slopes
    fx, fy = scale * lens.camera.fx, scale * lens.camera.fy
    return fx, fy, -left * fx - 0.5, -top * fy - 0.5


def _remap(lens: Lens, pinhole: tuple[float, float, float, float]) -> tuple[Array, Array]:
    """Where in the pinhole image each of the eye's pixels is, as `cv2.remap` wants it."""
    fx, fy, cx, cy = pinhole
    rays = lens.camera.bearing_map
    x, y = fx * rays[..., 0] / rays[..., 2] + cx, fy * rays[..., 1] / rays[..., 2] + cy
    maps = cv2.convertMaps(x.astype(np.float32), y.astype(np.float32), cv2.CV_16SC2)
    return np.asarray(maps[0]), np.asarray(maps[1])
