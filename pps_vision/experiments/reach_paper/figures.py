"""J's figures of the maps: both in gaze space (Figs 4, 7), the Enhanced map on slices (Fig 8, with points C and D of
Fig 3) and on planes through a box of locations (Fig 9).

Figs 5 and 6 show the same of the Basic map and are not drawn: R above 0.5 means reachable.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learning.reach.babbling import Babbled
from learning.reach.labels import Labels
from pps_vision.experiments import charts
from pps_vision.experiments.baselines import jamone
from pps_vision.experiments.baselines.jamone import MapQuery
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

_N_YAWS = 60
_N_VERGENCES = 56
_N_SIDE = 48  # locations along a side of a plane
_N_SPACE = 4000  # gaze postures per panel of gaze space
_MAX_BABBLED = 400
_PITCHES_DEG = (0, -25)
_PITCH_HALF_WIDTH_DEG = 3
_PLANE_HALF_WIDTH_M = 0.02
_BOX = np.array([[-0.10, 0.10], [0.75, 0.95], [0.20, 0.35]])  # J's X, Y, Z, m in the axes of its simulator (Y up)
_SIMULATOR_M = np.array([0.0, 0.5976, -0.026])  # p_sim = (−y, z, −x) of the root frame + this, from its public code
_PLANES = {"seen from above, Y 0.85 m": (0, 2), "seen from the side, X 0 m": (2, 1)}  # horizontal and vertical axis


def sample_planes(maps: Mapping[str, MapQuery], robot: Robot, babbled: Babbled) -> dict[str, Any]:
    """Return the degree R (percent) of each map on slices of gaze space and on planes through J's box."""
    return {
        "slices": {f"pitch {pitch}°": _sample_slice(maps, pitch, babbled) for pitch in _PITCHES_DEG},
        "box": {title: _sample_box(maps, robot, *axes, babbled) for title, axes in _PLANES.items()},
    }


def sample_space(labels: Labels, query: MapQuery, max_error_m: float, rng: np.random.Generator) -> dict[str, Any]:
    """Return gaze postures (degrees), whether they are reachable, and R (percent): training data and map."""
    n = len(labels.gaze_rad)
    some = labels.only(np.isin(np.arange(n), rng.permutation(n)[:_N_SPACE]))
    degree = jamone.degree(some.reachable, some.optimality, some.error_m, max_error_m)
    limits = GazeLimits()
    gaze = rng.uniform(limits.lower, limits.upper, (_N_SPACE, 3))
    predicted = query(gaze)
    return {
        "training data": _space_samples(some.gaze_rad, some.reachable, degree),
        "map": _space_samples(gaze, predicted.reachable, predicted.degree),
    }


def _space_samples(gaze_rad: Array, reachable: Mask, degree: Array) -> dict[str, Any]:
    return {
        "gaze_deg": np.rad2deg(gaze_rad).round(1).tolist(),
        "reachable": reachable.astype(int).tolist(),
        "degree": np.round(100 * degree).astype(int).tolist(),
    }


def space(samples: dict[str, Any]) -> Figure:
    """Draw Basic and Enhanced map over yaw, pitch and vergence: training data left, map right (J Figs 4, 7)."""
    figure = Figure((8.6, 7.6), layout="constrained")
    style = {"cmap": "RdYlBu", "vmin": 0, "vmax": 1, "linewidths": 0, "depthshade": False}
    panels = [
        (f"{title}: {source}", points, np.array(points[key]) / scale)
        for title, key, scale in (("Basic map (J Fig 4)", "reachable", 1), ("Enhanced map (J Fig 7)", "degree", 100))
        for source, points in samples.items()
    ]
    for k, (title, points, value) in enumerate(panels):
        axis = figure.add_subplot(2, 2, k + 1, projection="3d")
        gaze = np.array(points["gaze_deg"])
        reachable = np.array(points["reachable"], dtype=bool)
        axis.scatter(*gaze[~reachable].T, c=value[~reachable], s=2.5, alpha=0.4, **style)
        image = axis.scatter(*gaze[reachable].T, c=value[reachable], s=8, alpha=0.9, **style)
        axis.set(xlabel="neck yaw (°)", ylabel="neck pitch (°)", zlabel="vergence (°)")
        axis.set_title(title, fontsize=9)
        axis.tick_params(labelsize=7)
        axis.view_init(elev=18, azim=-60)
    figure.colorbar(image, ax=figure.axes, label="reachable (0, 1); degree of reachability R", shrink=0.5, pad=0.08)
    return figure


def slices(samples: dict[str, Any], extremes: Mapping[str, Mapping[str, float]]) -> Figure:
    """Draw R over yaw and vergence; line: true border; dots: babbled postures; C and D of J Fig 3."""
    figure, axes = _draw(samples)
    for axis in axes:
        axis.set(yscale="log")
        axis.set_yticks([5, 10, 20, 40, 80], ["5", "10", "20", "40", "80"])
        axis.minorticks_off()
    for name, point in extremes.items():
        position = (point["yaw_deg"], point["vergence_deg"])
        axes[0].plot(*position, "k^", ms=6)
        label = f"{name}, elbow {point['elbow_deg']:.0f}°"
        axes[0].annotate(label, position, (0, -12), textcoords="offset points", ha="center", fontsize=7)
    figure.supxlabel("neck yaw (°)", fontsize=9)
    figure.supylabel("vergence (°)", fontsize=9)
    return figure


