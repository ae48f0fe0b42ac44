"""LWPR on the cross function: receptive fields, error and update time beside the authors' C library."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from pps_vision.experiments.baselines.lwpr import LWPR, LWPRParams
from pps_vision.experiments.tables import Table
from pps_vision.experiments.timing import timed
from pps_vision.types import Array

_N_SAMPLES = 20_000
_WARM_UP_SHARE = 0.02  # of the samples, for a first model that loads the compiled code
_GRID = np.stack(np.meshgrid(*[np.linspace(-1, 1, 41)] * 2), axis=-1).reshape(-1, 2)


class Setting(NamedTuple):
    """Parameters of LWPR, and the results of five seeds of the authors' C library, lowest and highest."""

    params: LWPRParams
    library_fields: tuple[int, int] | None  # receptive fields
    library_nmse: tuple[float, float]  # normalized mean squared error


SETTINGS = {
    "adapting metrics": Setting(LWPRParams(init_D=50, w_gen=0.2, rate=250), (54, 58), (0.019, 0.022)),
    "constant metrics": Setting(LWPRParams(init_D=50, w_gen=0.2, rate=0), None, (0.058, 0.065)),
}


def cross(x: Array) -> Array:
    """Return (N,) the cross function of points (N, 2) (Schaal, Atkeson & Vijayakumar 2002)."""
    ridges = (np.exp(-10 * x[:, 0] ** 2), np.exp(-50 * x[:, 1] ** 2), 1.25 * np.exp(-5 * np.sum(x**2, axis=1)))
    return np.asarray(np.max(ridges, axis=0))


def train(params: LWPRParams, rng: np.random.Generator, share: float) -> tuple[LWPR, float]:
    """Return a model trained with a share of 20 000 samples, and the processor time per update (µs)."""
    x = rng.uniform(-1, 1, (round(share * _N_SAMPLES), 2))
    y = cross(x) + rng.uniform(-0.05, 0.05, len(x))
    order = rng.permutation(len(x))
    model = LWPR(2, 1, params)
    _, ms = timed(lambda: model.update(x[order], y[order, None]))
    return model, 1000 * ms / len(x)


def nmse(model: LWPR) -> float:
    """Return the normalized mean squared error on a 41×41 grid."""
    truth = cross(_GRID)
    return float(np.mean((model.predict(_GRID)[:, 0] - truth) ** 2) / truth.var())


def run(seed: int, n: int, share: float) -> dict[str, Any]:
    """Return by setting the results of each model, beside the library's ranges."""
    settings = {}
    for name, setting in SETTINGS.items():
        train(setting.params, np.random.default_rng(seed), _WARM_UP_SHARE)
        columns: dict[str, list[float]] = {"fields": [], "nmse": [], "update_us": []}
        for k in tqdm(range(n), desc=name, disable=None):
            model, update_us = train(setting.params, np.random.default_rng(seed + k), share)
            columns["fields"].append(model.n_fields)
            columns["nmse"].append(nmse(model))
            columns["update_us"].append(update_us)
        settings[name] = {
            **columns,
            "library_fields": setting.library_fields,
            "library_nmse": setting.library_nmse,
        }
    return {"settings": settings}


def table(numbers: dict[str, Any]) -> Table:
    """Return fields, error and update time of the models, median and range, beside the library's ranges."""
    rows = []
    for name, row in numbers["settings"].items():
        fields = _range(row["library_fields"]) if row["library_fields"] else "–"
        rows.append([name, _spread(row["fields"]), fields, _spread(row["nmse"]), _range(row["library_nmse"]),
                     _spread(row["update_us"])])  # fmt: skip
    return Table(["setting", "fields", "library", "error (nMSE)", "library", "update (µs)"], rows)


def _spread(values: Sequence[float]) -> str:
    return f"{np.median(values):.3g} ({_range((min(values), max(values)))})"


def _range(ends: Sequence[float]) -> str:
    return "–".join(f"{end:.3g}" for end in ends)
