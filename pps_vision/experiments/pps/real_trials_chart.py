"""What `real_trials` measured, drawn."""

from typing import Any

import matplotlib

matplotlib.use("Agg")  # draws to files only; no display is needed

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

_INK, _OURS, _THEIRS = "0.25", "tab:blue", "tab:orange"
_GOAL = {"auroc": 0.88, "brier": 0.110}
_NAMES = {"auroc": "AUROC (higher is better)", "brier": "Brier score (lower is better)"}
_LABELS = {
    "samples": "samples averaged",
    "toward": "belief: nearer by this share of the way",
    "prior_trials": "trials the belief is worth",
    "offset_m": "offset between sessions (mm)",
}


def draw(numbers: dict[str, Any]) -> dict[str, Figure]:
    """A figure for each message."""
    return {
        "methods": _methods(numbers),
        "horizon": _horizon(numbers),
        "choices": _choices(numbers),
        "reliability": _reliability(numbers),
    }


def _methods(numbers: dict[str, Any]) -> Figure:
    """Scores with their intervals and the means as on another session; what each gains on the base rate."""
    methods, elsewhere = numbers["methods"], numbers["another_session"]
    at = {name: y for y, name in enumerate(reversed(methods))}
    colors = {name: _OURS if name == list(methods)[-1] else _THEIRS for name in methods}
    figure, axes = plt.subplots(1, 3, figsize=(12.5, 0.34 * len(at) + 1.5), sharey=True, layout="constrained")
    for axis, score in zip(axes, _NAMES, strict=False):
        for name, y in at.items():
            axis.plot(methods[name][f"{score}_95"], [y, y], color=colors[name], lw=1.2, alpha=0.6)
            axis.plot(methods[name][score], y, "o", color=colors[name], ms=6)
            axis.plot(elsewhere[name][score], y, "D", mfc="none", mec=colors[name], ms=5)
        axis.axvline(_GOAL[score], color=_INK, ls="--", lw=1)
        axis.set_xlabel(_NAMES[score])
    for name, y in at.items():
        gain = methods["base rate"]["brier"] - methods[name]["brier"]
        axes[2].plot(methods[name]["brier_gain_95"], [y, y], color=colors[name], lw=1.2, alpha=0.6)
        axes[2].plot(gain, y, "o", color=colors[name], ms=6)
    axes[2].axvline(0, color="0.5", lw=1)
    axes[2].set_xlabel("Brier score below the base rate's")
    for axis in axes:
        axis.grid(alpha=0.25)
    axes[0].set_yticks(list(at.values()), list(at))
    axes[0].plot([], [], "o", color=_INK, label="one left out, with its 95 % interval")
    axes[0].plot([], [], "D", mfc="none", mec=_INK, label="a third predicted from the rest (mean)")
    axes[0].plot([], [], color=_INK, ls="--", label="goal, one left out")
    _legend_above(figure, axes[0])
    return figure


def _horizon(numbers: dict[str, Any]) -> Figure:
    figure, axes = plt.subplots(1, 2, figsize=(9.5, 3.8), layout="constrained")
    colors = ("0.5", _THEIRS, _OURS)
    for axis, score in zip(axes, _NAMES, strict=True):
        for (name, rows), color in zip(numbers["horizons"].items(), colors, strict=True):
            axis.plot(
                [row["horizon_s"] for row in rows], [row[score] for row in rows], "o-", color=color, ms=4, label=name
            )
        axis.axvline(numbers["horizon_s"], color=_INK, ls=":", lw=1)
        axis.plot(numbers["horizon_s"], _GOAL[score], "*", color=_INK, ms=9, label="goal")
        axis.set_xlabel("nothing known later than this before the touch (s)")
        axis.set_ylabel(_NAMES[score])
        axis.grid(alpha=0.25)
    _legend_above(figure, axes[0])
    return figure


def _choices(numbers: dict[str, Any]) -> Figure:
    """Brier score over each parameter, the default ringed: on the real trials, and on simulated sessions."""
    rows = numbers["choices"]
    names = list(dict.fromkeys(row["choice"] for row in rows))
    figure, axes = plt.subplots(
        2, len(names), figsize=(3.1 * len(names), 5.2), sharey="row", sharex="col", layout="constrained"
    )
    for (real, simulated), name in zip(axes.T, names, strict=True):
        mine = [row for row in rows if row["choice"] == name]
        default = [row["default"] for row in mine].index(True)
        for axis, of in ((real, mine), (simulated, [row["simulated"] for row in mine])):
            brier = [row["brier"] for row in of]
            axis.plot(brier, "o-", color=_OURS, ms=5)
            axis.plot(default, brier[default], "o", mfc="none", mec=_INK, ms=12, mew=1.4)
            axis.grid(alpha=0.25)
        real.axhline(numbers["methods"]["base rate"]["brier"], color="0.5", lw=1, label="base rate")
        real.axhline(_GOAL["brier"], color=_INK, lw=1, ls="--", label="goal")
        simulated.axhline(mine[0]["simulated"]["base_rate_brier"], color="0.5", lw=1)
        labels = [f"{1000 * row['value'] if name == 'offset_m' else row['value']:g}" for row in mine]
        simulated.set_xticks(range(len(mine)), labels)
        simulated.set_xlabel(_LABELS[name])
    axes[0, 0].set_ylabel("Brier score, real trials,\none left out")
    axes[1, 0].set_ylabel("Brier score, simulated sessions,\nforetold from another")
    _legend_above(figure, axes[0, -1])
    return figure


def _legend_above(figure: Figure, axis: Axes) -> None:
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8, frameon=False)


def _reliability(numbers: dict[str, Any]) -> Figure:
    of = numbers["calibration"]
    figure, axis = plt.subplots(figsize=(4.6, 4.2), layout="constrained")
    axis.plot([0, 1], [0, 1], color=_INK, lw=1, label="honest")
    predicted, happened, n = (np.array(of[key]) for key in ("predicted", "happened", "n"))
    spread = np.sqrt(predicted * (1 - predicted) / n)
    axis.errorbar(predicted, happened, spread, fmt="o-", color=_OURS, capsize=3, label="predicted, ±1 sd of chance")
    for x, y, count in zip(predicted, happened, n, strict=True):
        axis.annotate(f"{count}", (x, y), xytext=(7, -10), textcoords="offset points", fontsize=8, color=_INK)
    axis.set_xlabel("predicted probability of touch")
    axis.set_ylabel("share that was touched")
    axis.set_title(f"expected calibration error {of['error']:.3f} ({n.sum()} predictions)", fontsize=9)
    axis.legend(fontsize=8)
    axis.grid(alpha=0.25)
    return figure
