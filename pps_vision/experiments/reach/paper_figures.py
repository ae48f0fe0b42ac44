"""What J shows of the maps (Figs 3, 5, 6, 8, 9): slices of gaze space, and its box of Cartesian locations."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from learning.reach.babbling import Babbled
from pps_vision.experiments import charts
from pps_vision.experiments.reach.jamone import MapQuery
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.model import Robot
from pps_vision.types import Array

N_YAWS, N_VERGENCES, N_SIDE = 60, 56, 48
_PITCHES_DEG, _SLICE_HALF_WIDTH_DEG = (0, -25), 3
_BOX = {"X": (-0.10, 0.10), "Y": (0.75, 0.95), "Z": (0.20, 0.35)}  # J's, m in the axes of its simulator (Y up)
_SIMULATOR_M = np.array([0.0, 0.5976, -0.026])  # p_sim = (−y, z, −x) of the root frame + this, from its public code
_PLANES = {"seen from above, Y 0.85 m": ("X", "Z"), "seen from the side, X 0 m": ("Z", "Y")}
_PLANE_HALF_WIDTH_M = 0.02
_MOST_POINTS = 400


def sample(maps: Mapping[str, MapQuery], robot: Robot, babbled: Babbled) -> dict[str, Any]:
    """Return the degrees R of each map on slices and planes, percent, with the babbled postures near them.

    A grid is a text per row, "-" where a location cannot be fixated; the first map is the truth.
    """
    hands = _to_simulator(fixation_points(robot, babbled.gaze_rad))
    gaze_deg = np.rad2deg(babbled.gaze_rad)
    slices = {}
    for pitch in _PITCHES_DEG:
        grids = {name: to_text(query(_slice(pitch)).degree, N_YAWS) for name, query in maps.items()}
        near = np.abs(gaze_deg[:, 1] - pitch) <= _SLICE_HALF_WIDTH_DEG
        slices[f"pitch {pitch}°"] = {"grids": grids, "babbled": _points(gaze_deg[near][:, [0, 2]])}
    planes = {}
    for plane, axes in _PLANES.items():
        gaze = gaze_for_points(robot, _to_root(_plane(axes)))
        fixated = np.isfinite(gaze[:, 0])
        grids = {}
        for name, query in maps.items():
            degree = np.full(len(gaze), np.nan)
            degree[fixated] = query(gaze[fixated]).degree
            grids[name] = to_text(degree, N_SIDE)
        third = _third(axes)
        near = np.abs(hands[:, "XYZ".index(third)] - np.mean(_BOX[third])) <= _PLANE_HALF_WIDTH_M
        planes[plane] = {"grids": grids, "babbled": _points(hands[near][:, ["XYZ".index(axis) for axis in axes]])}
    return {"slices": slices, "planes": planes}


def slices(drawn: dict[str, Any], extremes: dict[str, dict[str, float]]) -> Figure:
    """Draw R over yaw and vergence; line: true border; dots: babbled postures; C and D of J Fig 3."""
    limits = GazeLimits()
    x, y = (np.rad2deg(values) for values in _gaze_axes())
    figure, rows = _draw(drawn["slices"], dict.fromkeys(drawn["slices"], (x, y)))
    for axis in (axis for row in rows for axis in row):
        axis.set(yscale="log", xlim=np.rad2deg(limits.yaw_rad), ylim=np.rad2deg(limits.vergence_rad))
        axis.set_yticks([5, 10, 20, 40, 80], ["5", "10", "20", "40", "80"])
        axis.minorticks_off()
    for name, at in extremes.items():
        place = at["yaw_deg"], at["vergence_deg"]
        rows[0][0].plot(*place, "k^", ms=6)
        label, left = f"{name}, elbow {at['elbow_deg']:.0f}°", at["yaw_deg"] < 0
        offset, side = ((6, -10), "left") if left else ((-6, -12), "right")
        rows[0][0].annotate(label, place, offset, textcoords="offset points", ha=side, fontsize=7)
    figure.supxlabel("neck yaw (°)", fontsize=9)
    figure.supylabel("vergence (°)", fontsize=9)
    return figure


def box(drawn: dict[str, Any]) -> Figure:
    """Draw R in J's box of locations; white: cannot be fixated; dots: where babbling had the hand."""
    grids = {title: (_axis(across), _axis(up)) for title, (across, up) in _PLANES.items()}
    figure, rows = _draw(drawn["planes"], grids)
    for row, (across, up) in zip(rows, _PLANES.values(), strict=True):
        for axis in row:
            axis.set(xlim=_BOX[across], ylim=_BOX[up], xlabel=f"{across} (m, simulator)", ylabel=f"{up} (m)")
    return figure


