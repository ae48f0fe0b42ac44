"""Figures of the report and of `show`: one message each, axes with units, losses shown."""

import matplotlib

matplotlib.use("Agg")  # draws to files only; no display is needed

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import ArrayLike

from learning.pps.memory import PPSMemory, activation
from pps_vision.app.encounter import EncounterLog
from pps_vision.types import Array, Reachability, ReachStatus

Range = tuple[float, float]

_INK = "0.25"
_TAXEL_COLORS = plt.get_cmap("viridis")


def landscape(memory: PPSMemory, taxel: int = 0) -> Array:
    """(30, 30) of a taxel's activation over the ranges of D and TTC (3 s of TTC where the map knows none)."""
    (d0, d1), (t0, t1) = _ranges(memory)
    cell = (np.arange(30) + 0.5) / 30
    D, TTC = np.meshgrid(d0 + (d1 - d0) * cell, t0 + (t1 - t0) * cell, indexing="ij")
    of = [taxel]
    alone = replace(
        memory, taxel_ids=(memory.taxel_ids[taxel],), part_index=memory.part_index[of], counts=memory.counts[of]
    )
    return activation(alone, D[..., None], TTC[..., None])[..., 0]


def draw_landscape(
    axis: Axes, expected: ArrayLike, ranges: tuple[Range, Range] = ((-0.10, 0.20), (0.0, 3.0)), smooth: bool = False
) -> AxesImage:
    """A `landscape` as a picture; `ranges` of D in m and TTC in s, by default R's."""
    (d0, d1), (t0, t1) = ranges
    return axis.imshow(
        np.asarray(expected).T,
        origin="lower",
        aspect="auto",
        extent=(100 * d0, 100 * d1, t0, t1),
        vmin=0,
        vmax=1,
        cmap="magma",
        interpolation="bilinear" if smooth else None,
    )


