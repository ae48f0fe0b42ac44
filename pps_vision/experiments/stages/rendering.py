"""How finely a scene must be drawn: the renderer's time against the image error.

Balls and markers on paths that the eyes follow, drawn in several ways, beside images cast ray by ray.
"""

from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pps_vision.app.render import scene
from pps_vision.app.render_params import RenderParams
from pps_vision.experiments.charts import cells_chart
from pps_vision.experiments.films.exact import ray_cast
from pps_vision.experiments.study import Metric, Values, compare, rms
from pps_vision.experiments.timing import timed_steps
from pps_vision.geometry.camera import View
from pps_vision.robot.icub import icub_rig, icub_setup, load_icub
from pps_vision.types import Array, Mask
from rendering.eyes import Eyes
from rendering.fidelity import Fidelity
from rendering.names import StimulusName
from rendering.scene import SceneState
from rendering.stimuli import make_stimulus

WAYS = {
    "scale 1, fineness 2": Fidelity(fineness=2),
    "scale 1": Fidelity(scale=1.0),
    "scale 1, fineness 4": Fidelity(fineness=4),
    "scale 1.5": Fidelity(scale=1.5),
    "scale 2": Fidelity(scale=2.0),
    "scale 1, lights": Fidelity(lighting="lights"),
}
DEFAULT = "scale 1"
OBJECTS: tuple[StimulusName, ...] = ("ball", "marker")
_MARGIN_PX = 2.0  # around the object, where images are compared
_RAYS = 5  # rays of the reference, along a pixel's side
_METRICS = {"object_error": Metric("object", rms)}


class Drawing(NamedTuple):
    """Stamps and states, and of both eyes in the first: ray-cast image (grey levels), pixels around the object."""

    states: list[SceneState]
    references: list[tuple[Array, Mask]]


chart = cells_chart("object_error", "image error (grey levels)", (), DEFAULT, "time (ms per drawn pair)")


def run(study: Any) -> dict[str, Any]:
    """Return by object and way to draw: time of a pair and image error (grey levels)."""
    cells: dict[str, Any] = {}
    robot = load_icub()
    for stimulus in OBJECTS:
        methods = {}
        with ExitStack() as stack:
            for name, way in WAYS.items():
                shape = make_stimulus(stimulus, fineness=way.fineness)
                eyes = stack.enter_context(Eyes(robot, icub_rig(robot), shape, fidelity=way))
                eyes.render(SceneState(np.zeros(robot.n_joints), np.array([-0.4, 0.0, 0.3])), 0.0)  # warms up
                methods[name] = partial(_errors, eyes)
            cells |= compare({stimulus: partial(_drawing, stimulus, study.seconds)}, methods, _METRICS, study.seeds)
    return {"cells": cells}


def _drawing(stimulus: StimulusName, seconds: float, seed: int) -> Drawing:
    """A random motion that the eyes follow, with one ray a pixel, and many around the object, in its first state."""
    params = RenderParams(stimulus, "figure8" if seed % 2 else "circle", Path(), seconds=seconds, seed=seed)
    states = [state for _, state in scene(params, icub_setup(), np.random.default_rng(seed))]
    robot = load_icub()
    shape = make_stimulus(stimulus)
    ball = shape.radius_m, shape.parts[0].color
    views = icub_rig(robot).view(states[0].q_rad)
    references = []
    for view in (views.left, views.right):
        near = _beyond_rim_px(view, np.asarray(states[0].position), shape.radius_m) < _MARGIN_PX
        image = np.array(ray_cast(robot, view, states[0], *ball, 1))
        image[near] = ray_cast(robot, view, states[0], *ball, _RAYS, near)[near]
        references.append((image, near))
    return Drawing(states, references)


def _beyond_rim_px(view: View, p: Array, radius_m: float) -> Array:
    """(h, w) distance of each pixel from the image of a ball at `p`, negative inside, px."""
    away = p - view.center
    distance = float(np.linalg.norm(away))
    cosine = view.camera.bearing_map() @ (view.T_root_camera[:3, :3].T @ (away / distance))
    return np.asarray((np.arccos(np.clip(cosine, -1, 1)) - np.arcsin(radius_m / distance)) * view.camera.focal_px)


def _errors(eyes: Eyes, drawing: Drawing, seed: int) -> Values:
    """Image differences around the object in the first pair."""
    frames, ms = timed_steps(lambda state: eyes.render(state, 0.0), drawing.states)
    pairs = zip((frames[0].left, frames[0].right), drawing.references, strict=True)
    difference = [(image.astype(float) - exact)[near].ravel() for image, (exact, near) in pairs]
    return {"object": np.concatenate(difference), "ms": ms}
