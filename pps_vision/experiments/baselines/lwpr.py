"""Locally weighted projection regression (LWPR): incremental regression by overlapping local linear models.

Vijayakumar, D'Souza and Schaal, "Incremental online learning in high dimensions", Neural Computation 17 (2005), with
the safeguards that the documentation of the authors' library describes. A receptive field responds to x with the
activation w = exp(−½ D |x − c|²) and predicts by a linear model, fitted by partial least squares; the prediction is
the mean over fields, weighted by w. A sample to which no field responds adds a field. Each output has its own fields.

The metric D is constant, as it is in all studies. Co-moments are exact instead of recursive: the recursion has the same
limit, but with tens of samples per field the difference is half of the error.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.jit import njit
from pps_vision.types import Array, Mask

_TINY = 1e-10  # initial weight; keeps the first divisions finite
_FIRST_CAPACITY = 64


class LWPRParams(NamedTuple):
    """Parameters, by default those of the authors' library, for inputs and outputs of the order of 1.

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
    stale: Mask  # (F,) whether `offset` and `slope` are older than the moments
    offset: Array  # (F,) prediction at x = 0
    slope: Array  # (F, n) derivative of the prediction
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
        shapes = {"slope": (n,), "center": (n,), "mean_x": (n,), "xx": (n, n), "xy": (n,), "left_out_error": (n,)}
        types = {"output": np.intp, "n_projections": np.intp, "stale": np.bool_}
        return cls(**{f: np.zeros((capacity, *shapes.get(f, ())), types.get(f, np.float64)) for f in cls._fields})


