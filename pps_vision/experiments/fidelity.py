"""How faithfully a scene must be drawn: time against the image's error and against the tracking's."""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from pps_vision.app.render import Render
from pps_vision.experiments.chart import Variant, legend, speed_against_error
from pps_vision.experiments.fidelity_images import compare, eyes_of, place_of
from pps_vision.experiments.study import Study
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, StereoFrame
from rendering.fidelity import Fidelity as Drawn
from rendering.names import StimulusName
from rendering.scene import SceneState
from rendering.sensor import Sensor, expose
from tracking.tracker import Tracker, TrackerParams

SHARP = {
    "scale 1, fineness 1": Drawn(fineness=1),
    "scale 1, fineness 2": Drawn(fineness=2),
    "scale 1": Drawn(scale=1.0),
    "scale 1, fineness 4": Drawn(fineness=4),
    "scale 1.25": Drawn(scale=1.25),
    "scale 1.5": Drawn(scale=1.5),
    "scale 2": Drawn(scale=2.0),
    "scale 2, fineness 4": Drawn(scale=2.0, fineness=4),
    "scale 1, lights": Drawn(lighting="lights"),
    "scale 1, shadows": Drawn(lighting="shadows"),
}
BLURRED = {f"{step:g} px": Drawn(blur_step_px=step) for step in (1.0, 1.7, 2.5, 5.0)}
_BLUR_S, _BLUR_PX = 0.02, 6.0
_TICKS_MS = (20, 50, 100, 200, 500)
DEFAULT = "scale 1"
_MODE: dict[StimulusName, Any] = {"ball": "generic", "marker": "marker"}


