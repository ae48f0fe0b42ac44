"""How far rendered images are from ray-cast ones of the same scenes, and what drawing them took."""

from collections.abc import Mapping
from contextlib import ExitStack
from time import process_time
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from pps_vision.experiments.chart import Variant
from pps_vision.experiments.raycast import ray_cast
from pps_vision.geometry.camera import View
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.types import Array, Image, StereoFrame
from rendering.eyes import Eyes
from rendering.fidelity import Fidelity as Drawn
from rendering.names import StimulusName
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus

_RUNS = 3  # of each way to draw a scene


def compare(
    stimulus: StimulusName,
    scenes: list[tuple[float, SceneState]],
    ways: Mapping[str, Drawn],
    sensor: Sensor,
    margin_px: float = 2.0,
    samples: int = 4,
    instants: int = 1,
) -> dict[str, dict[str, Any]]:
    """Every way's processor time and image error over the same scenes, scene by scene all ways.

    The reference takes samples² rays a pixel at each of `instants` of the exposure.
    """
    robot = load_icub()
    rig, shape = icub_rig(robot), make_stimulus(stimulus)
    ms: dict[str, list[float]] = {name: [] for name in ways}
    errors: dict[str, list[dict[str, Array]]] = {name: [] for name in ways}
    with ExitStack() as stack:
        eyes = {name: stack.enter_context(eyes_of(stimulus, drawn, sensor)) for name, drawn in ways.items()}
        for one in eyes.values():
            one.render(scenes[0][1], 0.0)  # uploads its meshes, compiles its shaders
        for t, state in tqdm(scenes, desc=f"drawing a {stimulus}", unit="scene", disable=None):
            stereo, place = rig.view(state.q_rad), place_of(state)
            views = (stereo.left, stereo.right)
            moments = [state.moved(sensor.blur_s * ((k + 0.5) / instants - 0.5)) for k in range(instants)]
            ball = shape.radius_m, shape.parts[0].color
            exact = [np.mean([ray_cast(robot, view, s, *ball, samples) for s in moments], axis=0) for view in views]
            beyond = [_beyond_rim_px(view, place, shape.radius_m) for view in views]
            for _ in range(_RUNS):
                for name, one in eyes.items():
                    frame, taken = timed_render(one, state, t)
                    ms[name].append(taken)
                    if len(ms[name]) % _RUNS == 0:
                        errors[name].append(_image_errors(frame.left, exact[0], beyond[0], margin_px))
                        errors[name].append(_image_errors(frame.right, exact[1], beyond[1], margin_px))
    return {name: _pooled(name, ms[name], errors[name]) for name in ms}


def timed_render(eyes: Eyes, state: SceneState, t: float) -> tuple[StereoFrame, float]:
    """The pair, and its milliseconds of processor time."""
    start = process_time()
    frame = eyes.render(state, t)
    return frame, 1000 * (process_time() - start)


def eyes_of(stimulus: StimulusName, drawn: Drawn, sensor: Sensor) -> Eyes:
    """The robot's eyes, drawing one way."""
    robot = load_icub()
    return Eyes(robot, icub_rig(robot), make_stimulus(stimulus, fineness=drawn.fineness), sensor=sensor, fidelity=drawn)


def _image_errors(ours: Image, exact: Array, beyond_px: Array, margin_px: float) -> dict[str, Array]:
    """Squares of the differences over the object, its rim and the whole image, and similarity over the object."""
    square = (ours.astype(float) - exact) ** 2
    quality: Any = cv2.quality
    similarity = quality.QualitySSIM_compute(ours, np.rint(exact).astype(np.uint8))[1][..., :3].mean(axis=-1)
    on_object = beyond_px < margin_px
    rim, whole = square[np.abs(beyond_px) < 1.5], square.ravel()
    return {"object": square[on_object].ravel(), "rim": rim.ravel(), "whole": whole, "ssim": similarity[on_object]}


def _pooled(name: str, ms: list[float], errors: list[dict[str, Array]]) -> dict[str, Any]:
    """Time and error over all scenes; `error` is that over the object."""
    joined = {part: np.concatenate([one[part] for one in errors]) for part in errors[0]}
    rms = {part: float(np.sqrt(joined[part].mean())) for part in ("object", "rim", "whole")}
    return {
        **Variant(name, np.array(ms), rms["object"]).summary(),
        "rim_error": rms["rim"],
        "whole_error": rms["whole"],
        "ssim": float(joined["ssim"].mean()),
    }


def place_of(state: SceneState) -> Array:
    """(3,) where the object is, root frame, m; ValueError where there is none."""
    if state.position is None:
        raise ValueError("expected a scene with an object in it")
    return state.position


def _beyond_rim_px(view: View, p: Array, radius_m: float) -> Array:
    """(h, w) how far each pixel is outside the image of a ball at `p`, px."""
    away = p - view.center
    distance = float(np.linalg.norm(away))
    cosine = view.camera.bearing_map @ (view.T_root_camera[:3, :3].T @ (away / distance))
    beyond: Array = (np.arccos(np.clip(cosine, -1, 1)) - np.arcsin(radius_m / distance)) * view.camera.focal_px
    return beyond
