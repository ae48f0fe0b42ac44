"""Other ways to remember what came before a touch, to hold against R's table of counts, and which of them to take.

Each learns from samples of n taxels, D and TTC (N, n) with NaN where nothing was perceived and what came of it
`touched` (N, n), and answers with the probability of touch (…, n) at D and TTC (…, n), 0 for NaN.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from learning.pps.memory import MemoryParams, PPSMemory, activation, count_samples, windows
from pps_vision.types import Array, Mask

if TYPE_CHECKING:
    import torch


class Foresight(Protocol):
    """What a representation has learned."""

    def __call__(self, distance_m: Array, ttc_s: Array) -> Array:
        """Probability of touch (…, n) at D and TTC (…, n)."""
        ...


class Representation(Protocol):
    """A way to remember."""

    def fit(self, distance_m: Array, ttc_s: Array, touched: Mask, rng: np.random.Generator) -> Foresight:
        """Learn from samples (N, n)."""
        ...


@dataclass(frozen=True)
class Counts:
    """R's table of counts; with one bin of TTC the earlier, distance-only model.

    `normalised`: positives and all samples are smoothed each and then divided, so that a bin never visited has
    no say; R smooths their ratio, so that it speaks for 0.  A taxel counts what each of its neighbours has
    seen as `pooled` samples (0: only its own, as R).
    """

    params: MemoryParams
    normalised: bool = False
    pooled: float = 0.0

    def fit(self, distance_m: Array, ttc_s: Array, touched: Mask, rng: np.random.Generator) -> Foresight:
        """Count; samples with the same touches go together."""
        memory = counted(self.params, distance_m, ttc_s, touched)
        if self.pooled:
            own = (1 - self.pooled) * memory.counts
            memory = replace(memory, counts=own + self.pooled * memory.counts.sum(axis=0))
        if not self.normalised:
            return lambda distance, ttc: activation(memory, distance, ttc)
        return lambda distance, ttc: _ratio(memory, distance, ttc)


def counted(params: MemoryParams, distance_m: Array, ttc_s: Array, touched: Mask) -> PPSMemory:
    """A memory of samples (N, n), all taxels on one body part; samples that ended in no touch count too."""
    n = distance_m.shape[1]
    names, every = tuple(str(i) for i in range(n)), np.ones(n, bool)
    apart = PPSMemory(names, np.arange(n), np.zeros((n, *params.bins, 2), np.int64), params)
    positive, negative = (
        count_samples(apart, np.where(chosen, distance_m, np.nan), ttc_s, every).counts[..., 0].astype(np.int64)
        for chosen in (touched, ~touched)
    )
    return PPSMemory(names, np.zeros(n, np.intp), np.stack([positive, negative], axis=-1), params)


def _ratio(memory: PPSMemory, distance_m: Array, ttc_s: Array) -> Array:
    inside = memory.params.covers(distance_m, ttc_s)
    found = np.zeros(inside.shape)
    at = np.nonzero(inside)
    w_distance, w_ttc = windows(memory.params, distance_m, ttc_s, inside)
    seen = np.einsum("kd,kdtc,kt->kc", w_distance, memory.counts[at[-1]].astype(float), w_ttc)
    found[at] = seen[:, 0] / np.maximum(seen.sum(axis=1), 1e-12)
    return found


@dataclass(frozen=True)
class Kernel:
    """Nadaraya–Watson: the samples' outcomes, weighted by a Gaussian of D and TTC; a taxel keeps `most` samples."""

    sigma_m: float = 0.01
    sigma_s: float = 0.1
    most: int = 2000

    def fit(self, distance_m: Array, ttc_s: Array, touched: Mask, rng: np.random.Generator) -> Foresight:
        """Keep the samples, or as many of them as a taxel may keep, drawn at random."""
        scale = np.array([self.sigma_m, self.sigma_s])
        kept = []
        for D, TTC, y in zip(distance_m.T, ttc_s.T, touched.T, strict=True):
            known = np.flatnonzero(np.isfinite(D) & np.isfinite(TTC))
            some = rng.permutation(known)[: self.most]
            kept.append((np.stack([D[some], TTC[some]], axis=1) / scale, y[some].astype(float)))
        return lambda distance, ttc: np.stack(
            [
                _kernel_mean(x, y, np.stack([distance[..., i], ttc[..., i]], axis=-1) / scale)
                for i, (x, y) in enumerate(kept)
            ],
            axis=-1,
        )


