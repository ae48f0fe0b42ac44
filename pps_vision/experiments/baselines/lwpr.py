"""Locally weighted projection regression: incremental regression by overlapping linear models.

After Vijayakumar, D'Souza & Schaal, "Incremental online learning in high dimensions", Neural Computation 17
(2005), with the safeguards that the documentation of the authors' library describes.  Each receptive field is
a Gaussian about its centre with a linear model found by partial least squares (of moments kept exactly, where
the paper recurs); fields are added where none responds, and adapt their reach.  The fields of all outputs are
rows of one table: a sample updates those it activates, and no others, in one compiled loop.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.experiments.baselines.lwpr_fields import (
    CENTER,
    METRIC,
    OUTPUT,
    Fields,
    Groups,
    new_field,
    quadratic,
    row_of,
    write_form,
)
from pps_vision.experiments.baselines.lwpr_metric import MetricParams, adapt_metric
from pps_vision.experiments.baselines.lwpr_regression import (
    RegressionParams,
    add_projection,
    is_trusted,
    refresh_models,
    regress,
)
from pps_vision.jit import njit
from pps_vision.types import Array

_PAIRS_AT_ONCE = 4_000_000  # queries × fields looked at together


@dataclass(frozen=True)
class LWPRParams:
    """Defaults of the authors' library.  A field is born, `init_D` wide, where none responds above `w_gen`; what
    responds below `cutoff` is neither updated nor asked.  No field is ever pruned: by the library's default that takes
    a response above 1.  `init_D` and the metric's rates fit inputs and outputs of the order of 1."""

    init_D: float = 25.0
    w_gen: float = 0.1
    cutoff: float = 0.001
    metric: MetricParams = MetricParams()
    regression: RegressionParams = RegressionParams()


