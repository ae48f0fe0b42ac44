"""The Monte Carlo of a single taxel (R, "Monte Carlo simulation of a single taxel"): a shower of objects."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from learning.pps.memory import MemoryParams, PPSMemory, activation, count_samples
from learning.pps.receptive_field import ReceptiveField, distance_and_ttc
from pps_vision.types import Array, Mask

Reference = Literal["taxel", "landing"]
"""From where D and TTC are measured: the taxel (R eqs 1–2), or the point where the path ends (R's published maps)."""

_UP = np.array([0.0, 0.0, 1.0])
_ANYWHERE = ReceptiveField(base_radius_m=10.0, length_m=10.0)  # the published maps know no cone
_CHUNK = 2000  # objects at once: what bounds the working memory


@dataclass(frozen=True)
class Shower:
    """Objects that fly straight, each at its own constant speed, from a starting zone above a flat skin to a
    point on it that is Gaussian about the middle one of three neighbouring virtual taxels.

    Values as R's text gives them; where it is silent, as its released data show: starts are uniform in distance
    and in angle from the normal, noise is 1 mm and 1 cm/s (both off here).  The neighbours lie as the skin's
    triangular modules do, 3 cm wide.  What is measured carries Gaussian noise and is `offset_m` off along the normal.
    """

    start_distance_m: tuple[float, float] = (0.25, 0.30)
    start_half_angle_rad: float = float(np.pi / 4)
    landing_sigma_m: float = 0.05
    speed_m_s: tuple[float, float] = (0.05, 0.15)
    taxels_m: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.0173, 0.0), (-0.0087, 0.015))
    touch_radius_m: float = 0.02
    position_noise_m: float = 0.0
    velocity_noise_m_s: float = 0.0
    offset_m: float = 0.0
    step_s: float = 0.05
    length_s: float = 3.0

    def __post_init__(self) -> None:
        (r0, r1), (v0, v1) = self.start_distance_m, self.speed_m_s
        if not (0 < r0 <= r1 and 0 < v0 <= v1 and 0 <= self.start_half_angle_rad < np.pi / 2):
            raise ValueError(f"{self}: expected distances and speeds above 0 from low to high, an angle of 0–90°")
        if not (self.landing_sigma_m > 0 and self.touch_radius_m > 0 and 0 < self.step_s <= self.length_s):
            raise ValueError(f"{self}: expected a spread, a touch radius and a time step above 0")
        if min(self.position_noise_m, self.velocity_noise_m_s) < 0 or not self.taxels_m:
            raise ValueError(f"{self}: expected noise of at least 0 and at least one taxel")


@dataclass(frozen=True)
class Fall:
    """What is measured of N objects in the time before they land, oldest first: displacements from the n taxels
    `d_m` (N, T, n, 3) and velocities `v_m_s` (N, T, 1, 3), NaN before the start; `touched` (N, n)."""

    d_m: Array
    v_m_s: Array
    touched: Mask


def fall(shower: Shower, n: int, rng: np.random.Generator) -> Fall:
    """n objects of a shower, sampled every `step_s` from their start; of each the last `length_s`."""
    landing = np.zeros((n, 3))
    landing[:, :2] = rng.normal(0.0, shower.landing_sigma_m, (n, 2))
    distance = rng.uniform(*shower.start_distance_m, n)
    angle, turn = rng.uniform(0, shower.start_half_angle_rad, n), rng.uniform(0, 2 * np.pi, n)
    start = distance[:, None] * np.stack(
        [np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], axis=1
    )
    way, speed = landing - start, rng.uniform(*shower.speed_m_s, n)
    length = np.linalg.norm(way, axis=1)
    velocity, duration = way * (speed / length)[:, None], length / speed
    steps = np.arange(int(shower.length_s / shower.step_s), -1, -1)
    remaining = np.mod(duration, shower.step_s)[:, None] + steps * shower.step_s  # (N, T) until it lands
    remaining[remaining > duration[:, None] + 1e-9] = np.nan
    p = landing[:, None] - remaining[..., None] * velocity[:, None]
    p += shower.offset_m * _UP
    v = np.broadcast_to(velocity[:, None], p.shape)
    if shower.position_noise_m or shower.velocity_noise_m_s:
        p += rng.normal(0, shower.position_noise_m, p.shape)
        v = v + rng.normal(0, shower.velocity_noise_m_s, p.shape)
    taxels = np.array([(x, y, 0.0) for x, y in shower.taxels_m])
    touched = np.linalg.norm(landing[:, None] - taxels, axis=2) <= shower.touch_radius_m
    return Fall(p[:, :, None] - taxels, v[:, :, None], touched)


