"""Where the learned map breaks: one disturbance of tracks or touches at a time, ours beside simpler models."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learning.pps.memory import MemoryParams, activation
from learning.pps.receptive_field import ReceptiveField, distance_and_ttc
from learning.pps.scores import auroc, brier
from pps_vision.experiments.baselines.single_taxel import Fall, Shower, fall, learned
from pps_vision.experiments.study import Study
from pps_vision.types import Array, Mask

LEAD_S = 0.5
BREAKS_BELOW, DEGRADES_BY = 0.75, 0.05
CRITERION = (
    f"breaks: AUROC of touch {LEAD_S} s ahead below {BREAKS_BELOW}, or a Brier score that each taxel's base rate "
    f"beats; degrades: AUROC {DEGRADES_BY} below that of the mildest severity"
)
PATCH = Shower(taxels_m=tuple((0.03 * i, 0.03 * j) for i in range(-2, 3) for j in range(-2, 3)))
"""Skin of 15 × 15 cm: nearly every object touches some of its 25 virtual taxels, and teaches the others."""
MAPS = {
    "ours (8×4)": MemoryParams(),
    "ours, 16×8, half the window": MemoryParams(bins=(16, 8), sigma_bins=0.5),
    "distance only": MemoryParams(bins=(8, 1)),
}
METHODS = (*MAPS, "base rate")
_STYLES = {
    "ours (8×4)": ("tab:blue", "-", 2.2),
    "ours, 16×8, half the window": ("tab:cyan", "--", 1.4),
    "distance only": ("tab:orange", "-", 1.2),
    "base rate": ("tab:brown", ":", 1.4),
}
_UP = np.array([0.0, 0.0, 1.0])
_TESTED = 300


@dataclass(frozen=True)
class World:
    """What is disturbed: the tracks to learn from and to predict from, the touches reported, the trials to learn from,
    and the share of moments at which nothing is tracked."""

    taught: Shower = PATCH
    tested: Shower = PATCH
    wrong_touches: float = 0.0
    missing: float = 0.0
    trials: int = 200


@dataclass(frozen=True)
class Case:
    """`world` makes a severity; the first of `severities` is undisturbed."""

    axis: str
    severities: tuple[float, ...]
    world: Callable[[float], World]


def _noisy(millimetres: float) -> World:
    shower = replace(PATCH, position_noise_m=millimetres / 1000, velocity_noise_m_s=2 * millimetres / 1000)
    return World(taught=shower, tested=shower)


def _off(centimetres: float) -> Shower:
    return replace(PATCH, offset_m=centimetres / 100)


CASES: dict[str, Case] = {
    "track noise": Case("σ (mm; velocity: twice that per s)", (0, 5, 10, 20, 40, 80), _noisy),
    "offset outwards, learned with it": Case(
        "seems farther by (cm)", (0, 1, 2, 4, 6, 10), lambda v: World(taught=_off(v), tested=_off(v))
    ),
    "offset outwards, comes later": Case("seems farther by (cm)", (0, 1, 2, 4, 6, 10), lambda v: World(tested=_off(v))),
    "offset inwards, learned with it": Case(
        "seems nearer by (cm)", (0, 1, 2, 4, 6, 10), lambda v: World(taught=_off(-v), tested=_off(-v))
    ),
    "drop-outs": Case("moments missing (%)", (0, 25, 50, 75, 90, 97), lambda v: World(missing=v / 100)),
    "label flips": Case(
        "touches on wrong taxels (%)", (0, 10, 20, 40, 60, 80, 95), lambda v: World(wrong_touches=v / 100)
    ),
    "too few trials": Case("trials", (200, 100, 50, 20, 10, 5, 2), lambda v: World(trials=int(v))),
}


@dataclass(frozen=True)
class PpsFailures(Study):
    """A patch of skin learns from a shower of objects, one thing goes wrong from mild to hopeless, and each taxel
    says how likely a touch is, half a second ahead, for objects it has not met."""

    seed: int = 0
    repeats: int = 4
    """Showers that scores are averaged over."""

    def run(self) -> dict[str, object]:
        """By disturbance, by method: AUROC and Brier score at each severity, and where it breaks."""
        return {"criterion": CRITERION, "lead_s": LEAD_S, "cases": {name: self._case(c) for name, c in CASES.items()}}

    def _case(self, case: Case) -> dict[str, Any]:
        scores = np.array(
            [
                [measured(case.world(severity), np.random.default_rng([self.seed, k])) for k in range(self.repeats)]
                for severity in case.severities
            ]
        ).mean(axis=1)  # (severities, methods, 2)
        chance = scores[:, METHODS.index("base rate"), 1]
        methods: dict[str, dict[str, Any]] = {}
        for k, method in enumerate(METHODS):
            area, error = scores[:, k].T
            methods[method] = {"auroc": area.round(4).tolist(), "brier": error.round(4).tolist()}
            if method != "base rate":
                methods[method] |= {
                    "breaks_at": first(case.severities, (area < BREAKS_BELOW) | (error > chance)),
                    "degrades_at": first(case.severities, area < area[0] - DEGRADES_BY),
                }
        return {"axis": case.axis, "severities": case.severities, "methods": methods}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Above AUROC, below Brier score as a multiple of the base rate's, over severity."""
        cases = numbers["cases"]
        figure, axes = plt.subplots(
            2, len(cases), figsize=(2.55 * len(cases), 5), sharey="row", squeeze=False, layout="constrained"
        )
        for k, (name, case) in enumerate(cases.items()):
            _panel(axes[0][k], axes[1][k], name, case)
        axes[0][0].set_ylabel(f"AUROC of touch, {LEAD_S} s ahead", fontsize=9)
        axes[1][0].set_ylabel("Brier score / base rate's", fontsize=9)
        handles, labels = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9, frameon=False)
        figure.suptitle("Where the learned map breaks (×: AUROC below 0.75, or the base rate's Brier score is lower)")
        return figure


