"""Locally weighted projection regression (LWPR): incremental regression by overlapping local linear models.

Vijayakumar, D'Souza and Schaal, "Incremental online learning in high dimensions", Neural Computation 17 (2005), with
the safeguards that the documentation of the authors' library describes. A receptive field responds to x with the
activation w = exp(−½ D |x − c|²) and predicts by a linear model, fitted by partial least squares; the prediction is
the mean over fields, weighted by w. A sample to which no field responds adds a field. Each output has its own fields.

The metric D is constant in all studies. Co-moments are exact instead of recursive: the recursion has the same
limit, but with tens of samples per field the difference is half of the error.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.jit import njit
from pps_vision.types import Array

_TINY = 1e-10  # initial weight; keeps the first divisions finite
_FIRST_CAPACITY = 64


class LWPRParams(NamedTuple):
    """Parameters, by default the authors' library's, for inputs and outputs of the order of 1.

    A named tuple because compiled code takes it. Fields are never pruned: with the library's default they never are.
    """

    init_D: float = 25.0  # metric D
    w_gen: float = 0.1  # largest activation at which a field is added
    cutoff: float = 0.001  # activation below which a field is neither updated nor queried
    first_forgetting: float = 0.999  # forgetting factor of a new field
    last_forgetting: float = 0.99999  # forgetting factor after many samples
    forgetting_pace: float = 0.9999  # decay per sample of the difference between the factor and the last one
    first_projections: int = 2  # projections of a new field, at most one per input
    add_threshold: float = 0.5  # a projection is added below this ratio of errors with and without the last one


class Fields(NamedTuple):
    """F receptive fields of n inputs, one per row; rows beyond those in use are zero. Sums and means forget."""

    output: NDArray[np.intp]  # (F,) output that the field predicts
    n_projections: NDArray[np.intp]  # (F,) projections in use
    center: Array  # (F, n) c
    weight: Array  # (F,) Σ w
    n_seen: Array  # (F,) number of samples
    forgetting: Array  # (F,) forgetting factor
    mean_x: Array  # (F, n) weighted mean of the inputs
    mean_y: Array  # (F,) weighted mean of the output
    xx: Array  # (F, n, n) weighted co-moments of the inputs about their mean
    xy: Array  # (F, n) weighted co-moments of inputs and output
    left_out_error: Array  # (F, n) Σ w e², e the leave-one-out residual with 1 to n projections

    @classmethod
    def empty(cls, capacity: int, n: int) -> "Fields":
        """Return rows of zeros."""
        shapes = {"center": (n,), "mean_x": (n,), "xx": (n, n), "xy": (n,), "left_out_error": (n,)}
        types: dict[str, Any] = {"output": np.intp, "n_projections": np.intp}
        return cls(**{f: np.zeros((capacity, *shapes.get(f, ())), types.get(f, np.float64)) for f in cls._fields})


class LWPR:
    """Model of `n_outputs` functions of `n_inputs` inputs."""

    def __init__(self, n_inputs: int, n_outputs: int, params: LWPRParams) -> None:
        self.params = params
        self.n_outputs = n_outputs
        self.n_fields = 0
        self.fields = Fields.empty(_FIRST_CAPACITY, n_inputs)

    def update(self, x: Array, y: Array) -> None:
        """Learn samples x (N, inputs), y (N, outputs) one by one."""
        for sample_x, sample_y in zip(x, y, strict=True):
            largest = _learn(self.fields, self.n_fields, sample_x, sample_y, self.params)
            for output in np.flatnonzero(largest <= self.params.w_gen).tolist():
                self._add(sample_x, sample_y[output], output)

    def _add(self, x: Array, y: float, output: int) -> None:
        """Add a field at x."""
        k = self.n_fields
        if k == len(self.fields.output):
            self.fields = Fields(*(np.concatenate([rows, np.zeros_like(rows)]) for rows in self.fields))
        fields = self.fields
        fields.output[k] = output
        fields.n_projections[k] = min(self.params.first_projections, len(x))
        fields.center[k] = x
        fields.mean_x[k] = x
        fields.mean_y[k] = y
        fields.forgetting[k] = self.params.first_forgetting
        fields.weight[k] = _TINY
        fields.n_seen[k] = _TINY
        self.n_fields += 1

    def predict(self, x: ArrayLike) -> Array:
        """Return predictions (N, outputs) at x (N, inputs); NaN where no field with enough samples responds."""
        total = _sums(self.fields, self.n_fields, np.asarray(x, float), self.n_outputs, self.params)
        return total[..., 0] / np.where(total[..., 1] > 0, total[..., 1], np.nan)


@njit(cache=True, error_model="numpy")
def _learn(fields: Fields, n_fields: int, x: Array, y: Array, params: LWPRParams) -> Array:
    """Update in place all fields that respond to a sample; return the largest activation (outputs,)."""
    largest = np.zeros(len(y))
    for k in range(n_fields):
        w = _activation(fields.center[k], x, params)
        if w > 0:
            output = fields.output[k]
            _regress(fields, k, x, y[output], w, params)
            _add_projection(fields, k, params.add_threshold)
            largest[output] = max(w, largest[output])
    return largest


@njit(cache=True, error_model="numpy")
def _sums(fields: Fields, n_fields: int, x: Array, n_outputs: int, params: LWPRParams) -> Array:
    """Sums over fields at x (N, inputs), y being a field's prediction: Σ w y and Σ w (N, outputs, 2)."""
    n_queries, n = x.shape
    total = np.zeros((n_queries, n_outputs, 2))
    for k in range(n_fields):
        if fields.n_seen[k] <= 2 * n:
            continue
        offset, slope = _linear_model(fields, k)
        output = fields.output[k]
        for i in range(n_queries):
            w = _activation(fields.center[k], x[i], params)
            if w > 0:
                total[i, output, 0] += w * (offset + slope @ x[i])
                total[i, output, 1] += w
    return total


