"""What J shows of the maps (Figs 3, 5, 6, 8, 9): slices of gaze space, and the box of Cartesian locations."""

from collections.abc import Callable, Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learning.reach.babbling import Babbled
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

_PITCHES_DEG, _BAND_DEG = (0, -25), 3
_YAWS, _VERGENCES, _SIDE = 60, 56, 48
# J's box in the simulator's axes (FACTS §6): its three ranges in m, and a plane through the middle of one of them
_BOX = {"X": (-0.10, 0.10), "Y": (0.75, 0.95), "Z": (0.20, 0.35)}
_PLANES = {"seen from above, Y 0.85 m": ("X", "Z"), "seen from the side, X 0 m": ("Z", "Y")}

Query = Callable[[Array], tuple[Mask, Array]]


def measured(queries: Mapping[str, Query], robot: Robot, babbled: Babbled) -> dict[str, Any]:
    """The degrees each query gives on slices and planes, in percent, a line of text a row; "-" where there is none."""
    reached = fixation_points(robot, babbled.gaze_rad)
    return {
        "slices": {
            f"pitch {pitch}°": {
                **{name: _lines(query(_slice(pitch))[1], _YAWS) for name, query in queries.items()},
                "babbled": _near(np.rad2deg(babbled.gaze_rad), 1, pitch, _BAND_DEG, (0, 2)),
            }
            for pitch in _PITCHES_DEG
        },
        "planes": {
            plane: {
                **{name: _lines(_fixated(query, robot, _plane(axes)), _SIDE) for name, query in queries.items()},
                "babbled": _near(_simulator(reached), *_through(axes), tuple("XYZ".index(a) for a in axes)),
            }
            for plane, axes in _PLANES.items()
        },
    }


def slices(drawn: dict[str, Any], extremes: dict[str, dict[str, float]]) -> Figure:
    """Degree over yaw and vergence; the line: the border; points: babbled postures; C and D of J Fig 3."""
    limits, (yaw, vergence) = GazeLimits(), _gaze_axes()
    figure, rows = _panels(drawn["slices"])
    for row, (title, panels) in zip(rows, drawn["slices"].items(), strict=True):
        image = _row(row, title, panels, np.rad2deg(yaw), np.rad2deg(vergence))
        for axis in row:
            axis.set(yscale="log", xlim=np.rad2deg(limits.yaw_rad), ylim=np.rad2deg(limits.vergence_rad))
            axis.set_yticks([5, 10, 20, 40, 80], ["5", "10", "20", "40", "80"])
            axis.minorticks_off()
    for name, at in extremes.items():
        rows[0][0].plot(at["yaw_deg"], at["vergence_deg"], "k^", ms=6)
        label = f"{name}, elbow {at['elbow_deg']:.0f}°"
        place = at["yaw_deg"], at["vergence_deg"]
        side, offset = ("left", (6, -10)) if at["yaw_deg"] < 0 else ("right", (-6, -12))
        rows[0][0].annotate(label, place, offset, textcoords="offset points", ha=side, fontsize=7)
    figure.colorbar(image, ax=rows, label="degree of reachability R (reachable above 0.5)", shrink=0.8)
    figure.supxlabel("neck yaw (°)", fontsize=9)
    figure.supylabel("vergence (°)", fontsize=9)
    return figure


def box(drawn: dict[str, Any]) -> Figure:
    """Degree in J's box of locations; white: cannot be fixated; points: where babbling had the hand."""
    figure, rows = _panels(drawn["planes"])
    for row, (title, panels) in zip(rows, drawn["planes"].items(), strict=True):
        across, up = _PLANES[title]
        image = _row(row, title, panels, *(_axis(name) for name in (across, up)))
        for axis in row:
            axis.set(xlim=_BOX[across], ylim=_BOX[up])
            axis.set_xlabel(f"{across} (m, simulator)", fontsize=8)
            axis.tick_params(labelsize=7)
        row[0].set_ylabel(f"{title}\n{up} (m)", fontsize=8)
    figure.colorbar(image, ax=rows, label="degree of reachability R (reachable above 0.5)", shrink=0.8)
    return figure


def _panels(groups: dict[str, Any]) -> tuple[Figure, Any]:
    n = len(next(iter(groups.values()))) - 1
    return plt.subplots(len(groups), n, figsize=(3.4 * n + 1, 3.1 * len(groups)), squeeze=False, layout="constrained")


