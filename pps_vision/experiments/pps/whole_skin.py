"""Cost of the whole skin: time for one stimulus and for one learning iteration, by the number of taxels."""

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
from pps_vision.experiments.charts import curves, panels
from pps_vision.experiments.study import SampledStudy
from pps_vision.types import Array, TaxelEvents

TAXELS = (32, 125, 500, 1000, 2000, 4000, 8000, 16000)  # the iCub has 4000
_LIMBS = 8
_SAMPLES = 60  # 3 s at 50 ms


@dataclass(frozen=True)
class Body:
    """Taxels of eight cylindrical limbs 30 cm long and 10 cm thick, a memory, and the path of a ball (60, 3) m that
    approaches the first taxel."""

    positions: Array
    normals: Array
    memory: PPSMemory
    ball: Array
    velocity: Array


@dataclass(frozen=True)
class WholeSkin(SampledStudy):
    """Processor time to perceive one stimulus and activate all taxels, and to learn from 3 s, against the taxels.

    Usually the ball is in the receptive fields of the taxels near it; in the worst case it is in all of them.
    """

    n: int = 100
    """Runs of each; a fifth as many of learning."""

    def run(self) -> dict[str, Any]:
        """Return median and quartiles of the milliseconds, by case, for each number of taxels."""
        rng = np.random.default_rng(self.seed)
        found: dict[str, list[list[float]]] = {"one stimulus": [], "one stimulus, worst case": [], "3 s learned": []}
        for n in TAXELS:
            body = make_body(n, rng)
            shape = body.positions.shape
            first = np.broadcast_to(body.positions[0], shape), np.broadcast_to(body.normals[0], shape)
            in_all = replace(body, positions=first[0], normals=first[1])
            learning = partial(learn, body.memory, buffer_at_touch(body), np.arange(n) == 0)
            found["one stimulus"].append(_cpu_ms(partial(activations, body), self.n))
            found["one stimulus, worst case"].append(_cpu_ms(partial(activations, in_all), self.n))
            found["3 s learned"].append(_cpu_ms(learning, self.n // 5))
        return {"taxels": TAXELS, "ms": found}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw time against the number of taxels."""
        figure, (axis,) = panels(1, width=6.0)
        curves(axis, numbers["taxels"], numbers["ms"], "taxels", "processor time (ms; quartiles)")
        axis.set(xscale="log", yscale="log")
        axis.legend(fontsize=8)
        return figure


def _cpu_ms(call: Callable[[], object], runs: int) -> list[float]:
    """Median and quartiles of the processor time of a call in ms; the first, which fills caches, does not count."""
    call()
    ms = np.empty(max(runs, 5))
    for k in range(len(ms)):
        begun = process_time_ns()
        call()
        ms[k] = (process_time_ns() - begun) / 1e6
    return [round(float(q), 4) for q in np.percentile(ms, (50, 25, 75))]


def make_body(n: int, rng: np.random.Generator) -> Body:
    """Return a body of `n` taxels, uniform on eight limbs 40 cm apart, with random counts in its memory."""
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


def activations(body: Body, sample: int = _SAMPLES // 2) -> Array:
    """Return the activations (n,) for the ball at one sample, from its position and velocity on."""
    stimulus = (body.ball[sample], body.velocity, 0.035, 1e-6 * np.eye(3))
    return activation(body.memory, *perceive(ReceptiveField(), body.positions, body.normals, *stimulus))


def buffer_at_touch(body: Body) -> EventBuffer:
    """Return the buffered samples of the whole approach."""
    buffer, none = EventBuffer(), np.zeros(len(body.positions), bool)
    for k, p in enumerate(body.ball):
        D, TTC = perceive(ReceptiveField(), body.positions, body.normals, p, body.velocity)
        buffer = push(buffer, TaxelEvents(0.05 * k, body.memory.taxel_ids, D, TTC, none))
    return buffer
