"""How faithfully a scene must be drawn: the renderer's time against the image error and the tracking error."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.render import scene
from pps_vision.app.render_params import RenderParams
from pps_vision.experiments.charts import speed_errors
from pps_vision.experiments.films.exact import ray_cast
from pps_vision.experiments.study import NOISE_SIGMA, TURNS, Metric, SampledStudy, Values, compare, rms
from pps_vision.experiments.tables import Table, estimate, median_first
from pps_vision.geometry.camera import View
from pps_vision.robot.icub import icub_rig, icub_setup, load_icub
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, Image
from rendering.eyes import Eyes
from rendering.fidelity import Fidelity as Drawn
from rendering.names import StimulusName
from rendering.scene import SceneState
from rendering.sensor import Sensor, expose
from rendering.stimuli import make_stimulus
from tracking.tracker import Tracker, TrackerParams

SHARP = {
    "scale 1, fineness 2": Drawn(fineness=2),
    "scale 1": Drawn(scale=1.0),
    "scale 1, fineness 4": Drawn(fineness=4),
    "scale 1.5": Drawn(scale=1.5),
    "scale 2": Drawn(scale=2.0),
    "scale 1, lights": Drawn(lighting="lights"),
}
BLURRED = {f"{step:g} px": Drawn(blur_step_px=step) for step in (1.0, 1.7, 2.5, 5.0)}
DEFAULT, DEFAULT_BLUR = "scale 1", "2.5 px"
OBJECTS: tuple[StimulusName, ...] = ("ball", "marker")
_BLUR_S, _BLUR_PX = 0.02, 6.0
_MARGIN_PX, _RAYS, _BLUR_RAYS, _INSTANTS = 2.0, 5, 3, 8  # of the reference: rays along a pixel's side, moments
_METRICS = {"object_error": Metric("object", rms), "rim_error": Metric("rim", rms)}
_TRACKING = {"error_mm": Metric("error_mm", rms)}


class Scene(NamedTuple):
    """A state, its ray-cast images (grey levels), and how far each pixel is outside the object's image (px)."""

    state: SceneState
    exact: tuple[Array, Array]
    beyond_px: tuple[Array, Array]


@dataclass(frozen=True)
class Fidelity(SampledStudy):
    """Rendered balls and markers, drawn in many ways, beside ray-cast images: error over the object and at its rim, and
    3D error of the tracker before its filter."""

    SHORT: ClassVar[Mapping[str, Any]] = {"seconds": 1.0}

    seconds: float = 2.0
    """Length of the recording of each object that is tracked, 20 pairs a second, pixel noise 2 of 255."""

    def run(self) -> dict[str, Any]:
        """Return by object and way to draw: time of a pair, image error (grey levels), tracking error (mm)."""
        seeds = self.seeds
        images: dict[str, Any] = {}
        tracking: dict[str, Any] = {}
        for stimulus in OBJECTS:
            images |= self.images(stimulus, seeds, SHARP)
            with ExitStack() as stack:
                eyes = open_eyes(stack, stimulus, SHARP, Sensor())
                ways = {name: partial(_tracked, stimulus, one) for name, one in eyes.items()}
                recording: dict[str, Any] = {stimulus: partial(self._states, stimulus, self.seconds)}
                tracking |= compare(recording, ways, _TRACKING, (self.seed,))
        images |= self.images("ball", seeds, BLURRED, Sensor(blur_s=_BLUR_S), "moving ball")
        return {"images": images, "tracking": tracking}

    def images(
        self,
        stimulus: StimulusName,
        seeds: Any,
        drawn: Mapping[str, Drawn],
        sensor: Sensor | None = None,
        name: str = "",
    ) -> dict[str, Any]:
        """Return each way's time and image error; with a sensor that blurs the object moves fast."""
        sensor = sensor or Sensor()
        with ExitStack() as stack:
            eyes = open_eyes(stack, stimulus, drawn, sensor)
            ways = {key: partial(_image_errors, one) for key, one in eyes.items()}
            scenes = {name or stimulus: lambda seed: _exact(self._states(stimulus, 1.0, seed)[0], stimulus, sensor)}
            return compare(scenes, ways, _METRICS, seeds, repeated=TURNS)

    def _states(self, stimulus: StimulusName, seconds: float, seed: int) -> list[SceneState]:
        """The states of a random motion that the eyes follow."""
        what = RenderParams(stimulus, "figure8" if seed % 2 else "circle", Path(), seconds=seconds, seed=seed)
        return [state for _, state in scene(what, icub_setup(), np.random.default_rng(seed))]

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time against the image error of each object."""
        cells: dict[str, Any] = {stimulus: numbers["images"][stimulus] for stimulus in OBJECTS}
        return speed_errors(cells, "object_error", "image error (grey levels)", (), DEFAULT, "time (ms per drawn pair)")

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return time, image error and tracking error, one row a way to draw; and those of a ball that moves fast."""
        images, tracking = numbers["images"], numbers["tracking"]
        rows = []
        for way in SHARP:
            errors = [estimate(images[o][way]["object_error"]) for o in OBJECTS]
            tracked = [estimate(tracking[o][way]["error_mm"][:1]) for o in OBJECTS]
            rows.append([way, median_first(images["ball"][way]["ms"]), *errors, *tracked])
        header = [
            "drawn with",
            "ms, quartiles",
            "image error, ball",
            "image error, marker",
            "3D error, ball (mm)",
            "3D, marker (mm)",
        ]
        blur = [
            [step, median_first(cell["ms"]), estimate(cell["object_error"])]
            for step, cell in images["moving ball"].items()
        ]
        blurred = Table(["moments at most apart by", "ms, quartiles", "image error"], blur)
        return {"": Table(header, rows), "blur": blurred}