def _row(row: Any, title: str, panels: dict[str, Any], x: Array, y: Array) -> Any:
    """One slice, a panel a map, the true border drawn into all."""
    grids = {name: _numbers(lines) for name, lines in panels.items() if name != "babbled"}
    truth = next(iter(grids.values()))
    image = None
    for k, (axis, (name, grid)) in enumerate(zip(row, grids.items(), strict=True)):
        image = axis.pcolormesh(x, y, grid, vmin=0, vmax=1, cmap="RdYlBu", shading="nearest")
        _border(axis, x, y, truth, "0.1")
        axis.set_title(name, fontsize=9)
        points = np.array(panels["babbled"], dtype=float).reshape(-1, 2)
        axis.plot(*points.T, ".", color="white", ms=2.5, mec="0.3", mew=0.2)
        if k == 0:
            axis.set_ylabel(title, fontsize=9)
    return image


def _border(axis: Axes, x: Array, y: Array, degree: Array, color: str) -> None:
    if np.nanmin(degree) < 0.5 < np.nanmax(degree):
        axis.contour(x, y, degree, levels=[0.5], colors=color, linewidths=1)


def _gaze_axes() -> tuple[Array, Array]:
    limits = GazeLimits()
    return np.linspace(*limits.yaw_rad, _YAWS), np.geomspace(*limits.vergence_rad, _VERGENCES)


def _slice(pitch_deg: float) -> Array:
    """(rows of vergence × yaw, 3) gaze postures of one pitch."""
    vergence, yaw = np.meshgrid(*_gaze_axes()[::-1], indexing="ij")
    # the last place of the limits is theirs, whatever the rounding of geomspace
    upright = np.full(yaw.size, np.deg2rad(pitch_deg))
    gaze = np.stack([yaw.ravel(), upright, vergence.ravel()], axis=1)
    return np.clip(gaze, GazeLimits().lower, GazeLimits().upper)


def _axis(name: str) -> Array:
    return np.linspace(*_BOX[name], _SIDE)


def _plane(axes: tuple[str, str]) -> Array:
    """(rows of the second axis × first, 3) simulator coordinates on a plane through the middle of the third."""
    up, across = np.meshgrid(_axis(axes[1]), _axis(axes[0]), indexing="ij")
    _, middle, _ = _through(axes)
    at = np.full((up.size, 3), middle)
    at[:, "XYZ".index(axes[0])], at[:, "XYZ".index(axes[1])] = across.ravel(), up.ravel()
    return at


def _through(axes: tuple[str, str]) -> tuple[int, float, float]:
    """The third axis, the middle of its range, and how far from that a babbled point still counts (m)."""
    third = next(name for name in "XYZ" if name not in axes)
    return "XYZ".index(third), float(np.mean(_BOX[third])), 0.02


def _near(points: Array, axis: int, at: float, within: float, shown: tuple[int, ...]) -> list[list[float]]:
    """Those of points (N, 3) near a plane, their two other coordinates."""
    near = np.abs(points[:, axis] - at) <= within
    return [[round(float(v), 4) for v in row] for row in points[near][:, shown]][:400]


def _simulator(points_root: Array) -> Array:
    """Root frame → the simulator's world (FACTS §6)."""
    x, y, z = points_root.T
    return np.stack([-y, z + 0.5976, -x - 0.026], axis=1)


def _fixated(query: Query, robot: Robot, simulator: Array) -> Array:
    """Degrees at locations (N, 3); NaN where they cannot be fixated."""
    x, y, z = simulator.T
    gaze = gaze_for_points(robot, np.stack([-z - 0.026, -x, y - 0.5976], axis=1))
    seen = np.isfinite(gaze[:, 0])
    degree = np.full(len(gaze), np.nan)
    degree[seen] = query(gaze[seen])[1]
    return degree


def _lines(degree: Array, width: int) -> list[str]:
    rows = degree.reshape(-1, width)
    return [" ".join("-" if np.isnan(v) else f"{100 * v:.0f}" for v in row) for row in rows]


def _numbers(lines: list[str]) -> Array:
    return np.array([[np.nan if v == "-" else int(v) / 100 for v in line.split()] for line in lines])
