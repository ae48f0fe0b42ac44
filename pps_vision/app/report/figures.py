"""Figures of the demo's report, of `show` and of `reach show`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import ArrayLike

from learning.pps.memory import PPSMemory, activation
from learning.reach.map import ReachableMap
from pps_vision.app.report.page import shade
from pps_vision.app.simulation import EpisodeLog
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.model import Robot
from pps_vision.types import Array, ReachStatus

Range = tuple[float, float]

_R_RANGES: tuple[Range, Range] = ((-0.10, 0.20), (0.0, 3.0))  # D in m and TTC in s (R Fig 5)
_VERGENCES_DEG = (10, 13, 17, 22, 30, 45, 60, 80)
_INK = "0.25"


def landscape(memory: PPSMemory, taxel: int = 0) -> Array:
    """(30, 30) activation of a taxel over the ranges of D and TTC (0–3 s where the memory has no TTC); of an object on
    its way to the taxel, where the memory knows the path."""
    (d0, d1), (t0, t1) = _ranges(memory)
    cell = (np.arange(30) + 0.5) / 30
    D, TTC = np.meshgrid(d0 + (d1 - d0) * cell, t0 + (t1 - t0) * cell, indexing="ij")
    at_taxel = np.where(np.arange(len(memory.taxel_ids)) == taxel, 0.0, np.nan)
    return activation(memory, D[..., None] + at_taxel, TTC[..., None])[..., taxel]


def draw_landscape(
    axis: Axes, expected: ArrayLike, ranges: tuple[Range, Range] = _R_RANGES, smooth: bool = False
) -> AxesImage:
    """Draw a `landscape`; `ranges` of D in m and TTC in s."""
    (d0, d1), (t0, t1) = ranges
    style: dict[str, Any] = {"vmin": 0, "vmax": 1, "cmap": "magma", "interpolation": "bilinear" if smooth else None}
    extent = (100 * d0, 100 * d1, t0, t1)
    return axis.imshow(np.asarray(expected).T, origin="lower", aspect="auto", extent=extent, **style)


def landscapes(memory: PPSMemory, taxels: Sequence[int] | None = None) -> Figure:
    """Probability of touch over distance D and time to contact TTC, one panel for each taxel."""
    chosen = list(range(len(memory.taxel_ids))) if taxels is None else list(taxels)
    figure, axes = _panels(len(chosen), 4, (2.6, 2.2))
    for axis, taxel in zip(axes, chosen, strict=True):
        image = draw_landscape(axis, landscape(memory, taxel), _ranges(memory), smooth=True)
        samples = int(memory.counts[taxel].sum())
        axis.set_title(f"{memory.taxel_ids[taxel]}  ({samples} samples)", fontsize=8)
        if samples == 0:
            axis.text(0.5, 0.5, "never stimulated", transform=axis.transAxes, ha="center", color="w", fontsize=8)
        if axis is axes[-1]:
            figure.colorbar(image, ax=axes, label="probability of touch", shrink=0.8)
    figure.supxlabel("distance D (cm)", fontsize=9)
    figure.supylabel("time to contact TTC (s)", fontsize=9)
    return figure


def episodes(logs: Sequence[EpisodeLog], threshold: float) -> Figure:
    """Distance and activation of every taxel and commanded speed over time, as R Fig 10; and reachability, if known."""
    labels = [
        "gap to each taxel (cm)\n2 cm is a touch",
        f"activation of each taxel\n(arm reacts above {threshold:g})",
        "speed of the arm\ncommanded (cm/s)",
        "degree of reach R\n(reachable above 0.5)",
    ][: 4 if all(log.reachability for log in logs) else 3]
    limits = ((0, 30), (-0.03, 1.03), (None, None), (0, 1))
    figure = Figure(figsize=(3.4 * len(logs), 0.2 + 2 * len(labels)), layout="constrained")
    axes = figure.subplots(len(labels), len(logs), sharex="col", sharey="row", squeeze=False)
    for (gap, activity, speed, *reach), log in zip(axes.T, logs, strict=True):
        t = log.stamps_s - log.stamps_s[0]
        for i, color in enumerate(colormaps["viridis"](np.linspace(0, 0.9, len(log.taxel_ids)))):
            gap.plot(t, 100 * log.surface_gap_m[:, i], color=color, lw=1)
            activity.plot(t, log.activations[:, i], color=color, lw=1)
        speed.plot(t, 100 * log.speed_m_s, color="tab:blue", lw=1.4)
        for axis in reach:
            axis.plot(t, [reach.degree for reach in log.reachability], color=_INK, lw=1.4)
            status = np.array([reach.status for reach in log.reachability])
            shade(axis, t, status == ReachStatus.REACHABLE, "tab:green")
            shade(axis, t, status == ReachStatus.UNREACHABLE, "0.6")
            axis.axhline(0.5, color=_INK, lw=1, ls="--")
        for axis in (gap, activity, speed, *reach):
            shade(axis, t, log.touched.any(axis=1), "tab:red")
            axis.grid(alpha=0.25)
        gap.axhline(2, color="tab:red", lw=1, ls="--")
        activity.axhline(threshold, color=_INK, lw=1, ls="--")
        gap.set_title(log.title, fontsize=10)
    for axis in axes[-1]:
        axis.set_xlabel("time (s)")
    for axis, label, limit in zip(axes[:, 0], labels, limits, strict=False):
        axis.set(ylabel=label, ylim=limit)
    return figure


def path(log: EpisodeLog) -> Figure:
    """The tracked path with ±2σ and the true one, coordinate by coordinate, and the 3D error."""
    figure = Figure(figsize=(7.2, 7.2), layout="constrained")
    axes = figure.subplots(4, 1, sharex=True)
    t = log.stamps_s - log.stamps_s[0]
    for k, name in enumerate("xyz"):
        track = 100 * log.track_m[:, k]
        band = 200 * log.track_std_m[:, k]
        axes[k].fill_between(t, track - band, track + band, color="tab:blue", alpha=0.25, lw=0, label="tracked ± 2σ")
        axes[k].plot(t, track, color="tab:blue", lw=1.2)
        axes[k].plot(t, 100 * log.truth_m[:, k], color="k", lw=1, ls=":", label="truth")
        axes[k].set_ylabel(f"{name} (cm)")
    axes[3].plot(t, 1000 * np.linalg.norm(log.track_m - log.truth_m, axis=1), color="tab:red", lw=1.2)
    axes[3].set(ylabel="3D error (mm)", ylim=(0, None), xlabel="time (s)")
    axes[0].legend(loc="best", fontsize=8)
    axes[0].set_title(log.title, fontsize=10)
    for axis in axes:
        axis.grid(alpha=0.25)
    return figure


def reachable_space(reachable_map: ReachableMap, robot: Robot) -> Figure:
    """Degree of reachability over yaw and pitch at several vergences, with its border at 0.5 (as J Figs 5 and 8)."""
    limits = reachable_map.limits
    yaw, pitch = (np.linspace(*ends, 120) for ends in (limits.yaw_rad, limits.pitch_rad))
    Y, P = np.meshgrid(yaw, pitch)
    shown = [v for v in _VERGENCES_DEG if limits.lower[2] <= np.deg2rad(v) <= limits.upper[2]]
    figure, axes = _panels(len(shown), -(-len(shown) // 2), (2.5, 2.5))
    extent = np.rad2deg([*limits.yaw_rad, *limits.pitch_rad]).tolist()
    left, right = robot.eye_poses(np.zeros(robot.n_joints))
    for axis, vergence in zip(axes, shown, strict=True):
        answers = reachable_map.query(np.stack([Y.ravel(), P.ravel(), np.full(Y.size, np.deg2rad(vergence))], axis=1))
        image = axis.imshow(
            answers.degree.reshape(Y.shape), origin="lower", extent=extent, vmin=0, vmax=1, cmap="RdYlGn", aspect="auto"
        )
        probability = answers.probability.reshape(Y.shape)
        if probability.min() < 0.5 < probability.max():
            axis.contour(np.rad2deg(yaw), np.rad2deg(pitch), probability, levels=[0.5], colors="0.2", linewidths=1)
        ahead = fixation_points(robot, np.deg2rad([[0.0, 0.0, vergence]]))[0]
        distance = np.linalg.norm(ahead - 0.5 * (left + right)[:3, 3])
        axis.set_title(f"vergence {vergence}° ({100 * distance:.0f} cm)", fontsize=9)
        if axis is axes[-1]:
            label = f"degree of reachability R ({reachable_map.measure}; reachable above 0.5)"
            figure.colorbar(image, ax=axes, label=label, shrink=0.8)
    who = "both hands at once" if reachable_map.side == "both" else f"the {reachable_map.side} hand"
    if reachable_map.end_point != "palm":
        who = f"taxel {reachable_map.end_point}"
    figure.suptitle(f"Reachability of the fixated point by {who}; line: the border", fontsize=10)
    figure.supxlabel("neck yaw (°)", fontsize=9)
    figure.supylabel("neck pitch (°)", fontsize=9)
    return figure


def _panels(n: int, columns: int, size_in: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    """A figure with n panels of a size in at most `columns` columns."""
    columns = min(columns, max(1, n))
    rows = max(1, -(-n // columns))
    figure = Figure(figsize=(size_in[0] * columns + 0.8, size_in[1] * rows + 0.5), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel().tolist()
    for axis in axes[n:]:
        axis.set_visible(False)
    for axis in axes[max(n - columns, 0) : n]:
        axis.tick_params(labelbottom=True)  # the lowest of each column
    return figure, axes[:n]


def _ranges(memory: PPSMemory) -> tuple[Range, Range]:
    """Of D in m and TTC in s."""
    ttc = memory.params.ttc_range_s
    return memory.params.distance_range_m, ttc if np.isfinite(ttc).all() else (0.0, 3.0)
