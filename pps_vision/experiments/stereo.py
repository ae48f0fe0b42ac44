"""From two images to one place: how far off, at which distance, for how long, and which method where."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.chart import timed
from pps_vision.experiments.motorcycle import motorcycle
from pps_vision.experiments.stereo_charts import depth_chart, motorcycle_chart, speed_chart, tracked_chart
from pps_vision.experiments.stereo_methods import METHODS, outlined, plain_centroid
from pps_vision.experiments.stereo_scenes import Scene, Theatre, open_theatre, patched_ball
from pps_vision.experiments.study import DATA, Study
from pps_vision.geometry.camera import StereoView
from pps_vision.geometry.triangulation import triangulate
from pps_vision.types import Array
from rendering.stimuli import Stimulus, make_stimulus
from tracking.tracker import Tracker, TrackerParams

VERGENCE_DEPTH_M = 0.3
_MARKER_REACH_M = 0.8  # how far away a marker is tracked
_ASKED_MM = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
_SETTLED = 5  # frames a tracker is given before its observations count
_LEAST_SHARE = 0.5  # of answers, below which a method counts as failing


@dataclass(frozen=True)
class Stereo(Study):
    """3D error and time of centroid triangulation and of disparity in the region or the whole image, over
    distance and vergence, textured and not; of the tracker's observations before its filter; and of disparity
    on `motorcycle`."""

    n: int = 20
    """Scenes for each distance and vergence; a tenth of the windows on `motorcycle`."""
    frames: int = 60
    """Length of each tracked recording."""
    depths_m: tuple[float, ...] = (0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 2.0)
    """Distances, 0.4 m among them; a marker is tracked at those up to 0.8 m."""
    vergences_deg: tuple[float, ...] = (0.0, 10.0, 20.0, 30.0, 40.0)
    """Vergences at 0.3 m; 0 is parallel."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    data: Path = DATA
    """Folder that holds `motorcycle` (default: PPS_VISION_DATA, else ../shared/data)."""
    seed: int = 0
    """Seed of scenes and noise."""

    def run(self) -> dict[str, object]:
        """By texture and place, each method's RMS in mm, share of answers and ms; marker and ball as tracked."""
        if self.n < 2 or self.frames <= _SETTLED + 1:
            raise ValueError(
                f"bench stereo: --n {self.n}, --frames {self.frames}; expected 2 and {_SETTLED + 2} at least"
            )
        rng = np.random.default_rng(self.seed)
        near = [d for d in self.depths_m if d <= _MARKER_REACH_M]
        with open_theatre(self.noise) as theatre:
            textured, plain = patched_ball(rng), make_stimulus("ball")
            numbers: dict[str, Any] = {
                "depth_textured": {str(d): self._compare(theatre, textured, d, None, rng) for d in self.depths_m},
                "depth_plain": {str(d): self._compare(theatre, plain, d, None, rng) for d in self.depths_m},
                "vergence_textured": {
                    str(v): self._compare(theatre, textured, VERGENCE_DEPTH_M, v, rng) for v in self.vergences_deg
                },
                "marker": {
                    head: {str(d): self._track(theatre, "marker", d, head == "moving", rng) for d in near}
                    for head in ("still", "moving")
                },
                "ball_0.3_m": {
                    head: self._track(theatre, "generic", 0.3, head == "moving", rng) for head in ("still", "moving")
                },
            }
        numbers["cheapest_within_mm"] = {
            texture: {place: _cheapest(of["methods"]) for place, of in numbers[f"depth_{texture}"].items()}
            for texture in ("textured", "plain")
        }
        folder = self.data / "motorcycle"
        numbers["motorcycle"] = motorcycle(folder, 10 * self.n, rng) if folder.exists() else f"skipped: no {folder}"
        return numbers

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Error over distance and vergence; time against error, textured and not; as tracked; `motorcycle`."""
        charts = {"depth": depth_chart(numbers), "speed": speed_chart(numbers), "tracked": tracked_chart(numbers)}
        if isinstance(numbers["motorcycle"], dict):
            charts["motorcycle"] = motorcycle_chart(numbers["motorcycle"])
        return charts

    def _compare(
        self, theatre: Theatre, stimulus: Stimulus, depth_m: float, vergence_deg: float | None, rng: np.random.Generator
    ) -> dict[str, Any]:
        """All methods on the same scenes in turn; the bound is that of the outlines' measured pixel error."""
        vergence = None if vergence_deg is None else float(np.deg2rad(vergence_deg))
        errors: dict[str, list[float]] = {name: [] for name in METHODS}
        ms: dict[str, list[float]] = {name: [] for name in METHODS}
        pixels, unit = [], []
        for scene in theatre.scenes(stimulus, depth_m, vergence, self.n, rng):
            for name, method in METHODS.items():
                p, took = timed(lambda method=method, scene=scene: method(scene))  # type: ignore[misc]
                errors[name].append(np.nan if p is None else float(np.linalg.norm(p - scene.p)))
                ms[name].append(took)
            if (found := outlined(scene)) is not None:
                pixels.append(_pixel_errors(scene.view, found.left.center_px, found.right.center_px, scene.p))
                unit.append(_unit_bound_m2(scene))
        rms_px = _rms(np.array(pixels))
        return {
            "pixel_rms": rms_px,
            "bound_mm": 1000 * rms_px * float(np.sqrt(np.mean(unit))),
            "methods": {name: _method_summary(np.array(errors[name]), np.array(ms[name])) for name in METHODS},
        }

    def _track(
        self,
        theatre: Theatre,
        mode: Literal["marker", "generic"],
        depth_m: float,
        moving_head: bool,
        rng: np.random.Generator,
    ) -> dict[str, float]:
        """The tracker's observations before its filter, bias included, over two recordings."""
        pixels, errors, naive, unit = [], [], [], []
        stimulus = make_stimulus("marker" if mode == "marker" else "ball")
        for _ in range(2):
            tracker = Tracker(TrackerParams(mode=mode), theatre.rig, rng)
            for k, scene in enumerate(theatre.film(stimulus, depth_m, moving_head, self.frames, rng)):
                step = tracker.step(scene.frame)
                if k < _SETTLED or step.observation is None:
                    continue
                left, right = step.detections
                pixels.append(_pixel_errors(scene.view, left.center_px, right.center_px, scene.p))
                errors.append(step.observation.p_root - scene.p)
                unit.append(_unit_bound_m2(scene))
                if (flat := plain_centroid(scene)) is not None:
                    naive.append(flat - scene.p)
        rms_px = _rms(np.array(pixels))
        rms, bound = _rms_3d(np.array(errors)), rms_px * float(np.sqrt(np.mean(unit)))
        return {
            "seen_share": len(errors) / (2 * (self.frames - _SETTLED)),
            "pixel_rms": rms_px,
            "rms_mm": 1000 * rms,
            "bias_mm": 1000 * float(np.linalg.norm(np.mean(errors, axis=0))),
            "bound_mm": 1000 * bound,
            "of_bound": rms / bound,
            "plain_centroid_rms_mm": 1000 * _rms_3d(np.array(naive)),
        }


