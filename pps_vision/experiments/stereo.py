"""From two images to one point: our triangulation beside OpenCV's and beside disparity maps, over the distance."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np
import trimesh
from matplotlib.figure import Figure

from pps_vision.experiments.baselines import disparity
from pps_vision.experiments.charts import PAGE_IN, intervals, panels, speed_errors
from pps_vision.experiments.films.recordings import EYES_M, Footage, film, follow, watching
from pps_vision.experiments.films.score import steps_of
from pps_vision.experiments.study import (
    NOISE_SIGMA,
    TURNS,
    Axis,
    Break,
    Method,
    Metric,
    SceneSource,
    TrackingStudy,
    Values,
    compare,
    compare_severities,
    mean,
    percent,
    rms,
)
from pps_vision.experiments.tables import Table, estimate, median_first
from pps_vision.experiments.timing import timed_steps
from pps_vision.geometry.camera import StereoView
from pps_vision.geometry.triangulation import triangulate
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array, Detection2D, StereoFrame
from rendering.motions import Circle
from rendering.sensor import Sensor
from rendering.shapes import Part
from rendering.stimuli import RED, Stimulus, make_stimulus

DEPTHS_M = (0.3, 0.4, 0.6, 0.8, 1.2)
BALL_M = 0.035
OURS = "covariance (ours)"
BASELINES = ("midpoint", "linear (OpenCV)", "corrected (OpenCV)", "whole BM", "whole SGBM")
BOUNDS = ("Cramér–Rao bound", "bound, eyes taken as independent")
_SECONDS, _SETTLED, _NEAR_M, _FEWEST = 1.5, 10, 0.4, 5
_METRICS = {"rms_mm": Metric("error_mm", rms), "found_percent": Metric("found", percent)}


class Pair(NamedTuple):
    """A stereo pair, its view, the tracker's detections in it, and where the ball really is."""

    frame: StereoFrame
    view: StereoView
    left: Detection2D
    right: Detection2D
    p: Array


@dataclass(frozen=True)
class Stereo(TrackingStudy):
    """3D error and time of triangulating the tracker's detections, and of disparity in the whole image, of a plain and
    a textured ball of 35 mm while the head sways, over its distance. The error counts before any filter; the ball's
    direction is given to the disparity maps."""

    n: int = 3
    """Recordings of each ball at each distance."""

    def run(self) -> dict[str, Any]:
        """Return by scenes: errors and times at 0.4 m, and errors and their bounds over the distance."""
        kinds = self.scenarios(self._pairs, ("plain", "textured"))
        near = {name: partial(make, depth_m=_NEAR_M) for name, make in kinds.items()}
        broken, distance = Break("found_percent", 50.0, above=False), Axis("distance (m)", DEPTHS_M)
        over = {
            name: compare_severities(make, distance, methods(), _METRICS, self.seeds, broken)
            for name, make in kinds.items()
        }
        bounds = {
            name: [bounds_mm([make(k, depth_m=depth) for k in self.seeds]) for depth in DEPTHS_M]
            for name, make in kinds.items()
            if name.startswith("rendered")  # before photographs few pairs err by pixels, far from normally
        }
        return {
            "cells": compare(near, methods(), _METRICS, self.seeds, "midpoint", TURNS),
            "distance": over,
            "bound": {name: {which: [at[which] for at in of] for which in BOUNDS} for name, of in bounds.items()},
        }

    def _pairs(self, ball: str, source: SceneSource, seed: int, depth_m: float) -> list[Pair]:
        rng, robot = np.random.default_rng(seed), load_icub()
        plane = np.linalg.qr(rng.standard_normal((3, 3)))[0][:2]
        center = EYES_M + depth_m * np.array([-1.0, *rng.uniform(-0.1, 0.1, 2)])
        states = watching(Circle(center, plane, 0.03, 0.1), _SECONDS, follow(robot))
        stimulus = make_stimulus("ball", BALL_M) if ball == "plain" else patched_ball(BALL_M)
        recording = film(states, stimulus, source, Sensor(noise_sigma=NOISE_SIGMA), seed)
        return list(pairs(recording, seed))

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Time against error at 0.4 m; error over the distance beside its bound."""
        cells = numbers["cells"]
        label = "3D RMS error, 0.4 m (mm)"
        figure, axes = panels(len(cells), 2, PAGE_IN / 2, 3.0)
        for k, (name, axis) in enumerate(zip(cells, axes, strict=True)):
            of, bound = numbers["distance"][name], numbers["bound"].get(name, {})
            for method, color in ((OURS, "tab:blue"), ("whole BM", "tab:orange"), ("whole SGBM", "tab:red")):
                value, low, high = intervals(of["methods"][method]["rms_mm"])
                axis.plot(of["severities"], value, "o-", ms=4, color=color, label=method)
                axis.fill_between(of["severities"], low, high, color=color, alpha=0.15, lw=0)
            linear, _, _ = intervals(of["methods"]["linear (OpenCV)"]["rms_mm"])
            axis.plot(of["severities"], linear, "s", ms=8, mfc="none", color="0.25", label="linear (OpenCV)")
            for (which, values), style in zip(bound.items(), ("k--", "k:"), strict=False):
                axis.plot(of["severities"], np.array(values, float), style, lw=1.2, label=which)
            axis.set(yscale="log", xlabel="distance (m)", ylabel="" if k % 2 else "3D RMS error (mm)")
            axis.set_title(f"{name} ball", fontsize=10)
            axis.grid(alpha=0.25)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
        near = {f"{name} ball": of for name, of in cells.items()}
        return {"": speed_errors(near, "rms_mm", label, BASELINES, OURS), "distance": figure}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return error at 0.4 m and time, one row a method, and the bounds of the error there."""
        cells, bounds = numbers["cells"], numbers["bound"]
        rows = []
        for m in next(iter(cells.values())):
            times = np.median([cell[m]["ms"] for cell in cells.values()], axis=0)
            rows.append([m, *(estimate(cell[m]["rms_mm"]) for cell in cells.values()), median_first(times.tolist())])
        k = DEPTHS_M.index(_NEAR_M)
        rows += [
            [which, *(estimate([bounds[name][which][k]] if name in bounds else [None]) for name in cells), "–"]
            for which in (BOUNDS if bounds else ())
        ]
        return {"": Table(["3D RMS error at 0.4 m (mm)", *cells, "ms per pair, quartiles"], rows)}