def _kernel_mean(x: Array, y: Array, at: Array) -> Array:
    """Mean of y (N,) about points (…, 2), 0 for what is not finite; in portions, so that memory stays small."""
    flat = at.reshape(-1, 2)
    found = np.zeros(len(flat))
    finite = np.flatnonzero(np.isfinite(flat).all(axis=1))
    for some in np.array_split(finite, max(1, len(finite) // 500)) if len(x) else []:
        squared = ((flat[some, None] - x) ** 2).sum(axis=-1)
        w = np.exp(-0.5 * (squared - squared.min(axis=1, keepdims=True)))  # the nearest counts 1: no 0/0
        found[some] = w @ y / w.sum(axis=1)
    return found.reshape(at.shape[:-1])


@dataclass(frozen=True)
class Network:
    """A small network of D, TTC and the taxel's number (one-hot), one for all taxels, on the torch `device`."""

    hidden: int = 24
    epochs: int = 60
    learning_rate: float = 0.01
    batch: int = 512
    device: str = "cpu"

    def fit(self, distance_m: Array, ttc_s: Array, touched: Mask, rng: np.random.Generator) -> Foresight:
        """Adam on the cross entropy."""
        import torch  # takes seconds to load

        generator = torch.Generator().manual_seed(int(rng.integers(2**31)))
        n = distance_m.shape[1]
        x, known = _inputs(distance_m, ttc_s, self.device)
        y = torch.tensor(touched[known], dtype=torch.float32, device=self.device)[:, None]
        sizes = (2 + n, self.hidden), (self.hidden, self.hidden), (self.hidden, 1)
        first, second, last = (_linear(a, b, generator) for a, b in sizes)
        net = torch.nn.Sequential(first, torch.nn.Tanh(), second, torch.nn.Tanh(), last).to(self.device)
        optimiser = torch.optim.Adam(net.parameters(), lr=self.learning_rate)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, self.epochs)
        for _ in range(self.epochs):
            order = torch.tensor(rng.permutation(len(x)), device=self.device)
            for start in range(0, len(x), self.batch):
                rows = order[start : start + self.batch]
                optimiser.zero_grad()
                loss = torch.nn.functional.binary_cross_entropy_with_logits(net(x[rows]), y[rows])
                loss.backward()  # type: ignore[no-untyped-call]
                optimiser.step()
            schedule.step()
        return lambda distance, ttc: _answered(net, distance, ttc, self.device)


def _linear(n_inputs: int, n_outputs: int, generator: "torch.Generator") -> "torch.nn.Linear":
    """A layer with torch's usual first weights, drawn without torch's own generator, which all of a process share."""
    import torch

    layer: torch.nn.Linear = torch.nn.utils.skip_init(torch.nn.Linear, n_inputs, n_outputs)  # type: ignore[no-untyped-call]
    torch.nn.init.kaiming_uniform_(layer.weight, a=5**0.5, generator=generator)
    torch.nn.init.uniform_(layer.bias, -(n_inputs**-0.5), n_inputs**-0.5, generator=generator)
    return layer


def _inputs(distance_m: Array, ttc_s: Array, device: str) -> tuple["torch.Tensor", Mask]:
    import torch

    known: Mask = np.isfinite(distance_m) & np.isfinite(ttc_s)
    taxel = np.nonzero(known)[-1]
    one_hot = np.eye(distance_m.shape[-1])[taxel]
    x = np.column_stack([10 * distance_m[known], np.clip(ttc_s[known], -3, 6) / 1.5, one_hot])
    return torch.tensor(x, dtype=torch.float32, device=device), known


def _answered(net: "torch.nn.Module", distance_m: Array, ttc_s: Array, device: str) -> Array:
    import torch

    x, known = _inputs(distance_m, ttc_s, device)
    found = np.zeros(known.shape)
    with torch.inference_mode():
        found[known] = torch.sigmoid(net(x))[:, 0].cpu().numpy()
    return found


@dataclass(frozen=True)
class Measured:
    """What a representation costs a stimulus and how far what it says is off, on what it has not learned from:
    expected calibration error and Brier score (which also sees whether it tells apart)."""

    name: str
    us: float
    ece: float
    brier: float


def cheapest(table: Sequence[Measured], max_ece: float, max_brier: float = 1.0) -> Measured | None:
    """The representation that costs least of those with at most the asked-for calibration error and Brier score;
    None where none is that good."""
    if not (max_ece > 0 and max_brier > 0):
        raise ValueError(f"calibration error {max_ece}, Brier score {max_brier}: expected numbers above 0")
    good = [one for one in table if one.ece <= max_ece and one.brier <= max_brier]
    return min(good, key=lambda one: one.us, default=None)