def landscapes(memory: PPSMemory, taxels: Sequence[int] | None = None) -> Figure:
    """What each taxel expects: probability of touch over distance D and time to contact TTC."""
    chosen = list(range(len(memory.taxel_ids))) if taxels is None else list(taxels)
    columns = min(4, max(1, len(chosen)))
    rows = -(-len(chosen) // columns)
    figure, axes = plt.subplots(
        rows,
        columns,
        figsize=(2.6 * columns + 0.8, 2.2 * rows + 0.5),
        squeeze=False,
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    image = None
    for axis in axes.flat[len(chosen) :]:
        axis.set_visible(False)
    for axis, taxel in zip(axes.flat, chosen, strict=False):
        image = draw_landscape(axis, landscape(memory, taxel), _ranges(memory), smooth=True)
        samples = int(memory.counts[taxel].sum())
        axis.set_title(f"{memory.taxel_ids[taxel]}  ({samples} samples)", fontsize=8)
        if samples == 0:
            axis.text(0.5, 0.5, "never stimulated", transform=axis.transAxes, ha="center", color="w", fontsize=8)
    if image is not None:
        figure.colorbar(image, ax=axes, label="expected probability of touch", shrink=0.8)
    figure.supxlabel("distance D (cm)", fontsize=9)
    figure.supylabel("time to contact TTC (s)", fontsize=9)
    return figure


def _ranges(memory: PPSMemory) -> tuple[Range, Range]:
    """Of D in m and TTC in s; a map of distance alone is drawn up to 3 s."""
    ttc = memory.params.ttc_range_s
    return memory.params.distance_range_m, ttc if np.isfinite(ttc).all() else (0.0, 3.0)


def encounters(logs: Sequence[EncounterLog], threshold: float) -> Figure:
    """In the manner of R Fig 10: distance and activation of every taxel, what the arm was told, and what the
    reachable-space map said of the tracked object in each frame."""
    figure, axes = plt.subplots(
        4, len(logs), figsize=(3.4 * len(logs), 8.2), sharex="col", sharey="row", squeeze=False, layout="constrained"
    )
    for column, log in enumerate(logs):
        t = log.stamps_s - log.stamps_s[0]
        _degree(axes[3, column], t, log.reachability)
        colors = _TAXEL_COLORS(np.linspace(0, 0.9, len(log.taxel_ids)))
        for i, color in enumerate(colors):
            axes[0, column].plot(t, 100 * log.surface_gap_m[:, i], color=color, lw=1)
            axes[1, column].plot(t, log.activations[:, i], color=color, lw=1)
        axes[2, column].plot(t, 100 * log.speed_m_s, color="tab:blue", lw=1.4)
        touched = log.touched.any(axis=1)
        for axis in axes[:, column]:
            axis.fill_between(
                t, 0, 1, where=touched, transform=axis.get_xaxis_transform(), color="tab:red", alpha=0.18, lw=0
            )
            axis.grid(alpha=0.25)
        axes[0, column].axhline(2, color="tab:red", lw=1, ls="--")
        axes[1, column].axhline(threshold, color=_INK, lw=1, ls="--")
        axes[0, column].set_title(log.title, fontsize=10)
        axes[3, column].set_xlabel("time (s)")
    axes[0, 0].set_ylabel("gap to each taxel (cm)\n2 cm is a touch")
    axes[0, 0].set_ylim(0, 30)
    axes[1, 0].set_ylabel(f"activation of each taxel\n(arm reacts past {threshold:g})")
    axes[1, 0].set_ylim(-0.03, 1.03)
    axes[2, 0].set_ylabel("speed of the arm\ncommanded (cm/s)")
    axes[3, 0].set_ylabel("degree of reach R\n(reachable above 0.5)")
    axes[3, 0].set_ylim(0, 1)
    return figure


def _degree(axis: Axes, t: Array, reachability: Sequence[Reachability]) -> None:
    """The degree of reachability over time, on green where reachable, on grey where not."""
    axis.plot(t, [reach.degree for reach in reachability], color=_INK, lw=1.4)
    status = [reach.status for reach in reachability]
    for of, color in ((ReachStatus.REACHABLE, "tab:green"), (ReachStatus.UNREACHABLE, "0.6")):
        axis.fill_between(
            t,
            0,
            1,
            where=[one == of for one in status],
            step="mid",
            transform=axis.get_xaxis_transform(),
            color=color,
            alpha=0.2,
            lw=0,
        )
    axis.axhline(0.5, color=_INK, lw=1, ls="--")


def path(log: EncounterLog) -> Figure:
    """The tracked 3D path with its own ±2σ against the truth, coordinate by coordinate, and the error."""
    figure, axes = plt.subplots(4, 1, figsize=(7.2, 7.2), sharex=True, layout="constrained")
    t = log.stamps_s - log.stamps_s[0]
    for k, name in enumerate("xyz"):
        axes[k].fill_between(
            t,
            100 * (log.track_m[:, k] - 2 * log.track_std_m[:, k]),
            100 * (log.track_m[:, k] + 2 * log.track_std_m[:, k]),
            color="tab:blue",
            alpha=0.25,
            lw=0,
            label="tracked ± 2σ",
        )
        axes[k].plot(t, 100 * log.track_m[:, k], color="tab:blue", lw=1.2)
        axes[k].plot(t, 100 * log.truth_m[:, k], color="k", lw=1, ls=":", label="truth")
        axes[k].set_ylabel(f"{name} (cm)")
    error = 1000 * np.linalg.norm(log.track_m - log.truth_m, axis=1)
    axes[3].plot(t, error, color="tab:red", lw=1.2)
    axes[3].set_ylabel("3D error (mm)")
    axes[3].set_ylim(bottom=0)
    axes[3].set_xlabel("time (s)")
    axes[0].legend(loc="best", fontsize=8)
    axes[0].set_title(log.title, fontsize=10)
    for axis in axes:
        axis.grid(alpha=0.25)
    return figure


def save(figure: Figure, file: Path) -> None:
    """Write a figure; its suffix says the format, ValueError for one that is not known."""
    try:
        figure.savefig(file, dpi=130)
    finally:
        plt.close(figure)