def box(samples: dict[str, Any]) -> Figure:
    """Draw R in J's box of locations; white: cannot be fixated; dots: babbled positions of the hand."""
    figure, axes = _draw(samples)
    for k, axis in enumerate(axes):
        across, up = list(_PLANES.values())[k * len(_PLANES) // len(axes)]
        axis.set(xlabel=f"{'XYZ'[across]} (m, simulator)", ylabel=f"{'XYZ'[up]} (m)")
    return figure


def to_simulator(points_root: Array) -> Array:
    """Return points (N, 3) of the root frame in the axes of J's simulator, m."""
    x, y, z = points_root.T
    return np.stack([-y, z, -x], axis=1) + _SIMULATOR_M


def to_root(points_simulator: Array) -> Array:
    """Return the inverse of `to_simulator`."""
    x, y, z = (points_simulator - _SIMULATOR_M).T
    return np.stack([-z, -x, y], axis=1)


def _sample_slice(maps: Mapping[str, MapQuery], pitch_deg: float, babbled: Babbled) -> dict[str, Any]:
    """Samples over yaws and vergences of one pitch, in degrees."""
    limits = GazeLimits()
    yaw = np.linspace(*limits.yaw_rad, _N_YAWS)
    vergence = np.geomspace(*limits.vergence_rad, _N_VERGENCES)
    vergences, yaws = np.meshgrid(vergence, yaw, indexing="ij")
    grid = np.stack([yaws, np.full_like(yaws, np.deg2rad(pitch_deg)), vergences], axis=-1).reshape(-1, 3)
    gaze_deg = np.rad2deg(babbled.gaze_rad)
    near = np.abs(gaze_deg[:, 1] - pitch_deg) <= _PITCH_HALF_WIDTH_DEG
    gaze = grid.clip(limits.lower, limits.upper)  # geomspace rounds
    return _sample(maps, np.rad2deg(yaw), np.rad2deg(vergence), gaze, gaze_deg[near][:, [0, 2]])


def _sample_box(maps: Mapping[str, MapQuery], robot: Robot, across: int, up: int, babbled: Babbled) -> dict[str, Any]:
    """Samples on a plane through the middle of J's box, spanned by two axes of the simulator, m."""
    x, y = (np.linspace(low, high, _N_SIDE) for low, high in _BOX[[across, up]])
    points = np.tile(_BOX.mean(axis=1), (_N_SIDE**2, 1))
    points[:, across], points[:, up] = (values.ravel() for values in np.meshgrid(x, y))
    hands = to_simulator(fixation_points(robot, babbled.gaze_rad))
    normal = 3 - across - up
    near = np.abs(hands[:, normal] - _BOX[normal].mean()) <= _PLANE_HALF_WIDTH_M
    near &= ((hands >= _BOX[:, 0]) & (hands <= _BOX[:, 1]))[:, [across, up]].all(axis=1)
    return _sample(maps, x, y, gaze_for_points(robot, to_root(points)), hands[near][:, [across, up]])


def _sample(maps: Mapping[str, MapQuery], x: Array, y: Array, gaze_rad: Array, babbled: Array) -> dict[str, Any]:
    """R (percent) of each map over x (w,) and y (h,), whose gaze (h·w, 3) is NaN where a location cannot be fixated."""
    fixated = np.isfinite(gaze_rad[:, 0])
    grids = {}
    for name, query in maps.items():
        percent = np.full(len(fixated), np.nan)
        percent[fixated] = 100 * query(gaze_rad[fixated]).degree
        rows = percent.reshape(len(y), len(x)).tolist()
        grids[name] = [[None if np.isnan(value) else round(value) for value in row] for row in rows]
    axes = {"x": x.round(3).tolist(), "y": y.round(3).tolist()}
    return {**axes, "grids": grids, "babbled": babbled[:_MAX_BABBLED].round(3).tolist()}


def _draw(planes: dict[str, Any]) -> tuple[Figure, list[Axes]]:
    """Draw a row of panels per plane, a panel per map; the first map is the truth."""
    panels = [(title, plane, name) for title, plane in planes.items() for name in plane["grids"]]
    figure, axes = charts.panels(len(panels), len(panels) // len(planes), 3.4, 3.1)
    for axis, (title, plane, name) in zip(axes, panels, strict=True):
        grids = {key: np.array(percent, dtype=float) / 100 for key, percent in plane["grids"].items()}
        truth = next(iter(grids.values()))
        image = axis.pcolormesh(plane["x"], plane["y"], grids[name], vmin=0, vmax=1, cmap="RdYlBu", shading="nearest")
        if np.nanmin(truth) < 0.5 < np.nanmax(truth):
            axis.contour(plane["x"], plane["y"], truth, levels=[0.5], colors="0.1", linewidths=1)
        points = np.array(plane["babbled"], dtype=float).reshape(-1, 2)
        axis.plot(*points.T, ".", color="white", ms=2.5, mec="0.3", mew=0.2)
        axis.set(xlim=(plane["x"][0], plane["x"][-1]), ylim=(plane["y"][0], plane["y"][-1]))
        axis.set_title(f"{name}\n{title}", fontsize=8)
        axis.tick_params(labelsize=7)
    figure.colorbar(image, ax=axes, label="degree of reachability R (reachable above 0.5)", shrink=0.8)
    return figure, axes
