"""Where two rays meet: ours against what libraries offer, with eyes that see equally well and that do not."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np
from kornia.geometry.epipolar import triangulate_points
from matplotlib.figure import Figure
from torch import from_numpy

from pps_vision.experiments.chart import Variant, legend, panels, speed_against_error, timed
from pps_vision.experiments.study import Study
from pps_vision.geometry.camera import StereoRig, StereoView
from pps_vision.geometry.triangulation import midpoint, triangulate
from pps_vision.robot.icub import home, icub_rig, load_icub, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array

DEPTHS_M = (0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 2.0)
VERGENCES_DEG = (0.0, 5.0, 10.0, 20.0, 30.0, 40.0)
VERGENCE_DEPTH_M = 0.3
_MET = 1.3  # times the bound, within which it counts as met
Method = Callable[[StereoView, Array, Array, Array, Array], Array | None]


@dataclass(frozen=True, slots=True)
class _Case:
    """Two noisy pixels (2,) of a point (3,), how well each is known (2, 2), and the bound (m²) that follows."""

    view: StereoView
    p: Array
    pixels: tuple[Array, Array]
    covs: tuple[Array, Array]
    bound_m2: float


@dataclass(frozen=True)
class Triangulation(Study):
    """Error of one point's triangulation, as a multiple of the Cramér–Rao bound, over depth and vergence.

    The eyes see alike (0.1 px), or differ: the left one has 0.5 px along a diagonal (an outline half hidden, a
    blur) and 0.05 px across it.
    """

    n: int = 150
    """Points for each depth, vergence and kind of noise."""
    seed: int = 0
    """Seed of the points and the noise."""

    def run(self) -> dict[str, object]:
        """By method: time, RMS error as a multiple of the bound, in how many cases it finds no point."""
        if self.n < 1:
            raise ValueError(f"bench triangulation: --n {self.n}; expected at least 1")
        rng = np.random.default_rng(self.seed)
        robot = load_icub()
        rig = icub_rig(robot)
        numbers: dict[str, Any] = {
            name: {"ms": [], "depth": {"alike": {}, "differ": {}}, "vergence": {"alike": {}, "differ": {}}}
            for name in METHODS
        }
        for eyes in ("alike", "differ"):
            for depth in DEPTHS_M:
                cases = _cases(robot, rig, depth, None, eyes, self.n, rng)
                _measure(numbers, cases, "depth", eyes, str(depth))
            for vergence in VERGENCES_DEG:
                cases = _cases(robot, rig, VERGENCE_DEPTH_M, vergence, eyes, self.n, rng)
                _measure(numbers, cases, "vergence", eyes, str(vergence))
        return {name: _summary(name, of) for name, of in numbers.items()}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time against error where the eyes differ; error over vergence, alike and differing."""
        figure, axes = panels(2, width=5.6)
        variants = [
            Variant(name, np.array([of["ms"][q] for q in ("q25_ms", "median_ms", "q75_ms")]), of["differ"], ours, ours)
            for name, of in numbers.items()
            for ours in [name == OURS]
        ]
        speed_against_error(axes[0], variants, "point", "3D RMS error / Cramér–Rao bound", ("bound", 1.0))
        axes[0].set(title="One eye sees worse than the other", ylim=(0.8, 1.15 * max(v.error for v in variants)))
        axes[0].margins(x=0.3)
        legend(axes[0])
        for name, of in numbers.items():
            ours = name == OURS
            for eyes, style in (("differ", "-"), ("alike", ":")):
                values = of["vergence"][eyes]
                label = f"{'ours' if ours else 'each of the peers'}, eyes {eyes}" if ours or name == "linear" else None
                color = "tab:blue" if ours else "tab:orange"
                axes[1].plot([float(v) for v in values], list(values.values()), style, color=color, lw=1.5, label=label)
        axes[1].set(
            title=f"From parallel to strongly verged eyes, {VERGENCE_DEPTH_M} m",
            xlabel="vergence (degrees; 0 = parallel)",
            ylabel="3D RMS error / Cramér–Rao bound",
            ylim=axes[0].get_ylim(),
        )
        axes[1].legend(fontsize=7, loc="center right")
        axes[1].grid(alpha=0.25)
        return figure