def bounds_mm(recordings: Sequence[list[Pair]]) -> dict[str, float]:
    """Return the Cramér–Rao bounds of the 3D RMS error of a point seen in two images, mm, by `BOUNDS`.

    The four image coordinates of a recording's pairs err with the covariance C (4, 4) of its detections about the
    images of the ball's centre, the eyes' correlation included; for normal errors no unbiased estimate from them has a
    covariance below (Jᵀ C⁻¹ J)⁻¹, with J (4, 3) the derivative of the four by the point. The second bound leaves the
    blocks between the eyes out of C: it is larger where both eyes err alike. A recording of fewer than five pairs does
    not count.
    """
    variances: dict[str, list[float]] = {which: [] for which in BOUNDS}
    for recording in recordings:
        errors, jacobians = [], []
        for pair in recording:
            eyes = ((pair.view.left, pair.left), (pair.view.right, pair.right))
            errors.append(np.concatenate([seen.center_px - eye.project(pair.p) for eye, seen in eyes]))
            jacobians.append(np.vstack([eye.project_jacobian(pair.p) for eye, _ in eyes]))
        if len(errors) >= _FEWEST:
            cov = np.array(errors).T @ np.array(errors) / len(errors)
            apart = np.kron(np.eye(2), np.ones((2, 2))) * cov
            for which, one in zip(BOUNDS, (cov, apart), strict=True):
                variances[which] += [float(np.trace(np.linalg.inv(J.T @ np.linalg.solve(one, J)))) for J in jacobians]
    return {which: 1000 * float(np.sqrt(mean(np.array(of)))) for which, of in variances.items()}


def pairs(recording: Footage, seed: int) -> Iterator[Pair]:
    """Yield the pairs in which the settled tracker detects the ball in both eyes."""
    steps, _ = steps_of(recording, seed)
    for k, (frame, step) in enumerate(zip(recording.frames, steps, strict=True)):
        if k >= _SETTLED and len(step.detections) == 2:
            left, right = step.detections
            yield Pair(frame, recording.rig.view_of(frame), left, right, recording.position[k])


def methods() -> dict[str, Method]:
    """Return the ways from a pair to a point, by name."""

    def pixels(find: Callable[[StereoView, Array, Array], Array | None]) -> Method:
        return partial(_run, lambda pair: find(pair.view, pair.left.center_px, pair.right.center_px))

    def whole(make: Callable[[], cv2.StereoMatcher]) -> Method:
        return partial(_run, lambda pair: disparity.in_whole_image(make, pair.frame, pair.view, pair.p, BALL_M))

    return {
        OURS: partial(_run, _ours),
        "midpoint": pixels(disparity.midpoint),
        "linear (OpenCV)": pixels(disparity.linear),
        "corrected (OpenCV)": pixels(disparity.corrected),
        "whole BM": whole(disparity.block_matching),
        "whole SGBM": whole(disparity.semi_global),
    }


def _ours(pair: Pair) -> Array | None:
    left, right = pair.left, pair.right
    found = triangulate(pair.view, left.center_px, right.center_px, left.cov_px, right.cov_px)
    return None if found is None else found.p_root


def _run(find: Callable[[Pair], Array | None], recording: list[Pair], seed: int) -> Values:
    found, ms = timed_steps(find, recording)
    pairs = zip(found, recording, strict=True)
    error_mm = [1000 * float(np.linalg.norm(p - pair.p)) for p, pair in pairs if p is not None]
    return {"error_mm": error_mm, "found": [p is not None for p in found], "ms": ms}


def patched_ball(radius_m: float) -> Stimulus:
    """Return a red ball with every other patch of its surface half as bright."""
    mesh: Any = trimesh.creation.icosphere(4, radius_m)
    middle = mesh.triangles_center / radius_m
    azimuth, height = np.arctan2(middle[:, 1], middle[:, 0]), np.arcsin(np.clip(middle[:, 2], -1, 1))
    dark = (np.floor(azimuth * 5 / np.pi) + np.floor(height * 5 / np.pi)) % 2 > 0
    plain, patches = mesh.submesh([np.flatnonzero(~dark), np.flatnonzero(dark)], repair=False)
    r, g, b = RED
    return Stimulus("ball", radius_m, (Part(plain, RED), Part(patches, (0.5 * r, g, b))))
