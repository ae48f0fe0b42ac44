"""The charts of the studies: speed–error, severity, curves and bars, each drawn from plain data.

A value is a number or [value, low, high] with its 95 % interval; None is a value that does not exist.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import ArrayLike

from pps_vision.types import Array

PAGE_IN = 7.2  # width of a page
_INK = "0.25"
_MAX_WIDTH_IN = 14.0
_LOG_RATIO = 30.0  # errors that span a larger ratio are drawn on a logarithmic axis


def panels(n: int, columns: int | None = None, width: float = 4.6, height: float = 3.8) -> tuple[Figure, list[Axes]]:
    """Return a figure with `n` panels, `columns` of them side by side (default: all)."""
    columns = min(columns or n, n)
    rows = -(-n // columns)
    width = min(width, _MAX_WIDTH_IN / columns)
    size = (width * columns, height * rows)
    figure = Figure(size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for unused in axes.ravel()[n:]:
        unused.axis("off")
    return figure, list(axes.ravel()[:n])


def pareto_front(ms: Sequence[float], error: Sequence[float]) -> list[int]:
    """Return the indices of the points that no other beats in both, fastest first."""
    front: list[int] = []
    for k in np.lexsort((error, ms)):
        if np.isfinite(error[k]) and (not front or error[k] < error[front[-1]]):
            front.append(int(k))
    return front


def speed_errors(
    cells: Mapping[str, Mapping[str, Mapping[str, Any]]],
    metric: str,
    label: str,
    baselines: Collection[str] = (),
    default: str | None = None,
    time: str = "time (ms per pair)",
    height: float = 3.0,
) -> Figure:
    """Return a figure of time against one error, as wide as a page: a panel for each scenario, two side by side."""
    columns = min(2, len(cells))
    figure, axes = panels(len(cells), columns, PAGE_IN / columns, height)
    for k, ((scenario, methods), axis) in enumerate(zip(cells.items(), axes, strict=True)):
        _speed_error(axis, methods, metric, baselines, default)
        axis.set(title=scenario, xlabel=time, ylabel="" if k % columns else label)
        axis.title.set_fontsize(10)
    handles = {name: handle for axis in axes for handle, name in zip(*axis.get_legend_handles_labels(), strict=True)}
    title = "○ ours  □ baseline" if baselines else None
    options = {"ncols": 3, "fontsize": 8, "markerscale": 0.8, "title": title, "title_fontsize": 8}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", **options)
    return figure


def _speed_error(
    axis: Axes, methods: Mapping[str, Mapping[str, Any]], metric: str, baselines: Collection[str], default: str | None
) -> None:
    """Draw time (logarithmic, "ms") against `metric` of each method: Pareto front dotted, default ringed.

    Ours are circles, baselines squares. A method without an error is a cross at the top; one that had no frame to work
    on is left out.
    """
    ms, fast, slow = intervals([method["ms"] for method in methods.values()])
    is_timed = np.isfinite(ms)
    if not is_timed.any():
        axis.text(0.5, 0.5, "no frame to measure on", ha="center", va="center", transform=axis.transAxes)
        return
    value, low, high = np.where(is_timed, intervals([method[metric] for method in methods.values()]), np.nan)
    errors = value[np.isfinite(value)]
    wide = errors.size > 0 and errors.min() > 0 and errors.max() > _LOG_RATIO * errors.min()
    top = (1.8 if wide else 1.15) * (float(errors.max()) if errors.size else 1.0)
    shown = np.where(np.isfinite(value), value, top)
    front = pareto_front(ms.tolist(), value.tolist())
    axis.plot(ms[front], value[front], color=_INK, lw=1, ls=":", zorder=1)
    for k, name in enumerate(methods):
        if is_timed[k]:
            color = f"C{k}"
            marker = ("s" if name in baselines else "o") if np.isfinite(value[k]) else "x"
            axis.plot([fast[k], slow[k]], [shown[k]] * 2, color=color, lw=1.2, alpha=0.6)
            axis.plot([ms[k]] * 2, [low[k], high[k]], color=color, lw=1.2, alpha=0.6)
            axis.plot(ms[k], shown[k], marker, color=color, ms=5, label=name)
            if name == default:
                axis.plot(ms[k], shown[k], "o", mfc="none", mec=_INK, ms=12, mew=1.4, label="default")
    if wide:
        axis.set_yscale("log")
        axis.margins(y=0.15)
    else:
        axis.set_ylim(0, 1.1 * max(float(np.nanmax([*shown, *high])), 1e-9))
    axis.set_xscale("log")
    decades = float(np.ptp(np.log10(ms[is_timed])))
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2 else (1.0,)))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.margins(x=0.2)
    axis.grid(alpha=0.25, which="both")


def cells_chart(*args: Any, **options: Any) -> Callable[[Mapping[str, Any]], Figure]:
    """Return the chart of a part whose result holds its scenarios as "cells"; arguments as of `speed_errors`."""
    return lambda numbers: speed_errors(numbers["cells"], *args, **options)


def severities(studies: Mapping[str, Mapping[str, Any]], metric: str, label: str, bound: float, columns: int) -> Figure:
    """Return a figure of `metric` over severity, one panel a disturbance (results of `compare_severities`).

    × marks where a method breaks; the `bound` is dashed.
    """
    figure, axes = panels(len(studies), columns, width=3.2, height=2.7)
    for axis, (name, study) in zip(axes, studies.items(), strict=True):
        values = study["severities"]
        series = {method: cell[metric] for method, cell in study["methods"].items()}
        curves(axis, range(len(values)), series, study["axis"], label)
        for line, cell in zip(list(axis.lines), study["methods"].values(), strict=True):
            line.set_markersize(3)
            if cell["breaks_at"] is not None:
                k = values.index(cell["breaks_at"])
                y = float(np.asarray(line.get_ydata())[k])
                place = axis.transData if np.isfinite(y) else axis.get_xaxis_transform()
                color = line.get_color()
                axis.plot(k, np.nan_to_num(y), "x", color=color, ms=10, mew=2, clip_on=False, transform=place)
        axis.axhline(bound, color=_INK, lw=0.9, ls="--")
        axis.set_xticks(range(len(values)), [f"{value:g}" for value in values])
        axis.set_title(name, fontsize=9)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=columns, fontsize=9)
    return figure


def curves(axis: Axes, x: ArrayLike, series: Mapping[str, Sequence[Any]], xlabel: str, ylabel: str) -> None:
    """Draw each series over `x` with its intervals; scales and legend are the caller's."""
    at = np.asarray(x, dtype=float)
    for name, values in series.items():
        value, low, high = intervals(values)
        (line,) = axis.plot(at, value, "o-", ms=4, label=name)
        axis.fill_between(at, low, high, color=line.get_color(), alpha=0.15, lw=0)
    axis.set(xlabel=xlabel, ylabel=ylabel)
    axis.grid(alpha=0.25, which="both")


def bar_chart(groups: Sequence[str], series: Mapping[str, Sequence[Any]], label: str, width: float) -> Figure:
    """Return a figure with one bar for each series in each group, with intervals."""
    figure, (axis,) = panels(1, width=width)
    bar_width = 0.8 / len(series)
    for k, (name, values) in enumerate(series.items()):
        at = np.arange(len(groups)) + bar_width * (k - (len(series) - 1) / 2)
        value, low, high = intervals(values)
        axis.bar(at, value, bar_width, label=name)
        axis.errorbar(at, value, np.maximum([value - low, high - value], 0), fmt="none", ecolor=_INK, capsize=2)
    axis.set_xticks(range(len(groups)), list(groups), rotation=30, ha="right")
    axis.set_ylabel(label)
    axis.grid(alpha=0.25, axis="y")
    axis.legend(fontsize=8, ncols=2)
    return figure


def intervals(values: Sequence[Any]) -> tuple[Array, Array, Array]:
    """Return value, low and high (n,) each; a plain number has no interval, None is NaN."""
    rows = [list(value) if isinstance(value, list | tuple) else [value, value, value] for value in values]
    value, low, high = np.array(rows, dtype=float).reshape(-1, 3).T
    return value, low, high