class LWPR:
    """Model of `n_outputs` functions of `n_inputs` inputs."""

    def __init__(self, n_inputs: int, n_outputs: int, params: LWPRParams | None = None) -> None:
        self.params = params or LWPRParams()
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
        fields.stale[k] = True
        fields.center[k] = x
        fields.mean_x[k] = x
        fields.mean_y[k] = y
        fields.forgetting[k] = self.params.first_forgetting
        fields.weight[k] = _TINY
        fields.n_seen[k] = _TINY
        self.n_fields += 1

    def predict(self, x: ArrayLike) -> Array:
        """Return predictions (N, outputs) at x (N, inputs); NaN where no field with enough samples responds."""
        return self.predict_with_jacobian(x)[0]

    def predict_with_jacobian(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return predictions (N, outputs) at x (N, inputs) and their derivatives (N, outputs, inputs)."""
        mean, jacobian = _predict(self.fields, self.n_fields, np.asarray(x, float), self.n_outputs, self.params)
        return mean, jacobian


@njit(cache=True, error_model="numpy")
def _learn(fields: Fields, n_fields: int, x: Array, y: Array, params: LWPRParams) -> Array:
    """Update in place all fields that respond to a sample; return the largest activation (outputs,)."""
    largest = np.zeros(len(y))
    metric = math.sqrt(params.init_D)
    max_distance2 = -2 * math.log(params.cutoff)
    for k in range(n_fields):
        distance2 = _distance2(metric, fields.center[k], x)
        if distance2 >= max_distance2:
            continue
        w = math.exp(-0.5 * distance2)
        output = fields.output[k]
        _regress(fields, k, x, y[output], w, params)
        _add_projection(fields, k, params.add_threshold)
        largest[output] = max(w, largest[output])
    return largest


@njit(cache=True, error_model="numpy")
def _predict(fields: Fields, n_fields: int, x: Array, n_outputs: int, params: LWPRParams) -> tuple[Array, Array]:
    """Predictions (N, outputs) and Jacobian (N, outputs, inputs) at x (N, inputs); updates stale linear models."""
    n_queries, n = x.shape
    weight = np.zeros((n_queries, n_outputs))
    mean = np.zeros((n_queries, n_outputs))
    slope = np.zeros((n_queries, n_outputs, n))  # Σ w (∂y/∂x − y M²(x − c))
    decay = np.zeros((n_queries, n_outputs, n))  # Σ w M²(x − c) = −∂(Σ w)/∂x
    metric = math.sqrt(params.init_D)
    max_distance2 = -2 * math.log(params.cutoff)
    for k in range(n_fields):
        if fields.n_seen[k] <= 2 * n:
            continue
        if fields.stale[k]:
            _update_linear_model(fields, k)
        output = fields.output[k]
        for i in range(n_queries):
            distance2 = _distance2(metric, fields.center[k], x[i])
            if distance2 >= max_distance2:
                continue
            w = math.exp(-0.5 * distance2)
            y = fields.offset[k] + _dot(fields.slope[k], x[i])
            weight[i, output] += w
            mean[i, output] += w * y
            for j in range(n):
                narrowing = w * metric**2 * (x[i, j] - fields.center[k, j])
                slope[i, output, j] += w * fields.slope[k, j] - y * narrowing
                decay[i, output, j] += narrowing
    for i in range(n_queries):
        for output in range(n_outputs):
            total = weight[i, output] if weight[i, output] > 0 else np.nan
            mean[i, output] /= total
            for j in range(n):
                slope[i, output, j] = (slope[i, output, j] + mean[i, output] * decay[i, output, j]) / total
    return mean, slope


@njit(cache=True, error_model="numpy")
def _distance2(metric: float, center: Array, x: Array) -> float:
    """Σ (√D (xᵢ − cᵢ))²."""
    total = 0.0
    for i in range(len(x)):
        total += (metric * (x[i] - center[i])) ** 2
    return total


@njit(cache=True, error_model="numpy")
def _dot(a: Array, b: Array) -> float:
    """Σ aᵢ bᵢ of short vectors."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@njit(cache=True, error_model="numpy")
def _regress(fields: Fields, k: int, x: Array, y: float, w: float, params: LWPRParams) -> None:
    """Update the moments and errors of field k with one sample of activation w."""
    n = len(x)
    forget = fields.forgetting[k]
    fields.weight[k] = forget * fields.weight[k] + w
    fields.n_seen[k] = forget * fields.n_seen[k] + 1
    fields.forgetting[k] += (1 - params.forgetting_pace) * (params.last_forgetting - forget)
    fields.stale[k] = True
    z = np.empty(n)
    residual = _update_moments(fields, k, x, y, w, forget, z)
    if fields.n_seen[k] * (1 - fields.forgetting[k]) <= 0.1:  # too few samples for meaningful errors
        return
    xx = fields.xx[k].copy()
    xy = fields.xy[k].copy()
    direction = np.empty(n)
    load = np.empty(n)
    left_out = 1.0  # 1 − leverage of the projections up to r
    for r in range(n):
        ss, slope = _project(xx, xy, direction, load)
        s = _dot(z, direction)
        left_out -= w * s * s / ss
        residual -= s * slope
        for i in range(n):
            z[i] -= s * load[i]
        e = residual / max(left_out, _TINY)
        fields.left_out_error[k, r] = forget * fields.left_out_error[k, r] + w * e**2


@njit(cache=True, error_model="numpy")
def _update_moments(fields: Fields, k: int, x: Array, y: float, w: float, forget: float, z: Array) -> float:
    """Update weighted means and co-moments; writes x − mean into z (inputs,) and returns y − mean."""
    gain = w / fields.weight[k]
    off_y = y - fields.mean_y[k]
    fields.mean_y[k] += gain * off_y
    for i in range(len(x)):
        z[i] = x[i] - fields.mean_x[k, i]
        fields.mean_x[k, i] += gain * z[i]
    for i in range(len(x)):
        increment = w * (1 - gain) * z[i]
        for j in range(len(x)):
            fields.xx[k, i, j] = forget * fields.xx[k, i, j] + increment * z[j]
        fields.xy[k, i] = forget * fields.xy[k, i] + increment * off_y
    for i in range(len(x)):
        z[i] *= 1 - gain
    residual: float = (1 - gain) * off_y
    return residual


@njit(cache=True, error_model="numpy")
def _project(xx: Array, xy: Array, direction: Array, load: Array) -> tuple[float, float]:
    """Next projection of partial least squares, subtracted from the co-moments in place.

    Writes its unit direction u and its load p = Σ w s x / Σ w s² (inputs,).  Returns Σ w s² and the regression
    coefficient of y on the score s.
    """
    n = len(xy)
    length = math.sqrt(_dot(xy, xy))
    for i in range(n):
        direction[i] = xy[i] / (length + 1e-300)
    ss = _TINY
    for i in range(n):
        load[i] = _dot(xx[i], direction)
        ss += direction[i] * load[i]
    slope = length / ss
    for i in range(n):
        xy[i] -= slope * load[i]
    for i in range(n):
        for j in range(n):
            xx[i, j] -= load[i] * load[j] / ss
    for i in range(n):
        load[i] /= ss
    return ss, slope


@njit(cache=True, error_model="numpy")
def _update_linear_model(fields: Fields, k: int) -> None:
    """Compute `offset` and `slope` of field k from its moments."""
    n = len(fields.center[k])
    xx = fields.xx[k].copy()
    xy = fields.xy[k].copy()
    direction = np.empty(n)
    load = np.empty(n)
    dz_dx = np.eye(n)  # derivative of the deflated input
    ds_dx = np.empty(n)  # derivative of the score
    fields.slope[k, :] = 0.0
    for _ in range(fields.n_projections[k]):
        _, slope = _project(xx, xy, direction, load)
        for j in range(n):
            ds_dx[j] = _dot(direction, dz_dx[:, j])
            fields.slope[k, j] += ds_dx[j] * slope
        for i in range(n):
            for j in range(n):
                dz_dx[i, j] -= load[i] * ds_dx[j]
    fields.offset[k] = fields.mean_y[k] - _dot(fields.slope[k], fields.mean_x[k])
    fields.stale[k] = False


@njit(cache=True, error_model="numpy")
def _add_projection(fields: Fields, k: int, add_threshold: float) -> None:
    """Add a projection where the last one reduced the leave-one-out error enough."""
    last = fields.n_projections[k] - 1
    if 0 < last < fields.center.shape[1] - 1:
        error = fields.left_out_error[k, last] / fields.weight[k] + _TINY
        error_without = fields.left_out_error[k, last - 1] / fields.weight[k] + _TINY
        if error < add_threshold * error_without and fields.n_seen[k] * (1 - fields.forgetting[k]) > 0.5:
            fields.n_projections[k] += 1
