"""Cost of the whole skin: time for one stimulus and for one learning iteration, by the number of taxels."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.pps.buffer import EventBuffer, push
from learning.pps.memory import MemoryParams, PPSMemory, activation, learn
from learning.pps.receptive_field import ReceptiveField, perceive
from pps_vision.experiments.charts import curves, panels
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.timing import quartiles, timed_runs
from pps_vision.types import Array, TaxelEvents

TAXELS = (32, 125, 500, 1000, 2000, 4000, 8000, 16000)
_LIMBS = 8
_SAMPLES = 60  # 3 s at 50 ms
_FIELD = ReceptiveField(distance_to="surface")
_RADIUS_M = 0.035
_COV = 1e-6 * np.eye(3)


@dataclass(frozen=True)
class Body:
    """Taxels of eight cylindrical limbs 30 cm long and 10 cm thick, and a ball that approaches the first taxel."""

    positions: Array
    normals: Array
    memory: PPSMemory
    ball: Array  # (60, 3) m, its path
    velocity: Array


@dataclass(frozen=True)
class WholeSkin(SampledStudy):
    """Processor time to perceive one stimulus and activate all taxels, and to learn from 3 s.

    Usually the ball is in the receptive fields of the taxels near it; in the worst case it is in all receptive fields.
    """

    n: int = 100  # runs of each; a fifth as many of learning

    def run(self) -> dict[str, Any]:
        """Return median and quartiles of the milliseconds, by case, for each number of taxels."""
        rng = np.random.default_rng(self.seed)
        ms: dict[str, list[list[float]]] = {}
        for n in TAXELS:
            body = make_body(n, rng)
            shape = body.positions.shape
            worst = replace(
                body,
                positions=np.broadcast_to(body.positions[0], shape),
                normals=np.broadcast_to(body.normals[0], shape),
            )
            calls: dict[str, tuple[Callable[[], object], int]] = {
                "one stimulus": (partial(activations, body), self.n),
                "one stimulus, worst case": (partial(activations, worst), self.n),
                "3 s learned": (partial(learn, body.memory, buffer_at_touch(body), np.arange(n) == 0), self.n // 5),
            }
            for case, (call, runs) in calls.items():
                ms.setdefault(case, []).append(quartiles(timed_runs(call, max(runs, 5))))
        return {"taxels": TAXELS, "ms": ms}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw time against the number of taxels."""
        figure, (axis,) = panels(1, width=6.0)
        curves(axis, numbers["taxels"], numbers["ms"], "taxels", "processor time (ms; quartiles)")
        axis.set(xscale="log", yscale="log")
        axis.legend(fontsize=8)
        return figure


def make_body(n: int, rng: np.random.Generator) -> Body:
    """Return a body of `n` taxels, uniform on eight limbs 40 cm apart, with random counts in its memory."""
    limb = np.arange(n) * _LIMBS // n
    angle = rng.uniform(0, 2 * np.pi, n)
    height = rng.uniform(-0.15, 0.15, n)
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    positions = 0.05 * normals + np.stack([0.4 * limb, np.zeros(n), height], axis=1)
    params = MemoryParams()
    counts = rng.integers(0, 50, (n, *params.bins, 2))
    memory = PPSMemory(tuple(f"limb{k}:{i}" for i, k in enumerate(limb)), limb, counts, params)
    velocity = -0.08 * normals[0]
    left_s = 0.05 * np.arange(_SAMPLES, 0, -1)
    return Body(positions, normals, memory, positions[0] - left_s[:, None] * velocity, velocity)


def activations(body: Body, sample: int = _SAMPLES // 2) -> Array:
    """Return the activations (n,) for the ball at one sample."""
    stimulus = (body.ball[sample], body.velocity, _RADIUS_M, _COV)
    return activation(body.memory, *perceive(_FIELD, body.positions, body.normals, *stimulus))


def buffer_at_touch(body: Body) -> EventBuffer:
    """Return the buffered samples of the whole approach."""
    buffer = EventBuffer()
    untouched = np.zeros(len(body.positions), bool)
    for k, p in enumerate(body.ball):
        D, TTC = perceive(_FIELD, body.positions, body.normals, p, body.velocity)
        buffer = push(buffer, TaxelEvents(0.05 * k, body.memory.taxel_ids, D, TTC, untouched))
    return buffer
