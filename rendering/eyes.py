"""The robot's rendered eyes: a scene's state in, a stereo pair out."""

from dataclasses import replace
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from pps_vision.geometry.camera import StereoRig, View
from pps_vision.robot.model import Robot
from pps_vision.types import Array, StereoFrame, Truth
from rendering.carriers import CarrierName
from rendering.lens import make_lens
from rendering.offscreen import offscreen, pyrender
from rendering.scene import SceneState, Stage
from rendering.sensor import Sensor, expose
from rendering.shapes import Part
from rendering.shutter import instants, sample_offsets_px
from rendering.stimuli import Stimulus

_NEAR_M, _FAR_M = 0.02, 8.0
_GL_FROM_CV = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenGL's camera looks along −z, y up


class Eyes:
    """Renders what both eyes of a robot see; holds a scene, of which only the poses change.

    `props` are further things, which a `SceneState` places: a distractor, a board in the way.
    Use as a context manager, so that the graphics memory is given back.
    """

    def __init__(
        self,
        robot: Robot,
        rig: StereoRig,
        stimulus: Stimulus,
        carrier: CarrierName = "none",
        sensor: Sensor | None = None,
        props: tuple[tuple[Part, ...], ...] = (),
    ) -> None:
        self._robot, self._rig, self._stimulus = robot, rig, stimulus
        self._sensor = sensor or Sensor()
        self._lenses = (make_lens(rig.left), make_lens(rig.right))
        # both eyes are drawn on one size of canvas: to change it costs OpenGL a new one
        self._width = max(lens.pinhole.width for lens in self._lenses)
        self._height = max(lens.pinhole.height for lens in self._lenses)
        self._drawn = [replace(lens.pinhole, width=self._width, height=self._height) for lens in self._lenses]
        self._stage = Stage(robot, stimulus, carrier, props)
        self._cameras = [
            self._stage.scene.add(pyrender.IntrinsicsCamera(c.fx, c.fy, c.cx, c.cy, znear=_NEAR_M, zfar=_FAR_M))
            for c in self._drawn
        ]
        self._screen = offscreen()

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the graphics memory back."""
        self._screen.free()

    def set_stimulus(self, stimulus: Stimulus) -> None:
        """Show another stimulus from now on."""
        self._stimulus = stimulus
        self._stage.set_stimulus(stimulus)

    def render(self, state: SceneState, stamp_s: float, rng: np.random.Generator | None = None) -> StereoFrame:
        """Both eyes' images at one stamp; `rng` drives the sensor's noise."""
        exposure = instants(self._robot, self._rig, state, self._sensor.blur_s)
        light = np.zeros((2, self._height, self._width, 3), np.float32)
        smooth = len(exposure) == 1  # else the mean of many smooths the edges
        for instant, offset_px in zip(exposure, sample_offsets_px(len(exposure)), strict=True):
            self._stage.arrange(instant)
            for i, pinhole in enumerate(self._pinholes(instant)):
                self._aim(i, pinhole, instant, offset_px)
                cv2.accumulate(self._screen.color(self._stage.scene, self._width, self._height, smooth), light[i])
        light /= len(exposure)
        left, right = (expose(self._sensor, lens.warp(light[i]), rng) for i, lens in enumerate(self._lenses))
        q_rad = state.q_rad.copy()
        return StereoFrame(left, right, stamp_s, stamp_s, q_rad, q_rad)

    def truth(self, state: SceneState, stamp_s: float) -> Truth:
        """Where the stimulus really is and appears; NaN and not visible where there is none."""
        position = np.full(3, np.nan) if state.position is None else state.position
        stereo = self._rig.view(state.q_rad)
        self._stage.arrange(state)
        visible = [
            eye.sees(position) and self._is_first(i, pinhole, pinhole.project(position), state)
            for i, (eye, pinhole) in enumerate(zip((stereo.left, stereo.right), self._pinholes(state), strict=True))
        ]
        left_px, right_px = stereo.left.project(position), stereo.right.project(position)
        return Truth(
            stamp_s, position, state.velocity, self._stimulus.radius_m, left_px, right_px, visible[0], visible[1]
        )

    def _is_first(self, i: int, pinhole: View, pixel: Array, state: SceneState) -> bool:
        """Whether the stimulus is the first thing that eye `i` meets at a pixel of what is drawn."""
        u, v = np.rint(pixel).astype(int)
        self._aim(i, pinhole, state, np.zeros(2))
        first = self._screen.depth_at(self._stage.scene, self._width, self._height, u, v)
        self._stage.show_only_object()
        own = self._screen.depth_at(self._stage.scene, self._width, self._height, u, v)
        return own <= first

    def _pinholes(self, state: SceneState) -> tuple[View, View]:
        """What is drawn for each eye before its lens bends the image."""
        stereo = self._rig.view(state.q_rad)
        left, right = self._drawn
        return View(left, stereo.left.T_root_camera), View(right, stereo.right.T_root_camera)

    def _aim(self, i: int, pinhole: View, state: SceneState, offset_px: Array) -> None:
        """Look through eye `i`, with nothing on the stage that it cannot see."""
        self._stage.show(state, pinhole)
        node, camera = self._cameras[i], pinhole.camera
        # pyrender counts from the image's corner, we from the first pixel's centre: half a pixel between
        node.camera.cx, node.camera.cy = np.array([camera.cx, camera.cy]) + 0.5 - offset_px
        self._stage.scene.set_pose(node, pinhole.T_root_camera @ _GL_FROM_CV)
        self._stage.scene.main_camera_node = node
