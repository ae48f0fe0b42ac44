"""Speed against accuracy: the chart every stage gets (DESIGN, "Speed against accuracy")."""

import matplotlib

matplotlib.use("Agg")  # draws to files only; no display is needed

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, TypeVar

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from pps_vision.types import Array

T = TypeVar("T")
_INK, _OURS, _THEIRS = "0.25", "tab:blue", "tab:orange"


@dataclass(frozen=True)
class Variant:
    """One way to do a stage, measured: milliseconds a run and the error of each run (any unit, one for all)."""

    name: str
    ms: Array
    error: float
    ours: bool = True
    default: bool = False

    def summary(self) -> dict[str, object]:
        """Median and quartiles of ms, and the error, for JSON."""
        q25, median, q75 = (round(float(value), 5) for value in np.percentile(self.ms, (25, 50, 75)))
        return {"q25_ms": q25, "median_ms": median, "q75_ms": q75, "runs": len(self.ms), "error": self.error}

    @classmethod
    def of(cls, name: str, summary: Mapping[str, Any], ours: bool = True, default: bool = False) -> "Variant":
        """What `summary` wrote, with runs that have its median and quartiles."""
        low, middle, high = (float(summary[key]) for key in ("q25_ms", "median_ms", "q75_ms"))
        return cls(name, np.array([low, low, middle, high, high]), float(summary["error"]), ours, default)


def timed(run: Callable[[], T]) -> tuple[T, float]:
    """The result of a run and its milliseconds."""
    start = perf_counter()
    result = run()
    return result, 1000 * (perf_counter() - start)


def pareto_front(ms: Sequence[float], error: Sequence[float]) -> list[int]:
    """Indices of the variants no other beats in both, fastest first."""
    front: list[int] = []
    for k in np.lexsort((error, ms)):
        if np.isfinite(error[k]) and (not front or error[k] < error[front[-1]]):
            front.append(int(k))
    return front


def speed_against_error(
    axis: Axes, variants: Sequence[Variant], what: str, error: str, bound: tuple[str, float] | None = None
) -> None:
    """Time on a log axis with its quartiles, error on the other (from 0, or log where it spans much), the
    Pareto front, the default ringed, a `bound` (its name, its value) dashed; a variant whose error is not
    finite stands at the top, as lost."""
    finite = [v.error for v in variants if np.isfinite(v.error)]
    top = (1.8 if finite and _wide(finite) else 1.15) * max(finite, default=1.0)
    ms = [float(np.median(v.ms)) for v in variants]
    shown = [v.error if np.isfinite(v.error) else top for v in variants]
    front = pareto_front(ms, [v.error for v in variants])
    axis.plot([ms[k] for k in front], [shown[k] for k in front], color=_INK, lw=1, ls=":", zorder=1)
    for v, x, y, offset in zip(variants, ms, shown, _label_offsets(ms, shown), strict=True):
        color = _OURS if v.ours else _THEIRS
        axis.plot(np.percentile(v.ms, (25, 75)), [y, y], color=color, lw=1.2, alpha=0.6)
        axis.plot(x, y, "o" if np.isfinite(v.error) else "x", color=color, ms=5)
        if v.default:
            axis.plot(x, y, "o", mfc="none", mec=_INK, ms=12, mew=1.4)
        label = v.name if np.isfinite(v.error) else f"{v.name} (fails)"
        axis.annotate(label, (x, y), xytext=(5, offset), textcoords="offset points", fontsize=7, color=_INK)
    if bound is not None:
        axis.axhline(bound[1], color=_INK, lw=1, ls="--")
        axis.annotate(bound[0], (1, bound[1]), xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize=7)
    if _wide(shown):
        axis.set_yscale("log")
    else:
        axis.set_ylim(0, 1.1 * max([*shown, bound[1] if bound else 0.0]))
    axis.set_xscale("log")
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))  # a decade's own ticks may be less than one apart
    axis.xaxis.set_major_formatter(FuncFormatter(lambda ms, _: f"{ms:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_xlabel(f"time (ms per {what})")
    axis.set_ylabel(error)
    axis.grid(alpha=0.25, which="both")


def _wide(error: Sequence[float]) -> bool:
    """Whether errors span so much that the small ones would lie on the axis."""
    return min(error) > 0 and max(error) > 30 * min(error)


def _label_offsets(ms: Sequence[float], error: Sequence[float]) -> list[int]:
    """How far above each point (in printer's points) its label stands, so that neighbours' do not overlap."""
    x, y = np.log10(ms), np.array(error) / max(*error, 1e-9)
    if _wide(error):
        y = np.log(error) / max(float(np.ptp(np.log(error))), 1e-9)
    wide = 0.3 * max(float(np.ptp(x)), 0.5)
    offsets: dict[int, int] = {}
    for k in (int(index) for index in np.argsort(-y, kind="stable")):  # the upper of two neighbours' above it
        taken = {offset for j, offset in offsets.items() if abs(x[j] - x[k]) < wide and abs(y[j] - y[k]) < 0.08}
        offsets[k] = next((offset for offset in (5, -12, -21, 14, 23) if offset not in taken), 5)
    return [offsets[k] for k in range(len(x))]


def legend(axis: Axes) -> None:
    """What the colours and the ring mean."""
    axis.plot([], [], "o", color=_OURS, label="ours")
    axis.plot([], [], "o", color=_THEIRS, label="peers")
    axis.plot([], [], "o", mfc="none", mec=_INK, ms=10, label="our default")
    axis.plot([], [], color=_INK, ls=":", label="Pareto front")
    axis.legend(fontsize=7)


def panels(n: int, width: float = 5.2, height: float = 4.2) -> tuple[Figure, list[Axes]]:
    """A figure with `n` panels side by side."""
    figure, axes = plt.subplots(1, n, figsize=(width * n, height), squeeze=False, layout="constrained")
    return figure, list(axes[0])
