"""LWPR on the cross function: receptive fields, error and update time beside the authors' C library."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from tqdm import tqdm

from pps_vision.experiments import charts
from pps_vision.experiments.baselines.lwpr import LWPR, LWPRParams
from pps_vision.experiments.baselines.lwpr_metric import MetricParams
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table
from pps_vision.experiments.timing import timed, timed_steps
from pps_vision.types import Array

_WARMING = 0.02  # share of the points of a first model, which does not count
_GRID = np.stack(np.meshgrid(*[np.linspace(-1, 1, 41)] * 2), axis=-1).reshape(-1, 2)
_AUTHORS_UPDATE_US = (2, 12)
"""Processor time of an update of the authors' C library in these settings, lowest and highest (not of the same run)."""
_GOAL_US = 20
_SHOWN_US = (1, 40)
_ADAPTING = LWPRParams(init_D=50, w_gen=0.2, metric=MetricParams(rate=250))


class Setting(NamedTuple):
    """How LWPR is trained, and what five seeds of the authors' C library gave, lowest and highest."""

    params: LWPRParams
    n_points: int
    n_epochs: int
    gaussian: bool
    """Noise of standard deviation 0.1, as in the authors' script of this setting; else uniform within ±0.05."""
    authors_fields: tuple[int, int] | None
    """Receptive fields."""
    authors_nmse: tuple[float, float]
    """Normalised mean squared error."""


SETTINGS = {
    "adapting metrics": Setting(_ADAPTING, 20_000, 1, False, (54, 58), (0.019, 0.022)),
    "full metrics, adapting rates": Setting(
        replace(_ADAPTING, init_D=25, metric=MetricParams(rate=250, full=True, meta_rate=250)),
        *(500, 20, True, (38, 43), (0.032, 0.043)),
    ),
    "constant metrics": Setting(
        replace(_ADAPTING, metric=MetricParams(rate=0)), 20_000, 1, False, None, (0.058, 0.065)
    ),
}


def cross(x: Array) -> Array:
    """Return (N,) the cross function of points (N, 2) (Schaal, Atkeson & Vijayakumar 2002)."""
    ridges = np.exp(-10 * x[:, 0] ** 2), np.exp(-50 * x[:, 1] ** 2), 1.25 * np.exp(-5 * np.sum(x**2, axis=1))
    return np.asarray(np.max(ridges, axis=0))


def train(setting: Setting, rng: np.random.Generator, share: float = 1.0) -> tuple[LWPR, float]:
    """Return a model after a `share` of the setting's points, and the processor time per update (µs)."""
    x = rng.uniform(-1, 1, (round(share * setting.n_points), 2))
    y = cross(x) + (rng.normal(0, 0.1, len(x)) if setting.gaussian else rng.uniform(-0.05, 0.05, len(x)))
    model = LWPR(2, 1, setting.params)

    def epochs() -> None:
        for _ in range(setting.n_epochs):
            for k in rng.permutation(len(x)):
                model.update(x[k], y[k : k + 1])

    return model, 1e3 * timed(epochs)[1] / (setting.n_epochs * len(x))


def judge(model: LWPR) -> dict[str, float]:
    """Return receptive fields, normalised mean squared error on a 41×41 grid, and processor time per query (µs)."""
    query_us = 1e3 * float(np.mean(timed_steps(model.predict, _GRID[::4, None])[1]))
    truth = cross(_GRID)
    error = np.mean((model.predict(_GRID)[:, 0] - truth) ** 2) / truth.var()
    return {"fields": int(model.n_fields[0]), "nmse": float(error), "query_us": query_us}


@dataclass(frozen=True)
class LwprCross(SampledStudy):
    """LWPR, the regressor of J, on the function by which its authors judge it, in three settings."""

    SHORT: ClassVar[Mapping[str, Any]] = {"share": 0.05}

    n: int = 5
    """Models per setting, the independent units."""
    share: float = 1.0
    """Share of the training points."""

    def run(self) -> dict[str, Any]:
        """Return by setting what each model gave, beside the authors' ranges."""
        found = {}
        for name, setting in SETTINGS.items():
            rows = []
            judge(train(setting, np.random.default_rng(self.seed), _WARMING)[0])  # loads what is compiled
            for seed in tqdm(self.seeds, desc=name, disable=None):
                model, update_us = train(setting, np.random.default_rng(seed), self.share)
                rows.append({**judge(model), "update_us": update_us})
            columns = {key: [row[key] for row in rows] for key in rows[0]}
            authors = {"authors_fields": setting.authors_fields, "authors_nmse": setting.authors_nmse}
            found[name] = {**columns, **authors}
        return {"settings": found}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw fields against error, a dot per model and the authors' ranges shaded; update time against error."""
        figure, (fields, time) = charts.panels(2)
        rows: dict[str, dict[str, Any]] = {}
        for k, (name, row) in enumerate(numbers["settings"].items()):
            n, nmse = np.array(row["fields"]), np.array(row["nmse"], dtype=float)
            fields.plot(n, nmse, "o", color=f"C{k}", ms=5, label=name)
            (left, right), (low, high) = row["authors_fields"] or (n.min(), n.max()), row["authors_nmse"]
            fields.add_patch(Rectangle((left, low), right - left, high - low, color=f"C{k}", alpha=0.2, lw=0))
            rows[name] = {"ms": np.percentile(row["update_us"], (25, 50, 75)).tolist(), "nmse": nmse.mean()}
        error = "normalised mean squared error"
        fields.set(xlabel="receptive fields", ylabel=error, ylim=(0, None))
        fields.set_title("shaded: the authors' library, five seeds", fontsize=9)
        fields.legend(fontsize=8)
        fields.grid(alpha=0.25)
        charts.speed_error(time, rows, "nmse", rows, time="processor time per update (µs)", error=error)
        time.axvspan(*_AUTHORS_UPDATE_US, color="0.5", alpha=0.15, lw=0)
        time.axvline(_GOAL_US, color="k", lw=0.8, ls="--")
        time.set_xlim(_SHOWN_US)
        time.set_title("shaded: the authors' library (not in the same run); dashed: goal", fontsize=9)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return fields, error and times of the models, median and range, beside the library's ranges."""
        rows = []
        for name, row in numbers["settings"].items():
            library = [row["authors_fields"], row["authors_nmse"], _AUTHORS_UPDATE_US]
            pairs = zip(("fields", "nmse", "update_us"), library, strict=True)
            cells = [cell for key, of in pairs for cell in (_spread(row[key]), "–" if of is None else _range(of))]
            rows.append([name, str(len(row["nmse"])), *cells, f"≤ {_GOAL_US}", _spread(row["query_us"])])
        header = [
            "setting",
            "models",
            "fields",
            "of the library",
            "error (nMSE)",
            "of the library",
            "update (µs)",
            "of the library",
            "goal",
        ]
        return {"": Table([*header, "query (µs)"], rows)}


def _spread(values: Sequence[float | None]) -> str:
    of = np.array(values, dtype=float)
    return f"{np.median(of):.3g} ({_range((of.min(), of.max()))})"


def _range(ends: Sequence[float]) -> str:
    return "–".join(f"{end:.3g}" for end in ends)