def from_landing(d_m: Array, v_m_s: Array, offset_m: float = 0.0) -> tuple[Array, Array]:
    """D and TTC (…, T − 1, n) of displacements and velocities (…, T, n, 3) measured from the last displacement,
    which itself is no sample: so R's published maps are counted.

    With an offset TTC is still the time to where the path ends, and D is taken from the point of the
    mistaken skin that was touched: the ridge of Fig 3 cuts TTC = 0 there.
    """
    d, v = np.asarray(d_m, dtype=float), np.asarray(v_m_s, dtype=float)
    left = d[..., :-1, :, :] - d[..., -1:, :, :]
    _, ttc = distance_and_ttc(_ANYWHERE, left, _UP, v[..., :-1, :, :])
    distance, _ = distance_and_ttc(_ANYWHERE, left + offset_m * _UP, _UP, v[..., :-1, :, :])
    return distance, ttc


def rain(
    shower: Shower,
    n: int,
    rng: np.random.Generator,
    params: MemoryParams,
    reference: Reference = "taxel",
    field: ReceptiveField | None = None,
    near_misses: bool = False,
) -> PPSMemory:
    """The memory of the shower's taxels after n objects.

    As in R only what touches one of them teaches: positive samples for the touched, negative for the others.  With
    `near_misses` the others teach too, negative samples for all.  Memory in use does not grow with n.
    """
    n_taxels = len(shower.taxels_m)
    nothing = np.empty((0, 1, n_taxels))
    memory = learned(params, nothing, nothing, np.empty((0, n_taxels), bool))
    for objects in _chunks(shower, n, rng):
        if reference == "taxel":
            D, TTC = distance_and_ttc(field or ReceptiveField(), objects.d_m, _UP, objects.v_m_s)
        else:
            D, TTC = from_landing(objects.d_m, objects.v_m_s, shower.offset_m)
        more = learned(params, D, TTC, objects.touched, near_misses)
        memory = replace(memory, counts=memory.counts + more.counts)
    return memory


def _chunks(shower: Shower, n: int, rng: np.random.Generator) -> Iterator[Fall]:
    for first in range(0, n, _CHUNK):
        yield fall(shower, min(_CHUNK, n - first), rng)


def learned(params: MemoryParams, D: Array, TTC: Array, touched: Mask, near_misses: bool = False) -> PPSMemory:
    """The memory of n taxels after N objects of which T moments were perceived: D and TTC (N, T, n), `touched`
    (N, n).  Objects that touched the same taxels are counted together."""
    n = touched.shape[1]
    # one more taxel stands for the rest of the skin: it perceives nothing and is touched by what misses the others
    names = (*map(str, range(n)), "elsewhere")
    memory = PPSMemory(names, np.zeros(n + 1, np.intp), np.zeros((n + 1, *params.bins, 2), np.int64), params)
    nowhere = np.full((*D.shape[:2], 1), np.nan)
    D, TTC = np.concatenate([D, nowhere], axis=2), np.concatenate([TTC, nowhere], axis=2)
    missed = ~touched.any(axis=1, keepdims=True) & near_misses
    touched = np.concatenate([touched, missed], axis=1)
    for pattern in np.unique(touched[touched.any(axis=1)], axis=0):
        same = np.all(touched == pattern, axis=1)
        memory = count_samples(memory, D[same].reshape(-1, n + 1), TTC[same].reshape(-1, n + 1), pattern)
    return PPSMemory(names[:-1], memory.part_index[:-1], memory.counts[:-1], params)


def contact_probability(
    shower: Shower,
    n: int,
    rng: np.random.Generator,
    field: ReceptiveField | None = None,
    given_a_touch: bool = False,
) -> PPSMemory:
    """P(touch | D, TTC) that the shower defines, as `frequency` of a memory with cells of 3 mm and 62 ms of which
    every object teaches (`given_a_touch`: every object that touches some taxel, all that R's rule sees); its
    counts say how often D and TTC occur.  With n = 200 000 it is good to about 0.01."""
    return rain(shower, n, rng, MemoryParams(bins=(96, 48)), field=field, near_misses=not given_a_touch)


def map_error(memory: PPSMemory, truth: PPSMemory, taxel: int = 0) -> float:
    """RMS difference between a taxel's activation and the true probability of contact, over the D and TTC
    that occur; its square is what the map costs in Brier score beside a map that knows."""
    (d0, d1), (t0, t1) = truth.params.distance_range_m, truth.params.ttc_range_s
    n_d, n_t = truth.params.bins
    weight = truth.counts[taxel].sum(axis=-1)
    i, j = np.nonzero(weight)
    D, TTC = d0 + (d1 - d0) * (i + 0.5) / n_d, t0 + (t1 - t0) * (j + 0.5) / n_t
    alone = PPSMemory(memory.taxel_ids[taxel : taxel + 1], np.zeros(1, np.intp), memory.counts[[taxel]], memory.params)
    wrong = activation(alone, D[:, None], TTC[:, None])[:, 0] - truth.frequency[taxel][i, j]
    return float(np.sqrt(np.average(wrong**2, weights=weight[i, j])))
