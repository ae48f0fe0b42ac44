"""Does a wider window for an uncertain track pay?  Where the map was learned from better tracks, with fine bins."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.memory import MemoryParams, PPSMemory, activation, count_samples
from learning.receptive_field import ReceptiveField, distance_and_ttc, distance_and_ttc_variance
from learning.scores import brier
from learning.single_taxel import Shower, fall
from pps_vision.experiments.chart import panels
from pps_vision.types import Array, Mask

_UP = np.array([0.0, 0.0, 1.0])
_NOISE_M = (0.001, 0.003, 0.01, 0.02, 0.04)
_BINS = ((8, 4), (16, 8), (32, 16))
_MOST_TTC_VAR_S2 = 100.0  # past this the window is flat


@dataclass(frozen=True)
class Tracks:
    """N tracked objects: D, TTC and their variances (N, T, n), and which taxels were touched (N, n)."""

    D: Array
    TTC: Array
    var_D: Array
    var_TTC: Array
    touched: Mask


@dataclass(frozen=True)
class UncertainTracks:
    """Brier score of activations with and without the track's own variance in the window, by the track's noise.

    Once the map is learned from the same noise, once from tracks 1 mm off, as joints know a touching hand.  All
    objects teach, misses too; velocities are off by twice the position's error a second.
    """

    seed: int = 0
    """Seed of the showers."""
    objects: int = 400
    """Objects to learn from; as many are held out."""
    repeats: int = 4
    """Skins that learn, each its own."""

    def run(self) -> dict[str, Any]:
        """Brier scores by what was learned from, bins and noise: "plain" and "widened"."""
        rng = np.random.default_rng(self.seed)
        numbers: dict[str, Any] = {"noise_m": list(_NOISE_M)}
        for source in ("same", "exact"):
            scores = np.array(
                [[self._scores(noise, source, rng) for noise in _NOISE_M] for _ in range(self.repeats)]
            ).mean(axis=0)  # (noise, bins, 2)
            for k, bins in enumerate(_BINS):
                plain, widened = scores[:, k].T.round(5).tolist()
                numbers[f"{source} {bins[0]}×{bins[1]}"] = {"plain": plain, "widened": widened}
        return numbers

    def _scores(self, noise: float, source: str, rng: np.random.Generator) -> list[tuple[float, float]]:
        lessons = tracks(noise if source == "same" else _NOISE_M[0], self.objects, rng)
        test = tracks(noise, self.objects, rng)
        return [compare(taught(lessons, MemoryParams(bins=bins)), test) for bins in _BINS]

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """How much lower the score is with the wider window, in per cent of the plain one's."""
        figure, axes = panels(2)
        titles = {"same": "learned from tracks as noisy", "exact": "learned from tracks 1 mm off"}
        noise_mm = 1000 * np.array(numbers["noise_m"])
        for axis, (source, title) in zip(axes, titles.items(), strict=True):
            for k, (d, t) in enumerate(_BINS):
                of_bins = numbers[f"{source} {d}×{t}"]
                gain = 100 * (1 - np.array(of_bins["widened"]) / np.array(of_bins["plain"]))
                axis.plot(noise_mm, gain, "o-", color=f"C{k}", label=f"{d}×{t} bins" + " (default)" * (k == 0))
            axis.axhline(0, color="0.25", lw=1)
            axis.set_xscale("log")
            axis.xaxis.set_major_formatter("{x:g}")
            axis.set_xlabel("noise of the track (mm)")
            axis.set_ylabel("Brier score lower by (%),\nwindow as wide as the doubt")
            axis.set_title(title, fontsize=9)
            axis.grid(alpha=0.25, which="both")
            axis.legend(fontsize=7)
        low = min(axis.get_ylim()[0] for axis in axes)
        high = max(axis.get_ylim()[1] for axis in axes)
        for axis in axes:
            axis.set_ylim(low, high)
        return figure


def tracks(noise_m: float, n: int, rng: np.random.Generator) -> Tracks:
    """n objects of a shower over three taxels, seen with white noise whose covariance is known."""
    objects = fall(Shower(landing_sigma_m=0.06, touch_radius_m=0.03), n, rng)
    d = objects.d_m + rng.normal(0, noise_m, (*objects.d_m.shape[:2], 1, 3))
    v = objects.v_m_s + rng.normal(0, 2 * noise_m, objects.v_m_s.shape)
    cov = noise_m**2 * np.diag([1.0, 1.0, 1.0, 4.0, 4.0, 4.0])
    field = ReceptiveField()
    D, TTC = distance_and_ttc(field, d, _UP, v, cov_v=cov[3:, 3:])
    var_D, var_TTC = distance_and_ttc_variance(field, d, _UP, v, cov)
    return Tracks(D, TTC, var_D, np.minimum(var_TTC, _MOST_TTC_VAR_S2), objects.touched)


def taught(lessons: Tracks, params: MemoryParams) -> PPSMemory:
    """The three taxels' memory; a fourth, which perceives nothing, is touched by what misses them."""
    n, nowhere = lessons.touched.shape[1], np.full((*lessons.D.shape[:2], 1), np.nan)
    D, TTC = (np.concatenate([x, nowhere], axis=2) for x in (lessons.D, lessons.TTC))
    touched = np.concatenate([lessons.touched, ~lessons.touched.any(axis=1, keepdims=True)], axis=1)
    ids = tuple(f"patch:{i}" for i in range(n + 1))
    memory = PPSMemory(ids, np.zeros(n + 1, np.intp), np.zeros((n + 1, *params.bins, 2), np.int64), params)
    for k in range(len(D)):
        memory = count_samples(memory, D[k], TTC[k], touched[k])
    return PPSMemory(ids[:n], memory.part_index[:n], memory.counts[:n], params)


def compare(memory: PPSMemory, test: Tracks) -> tuple[float, float]:
    """Brier scores without and with the variances, wherever a taxel perceives something."""
    at = memory.params.covers(test.D, test.TTC)
    outcome = np.broadcast_to(test.touched[:, None], at.shape)[at]
    plain = activation(memory, test.D, test.TTC)[at]
    widened = activation(memory, test.D, test.TTC, test.var_D, test.var_TTC)[at]
    return brier(outcome, plain), brier(outcome, widened)
