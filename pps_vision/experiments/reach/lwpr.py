"""LWPR on the cross function, beside what the authors' library gives (FACTS §6)."""

from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from tqdm import tqdm

from pps_vision.experiments.baselines.lwpr import LWPR, LWPRParams
from pps_vision.experiments.baselines.lwpr_metric import MetricParams
from pps_vision.experiments.chart import panels
from pps_vision.experiments.study import Study
from pps_vision.types import Array

_ADAPTS = LWPRParams(init_D=50, w_gen=0.2, metric=MetricParams(rate=250))
_GRID = np.stack(np.meshgrid(*[np.linspace(-1, 1, 41)] * 2), axis=-1).reshape(-1, 2)


@dataclass(frozen=True)
class Case:
    """How LWPR is taught `n_points` noisy points `n_epochs` times, and what the authors' library gave: the least and
    the greatest of five seeds' receptive fields (where quoted) and normalised errors."""

    params: LWPRParams
    n_points: int
    n_epochs: int
    gaussian: bool
    """Noise of standard deviation .1, as in the authors' own script of this case, instead of ±.05 evenly."""
    fields: tuple[int, int] | None
    nmse: tuple[float, float]


CASES = {
    "adapting": Case(_ADAPTS, 20_000, 1, False, (54, 58), (0.019, 0.022)),
    "full metrics, adapting rates": Case(
        replace(_ADAPTS, init_D=25, metric=MetricParams(rate=250, full=True, meta_rate=250)),
        *(500, 20, True, (38, 43), (0.032, 0.043)),
    ),
    "not adapting": Case(replace(_ADAPTS, metric=MetricParams(rate=0)), 20_000, 1, False, None, (0.058, 0.065)),
}


def cross(x: Array) -> Array:
    """(N,) the cross function of points (N, 2)."""
    ridges = np.exp(-10 * x[:, 0] ** 2), np.exp(-50 * x[:, 1] ** 2), 1.25 * np.exp(-5 * np.sum(x**2, axis=1))
    return np.asarray(np.max(ridges, axis=0))


def _noise(case: Case, n: int, rng: np.random.Generator) -> Array:
    return rng.normal(0, 0.1, n) if case.gaussian else rng.uniform(-0.05, 0.05, n)


def taught(case: Case, rng: np.random.Generator, share: float = 1.0) -> tuple[LWPR, float]:
    """A model after a `share` of the case's points, and the CPU seconds an update took."""
    x = rng.uniform(-1, 1, (round(share * case.n_points), 2))
    y = cross(x) + _noise(case, len(x), rng)
    model = LWPR(2, 1, case.params)
    begun = process_time()
    for _ in range(case.n_epochs):
        for k in rng.permutation(len(x)):
            model.update(x[k], y[k : k + 1])
    return model, (process_time() - begun) / (case.n_epochs * len(x))


def nmse(model: LWPR) -> float:
    """Mean squared error on a 41×41 grid over the variance of the function there."""
    truth = cross(_GRID)
    return float(np.mean((model.predict(_GRID).mean[:, 0] - truth) ** 2) / truth.var())


def covered(model: LWPR, case: Case, rng: np.random.Generator) -> tuple[float, ...]:
    """The share of the grid where the truth, and where a new noisy observation, is within one and within two of the
    model's standard deviations; 68 and 95 % would be a normal distribution's."""
    answer, truth = model.predict(_GRID), cross(_GRID)
    seen = truth + _noise(case, len(truth), rng)
    return tuple(
        float(np.mean(np.abs(answer.mean[:, 0] - y) <= times * answer.std[:, 0]))
        for y in (truth, seen)
        for times in (1, 2)
    )


@dataclass(frozen=True)
class CrossFunction(Study):
    """Receptive fields and errors of LWPR, and whether one model of two outputs is two models."""

    seed: int = 0
    """Seed of the first model of each kind; the others count up."""
    n: int = 5
    """Models of each kind."""

    def run(self) -> dict[str, Any]:
        """By case: fields, normalised errors, the authors' ranges, what the bounds cover (the truth within one and two
        standard deviations, then observations), µs an update and a query (CPU time)."""
        if self.n < 1:
            raise ValueError(f"bench reach lwpr: --n {self.n}; expected at least 1")
        cases = {name: self._measure(name, case) for name, case in CASES.items()}
        return {"cases": cases, "two_outputs_differ_by": self._two_outputs()}

    def _measure(self, name: str, case: Case) -> dict[str, Any]:
        fields, errors, coverage, update_us, query_us = [], [], [], [], []
        for seed in tqdm(range(self.seed, self.seed + self.n), desc=name, disable=None):
            model, seconds = taught(case, np.random.default_rng(seed))
            fields.append(int(model.n_fields[0]))
            errors.append(round(nmse(model), 4))
            coverage.append(covered(model, case, np.random.default_rng(seed)))
            update_us.append(1e6 * seconds)
            begun = process_time()
            for x in _GRID[::4]:
                model.predict(x[None])
            query_us.append(1e6 * (process_time() - begun) / len(_GRID[::4]))
        return {
            "fields": fields,
            "nmse": errors,
            "authors_fields": case.fields,
            "authors_nmse": case.nmse,
            "covered": np.mean(coverage, axis=0).round(3).tolist(),
            "update_us": round(min(update_us)),
            "query_us": round(min(query_us)),
        }

    def _two_outputs(self) -> float:
        """The greatest difference on the grid between one model of two outputs and two models."""
        rng = np.random.default_rng(self.seed)
        x = rng.uniform(-1, 1, (2000, 2))
        y = np.stack([cross(x) + rng.uniform(-0.05, 0.05, len(x)), np.sin(3 * x[:, 0])], axis=1)
        models = [LWPR(2, 2, _ADAPTS), LWPR(2, 1, _ADAPTS), LWPR(2, 1, _ADAPTS)]
        for at, (first, second) in zip(x, y, strict=True):
            for model, answer in zip(models, ((first, second), (first,), (second,)), strict=True):
                model.update(at, answer)
        together, *alone = (model.predict(_GRID).mean for model in models)
        return float(np.abs(together - np.concatenate(alone, axis=1)).max())

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Fields against error: each model a dot, the authors' ranges as boxes."""
        figure, (axis,) = panels(1)
        for color, (name, case) in zip(("tab:blue", "tab:green", "tab:orange"), numbers["cases"].items(), strict=True):
            axis.plot(case["fields"], case["nmse"], "o", color=color, label=f"ours: {name}", ms=5)
            low, high = case["authors_nmse"]
            left, right = case["authors_fields"] or (min(case["fields"]), max(case["fields"]))
            axis.add_patch(Rectangle((left, low), right - left, high - low, color=color, alpha=0.2, lw=0))
        axis.set_xlabel("receptive fields")
        axis.set_ylabel("normalised mean squared error")
        axis.set_ylim(0, None)
        axis.set_title("Cross function; shaded: the authors' library (of five seeds)", fontsize=9)
        axis.legend(fontsize=8)
        axis.grid(alpha=0.25)
        return figure