def open_eyes(stack: ExitStack, stimulus: StimulusName, drawn: Mapping[str, Drawn], sensor: Sensor) -> dict[str, Eyes]:
    """Return the robot's eyes for every way to draw, warmed up, open as long as the stack."""
    robot = load_icub()
    rig, found = icub_rig(robot), {}
    for name, way in drawn.items():
        shape = make_stimulus(stimulus, fineness=way.fineness)
        found[name] = stack.enter_context(Eyes(robot, rig, shape, sensor=sensor, fidelity=way))
        found[name].render(SceneState(np.zeros(robot.n_joints), np.array([-0.4, 0.0, 0.3])), 0.0)
    return found


def _exact(state: SceneState, stimulus: StimulusName, sensor: Sensor) -> Scene:
    """Cast 1 ray a pixel, and many around the object, at each of several moments of the exposure."""
    robot = load_icub()
    rig, shape = icub_rig(robot), make_stimulus(stimulus)
    rays, instants = _RAYS, 1
    if sensor.blur_s > 0:
        rays, instants, state = _BLUR_RAYS, _INSTANTS, _in_flight(state)
    moments = [state.moved(sensor.blur_s * ((k + 0.5) / instants - 0.5)) for k in range(instants)]
    ball, images, beyond = (shape.radius_m, shape.parts[0].color), [], []
    views = rig.view(state.q_rad)
    for view in (views.left, views.right):
        beyond.append(_beyond_rim_px(view, _place(state), shape.radius_m))
        near = beyond[-1] < (_BLUR_PX if sensor.blur_s > 0 else _MARGIN_PX)
        image = np.mean([ray_cast(robot, view, moment, *ball, 1) for moment in moments], axis=0)
        image[near] = np.mean([ray_cast(robot, view, moment, *ball, rays, near) for moment in moments], axis=0)[near]
        images.append(image)
    return Scene(state, (images[0], images[1]), (beyond[0], beyond[1]))


def _place(state: SceneState) -> Array:
    if state.position is None:
        raise ValueError("a scene without an object; expected one to compare")
    return state.position


def _in_flight(state: SceneState) -> SceneState:
    """The head still, and the object so fast that it smears over `_BLUR_PX` in the left eye."""
    eye = icub_rig(load_icub()).view(state.q_rad).left
    across = eye.T_root_camera[:3, :3] @ [0.8, 0.6, 0.0]
    px_per_m = np.linalg.norm(eye.project_jacobian(_place(state)) @ across)
    return replace(state, velocity=across * _BLUR_PX / px_per_m / _BLUR_S, dq_rad_s=None)


def _beyond_rim_px(view: View, p: Array, radius_m: float) -> Array:
    """(h, w) how far each pixel is outside the image of a ball at `p`, px."""
    away = p - view.center
    distance = float(np.linalg.norm(away))
    cosine = view.camera.bearing_map @ (view.T_root_camera[:3, :3].T @ (away / distance))
    beyond: Array = (np.arccos(np.clip(cosine, -1, 1)) - np.arcsin(radius_m / distance)) * view.camera.focal_px
    return beyond


def _image_errors(eyes: Eyes, scene: Scene, seed: int) -> Values:
    """Differences (grey levels) over the object and a margin, and at its rim."""
    frame = eyes.render(scene.state, 0.0)
    margin_px = _MARGIN_PX if scene.state.dq_rad_s is not None else _BLUR_PX
    on_object, rim = [], []
    for image, exact, beyond in zip((frame.left, frame.right), scene.exact, scene.beyond_px, strict=True):
        difference = image.astype(float) - exact
        on_object.append(difference[beyond < margin_px].ravel())
        rim.append(difference[np.abs(beyond) < 1.5].ravel())
    return {"object": np.concatenate(on_object), "rim": np.concatenate(rim)}


def _tracked(stimulus: StimulusName, eyes: Eyes, states: list[SceneState], seed: int) -> Values:
    """Errors of each pair's triangulation; the noise is the same for every way to draw."""
    robot = load_icub()
    params = TrackerParams("marker" if stimulus == "marker" else "generic")
    tracker = Tracker(params, icub_rig(robot), np.random.default_rng(seed), own_body=Silhouette(robot))
    error_mm = []
    for k, state in enumerate(states):
        frame, rng = eyes.render(state, k / 20), np.random.default_rng((seed, k))
        left, right = (_noisy(image, rng) for image in (frame.left, frame.right))
        seen = tracker.step(replace(frame, left=left, right=right)).observation
        if seen is not None:
            error_mm.append(1000 * float(np.linalg.norm(seen.p_root - _place(state))))
    return {"error_mm": error_mm}


def _noisy(image: Image, rng: np.random.Generator) -> Image:
    return expose(Sensor(noise_sigma=NOISE_SIGMA), image.astype(np.float32), rng)
