"""The charts of bench stereo."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pps_vision.experiments.chart import Variant, legend, panels, speed_against_error
from pps_vision.experiments.stereo_methods import OURS

SPEED_DEPTH = "0.4"  # m, the distance of the time-against-error chart
_INK = "0.25"


def depth_chart(numbers: dict[str, Any]) -> Figure:
    """Textured ball: error over distance, and over vergence."""
    figure, axes = panels(2, width=5.6)
    for axis, places in ((axes[0], numbers["depth_textured"]), (axes[1], numbers["vergence_textured"])):
        x = [float(place) for place in places]
        for name in next(iter(places.values()))["methods"]:
            y = [of["methods"][name]["rms_mm"] for of in places.values()]
            ours = name == OURS
            axis.plot(x, y, "o-" if ours else ".--", lw=2 if ours else 1, ms=5, label=name)
        axis.plot(
            x, [of["bound_mm"] for of in places.values()], color=_INK, ls="--", lw=1.5, label="bound of the centroid"
        )
        axis.set(yscale="log", ylabel="3D RMS error (mm)")
        axis.yaxis.set_major_formatter("{x:g}")
        axis.grid(alpha=0.25, which="both")
    axes[0].set(xscale="log", xlabel="distance (m)", title="Textured ball of 35 mm: over distance")
    ticks = [float(d) for d in numbers["depth_textured"]]
    axes[0].set_xticks(ticks, [f"{d:g}" for d in ticks])
    axes[0].minorticks_off()
    axes[0].legend(fontsize=7)
    axes[1].yaxis.set_minor_formatter("{x:g}")
    axes[1].set(xlabel="vergence (degrees; 0 = parallel)", title="0.3 m away: over vergence")
    return figure


def speed_chart(numbers: dict[str, Any]) -> Figure:
    """Time against error, textured and smooth: what fails stands at the top."""
    figure, axes = panels(2, width=6.2)
    for axis, texture in zip(axes, ("textured", "plain"), strict=True):
        at = numbers[f"depth_{texture}"][SPEED_DEPTH]
        variants = [
            Variant(
                name, np.array([of[f"{q}_ms"] for q in ("q25", "median", "q75")]), _number(of["rms_mm"]), *_kind(name)
            )
            for name, of in at["methods"].items()
        ]
        speed_against_error(axis, variants, "pair, outlines included", "3D RMS error (mm)", ("bound", at["bound_mm"]))
        axis.set(title=f"{'Textured' if texture == 'textured' else 'Smooth'} ball, {SPEED_DEPTH} m")
        found = [v.error for v in variants if np.isfinite(v.error)]
        axis.set(yscale="log", ylim=(0.6 * min(found), 2.6 * max(found)))
        axis.yaxis.set_major_formatter("{x:g}")
        axis.margins(x=0.25)
    axes[0].yaxis.set_minor_formatter("{x:g}")
    legend(axes[0])
    return figure


def tracked_chart(numbers: dict[str, Any]) -> Figure:
    """What the tracker observed before its filter, against the bound of its own pixel error."""
    figure, axes = panels(1, width=5.6)
    axis = axes[0]
    for head, color in (("still", "tab:blue"), ("moving", "tab:green")):
        places = numbers["marker"][head]
        x = [float(d) for d in places]
        axis.plot(x, [of["rms_mm"] for of in places.values()], "o-", color=color, label=f"marker of 10 mm, head {head}")
        axis.plot(
            x, [of["bound_mm"] for of in places.values()], "--", color=color, lw=1, label=f"its bound, head {head}"
        )
    ball = numbers["ball_0.3_m"]["moving"]
    axis.plot(0.3, ball["rms_mm"], "s", color="tab:red", label="ball of 35 mm, head moving")
    axis.plot(0.3, ball["plain_centroid_rms_mm"], "s", mfc="none", color="tab:red", label="ball, mean pixel instead")
    axis.set(
        yscale="log",
        xlabel="distance (m)",
        ylabel="3D RMS error, bias included (mm)",
        title="As tracked, before the filter; noise 2/255",
    )
    axis.yaxis.set_major_formatter("{x:g}")
    axis.grid(alpha=0.25, which="both")
    axis.legend(fontsize=7)
    return figure


def motorcycle_chart(numbers: dict[str, Any]) -> Figure:
    """Whole maps and windows of the size of an object: share that is more than 2 px off."""
    figure, axes = panels(2, width=5.0, height=3.6)
    maps, windows = numbers["maps"], numbers["windows"]
    _bars(axes[0], {f"{k}, {of['ms']:.0f} ms": (of["bad2_of_matched"], 1 - of["matched"]) for k, of in maps.items()})
    axes[0].set(title="motorcycle: whole maps", xlabel="share of the pixels with truth")
    shown = {
        name + (f", {of['ms']:.2f} ms" if "ms" in of else ""): (
            of["bad2_of_answered"] * of["answered"],
            1 - of["answered"],
        )
        for name, of in windows.items()
    }
    _bars(axes[1], shown)
    axes[1].set(title="motorcycle: windows of 27 × 27 px", xlabel="share of the windows")
    axes[1].legend(fontsize=7)
    return figure


def _bars(axis: Axes, shares: dict[str, tuple[float, float]]) -> None:
    bad, none = np.array(list(shares.values())).T
    y = np.arange(len(shares))[::-1]
    axis.barh(y, bad, color="tab:red", label="more than 2 px off")
    axis.barh(y, none, left=bad, color="0.8", label="no answer")
    axis.set_yticks(y, list(shares), fontsize=7)
    axis.grid(alpha=0.25, axis="x")


def _kind(name: str) -> tuple[bool, bool]:
    """Whether a method is ours, and our default."""
    return name == OURS, name == OURS


def _number(value: float | None) -> float:
    return np.nan if value is None else value