def _pixel_errors(view: StereoView, left_px: Array, right_px: Array, p: Array) -> Array:
    """(4,) px."""
    return np.concatenate([left_px - view.left.project(p), right_px - view.right.project(p)])


def _unit_bound_m2(scene: Scene) -> float:
    """Mean squared 3D error (m²) that a pixel of noise in all four coordinates leaves at best."""
    exact = scene.view.left.project(scene.p), scene.view.right.project(scene.p)
    found = triangulate(scene.view, *exact, np.eye(2), np.eye(2))
    return float(np.trace(found.cov_root)) if found else np.nan


def _method_summary(error_m: Array, ms: Array) -> dict[str, Any]:
    """RMS of the answers; NaN where they are too few."""
    found = np.isfinite(error_m)
    share = float(found.mean())
    rms = 1000 * float(np.sqrt(np.mean(error_m[found] ** 2))) if share >= _LEAST_SHARE else np.nan
    q25, median, q75 = (round(float(value), 4) for value in np.percentile(ms, (25, 50, 75)))
    return {"rms_mm": rms, "found": share, "q25_ms": q25, "median_ms": median, "q75_ms": q75}


def _cheapest(methods: dict[str, Any]) -> dict[str, str | None]:
    """By asked-for RMS error in mm, the fastest method that had an answer everywhere and met it."""
    by_time = sorted(
        (name for name, of in methods.items() if of["found"] == 1.0), key=lambda k: methods[k]["median_ms"]
    )
    return {
        f"{most:g}": next((name for name in by_time if methods[name]["rms_mm"] <= most), None) for most in _ASKED_MM
    }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _rms_3d(errors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
