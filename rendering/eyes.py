"""Rendered eye views: scene state in, stereo pair and truth out."""

import weakref
from typing import Self

import cv2
import numpy as np

from pps_vision.geometry.camera import Camera, StereoRig, View
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Image, StereoFrame, Truth
from rendering.fidelity import Fidelity
from rendering.lens import Lens, pinholes
from rendering.names import CarrierName
from rendering.renderer import shared_renderer
from rendering.scene import Scene, SceneState
from rendering.sensor import Sensor, expose
from rendering.shapes import Part
from rendering.stimuli import Stimulus

_MAX_INSTANTS = 24  # of motion blur


class Eyes:
    """Renderer of both eyes of a robot; holds one scene, of which only the poses change.

    `props` are further objects that a `SceneState` poses: a distractor, an occluding board.  `fidelity` sets the
    fineness of robot and carrier; stimulus and props keep theirs.  A context manager: leaving it frees the graphics
    memory.
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
    ) -> None:
        self._robot = robot
        self._rig = rig
        self._stimulus = stimulus
        self._sensor = sensor or Sensor()
        self._fidelity = fidelity or Fidelity()
        self._lenses = (Lens(rig.left), Lens(rig.right))
        self._pinholes = pinholes(self._lenses, self._fidelity.scale)
        self._maps = [lens.map_to(pinhole) for lens, pinhole in zip(self._lenses, self._pinholes, strict=True)]
        self._renderer = shared_renderer()
        self._scene = Scene(robot, stimulus, carrier, props, self._renderer.room, self._fidelity.fineness)
        self._release = weakref.finalize(self, self._renderer.release, self._scene.held)

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Free the graphics memory."""
        self._renderer.release(self._scene.held)

    def set_stimulus(self, stimulus: Stimulus) -> None:
        """Replace the stimulus."""
        self._renderer.release(self._scene.held)
        self._stimulus = stimulus
        self._scene.set_stimulus(stimulus)

    def render(self, state: SceneState, stamp_s: float, rng: np.random.Generator | None = None) -> StereoFrame:
        """Return the stereo pair at one stamp; `rng` drives the sensor noise."""
        exposure = instants(self._robot, self._rig, state, self._sensor.blur_s, self._fidelity)
        light = [np.zeros((lens.camera.height, lens.camera.width, 3), np.float32) for lens in self._lenses]
        for instant in exposure:
            for total, image in zip(light, self._images(instant), strict=True):
                cv2.accumulate(image, total)
        left, right = (expose(self._sensor, total / len(exposure), rng) for total in light)
        q_rad = state.q_rad.copy()
        return StereoFrame(left, right, stamp_s, stamp_s, q_rad, q_rad)

    def _images(self, state: SceneState) -> list[Image]:
        """Return both images at one instant, without sensor."""
        self._scene.arrange(state)
        images = []
        for lens, pinhole, maps, view in zip(self._lenses, self._pinholes, self._maps, self._views(state), strict=True):
            nodes = self._scene.in_view(view, lens.slopes)
            drawn = self._renderer.color(nodes, View(pinhole, view.T_root_camera), self._fidelity.lighting)
            images.append(np.asarray(cv2.remap(drawn, *maps, cv2.INTER_LINEAR), np.uint8))
        return images

    def truth(self, state: SceneState, stamp_s: float) -> Truth:
        """Return true position and image points of the stimulus; NaN and not visible if there is none."""
        position = np.full(3, np.nan) if state.position is None else state.position
        left, right = self._views(state)
        self._scene.arrange(state)
        visible = [view.sees(position) and self._is_first(view, position - view.center) for view in (left, right)]
        pixels = left.project(position), right.project(position)
        return Truth(stamp_s, position, state.velocity, self._stimulus.radius_m, *pixels, *visible)

    def _is_first(self, view: View, sight_root: Array) -> bool:
        """Return whether the line of sight `sight_root` (3,) to the stimulus's centre is free up to its surface.

        If the line passes through a hole in the stimulus, it must be free up to the centre.
        """
        x, y, z = view.T_root_camera[:3, :3].T @ sight_root
        f = view.camera.focal_px
        pixel = View(Camera(1, 1, f, f, -f * x / z, -f * y / z), view.T_root_camera)
        shown = self._scene.object
        others = [node for node in self._scene.in_view(view, (x / z, y / z, x / z, y / z)) if node is not shown]
        return min(self._renderer.depth([shown], pixel), z) <= self._renderer.depth(others, pixel)

    def _views(self, state: SceneState) -> tuple[View, View]:
        stereo = self._rig.view(state.q_rad)
        return stereo.left, stereo.right


def instants(robot: Robot, rig: StereoRig, state: SceneState, blur_s: float, fidelity: Fidelity) -> list[SceneState]:
    """Return the states whose mean image is the exposure, evenly spaced about `state`.

    Their number grows with the fastest motion in view, one per `blur_step_px`.  Their spacing d gives the blur the
    variance of an open shutter: d²·(n² − 1)/12 = blur_s²/12.
    """
    drift_px = _drift_px(robot, rig, state, blur_s) if blur_s > 0 else 0.0
    if drift_px < 0.4 * fidelity.blur_step_px:
        return [state]
    n = int(np.clip(np.ceil(drift_px / fidelity.blur_step_px), 2, _MAX_INSTANTS))
    apart_s = blur_s / np.sqrt(n * n - 1)
    return [state.moved((k - 0.5 * (n - 1)) * apart_s) for k in range(n)]


def _drift_px(robot: Robot, rig: StereoRig, state: SceneState, blur_s: float) -> float:
    """Return the largest image motion of anything in view while the shutter is open, px."""
    ends = [state.moved(-blur_s / 2), state.moved(blur_s / 2)]  # opening and closing
    views = [rig.view(end.q_rad) for end in ends]
    movers = [_movers(robot, end) for end in ends]
    drift = 0.0
    for eyes in ([view.left for view in views], [view.right for view in views]):
        size = (eyes[0].camera.width, eyes[0].camera.height)
        grid_px = np.stack(np.meshgrid(*(np.linspace(0, n - 1, 5) for n in size)), axis=-1)
        room = eyes[0].center + 0.5 * eyes[0].rays(grid_px.reshape(-1, 2))  # points at rest, 0.5 m from the eye
        px = np.array([eye.project(np.vstack([room, points])) for eye, points in zip(eyes, movers, strict=True)])
        visible = np.all((px >= 0) & (px < size), axis=(0, 2))
        drift = max(drift, np.linalg.norm(px[1, visible] - px[0, visible], axis=1).max(initial=0.0))
    return drift


def _movers(robot: Robot, state: SceneState) -> Array:
    """Return the positions (n, 3) of the robot's bodies, the props and the stimulus, root frame."""
    posture = robot.at(state.q_rad)
    places = {body.frame: body.T_frame_body[:3, 3] for body in robot.bodies}  # one body per rigid frame
    bodies = [posture.point(frame, place) for frame, place in places.items()]
    props = [np.full(3, np.nan) if prop is None else prop.position for prop in state.props]
    return np.array([*bodies, *props, *([] if state.position is None else [state.position])])
