"""Forgetting: how soon a map follows a patch of skin that was moved, and what that costs while nothing moves."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.memory import MemoryParams, PPSMemory, activation, count_samples
from learning.receptive_field import ReceptiveField, distance_and_ttc
from learning.scores import brier
from learning.single_taxel import Shower, fall
from pps_vision.experiments.chart import panels
from pps_vision.types import Array, Mask

_UP = np.array([0.0, 0.0, 1.0])
_GRID_M = tuple((0.03 * i, 0.03 * j) for i in range(-2, 3) for j in range(-2, 3))
_SHIFT_M = -0.05  # along the skin: where the patch now is by the robot's own idea
_LAST = 10  # samples before the touch that are judged: half a second
_BEFORE, _AFTER, _HELD_OUT = 300, 400, 100  # touches
_CHECKS = (0, 1, 2, 4, 7, 12, 20, 30, 45, 70, 100, 150, 200, 300, 400)
_HALF_LIVES = (np.inf, 160.0, 80.0, 40.0, 20.0, 10.0, 5.0)


@dataclass(frozen=True)
class Touches:
    """N objects that touched: D and TTC (N, T, n), and which taxels they touched (N, n)."""

    D: Array
    TTC: Array
    touched: Mask


@dataclass(frozen=True)
class Forgetting:
    """A patch of 25 taxels learns from touches, then is moved 5 cm along the skin and the robot is not told.

    What stood straight above a taxel and touched it now touches another; the score is Brier's over all taxels in
    the last half second before held-out touches.
    """

    seed: int = 0
    """Seed of the showers."""
    repeats: int = 10
    """Skins that learn."""

    def run(self) -> dict[str, Any]:
        """Held-out Brier scores by half life: before the shift, after it by touches, and of a map that begins there."""
        rng = np.random.default_rng(self.seed)
        lives = [f"{half_life:g}" for half_life in _HALF_LIVES]
        before: dict[str, list[float]] = {name: [] for name in lives}
        after: dict[str, list[list[float]]] = {name: [] for name in (*lives, "fresh")}
        for _ in range(self.repeats):
            old, old_test, new, new_test = (
                touches(offset, n, rng)
                for offset, n in ((0, _BEFORE), (0, _HELD_OUT), (_SHIFT_M, _AFTER), (_SHIFT_M, _HELD_OUT))
            )
            for name, half_life in zip(lives, _HALF_LIVES, strict=True):
                memory = taught(blank(half_life), old, 0, _BEFORE)
                before[name].append(score(memory, old_test))
                after[name].append(follow(memory, new, new_test))
            after["fresh"].append(follow(blank(np.inf), new, new_test))
        curves = {name: np.mean(of_name, axis=0) for name, of_name in after.items()}
        return {
            "touches_after_the_shift": list(_CHECKS),
            "brier_after": {name: curve.round(5).tolist() for name, curve in curves.items()},
            "brier_before": {name: round(float(np.mean(of_name)), 5) for name, of_name in before.items()},
            "touches_to_three_quarters": {name: _three_quarters(curves[name], curves["fresh"][-1]) for name in lives},
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Left how the maps follow, right what forgetting costs where nothing moves."""
        figure, (following, price) = panels(2)
        touched = numbers["touches_after_the_shift"]
        for k, (name, curve) in enumerate(numbers["brier_after"].items()):
            label = {"fresh": "begins at the shift", "inf": "never forgets (default)"}.get(name, f"half life {name}")
            style = ":" if name == "fresh" else "-"
            following.plot(touched, curve, style, label=label, color="k" if name in ("fresh", "inf") else f"C{k}")
        following.set_xscale("symlog", linthresh=1)
        following.set_xlim(0, _AFTER)
        following.xaxis.set_major_formatter("{x:g}")
        following.set_xlabel("touches since the patch was moved by 5 cm")
        following.set_ylabel("Brier score of the last 0.5 s, held-out")
        following.legend(fontsize=7)
        names = list(numbers["brier_before"])
        scores = [numbers["brier_before"][name] for name in names]
        price.plot(range(len(names)), scores, "o-", color="tab:blue")
        price.plot(
            names.index("inf"), numbers["brier_before"]["inf"], "o", mfc="none", mec="0.25", ms=12, label="default"
        )
        price.set_xticks(range(len(names)), ["never" if name == "inf" else name for name in names])
        price.set_xlabel("half life (touches)")
        price.set_ylabel(f"Brier score after {_BEFORE} touches, nothing moved")
        price.legend(fontsize=7)
        for axis in (following, price):
            axis.grid(alpha=0.25)
        return figure


def touches(shift_m: float, n: int, rng: np.random.Generator) -> Touches:
    """n objects of a shower that touched, as noisy tracks 1 mm and 1 cm/s off show them."""
    shower = Shower(taxels_m=_GRID_M, position_noise_m=0.001, velocity_noise_m_s=0.01)
    kept: list[Touches] = []
    while sum(len(some.D) for some in kept) < n:
        objects = fall(shower, 500, rng)
        seen = objects.d_m + np.array([shift_m, 0.0, 0.0])
        D, TTC = distance_and_ttc(ReceptiveField(), seen, _UP, objects.v_m_s)
        hit = objects.touched.any(axis=1)
        kept.append(Touches(D[hit], TTC[hit], objects.touched[hit]))
    D, TTC, touched = (np.concatenate([getattr(some, name) for some in kept])[:n] for name in ("D", "TTC", "touched"))
    return Touches(D, TTC, touched)


def blank(half_life: float) -> PPSMemory:
    """A patch that knows nothing."""
    params, n = MemoryParams(half_life_touches=half_life), len(_GRID_M)
    ids = tuple(f"patch:{i}" for i in range(n))
    return PPSMemory(ids, np.zeros(n, np.intp), np.zeros((n, *params.bins, 2), np.int64), params)


def taught(memory: PPSMemory, lessons: Touches, first: int, last: int) -> PPSMemory:
    """The memory after the lessons first … last − 1, one after another."""
    for k in range(first, last):
        memory = count_samples(memory, lessons.D[k], lessons.TTC[k], lessons.touched[k])
    return memory


def follow(memory: PPSMemory, lessons: Touches, test: Touches) -> list[float]:
    """Brier scores after so many lessons as `_CHECKS` says."""
    scores = [score(memory, test)]
    for first, last in pairwise(_CHECKS):
        memory = taught(memory, lessons, first, last)
        scores.append(score(memory, test))
    return scores


def score(memory: PPSMemory, test: Touches) -> float:
    """Brier score of the activations wherever a taxel perceives an approach in the last half second."""
    D, TTC = test.D[:, -_LAST:], test.TTC[:, -_LAST:]
    at = memory.params.covers(D, TTC)
    outcome = np.broadcast_to(test.touched[:, None], at.shape)
    return brier(outcome[at], activation(memory, D, TTC)[at])


def _three_quarters(curve: Array, settled: float) -> int | None:
    """Touches until three quarters of what the shift cost are made good; None if not within those measured."""
    there = np.flatnonzero(curve <= settled + 0.25 * (curve[0] - settled))
    return int(_CHECKS[there[0]]) if len(there) else None