@dataclass(frozen=True)
class Fidelity(Study):
    """Rendered balls and markers, drawn in many ways, beside ray-cast images: image error and tracking error."""

    n: int = 4
    """Scenes of each object whose images are compared."""
    seconds: float = 3.0
    """Length of the recording of each object that is tracked, 20 pairs a second, pixel noise 2 of 255."""
    seed: int = 0
    """Seed of the first scene; the others count up."""

    def run(self) -> dict[str, object]:
        """By object: each way's ms of processor time a pair, image error (RMS grey levels over the object and 2 px
        around it, over 1.5 px to both sides of its rim, over the whole image; structural similarity), tracking
        error (mm)."""
        if self.n < 1 or self.seconds < 1:
            raise ValueError(f"bench fidelity: --n {self.n}, --seconds {self.seconds}; expected at least 1 of each")
        numbers: dict[str, object] = {}
        for stimulus in _MODE:
            scenes = [next(self.scenes(stimulus, k, 1.0)) for k in range(self.n)]
            images = compare(stimulus, scenes, SHARP, Sensor())
            numbers[stimulus] = {"image": images, "tracking": self._track(stimulus)}
        fast = [_in_flight(*scene) for scene in (next(self.scenes("ball", k, 1.0)) for k in range(self.n))]
        numbers["blur"] = compare(
            "ball", fast, BLURRED, Sensor(blur_s=_BLUR_S), margin_px=_BLUR_PX, samples=1, fine_samples=3, instants=8
        )
        return numbers

    def scenes(self, stimulus: StimulusName, k: int, seconds: float) -> Iterator[tuple[float, SceneState]]:
        """Stamps and states of one random motion, the eyes following."""
        seed = self.seed + k
        render = Render(stimulus, "figure8" if k % 2 else "circle", Path(), seconds=seconds, seed=seed)
        robot = load_icub()
        return render.scene(robot, icub_rig(robot), np.random.default_rng(seed))

    def _track(self, stimulus: StimulusName) -> dict[str, dict[str, float]]:
        """3D error of each pair's triangulation, and its mean along the line of sight (away is positive)."""
        robot = load_icub()
        rig = icub_rig(robot)
        errors: dict[str, list[tuple[float, float]]] = {name: [] for name in SHARP}
        params, body = TrackerParams(mode=_MODE[stimulus]), Silhouette(robot)
        trackers = {name: Tracker(params, rig, np.random.default_rng(self.seed), own_body=body) for name in errors}
        scenes = list(self.scenes(stimulus, 0, self.seconds))
        with ExitStack() as stack:
            eyes = {name: stack.enter_context(eyes_of(stimulus, drawn, Sensor())) for name, drawn in SHARP.items()}
            for k, (t, state) in enumerate(tqdm(scenes, desc=f"tracking a {stimulus}", unit="pair", disable=None)):
                for name, tracker in trackers.items():
                    frame = _noisy(eyes[name].render(state, t), np.random.default_rng((self.seed, k)))
                    seen = tracker.step(frame).observation
                    if seen is not None:
                        view, off = rig.view(state.q_rad), seen.p_root - place_of(state)
                        sight = place_of(state) - 0.5 * (view.left.center + view.right.center)
                        errors[name].append((float(np.linalg.norm(off)), float(off @ sight / np.linalg.norm(sight))))
        return {name: _summary(np.array(rows).reshape(-1, 2), len(scenes)) for name, rows in errors.items()}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time against the image's error, sharp and blurred, and against the tracking's; a key to the numbers."""
        figure, axes = plt.subplots(2, 3, figsize=(13, 8.5), width_ratios=(3, 3, 1.6), layout="constrained")
        sharp, blur = numbers["ball"]["image"], numbers["blur"]
        worse = {k: max(numbers[o]["image"][k]["error"] for o in _MODE) for k in sharp}
        what = "drawn pair, of processors"
        speed_against_error(axes[0, 0], _variants(sharp, worse), what, "image error, ball or marker (grey levels)")
        for axis, stimulus in zip((axes[0, 1], axes[1, 0]), _MODE, strict=True):
            errors = {k: v["rms_mm"] for k, v in numbers[stimulus]["tracking"].items()}
            speed_against_error(axis, _variants(sharp, errors), what, f"3D RMS error of a tracked {stimulus} (mm)")
            axis.set_ylim(0, 1.15 * max(errors.values()))
        smeared = {k: v["error"] for k, v in blur.items()}
        title = f"image error of a ball that moves {_BLUR_PX:g} px (grey levels)"
        speed_against_error(axes[1, 1], _variants(blur, smeared, "2.5 px"), what, title)
        usual = "sharp: fineness 3,\nbaked light unless said"
        for axis, about, names in ((axes[0, 2], usual, sharp), (axes[1, 2], "blurred: one image every", BLURRED)):
            key = "\n".join(f"{k + 1}  {name}" for k, name in enumerate(names))
            axis.axis("off")
            axis.text(0, 1, f"{about}\n\n{key}", va="top", fontsize=9, linespacing=1.6)
        for axis in axes[:, :2].ravel():
            limits = axis.get_xlim()
            axis.set_xticks(_TICKS_MS, [str(ms) for ms in _TICKS_MS])
            axis.set_xticks([], minor=True)
            axis.set_xlim(limits)
        legend(axes[0, 0])
        return figure


def _in_flight(t: float, state: SceneState) -> tuple[float, SceneState]:
    """The head still, and the object so fast that it smears over `_BLUR_PX` in the left eye."""
    robot = load_icub()
    eye = icub_rig(robot).view(state.q_rad).left
    across = eye.T_root_camera[:3, :3] @ [0.8, 0.6, 0.0]
    px_per_m = np.linalg.norm(eye.project_jacobian(place_of(state)) @ across)
    return t, replace(state, velocity=across * _BLUR_PX / px_per_m / _BLUR_S, dq_rad_s=None)


def _noisy(frame: StereoFrame, rng: np.random.Generator) -> StereoFrame:
    """With pixel noise of 2 grey levels, the same for every way to draw."""
    noise = Sensor(noise_sigma=2.0)
    left, right = (expose(noise, image.astype(np.float32), rng) for image in (frame.left, frame.right))
    return replace(frame, left=left, right=right)


def _summary(errors: Array, pairs: int) -> dict[str, float]:
    """Of errors (n, 2): distance and depth, m."""
    if not len(errors):
        return {"rms_mm": float("nan"), "bias_mm": float("nan"), "seen_share": 0.0}
    return {
        "rms_mm": 1000 * float(np.sqrt(np.mean(errors[:, 0] ** 2))),
        "bias_mm": 1000 * float(errors[:, 1].mean()),
        "seen_share": len(errors) / pairs,
    }


def _variants(times: Mapping[str, Any], errors: Mapping[str, float], default: str = DEFAULT) -> list[Variant]:
    """For the chart: time quartiles of each way with an error, by its number in the key."""
    return [
        Variant(
            str(k + 1),
            np.array([times[name][q] for q in ("q25_ms", "median_ms", "q75_ms")]),
            error,
            default=name == default,
        )
        for k, (name, error) in enumerate(errors.items())
    ]