@njit(cache=True, error_model="numpy")
def _activation(center: Array, x: Array, params: LWPRParams) -> float:
    """w = exp(−½ D |x − c|²); 0 below the cutoff."""
    distance2 = 0.0
    for i in range(len(x)):
        distance2 += (x[i] - center[i]) ** 2
    exponent = -0.5 * params.init_D * distance2
    return math.exp(exponent) if exponent > math.log(params.cutoff) else 0.0


@njit(cache=True, error_model="numpy")
def _regress(fields: Fields, k: int, x: Array, y: float, w: float, params: LWPRParams) -> None:
    """Update the moments and errors of field k with one sample of activation w."""
    forget = fields.forgetting[k]
    fields.weight[k] = forget * fields.weight[k] + w
    fields.n_seen[k] = forget * fields.n_seen[k] + 1
    fields.forgetting[k] += (1 - params.forgetting_pace) * (params.last_forgetting - forget)
    gain = w / fields.weight[k]
    z = x - fields.mean_x[k]
    residual = y - fields.mean_y[k]
    fields.mean_x[k] += gain * z
    fields.mean_y[k] += gain * residual
    increment = w * (1 - gain) * z
    fields.xx[k] = forget * fields.xx[k] + np.outer(increment, z)
    fields.xy[k] = forget * fields.xy[k] + increment * residual
    if fields.n_seen[k] * (1 - fields.forgetting[k]) <= 0.1:  # too few samples for meaningful errors
        return
    z *= 1 - gain
    residual *= 1 - gain
    xx = fields.xx[k].copy()
    xy = fields.xy[k].copy()
    left_out = 1.0  # 1 − leverage of the projections up to r
    for r in range(len(x)):
        direction, load, ss, slope = _project(xx, xy)
        s = z @ direction
        left_out -= w * s * s / ss
        residual -= s * slope
        z -= s * load
        e = residual / max(left_out, _TINY)
        fields.left_out_error[k, r] = forget * fields.left_out_error[k, r] + w * e**2


@njit(cache=True, error_model="numpy")
def _project(xx: Array, xy: Array) -> tuple[Array, Array, float, float]:
    """Next projection of partial least squares, subtracted from the co-moments in place.

    Returns its unit direction u and its load p = Σ w s x / Σ w s² (inputs,), Σ w s² and the regression coefficient of
    y on the score s.
    """
    length = math.sqrt(xy @ xy)
    direction = xy / (length + 1e-300)
    load = xx @ direction
    ss = float(direction @ load) + _TINY
    slope = length / ss
    xy -= slope * load
    xx -= np.outer(load, load) / ss
    return direction, load / ss, ss, slope


@njit(cache=True, error_model="numpy")
def _linear_model(fields: Fields, k: int) -> tuple[float, Array]:
    """Prediction of field k at x = 0, and its derivative (inputs,)."""
    n = len(fields.center[k])
    xx = fields.xx[k].copy()
    xy = fields.xy[k].copy()
    dz_dx = np.eye(n)  # derivative of the deflated input
    slope = np.zeros(n)
    for _ in range(fields.n_projections[k]):
        direction, load, _, coefficient = _project(xx, xy)
        ds_dx = direction @ dz_dx  # derivative of the score
        slope += coefficient * ds_dx
        dz_dx -= np.outer(load, ds_dx)
    return fields.mean_y[k] - slope @ fields.mean_x[k], slope


@njit(cache=True, error_model="numpy")
def _add_projection(fields: Fields, k: int, add_threshold: float) -> None:
    """Add a projection where the last one reduced the leave-one-out error enough."""
    last = fields.n_projections[k] - 1
    if 0 < last < fields.center.shape[1] - 1:
        error = fields.left_out_error[k, last] / fields.weight[k] + _TINY
        error_without = fields.left_out_error[k, last - 1] / fields.weight[k] + _TINY
        if error < add_threshold * error_without and fields.n_seen[k] * (1 - fields.forgetting[k]) > 0.5:
            fields.n_projections[k] += 1