def _draw(groups: dict[str, Any], axes: dict[str, tuple[Array, Array]]) -> tuple[Figure, list[list[Any]]]:
    """Draw a row of panels per slice, a panel per map."""
    n = len(next(iter(groups.values()))["grids"])
    figure, flat = charts.panels(n * len(groups), n, 3.4, 3.1)
    rows = [flat[k : k + n] for k in range(0, len(flat), n)]
    for row, (title, group) in zip(rows, groups.items(), strict=True):
        x, y = axes[title]
        grids = {name: from_text(text) for name, text in group["grids"].items()}
        truth = next(iter(grids.values()))
        for axis, (name, grid) in zip(row, grids.items(), strict=True):
            image = axis.pcolormesh(x, y, grid, vmin=0, vmax=1, cmap="RdYlBu", shading="nearest")
            if np.nanmin(truth) < 0.5 < np.nanmax(truth):
                axis.contour(x, y, truth, levels=[0.5], colors="0.1", linewidths=1)
            points = np.array(group["babbled"], dtype=float).reshape(-1, 2)
            axis.plot(*points.T, ".", color="white", ms=2.5, mec="0.3", mew=0.2)
            axis.set_title(f"{name}\n{title}", fontsize=8)
            axis.tick_params(labelsize=7)
    figure.colorbar(image, ax=flat, label="degree of reachability R (reachable above 0.5)", shrink=0.8)
    return figure, rows


def _gaze_axes() -> tuple[Array, Array]:
    limits = GazeLimits()
    return np.linspace(*limits.yaw_rad, N_YAWS), np.geomspace(*limits.vergence_rad, N_VERGENCES)


def _slice(pitch_deg: float) -> Array:
    """Return (vergences × yaws, 3) gaze postures of one pitch, clipped against the rounding of `geomspace`."""
    yaw, vergence = np.meshgrid(*_gaze_axes())
    gaze = np.stack([yaw.ravel(), np.full(yaw.size, np.deg2rad(pitch_deg)), vergence.ravel()], axis=1)
    return np.clip(gaze, GazeLimits().lower, GazeLimits().upper)


def _axis(name: str) -> Array:
    return np.linspace(*_BOX[name], N_SIDE)


def _third(axes: tuple[str, str]) -> str:
    return next(name for name in _BOX if name not in axes)


def _plane(axes: tuple[str, str]) -> Array:
    """Return (rows of the second axis × first, 3) simulator coordinates on a plane through the middle of the third."""
    grid = dict(zip(axes, (values.ravel() for values in np.meshgrid(_axis(axes[0]), _axis(axes[1]))), strict=True))
    third = _third(axes)
    grid[third] = np.full(N_SIDE**2, np.mean(_BOX[third]))
    return np.stack([grid[name] for name in "XYZ"], axis=1)


def _to_simulator(points_root: Array) -> Array:
    x, y, z = points_root.T
    return np.stack([-y, z, -x], axis=1) + _SIMULATOR_M


def _to_root(points_simulator: Array) -> Array:
    x, y, z = (points_simulator - _SIMULATOR_M).T
    return np.stack([-z, -x, y], axis=1)


def _points(points: Array) -> list[list[float]]:
    found: list[list[float]] = points[:_MOST_POINTS].round(4).tolist()
    return found


def to_text(degree: ArrayLike, width: int) -> list[str]:
    """Return a grid as texts, a number (percent) or "-" per cell."""
    rows = np.asarray(degree, dtype=float).reshape(-1, width)
    return [" ".join("-" if np.isnan(value) else f"{100 * value:.0f}" for value in row) for row in rows]


def from_text(rows: list[str]) -> Array:
    """Return the grid that `to_text` wrote."""
    return np.array([[np.nan if cell == "-" else int(cell) / 100 for cell in row.split()] for row in rows])
