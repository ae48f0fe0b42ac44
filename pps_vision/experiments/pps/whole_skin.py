"""The whole skin at once: what one stimulus and one trial cost, by the number of taxels."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from time import process_time_ns
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.pps.buffer import EventBuffer, push
from learning.pps.memory import MemoryParams, PPSMemory, activation, learn
from learning.pps.receptive_field import ReceptiveField, perceive
from pps_vision.experiments.chart import panels
from pps_vision.experiments.study import Study
from pps_vision.types import Array, Mask, TaxelEvents

_TAXELS = (32, 125, 500, 1000, 2000, 4000, 8000, 16000)
_WHOLE = 4000  # of the iCub
_GOAL_MS = {"activation": 0.5, "learning": 10.0}
_LIMBS = 8
_SAMPLES = 60  # 3 s at 50 ms


@dataclass(frozen=True)
class Body:
    """Taxels of eight cylindrical limbs, 30 cm long and 10 cm thick, and a memory of all; one ball comes."""

    positions: Array
    normals: Array
    memory: PPSMemory
    ball: Array  # (60, 3) m, toward a taxel of the first limb
    velocity: Array


@dataclass(frozen=True)
class WholeSkin(Study):
    """CPU milliseconds to perceive and activate, and to learn from a trial of 3 s, on one core.

    Beside the usual case, where the ball is in the receptive fields of the taxels about it, the worst: it is in all.
    """

    seed: int = 0
    """Seed of the bodies and what they remember."""
    runs: int = 100
    """Runs of each; learning a fifth as many."""

    def run(self) -> dict[str, Any]:
        """Median, quartiles and least of the milliseconds, by number of taxels."""
        rng = np.random.default_rng(self.seed)
        activations, worst, learning, first, perceiving = {}, {}, {}, {}, {}
        for n in _TAXELS:
            body = make_body(n, rng)
            in_all = replace(body, positions=_everywhere(body.positions), normals=_everywhere(body.normals))
            buffer = trial(body)
            touched = np.arange(n) == 0
            activations[n] = cpu_ms(partial(expects, body), self.runs)
            worst[n] = cpu_ms(partial(expects, in_all), self.runs)
            learning[n] = cpu_ms(partial(learn, body.memory, buffer, touched), self.runs // 5)
            first[n] = cpu_ms(partial(_learn_and_expect, body, buffer, touched), self.runs // 5)
            perceiving[n] = int(np.isfinite(buffer.samples[_SAMPLES // 2].distance_m).sum())
        return {
            "taxels_that_perceive": perceiving,
            "activation_ms": activations,
            "activation_worst_ms": worst,
            "learning_ms": learning,
            "learning_and_the_next_activation_ms": first,
            "goal_ms_at_4000": _GOAL_MS,
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time against the number of taxels, the whole skin and its goals marked."""
        figure, axes = panels(2)
        curves = (
            (("activation_ms", "one ball near one limb (default)"), ("activation_worst_ms", "in all receptive fields")),
            (("learning_ms", "one trial of 3 s (default)"),),
        )
        for axis, named, goal, what in zip(axes, curves, _GOAL_MS.values(), ("one stimulus", "one trial"), strict=True):
            for (name, label), color in zip(named, ("tab:blue", "tab:orange"), strict=False):
                rows = {int(n): row for n, row in numbers[name].items()}
                least, q75 = ([row[q] for row in rows.values()] for q in ("least", "q75"))
                axis.plot(list(rows), least, "o-", ms=4, color=color, label=label)
                axis.fill_between(list(rows), least, q75, color=color, alpha=0.2)
            axis.plot(_WHOLE, goal, "v", color="tab:red", ms=9, label=f"goal at {_WHOLE} taxels: {goal:g} ms")
            axis.axvline(_WHOLE, color="0.25", lw=1, ls=":")
            axis.set_xscale("log")
            axis.set_yscale("log")
            axis.xaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_major_formatter("{x:g}")
            axis.set_xlabel("taxels")
            axis.set_ylabel(f"CPU time (ms per {what})\nleast, band to the upper quartile")
            axis.grid(alpha=0.25, which="both")
            axis.legend(fontsize=7)
        return figure


def cpu_ms(what: Callable[[], object], runs: int) -> dict[str, float]:
    """Least, median and quartiles of the CPU milliseconds of a call; the first, which pays for what is made
    once, does not count."""
    what()
    ms = np.empty(max(runs, 5))
    for k in range(len(ms)):
        begun = process_time_ns()
        what()
        ms[k] = (process_time_ns() - begun) / 1e6
    q25, median, q75 = (round(float(q), 4) for q in np.percentile(ms, (25, 50, 75)))
    return {"least": round(float(ms.min()), 4), "q25": q25, "median": median, "q75": q75}


def make_body(n: int, rng: np.random.Generator) -> Body:
    """A body of n taxels, evenly strewn on eight limbs 40 cm apart, that has learned something everywhere."""
    limb = np.arange(n) * _LIMBS // n
    angle, along = rng.uniform(0, 2 * np.pi, n), rng.uniform(-0.15, 0.15, n)
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    positions = 0.05 * normals + np.stack([0.4 * limb, np.zeros(n), along], axis=1)
    params = MemoryParams()
    counts = rng.integers(0, 50, (n, *params.bins, 2))
    memory = PPSMemory(tuple(f"limb{k}:{i}" for i, k in enumerate(limb)), limb, counts, params)
    velocity = -0.08 * normals[0]
    left_s = 0.05 * np.arange(_SAMPLES, 0, -1)
    return Body(positions, normals, memory, positions[0] - left_s[:, None] * velocity, velocity)


def expects(body: Body, sample: int = _SAMPLES // 2) -> Array:
    """All activations of one stimulus, from its position and velocity on."""
    what = (ReceptiveField(), body.positions, body.normals, body.ball[sample], body.velocity, 0.035, 1e-6 * np.eye(3))
    D, TTC = perceive(*what)
    return activation(body.memory, D, TTC)


def trial(body: Body) -> EventBuffer:
    """The buffer at the touch."""
    buffer, nothing = EventBuffer(), np.zeros(len(body.positions), bool)
    for k, p in enumerate(body.ball):
        D, TTC = perceive(ReceptiveField(), body.positions, body.normals, p, body.velocity)
        buffer = push(buffer, TaxelEvents(0.05 * k, body.memory.taxel_ids, D, TTC, nothing))
    return buffer


def _everywhere(of_first: Array) -> Array:
    """All taxels where the first is."""
    return np.broadcast_to(of_first[0], of_first.shape)


def _learn_and_expect(body: Body, buffer: EventBuffer, touched: Mask) -> Array:
    learned = learn(body.memory, buffer, touched)
    last = buffer.samples[-1]
    return activation(learned, last.distance_m, last.ttc_s)
