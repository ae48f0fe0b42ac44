"""What J shows of the maps: both in gaze space (Figs 4, 7); the Enhanced one on slices of it, with babbled postures and
points C and D of Fig 3 (Fig 8), and on planes through a box of locations (Fig 9).

Figs 5 and 6, the same of the Basic map, are not drawn: R above 0.5 means reachable.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from learning.reach.babbling import Babbled
from learning.reach.labels import Labels
from pps_vision.experiments import charts
from pps_vision.experiments.reach import jamone
from pps_vision.experiments.reach.jamone import MapQuery
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.model import Robot
from pps_vision.types import Array

N_YAWS, N_VERGENCES, N_SIDE = 60, 56, 48
_PITCHES_DEG, _PITCH_HALF_WIDTH_DEG, _PLANE_HALF_WIDTH_M = (0, -25), 3, 0.02
_BOX = np.array([[-0.10, 0.10], [0.75, 0.95], [0.20, 0.35]])  # J's X, Y, Z, m in the axes of its simulator (Y up)
_SIMULATOR_M = np.array([0.0, 0.5976, -0.026])  # p_sim = (−y, z, −x) of the root frame + this, from its public code
_PLANES = {"seen from above, Y 0.85 m": (0, 2), "seen from the side, X 0 m": (2, 1)}
_MOST_POINTS = 400
_N_SPACE = 4000  # gaze postures drawn of each panel of gaze space


class View(NamedTuple):
    """A plane that a map is drawn on."""

    x: Array
    """(w,) values of the horizontal axis."""
    y: Array
    """(h,) values of the vertical axis."""
    gaze_rad: Array
    """(h·w, 3) gaze postures, NaN where a location cannot be fixated."""
    babbled: Array
    """(N, 2) babbled postures near the plane."""


def sample(maps: Mapping[str, MapQuery], robot: Robot, babbled: Babbled) -> dict[str, Any]:
    """Return the degree R of each map, percent, on slices and planes; the first map is the truth."""
    planes = {title: _plane(robot, *axes, babbled) for title, axes in _PLANES.items()}
    return {
        "slices": sample_slices(maps, babbled),
        "planes": {title: _sampled(maps, view) for title, view in planes.items()},
    }


def sample_slices(maps: Mapping[str, MapQuery], babbled: Babbled | None = None) -> dict[str, Any]:
    """Return the degree R of each map, percent, on slices of gaze space; the first map is the truth."""
    babbled = babbled or Babbled(np.zeros((0, 4)), np.zeros((0, 3)), 0)
    return {f"pitch {pitch}°": _sampled(maps, _slice(pitch, babbled)) for pitch in _PITCHES_DEG}


def sample_space(labels: Labels, query: MapQuery, max_error_m: float, rng: np.random.Generator) -> dict[str, Any]:
    """Return gaze postures (degrees), whether they are reachable and R (percent): of the training data and the map."""
    chosen = np.zeros(len(labels.gaze_rad), dtype=bool)
    chosen[rng.permutation(len(chosen))[:_N_SPACE]] = True
    some = labels.only(chosen)
    degree = jamone.degree(some.reachable, some.optimality, some.error_m, max_error_m)
    limits = GazeLimits()
    gaze = rng.uniform(limits.lower, limits.upper, (_N_SPACE, 3))
    said = query(gaze)
    found = {"training data": (some.gaze_rad, some.reachable, degree), "map": (gaze, said.reachable, said.degree)}
    return {
        name: {
            "gaze_deg": np.rad2deg(at).round(1).tolist(),
            "reachable": reachable.astype(int).tolist(),
            "degree": np.round(100 * R).astype(int).tolist(),
        }
        for name, (at, reachable, R) in found.items()
    }


def space(drawn: dict[str, Any]) -> Figure:
    """Draw Basic and Enhanced map over yaw, pitch and vergence: training data left, map right (J Figs 4, 7)."""
    figure = Figure((8.6, 7.6), layout="constrained")
    colours = {"Basic map (J Fig 4)": "reachable", "Enhanced map (J Fig 7)": "degree"}
    for row, (title, key) in enumerate(colours.items()):
        for column, (source, points) in enumerate(drawn.items()):
            axis = figure.add_subplot(2, 2, 2 * row + column + 1, projection="3d")
            at, reachable = np.array(points["gaze_deg"]), np.array(points["reachable"], dtype=bool)
            value = np.array(points[key]) / (100 if key == "degree" else 1)
            style = {"cmap": "RdYlBu", "vmin": 0, "vmax": 1, "linewidths": 0, "depthshade": False}
            axis.scatter(*at[~reachable].T, c=value[~reachable], s=2.5, alpha=0.4, **style)
            image = axis.scatter(*at[reachable].T, c=value[reachable], s=8, alpha=0.9, **style)
            axis.set(xlabel="neck yaw (°)", ylabel="neck pitch (°)", zlabel="vergence (°)")
            axis.set_title(f"{title}: {source}", fontsize=9)
            axis.tick_params(labelsize=7)
            axis.view_init(elev=18, azim=-60)
    figure.colorbar(image, ax=figure.axes, label="reachable (0, 1); degree of reachability R", shrink=0.5, pad=0.08)
    return figure


def slices(drawn: dict[str, Any], extremes: Mapping[str, Mapping[str, float]]) -> Figure:
    """Draw R over yaw and vergence; line: true border; dots: babbled postures; C and D of J Fig 3."""
    figure, axes = _draw(drawn)
    for axis in axes:
        axis.set(yscale="log")
        axis.set_yticks([5, 10, 20, 40, 80], ["5", "10", "20", "40", "80"])
        axis.minorticks_off()
    for name, at in extremes.items():
        place = at["yaw_deg"], at["vergence_deg"]
        axes[0].plot(*place, "k^", ms=6)
        label, left = f"{name}, elbow {at['elbow_deg']:.0f}°", at["yaw_deg"] < 0
        offset, side = ((6, -10), "left") if left else ((-6, -12), "right")
        axes[0].annotate(label, place, offset, textcoords="offset points", ha=side, fontsize=7)
    figure.supxlabel("neck yaw (°)", fontsize=9)
    figure.supylabel("vergence (°)", fontsize=9)
    return figure


def box(drawn: dict[str, Any]) -> Figure:
    """Draw R in J's box of locations; white: cannot be fixated; dots: where babbling had the hand."""
    figure, axes = _draw(drawn["planes"])
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