def measured(world: World, rng: np.random.Generator) -> list[tuple[float, float]]:
    """AUROC and Brier score of every method on objects that were not learned from."""
    taught, tested = fall(world.taught, world.trials, rng), fall(world.tested, _TESTED, rng)
    D, TTC = _perceived(taught, world.missing, rng)
    touched = _reported(taught.touched, world.wrong_touches, rng)
    last = _last_known(*_perceived(tested, world.missing, rng), round(LEAD_S / world.tested.step_s))
    said = [activation(learned(params, D, TTC, touched), *last) for params in MAPS.values()]
    said.append(np.broadcast_to(touched.mean(axis=0), tested.touched.shape))
    return [(auroc(tested.touched, one), brier(tested.touched, one)) for one in said]


def _perceived(objects: Fall, missing: float, rng: np.random.Generator) -> tuple[Array, Array]:
    D, TTC = distance_and_ttc(ReceptiveField(), objects.d_m, _UP, objects.v_m_s)
    unseen = rng.random((*D.shape[:2], 1)) < missing
    return np.where(unseen, np.nan, D), np.where(unseen, np.nan, TTC)


def _reported(touched: Mask, wrong: float, rng: np.random.Generator) -> Mask:
    """A share of the objects is reported to have touched what another one did."""
    swapped = rng.random(len(touched)) < wrong
    return np.where(swapped[:, None], touched[rng.permutation(len(touched))], touched)


def _last_known(D: Array, TTC: Array, lead: int) -> tuple[Array, Array]:
    """(N, n) of the last moment at least `lead` samples before the end at which anything was perceived."""
    known = D[:, : D.shape[1] - lead], TTC[:, : D.shape[1] - lead]
    seen = np.any(np.isfinite(known[0]), axis=2)
    at = np.where(np.any(seen, axis=1), seen.shape[1] - 1 - np.argmax(seen[:, ::-1], axis=1), 0)
    rows = np.arange(len(D))
    return known[0][rows, at], known[1][rows, at]


def first(severities: Sequence[float], is_bad: Mask) -> float | None:
    """The mildest severity that is bad; None where none is."""
    return float(severities[int(np.argmax(is_bad))]) if np.any(is_bad) else None


def _panel(above: Axes, below: Axes, name: str, case: dict[str, Any]) -> None:
    places = np.arange(len(case["severities"]))
    chance = np.array(case["methods"]["base rate"]["brier"])
    for method, numbers in case["methods"].items():
        color, line, width = _STYLES[method]
        for axis, y in ((above, np.array(numbers["auroc"])), (below, np.array(numbers["brier"]) / chance)):
            axis.plot(places, y, line, color=color, lw=width, label=method)
            if numbers.get("breaks_at") is not None:
                k = case["severities"].index(numbers["breaks_at"])
                axis.plot(k, y[k], "x", color=color, ms=8, mew=2)
    for axis in (above, below):
        axis.set_xticks(places, [f"{value:g}" for value in case["severities"]])
        axis.tick_params(labelsize=8)
        axis.grid(alpha=0.25)
    above.axhline(BREAKS_BELOW, color="0.4", lw=0.8, ls="--")
    above.set_title(name, fontsize=9)
    below.set_xlabel(case["axis"], fontsize=8)