class LWPR:
    """A model of `n_outputs` functions of `n_inputs`, each with fields of its own."""

    def __init__(self, n_inputs: int, n_outputs: int, params: LWPRParams | None = None) -> None:
        """ValueError for no input or no output."""
        if n_inputs < 1 or n_outputs < 1:
            raise ValueError(f"{n_inputs} inputs, {n_outputs} outputs: expected at least one of each")
        self.n_inputs, self.n_outputs, self.params = n_inputs, n_outputs, params or LWPRParams()
        self.fields = Fields(n_inputs)
        p = self.params
        self._rates = (
            *(p.regression.last_forgetting, p.regression.forgetting_pace, p.regression.add_threshold),
            *(p.metric.rate, p.metric.penalty, p.metric.meta_rate),
        )

    @property
    def n_fields(self) -> NDArray[np.intp]:
        """(outputs,) receptive fields."""
        return np.bincount(self.fields.rows["output"], minlength=self.n_outputs)

    def update(self, x: ArrayLike, y: ArrayLike) -> None:
        """Learn one sample x (inputs,), y (outputs,); ValueError unless both are finite."""
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        shapes = x.shape == (self.n_inputs,) and y.shape == (self.n_outputs,)
        if not (shapes and all(map(math.isfinite, [*x.tolist(), *y.tolist()]))):
            raise ValueError(f"sample {x}, {y}: expected {self.n_inputs} and {self.n_outputs} finite numbers")
        p = self.params
        best = _learn(self.fields.groups, self.fields.forms, x, y, self._rates, p.metric.full, p.cutoff)
        for output, (first, w) in enumerate(best.tolist()):
            if w <= p.w_gen:
                self._add(x, y[output], output, self.fields.rows[int(first)] if w > 0.1 * p.w_gen else None)

    def _add(self, x: Array, y: float, output: int, like: np.void | None) -> None:
        """A new field about x, as wide as that which responds most if it has seen enough."""
        p = self.params
        metric, log_rate = np.sqrt(p.init_D) * np.eye(self.n_inputs), np.log(p.metric.rate or 1.0)
        if like is not None and is_trusted(like.reshape(1))[0]:
            metric = like["metric"]
        first = p.regression.first_forgetting, p.regression.first_projections
        self.fields.append(new_field(x, y, output, metric, log_rate, *first))

    def predict(self, x: ArrayLike) -> Array:
        """(N, outputs) the answers to queries x (N, inputs), the fields weighted by their responses.

        NaN where no field that has seen enough responds.
        """
        x = np.asarray(x, dtype=float)
        if x.ndim != 2 or x.shape[1] != self.n_inputs:
            raise ValueError(f"queries of shape {x.shape}: expected (N, {self.n_inputs})")
        step = max(1, _PAIRS_AT_ONCE // max(1, self.fields.n))
        return np.concatenate([self._predict(x[k : k + step]) for k in range(0, max(1, len(x)), step)])

    def _predict(self, x: Array) -> Array:
        i, k, w, y = self._responses(x)
        cell, n = i * self.n_outputs + self.fields.rows["output"][k], len(x) * self.n_outputs
        weight = np.bincount(cell, w, minlength=n).astype(float)
        mean = np.bincount(cell, w * y, minlength=n) / np.where(weight > 0, weight, np.nan)
        return mean.reshape(len(x), self.n_outputs)

    def jacobian(self, x: Array) -> Array:
        """(N, outputs, inputs) ∂mean/∂x at queries x (N, inputs), the responses' own change included; NaN where there
        is no mean."""
        step = max(1, _PAIRS_AT_ONCE // max(1, self.fields.n))
        return np.concatenate([self._jacobian(x[k : k + step]) for k in range(0, max(1, len(x)), step)])

    def _jacobian(self, x: Array) -> Array:
        i, k, w, y = self._responses(x)
        rows = self.fields.rows[k]
        cell, n = i * self.n_outputs + rows["output"], len(x) * self.n_outputs
        weight = np.bincount(cell, w, minlength=n).astype(float)
        known = np.where(weight > 0, weight, np.nan)
        mean = np.bincount(cell, w * y, minlength=n) / known
        M = rows["metric"]
        shift = np.swapaxes(M, 1, 2) @ (M @ (x[i] - rows["center"])[..., None])
        slope = w[:, None] * (rows["slope"] - (y - mean[cell])[:, None] * shift[..., 0])
        columns = [np.bincount(cell, column, minlength=n) / known for column in slope.T]
        return np.stack(columns, axis=1).reshape(len(x), self.n_outputs, self.n_inputs)

    def _responses(self, x: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]:
        """Pairs of a query and a field that responds to it and has seen enough: indices of both, how much it responds,
        and what it says."""
        q = quadratic(x) @ self.fields.forms.T
        i, k = np.nonzero(q < -2 * np.log(self.params.cutoff))
        rows = self.fields.rows
        stale = np.unique(k[rows["stale"][k] > 0])
        if len(stale):
            refresh_models(self.fields.groups, stale)
        trusted = is_trusted(rows, k)
        i, k = i[trusted], k[trusted]
        w = np.exp(-0.5 * np.maximum(q[i, k], 0.0))
        y = rows["offset"][k] + np.einsum("pi,pi->p", rows["slope"][k], x[i])
        return i, k, w, y


@njit(cache=True, error_model="numpy")
def _learn(
    table: Groups,
    forms: Array,
    x: Array,
    y: Array,
    rates: tuple[float, float, float, float, float, float],
    full: bool,
    cutoff: float,
) -> Array:
    """Update in place all fields that a sample x (inputs,), y (outputs,) activates.

    Returns for each output the index and activation of the field that it activates most, (outputs, 2), 0 without one.
    """
    last_forgetting, forgetting_pace, add_threshold, rate, penalty, meta_rate = rates
    n, farthest = len(x), -2 * math.log(cutoff)
    best = np.zeros((len(y), 2))
    for k in range(len(forms)):
        form, q, m = forms[k], forms[k, 0], 1 + n
        for i in range(n):
            q += form[1 + i] * x[i]
        for i in range(n):
            for j in range(i, n):
                q += form[m] * x[i] * x[j]
                m += 1
        if q >= farthest:
            continue
        row = row_of(table, k)
        output, w = row.whole[OUTPUT], math.exp(-0.5 * max(q, 0.0))
        fit = regress(row, x, y[output], w, (last_forgetting, forgetting_pace))
        if rate:
            adapt_metric(row, x, w, fit, penalty, full, meta_rate)
            write_form(form, row.matrices[METRIC], row.vectors[CENTER])
        add_projection(row, add_threshold)
        if w > best[output, 1]:
            best[output, 0], best[output, 1] = k, w
    return best