def _cases(
    robot: Robot,
    rig: StereoRig,
    depth_m: float,
    vergence_deg: float | None,
    eyes: str,
    n: int,
    rng: np.random.Generator,
) -> Iterator[_Case]:
    """Points at a distance from the eyes, which converge there unless their vergence is given."""
    c, s = np.cos(np.pi / 4), np.sin(np.pi / 4)
    diagonal = np.array([[c, -s], [s, c]])
    along = diagonal @ np.diag([0.5**2, 0.05**2]) @ diagonal.T
    covs = (0.01 * np.eye(2), 0.01 * np.eye(2)) if eyes == "alike" else (along, 0.01 * np.eye(2))
    vergence = 2 * np.arctan(0.034 / depth_m) if vergence_deg is None else np.deg2rad(vergence_deg)
    while n:
        yaw, pitch = rng.uniform((-0.5, -0.4), (0.5, 0.1))
        view = rig.view(set_gaze(robot, home(robot), yaw, pitch, vergence=vergence))
        ahead = view.left.T_root_camera[:3, 2] + view.right.T_root_camera[:3, 2] + rng.normal(0, 0.1, 3)
        p = 0.5 * (view.left.center + view.right.center) + depth_m * ahead / np.linalg.norm(ahead)
        exact = view.left.project(p), view.right.project(p)
        bound = triangulate(view, *exact, *covs)
        if view.left.sees(p) and view.right.sees(p) and bound is not None:
            n -= 1
            noisy = [rng.multivariate_normal(px, cov) for px, cov in zip(exact, covs, strict=True)]
            yield _Case(view, p, (noisy[0], noisy[1]), covs, float(np.trace(bound.cov_root)))


def _measure(numbers: dict[str, Any], cases: Iterator[_Case], over: str, eyes: str, where: str) -> None:
    """Every method on every case in turn; what a method does not find is left out and counted."""
    squared: dict[str, list[float]] = {name: [] for name in METHODS}
    bounds: list[float] = []
    names = list(METHODS)
    for case in cases:
        bounds.append(case.bound_m2)
        for k in range(len(names)):  # each in turn the first: it finds the caches cold
            name = names[(len(bounds) + k) % len(names)]
            p, ms = timed(partial(METHODS[name], case.view, *case.pixels, *case.covs))
            numbers[name]["ms"].append(ms)
            squared[name].append(float(np.sum((p - case.p) ** 2)) if p is not None else np.nan)
    for name, errors in squared.items():
        numbers[name][over][eyes][where] = float(np.sqrt(np.nanmean(errors) / np.mean(bounds)))


def _summary(name: str, of: dict[str, Any]) -> dict[str, object]:
    ms = Variant(name, np.array(of.pop("ms")), np.nan).summary()
    del ms["error"]
    mean = {eyes: float(np.mean(list(of["depth"][eyes].values()))) for eyes in ("alike", "differ")}
    return {"ms": ms, **mean, "wrong_where_eyes_differ": mean["differ"] > _MET * max(mean["alike"], 1.0), **of}


def _normalised(view: StereoView, left: Array, right: Array) -> tuple[Array, Array]:
    """Both pixels as an undistorted camera of focal length 1 sees them, (2, 1) each."""
    found = []
    for camera, px in ((view.left.camera, left), (view.right.camera, right)):
        at = cv2.undistortPoints(px.reshape(1, 1, 2), camera.K, np.array(camera.distortion))
        found.append(np.asarray(at, dtype=float).reshape(2, 1))
    return found[0], found[1]


def _linear(view: StereoView, left: Array, right: Array, *_: Array) -> Array | None:
    """OpenCV's direct linear transformation."""
    homogeneous = cv2.triangulatePoints(
        view.left.T_camera_root[:3], view.right.T_camera_root[:3], *_normalised(view, left, right)
    )[:, 0]
    return np.asarray(homogeneous[:3] / homogeneous[3])


def _corrected(view: StereoView, left: Array, right: Array, *_: Array) -> Array | None:
    """OpenCV's optimal correction of the pixels (Hartley and Sturm; both eyes alike), then the linear method."""
    a, b = _normalised(view, left, right)
    T_right_left = view.right.T_camera_root @ view.left.T_root_camera
    x, y, z = T_right_left[:3, 3]
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ T_right_left[:3, :3]
    a2, b2 = cv2.correctMatches(essential, a.reshape(1, 1, 2), b.reshape(1, 1, 2))
    projections = view.left.T_camera_root[:3], view.right.T_camera_root[:3]
    homogeneous = cv2.triangulatePoints(*projections, a2.reshape(2, 1), b2.reshape(2, 1))[:, 0]
    return np.asarray(homogeneous[:3] / homogeneous[3])


def _midpoint(view: StereoView, left: Array, right: Array, *_: Array) -> Array | None:
    """Middle of the shortest way between the rays."""
    return midpoint(view.left.center, view.left.rays(left), view.right.center, view.right.rays(right))


def _kornia(view: StereoView, left: Array, right: Array, *_: Array) -> Array | None:
    """The linear method by singular values, on torch."""
    of_left, of_right = (from_numpy(eye.T_camera_root[None, :3]) for eye in (view.left, view.right))
    a, b = (from_numpy(at.T[None]) for at in _normalised(view, left, right))
    return np.asarray(triangulate_points(of_left, of_right, a, b)[0, 0])


def _ours(view: StereoView, left: Array, right: Array, cov_left: Array, cov_right: Array) -> Array | None:
    found = triangulate(view, left, right, cov_left, cov_right)
    return found.p_root if found else None


OURS = "ours"
METHODS: dict[str, Method] = {
    "linear": _linear,
    "midpoint": _midpoint,
    "correctMatches": _corrected,
    "kornia": _kornia,
    OURS: _ours,
}