def _slice(pitch_deg: float, babbled: Babbled) -> View:
    """Return the yaws and vergences of one pitch, in degrees."""
    limits = GazeLimits()
    yaw, vergence = np.linspace(*limits.yaw_rad, N_YAWS), np.geomspace(*limits.vergence_rad, N_VERGENCES)
    grid = np.stack(np.meshgrid(yaw, np.deg2rad(pitch_deg), vergence, indexing="ij"), axis=-1)[:, 0]
    gaze = grid.swapaxes(0, 1).reshape(-1, 3).clip(limits.lower, limits.upper)  # geomspace rounds
    gaze_deg = np.rad2deg(babbled.gaze_rad)
    near = np.abs(gaze_deg[:, 1] - pitch_deg) <= _PITCH_HALF_WIDTH_DEG
    return View(np.rad2deg(yaw), np.rad2deg(vergence), gaze, gaze_deg[near][:, [0, 2]])


def _plane(robot: Robot, across: int, up: int, babbled: Babbled) -> View:
    """Return a plane through the middle of J's box, spanned by two axes of the simulator, m."""
    x, y = (np.linspace(low, high, N_SIDE) for low, high in _BOX[[across, up]])
    points = np.tile(_BOX.mean(axis=1), (N_SIDE**2, 1))
    points[:, across], points[:, up] = (values.ravel() for values in np.meshgrid(x, y))
    hands, normal = to_simulator(fixation_points(robot, babbled.gaze_rad)), 3 - across - up
    near = np.abs(hands[:, normal] - _BOX[normal].mean()) <= _PLANE_HALF_WIDTH_M
    near &= ((hands >= _BOX[:, 0]) & (hands <= _BOX[:, 1]))[:, [across, up]].all(axis=1)
    return View(x, y, gaze_for_points(robot, to_root(points)), hands[near][:, [across, up]])


def _sampled(maps: Mapping[str, MapQuery], view: View) -> dict[str, Any]:
    fixated, grids = np.isfinite(view.gaze_rad[:, 0]), {}
    for name, query in maps.items():
        percent = np.full(len(fixated), np.nan)
        percent[fixated] = 100 * query(view.gaze_rad[fixated]).degree
        rows = percent.reshape(len(view.y), len(view.x)).tolist()
        grids[name] = [[None if np.isnan(value) else round(value) for value in row] for row in rows]
    axes = {"x": view.x.round(3).tolist(), "y": view.y.round(3).tolist()}
    return {**axes, "grids": grids, "babbled": view.babbled[:_MOST_POINTS].round(3).tolist()}


def _draw(views: dict[str, Any]) -> tuple[Figure, list[Any]]:
    """Draw a row of panels per view, a panel per map."""
    n = len(next(iter(views.values()))["grids"])
    figure, axes = charts.panels(n * len(views), n, 3.4, 3.1)
    panels = [(title, view, name) for title, view in views.items() for name in view["grids"]]
    for axis, (title, view, name) in zip(axes, panels, strict=True):
        grids = {key: np.array(percent, dtype=float) / 100 for key, percent in view["grids"].items()}
        grid, truth = grids[name], next(iter(grids.values()))
        image = axis.pcolormesh(view["x"], view["y"], grid, vmin=0, vmax=1, cmap="RdYlBu", shading="nearest")
        if np.nanmin(truth) < 0.5 < np.nanmax(truth):
            axis.contour(view["x"], view["y"], truth, levels=[0.5], colors="0.1", linewidths=1)
        points = np.array(view["babbled"], dtype=float).reshape(-1, 2)
        axis.plot(*points.T, ".", color="white", ms=2.5, mec="0.3", mew=0.2)
        axis.set(xlim=(view["x"][0], view["x"][-1]), ylim=(view["y"][0], view["y"][-1]))
        axis.set_title(f"{name}\n{title}", fontsize=8)
        axis.tick_params(labelsize=7)
    figure.colorbar(image, ax=axes, label="degree of reachability R (reachable above 0.5)", shrink=0.8)
    return figure, axes
