"""The robot's rendered eyes: a scene's state in, a stereo pair out."""

from types import TracebackType
from typing import Self

import cv2
import numpy as np

from pps_vision.geometry.camera import StereoRig, View
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Image, StereoFrame, Truth
from rendering.fidelity import Fidelity
from rendering.lens import Lens
from rendering.names import CarrierName
from rendering.offscreen import offscreen
from rendering.scene import SceneState, Stage
from rendering.sensor import Sensor, expose
from rendering.shapes import Part
from rendering.shutter import instants, sample_offsets_px
from rendering.stimuli import Stimulus


class Eyes:
    """Renders what both eyes of a robot see; holds a scene, of which only the poses change.

    `props` are further things, which a `SceneState` places: a distractor, a board in the way.
    The stimulus and the props are as finely cut as they come, the rest as `fidelity` says; the bodies of the
    robot's frames `undrawn` are left out.
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
        fidelity: Fidelity | None = None,
        undrawn: tuple[str, ...] = (),
    ) -> None:
        self._robot, self._rig, self._stimulus = robot, rig, stimulus
        self._sensor, self._fidelity = sensor or Sensor(), fidelity or Fidelity()
        self._lenses = (Lens(rig.left), Lens(rig.right))
        self._stage = Stage(robot, stimulus, carrier, props, self._fidelity, undrawn)
        self._screen = offscreen()

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the graphics memory back."""
        self._stage.free()

    def set_stimulus(self, stimulus: Stimulus) -> None:
        """Show another stimulus from now on."""
        self._stage.free()
        self._stimulus = stimulus
        self._stage.set_stimulus(stimulus)

    def render(self, state: SceneState, stamp_s: float, rng: np.random.Generator | None = None) -> StereoFrame:
        """Both eyes' images at one stamp; `rng` drives the sensor's noise."""
        exposure = instants(self._robot, self._rig, state, self._sensor.blur_s, self._fidelity)
        light = [np.zeros((lens.camera.height, lens.camera.width, 3), np.float32) for lens in self._lenses]
        offsets = self._fidelity.pixel_spread * sample_offsets_px(len(exposure))
        for instant, offset_px in zip(exposure, offsets, strict=True):
            for one, image in zip(light, self._look(instant, offset_px), strict=True):
                cv2.accumulate(image, one)
        left, right = (expose(self._sensor, one / len(exposure), rng) for one in light)
        q_rad = state.q_rad.copy()
        return StereoFrame(left, right, stamp_s, stamp_s, q_rad, q_rad)

    def _look(self, state: SceneState, offset_px: Array) -> list[Image]:
        """What each eye sees at one instant."""
        self._stage.arrange(state)
        if self._fidelity.shadows:
            self._screen.cast_shadows(self._stage.there)
        return [
            self._screen.color(self._stage.in_view(view, lens), lens, view, self._fidelity, offset_px)
            for lens, view in zip(self._lenses, self._views(state), strict=True)
        ]

    def truth(self, state: SceneState, stamp_s: float) -> Truth:
        """Where the stimulus really is and appears; NaN and not visible where there is none."""
        position = np.full(3, np.nan) if state.position is None else state.position
        left, right = self._views(state)
        self._stage.arrange(state)
        visible = [
            view.sees(position) and self._is_first(lens, view, view.project(position))
            for lens, view in zip(self._lenses, (left, right), strict=True)
        ]
        left_px, right_px = left.project(position), right.project(position)
        return Truth(
            stamp_s, position, state.velocity, self._stimulus.radius_m, left_px, right_px, visible[0], visible[1]
        )

    def _is_first(self, lens: Lens, view: View, pixel: Array) -> bool:
        """Whether the stimulus is the first thing that an eye meets at a pixel."""
        u, v = np.rint(pixel).astype(int)
        first = self._screen.depth_at(self._stage.in_view(view, lens), lens, view, u, v)
        return self._screen.depth_at([self._stage.object], lens, view, u, v) <= first

    def _views(self, state: SceneState) -> tuple[View, View]:
        stereo = self._rig.view(state.q_rad)
        return stereo.left, stereo.right
