"""How far images are from the finest ones of the same scenes, and what drawing them took."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from time import process_time
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from pps_vision.experiments.chart import Variant, timed
from pps_vision.experiments.pyrender_peer import PyrenderPeer
from pps_vision.geometry.camera import View
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.types import Array, Image, StereoFrame
from rendering.eyes import Eyes
from rendering.fidelity import Fidelity as Drawn
from rendering.names import StimulusName
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus

Draw = Callable[[SceneState, float], tuple[StereoFrame, float, float]]  # a pair, ms of the clock and of processors


def compare(
    stimulus: StimulusName,
    scenes: list[tuple[float, SceneState]],
    ways: Mapping[str, Drawn],
    reference: Drawn,
    sensor: Sensor,
    margin_px: float = 2.0,
    peers: Mapping[str, float] | None = None,
) -> dict[str, dict[str, Any]]:
    """Every way's time and image error over the same scenes, scene by scene all ways."""
    rig, radius_m = icub_rig(load_icub()), make_stimulus(stimulus).radius_m
    ms: dict[str, list[tuple[float, float]]] = {name: [] for name in (*ways, *(peers or {}))}
    errors: dict[str, list[dict[str, Array]]] = {name: [] for name in ms}
    with ExitStack() as stack:
        finest = stack.enter_context(_eyes(stimulus, reference, sensor))
        draws = draws_of(stack, stimulus, ways, peers or {}, sensor)
        for draw in draws.values():
            draw(scenes[0][1], 0.0)  # uploads its meshes, compiles its shaders
        for t, state in tqdm(scenes, desc=f"drawing a {stimulus}", unit="scene", disable=None):
            best, view = finest.render(state, t), rig.view(state.q_rad)
            beyond = [_beyond_rim_px(eye, place_of(state), radius_m) for eye in (view.left, view.right)]
            for name, draw in draws.items():
                for _ in range(3):
                    frame, *taken = draw(state, t)
                    ms[name].append((taken[0], taken[1]))
                errors[name].append(_image_errors(frame.left, best.left, beyond[0], margin_px))
                errors[name].append(_image_errors(frame.right, best.right, beyond[1], margin_px))
    return {name: _pooled(name, ms[name], errors[name]) for name in ms}


def draws_of(
    stack: ExitStack, stimulus: StimulusName, ways: Mapping[str, Drawn], peers: Mapping[str, float], sensor: Sensor
) -> dict[str, Draw]:
    """Our ways to draw and the peers' (by how fine their pinhole images are), until the stack is left."""
    ours: dict[str, Draw] = {
        name: partial(_timed_render, stack.enter_context(_eyes(stimulus, drawn, sensor)))
        for name, drawn in ways.items()
    }
    return ours | {
        name: stack.enter_context(PyrenderPeer(stimulus, scale)).timed_render for name, scale in peers.items()
    }


def _timed_render(eyes: Eyes, state: SceneState, t: float) -> tuple[StereoFrame, float, float]:
    cpu = process_time()
    frame, ms = timed(partial(eyes.render, state, t))
    return frame, ms, 1000 * (process_time() - cpu)


def _image_errors(ours: Image, theirs: Image, beyond_px: Array, margin_px: float) -> dict[str, Array]:
    """Squares of the differences over the object, its rim and the whole image, and similarity over the object."""
    square = (ours.astype(float) - theirs) ** 2
    quality: Any = cv2.quality
    similarity = quality.QualitySSIM_compute(ours, theirs)[1][..., :3].mean(axis=-1)
    on_object = beyond_px < margin_px
    rim, whole = square[np.abs(beyond_px) < 1.5], square.ravel()
    return {"object": square[on_object].ravel(), "rim": rim.ravel(), "whole": whole, "ssim": similarity[on_object]}


def _pooled(name: str, ms: list[tuple[float, float]], errors: list[dict[str, Array]]) -> dict[str, Any]:
    """Time and error over all scenes; `error` is that over the object."""
    wall, cpu = np.array(ms).T
    joined = {part: np.concatenate([one[part] for one in errors]) for part in errors[0]}
    rms = {part: float(np.sqrt(joined[part].mean())) for part in ("object", "rim", "whole")}
    return {
        **Variant(name, wall, rms["object"]).summary(),
        "cpu_ms": [round(float(value), 3) for value in np.percentile(cpu, (25, 50, 75))],
        "rim_error": rms["rim"],
        "whole_error": rms["whole"],
        "ssim": float(joined["ssim"].mean()),
    }


def _eyes(stimulus: StimulusName, drawn: Drawn, sensor: Sensor) -> Eyes:
    robot = load_icub()
    return Eyes(robot, icub_rig(robot), make_stimulus(stimulus, fineness=drawn.fineness), sensor=sensor, fidelity=drawn)


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
