"""Cost of the whole skin: time for one stimulus and for one learning iteration, by the number of taxels."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.pps.buffer import EventBuffer, push
from learning.pps.memory import MemoryParams, PPSMemory, activation, learn, windows
from learning.pps.receptive_field import ReceptiveField, perceive
from pps_vision.experiments.charts import curves, panels
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table
from pps_vision.experiments.timing import quartiles, timed_runs
from pps_vision.types import Array, TaxelEvents

TAXELS = (32, 125, 500, 1000, 2000, 4000, 8000, 16000)
_ICUB = 4000
_LIMBS = 8
_SAMPLES = 60  # 3 s at 50 ms
_FIELD, _RADIUS_M, _COV = ReceptiveField(distance_to="surface"), 0.035, 1e-6 * np.eye(3)


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

    Usually the ball is in the receptive fields of the taxels near it; in the worst case it is in all of them. The
    compiled code stands beside the same in NumPy.
    """

    n: int = 100
    """Runs of each; a fifth as many of learning."""

    def run(self) -> dict[str, Any]:
        """Return median and quartiles of the milliseconds, by case, for each number of taxels."""
        rng = np.random.default_rng(self.seed)
        cases = "one stimulus", "one stimulus, worst case", "worst case, NumPy", "3 s learned"
        found: dict[str, list[list[float]]] = {case: [] for case in cases}
        for n in TAXELS:
            body = make_body(n, rng)
            shape = body.positions.shape
            first = np.broadcast_to(body.positions[0], shape), np.broadcast_to(body.normals[0], shape)
            in_all = replace(body, positions=first[0], normals=first[1])
            learning = partial(learn, body.memory, buffer_at_touch(body), np.arange(n) == 0)
            found["one stimulus"].append(_quartiles(partial(activations, body), self.n))
            found["one stimulus, worst case"].append(_quartiles(partial(activations, in_all), self.n))
            found["worst case, NumPy"].append(_quartiles(partial(activations_by_arrays, in_all), self.n))
            found["3 s learned"].append(_quartiles(learning, self.n // 5))
        return {"taxels": TAXELS, "ms": found}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw time against the number of taxels."""
        figure, (axis,) = panels(1, width=6.0)
        curves(axis, numbers["taxels"], numbers["ms"], "taxels", "processor time (ms; quartiles)")
        axis.set(xscale="log", yscale="log")
        axis.legend(fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the times of the iCub's number of taxels, and how many times as long NumPy takes."""
        taxels = numbers["taxels"]
        at = taxels.index(_ICUB) if _ICUB in taxels else -1
        ms = {case: values[at] for case, values in numbers["ms"].items()}
        ratio = ms["worst case, NumPy"][0] / ms["one stimulus, worst case"][0]
        rows = [[case, *(f"{value:.2g}" for value in values)] for case, values in ms.items()]
        header = [f"{taxels[at]} taxels, processor time (ms)", "median", "25 %", "75 %"]
        return {"": Table(header, [*rows, ["NumPy / compiled, worst case", f"{ratio:.2g}", "", ""]])}


def _quartiles(call: Callable[[], object], runs: int) -> list[float]:
    """Median and quartiles of the processor time of a call (ms)."""
    return quartiles(timed_runs(call, max(runs, 5)))


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
    stimulus = (body.ball[sample], body.velocity, _RADIUS_M, _COV)
    return activation(body.memory, *perceive(_FIELD, body.positions, body.normals, *stimulus))


def activations_by_arrays(body: Body, sample: int = _SAMPLES // 2) -> Array:
    """Return the same as `activations`, computed as R eqs 1–5 stand there."""
    d, v = body.ball[sample] - body.positions, body.velocity
    distance, height = np.linalg.norm(d, axis=1), np.einsum("ni,ni->n", d, body.normals)
    closing = -d @ v / distance
    uncertain = _FIELD.min_closing_sigmas * np.sqrt(np.einsum("ni,ij,nj->n", d, _COV, d)) / distance
    D, gap = np.where(height >= 0, distance, -distance) - _RADIUS_M, distance - _RADIUS_M
    with np.errstate(divide="ignore"):
        ttc = np.where(gap <= 0, 0.0, np.where(np.abs(closing) > uncertain, gap / closing, np.inf))
    aside = np.sqrt(np.maximum(distance**2 - height**2, 0.0))
    within = (aside <= _FIELD.base_radius_m + height * np.tan(_FIELD.half_angle_rad)) & (gap <= _FIELD.length_m)
    inside = within & body.memory.params.covers(D, ttc)
    w_distance, w_ttc = windows(body.memory.params, D, ttc, inside)
    found = np.zeros(len(d))
    found[inside] = np.einsum("kd,kdt,kt->k", w_distance, body.memory.frequency[inside], w_ttc)
    return found


def buffer_at_touch(body: Body) -> EventBuffer:
    """Return the buffered samples of the whole approach."""
    buffer, none = EventBuffer(), np.zeros(len(body.positions), bool)
    for k, p in enumerate(body.ball):
        D, TTC = perceive(_FIELD, body.positions, body.normals, p, body.velocity)
        buffer = push(buffer, TaxelEvents(0.05 * k, body.memory.taxel_ids, D, TTC, none))
    return buffer
