"""Locally weighted projection regression (LWPR): incremental regression by overlapping local linear models.

Vijayakumar, D'Souza and Schaal, "Incremental online learning in high dimensions", Neural Computation 17 (2005), with
the safeguards that the documentation of the authors' library describes.  A receptive field responds to x with the
activation w = exp(−½ Σ Mᵢ²(xᵢ − cᵢ)²) and predicts by a linear model, fitted by partial least squares; the prediction
is the mean over fields, weighted by w.  A sample to which no field responds adds a field.  Each output has its own
fields.

Two differences from the paper: the metric is diagonal, and co-moments are exact instead of recursive.  The recursion
has the same limit, but with tens of samples per field the difference is half of the error.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.jit import njit
from pps_vision.types import Array, Mask

_TINY = 1e-10  # initial weight; keeps the first divisions finite
_MAX_METRIC_STEP = 0.1  # relative to the largest metric element; a larger step is refused and halves the rate
_FIRST_CAPACITY = 64


class LWPRParams(NamedTuple):
    """Parameters, by default those of the authors' library, for inputs and outputs of the order of 1.

    A named tuple because compiled code takes it.  Fields are never pruned: with the library's default they never are.
    """

    init_D: float = 25.0  # metric M² of a new field
    w_gen: float = 0.1  # largest activation at which a field is added
    cutoff: float = 0.001  # activation below which a field is neither updated nor queried
    rate: float = 50.0  # learning rate of the metric; 0: the metric is constant
    penalty: float = 1e-6  # weight γ of the penalty on narrow fields
    first_forgetting: float = 0.999  # forgetting factor of a new field
    last_forgetting: float = 0.99999  # forgetting factor after many samples
    forgetting_pace: float = 0.9999  # decay per sample of the difference between the factor and the last one
    first_projections: int = 2  # projections of a new field, at most one per input
    add_threshold: float = 0.5  # a projection is added below this ratio of errors with and without the last one


class Fields(NamedTuple):
    """F receptive fields of n inputs, one per row; rows beyond those in use are zero.  Sums and means forget."""

    output: NDArray[np.intp]  # (F,) output that the field predicts
    n_projections: NDArray[np.intp]  # (F,) projections in use
    stale: Mask  # (F,) whether `offset` and `slope` are older than the moments
    offset: Array  # (F,) prediction at x = 0
    slope: Array  # (F, n) derivative of the prediction
    center: Array  # (F, n) c
    metric: Array  # (F, n) diagonal of M
    rate: Array  # (F, n) learning rates of the metric
    weight: Array  # (F,) Σ w
    n_seen: Array  # (F,) number of samples
    forgetting: Array  # (F,) forgetting factor
    mean_x: Array  # (F, n) weighted mean of the inputs
    mean_y: Array  # (F,) weighted mean of the output
    xx: Array  # (F, n, n) weighted co-moments of the inputs about their mean
    xy: Array  # (F, n) weighted co-moments of inputs and output
    error: Array  # (F,) Σ w e², e the residual after the update
    left_out_error: Array  # (F, n) Σ w e², e the leave-one-out residual with 1 to n projections
    trace_h: Array  # (F, n) memory H of the metric's gradient (paper, table 3)
    trace_r: Array  # (F, n) memory R

    @classmethod
    def empty(cls, capacity: int, n: int) -> "Fields":
        """Return rows of zeros."""
        scalars = ("output", "n_projections", "stale", "offset", "weight", "n_seen", "forgetting", "mean_y", "error")
        shapes = {name: () if name in scalars else (n, n) if name == "xx" else (n,) for name in cls._fields}
        types = {"output": np.intp, "n_projections": np.intp, "stale": np.bool_}
        return cls(**{name: np.zeros((capacity, *shapes[name]), types.get(name, np.float64)) for name in cls._fields})


class LWPR:
    """Model of `n_outputs` functions of `n_inputs` inputs."""

    def __init__(self, n_inputs: int, n_outputs: int, params: LWPRParams | None = None) -> None:
        self.params = params or LWPRParams()
        self.n_outputs = n_outputs
        self.n_fields = 0
        self.fields = Fields.empty(_FIRST_CAPACITY, n_inputs)

    def update(self, x: Array, y: Array) -> None:
        """Learn samples x (N, inputs), y (N, outputs) one by one."""
        w_gen = self.params.w_gen
        for sample_x, sample_y in zip(x, y, strict=True):
            most_active = _learn(self.fields, self.n_fields, sample_x, sample_y, self.params)
            for output, (k, w) in enumerate(most_active.tolist()):
                if w <= w_gen:
                    self._add(sample_x, sample_y[output], output, int(k) if w > 0.1 * w_gen else None)

    def _add(self, x: Array, y: float, output: int, neighbour: int | None) -> None:
        """Add a field at x, with the metric of a neighbour that has enough samples."""
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
        fields.metric[k] = math.sqrt(self.params.init_D)
        if neighbour is not None and fields.n_seen[neighbour] > 2 * len(x):
            fields.metric[k] = fields.metric[neighbour]
        fields.rate[k] = self.params.rate
        fields.forgetting[k] = self.params.first_forgetting
        fields.weight[k] = _TINY
        fields.n_seen[k] = _TINY
        self.n_fields += 1

    def predict(self, x: ArrayLike) -> Array:
        """Return predictions (N, outputs) at x (N, inputs); NaN where no field with enough samples responds."""
        return self.predict_with_jacobian(x)[0]

    def predict_with_jacobian(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return predictions (N, outputs) at x (N, inputs) and their derivatives (N, outputs, inputs)."""
        queries = np.asarray(x, dtype=float)
        mean, jacobian = _predict(self.fields, self.n_fields, queries, self.n_outputs, self.params.cutoff)
        return mean, jacobian


class _Fit(NamedTuple):
    """Effect of one sample on a field that responds to it."""

    scores: Array  # (inputs,) scores s of the projections in use, 0 for the others
    scaled: Array  # (inputs,) s / Σ w s²
    leverage: float  # Σ w s² / Σ w s² over the projections
    e: float  # residual after the update
    left_out_e: float  # leave-one-out residual


@njit(cache=True, error_model="numpy")
def _learn(fields: Fields, n_fields: int, x: Array, y: Array, params: LWPRParams) -> Array:
    """Update in place all fields that respond to a sample.

    Returns (outputs, 2): index and activation of the most active field of each output; 0 where none responds.
    """
    most_active = np.zeros((len(y), 2))
    max_distance2 = -2 * math.log(params.cutoff)
    for k in range(n_fields):
        distance2 = _distance2(fields, k, x)
        if distance2 >= max_distance2:
            continue
        w = math.exp(-0.5 * distance2)
        output = fields.output[k]
        fit = _regress(fields, k, x, y[output], w, params)
        if params.rate > 0 and _has_settled(fields, k):
            _adapt_metric(fields, k, x, w, fit, params.penalty)
        _add_projection(fields, k, params.add_threshold)
        if w > most_active[output, 1]:
            most_active[output, 0] = k
            most_active[output, 1] = w
    return most_active


@njit(cache=True, error_model="numpy")
def _predict(fields: Fields, n_fields: int, x: Array, n_outputs: int, cutoff: float) -> tuple[Array, Array]:
    """Predictions (N, outputs) and Jacobian (N, outputs, inputs) at x (N, inputs); updates stale linear models."""
    n_queries, n = x.shape
    weight = np.zeros((n_queries, n_outputs))
    mean = np.zeros((n_queries, n_outputs))
    slope = np.zeros((n_queries, n_outputs, n))  # Σ w (∂y/∂x − y M²(x − c))
    decay = np.zeros((n_queries, n_outputs, n))  # Σ w M²(x − c) = −∂(Σ w)/∂x
    max_distance2 = -2 * math.log(cutoff)
    for k in range(n_fields):
        if fields.n_seen[k] <= 2 * n:
            continue
        if fields.stale[k]:
            _update_linear_model(fields, k)
        output = fields.output[k]
        for i in range(n_queries):
            distance2 = _distance2(fields, k, x[i])
            if distance2 >= max_distance2:
                continue
            w = math.exp(-0.5 * distance2)
            y = fields.offset[k] + _dot(fields.slope[k], x[i])
            weight[i, output] += w
            mean[i, output] += w * y
            for j in range(n):
                narrowing = w * fields.metric[k, j] ** 2 * (x[i, j] - fields.center[k, j])
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
def _distance2(fields: Fields, k: int, x: Array) -> float:
    """Σ Mᵢ²(xᵢ − cᵢ)²."""
    total = 0.0
    for i in range(len(x)):
        total += (fields.metric[k, i] * (x[i] - fields.center[k, i])) ** 2
    return total


@njit(cache=True, error_model="numpy")
def _dot(a: Array, b: Array) -> float:
    """Σ aᵢ bᵢ of short vectors."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@njit(cache=True, error_model="numpy")
def _regress(fields: Fields, k: int, x: Array, y: float, w: float, params: LWPRParams) -> _Fit:
    """Update the moments and errors of field k with one sample of activation w."""
    n = len(x)
    forget = fields.forgetting[k]
    fields.weight[k] = forget * fields.weight[k] + w
    fields.n_seen[k] = forget * fields.n_seen[k] + 1
    fields.forgetting[k] += (1 - params.forgetting_pace) * (params.last_forgetting - forget)
    fields.stale[k] = True
    z = np.empty(n)
    residual = _update_moments(fields, k, x, y, w, forget, z)
    xx = fields.xx[k].copy()
    xy = fields.xy[k].copy()
    direction = np.empty(n)
    load = np.empty(n)
    scores = np.zeros(n)
    scaled = np.zeros(n)
    left_out_e = np.empty(n)
    left_out = 1.0  # 1 − leverage of the projections up to r
    leverage = 0.0
    e = 0.0
    for r in range(n):
        ss, slope = _project(xx, xy, direction, load)
        s = _dot(z, direction)
        left_out -= w * s * s / ss
        residual -= s * slope
        for i in range(n):
            z[i] -= s * load[i]
        left_out_e[r] = residual / max(left_out, _TINY)
        if r < fields.n_projections[k]:
            scores[r] = s
            scaled[r] = s / ss
            leverage += w * s * s / ss
            e = residual
    if _has_settled(fields, k):
        for r in range(n):
            fields.left_out_error[k, r] = forget * fields.left_out_error[k, r] + w * left_out_e[r] ** 2
        fields.error[k] = forget * fields.error[k] + w * e**2
    return _Fit(scores, scaled, leverage, e, left_out_e[fields.n_projections[k] - 1])


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
def _has_settled(fields: Fields, k: int) -> bool:
    """Whether field k has enough samples for its errors to be meaningful."""
    settled: bool = fields.n_seen[k] * (1 - fields.forgetting[k]) > 0.1
    return settled


@njit(cache=True, error_model="numpy")
def _add_projection(fields: Fields, k: int, add_threshold: float) -> None:
    """Add a projection where the last one reduced the leave-one-out error enough."""
    last = fields.n_projections[k] - 1
    if 0 < last < fields.center.shape[1] - 1:
        error = fields.left_out_error[k, last] / fields.weight[k] + _TINY
        error_without = fields.left_out_error[k, last - 1] / fields.weight[k] + _TINY
        if error < add_threshold * error_without and fields.n_seen[k] * (1 - fields.forgetting[k]) > 0.5:
            fields.n_projections[k] += 1


@njit(cache=True, error_model="numpy")
def _adapt_metric(fields: Fields, k: int, x: Array, w: float, fit: _Fit, penalty: float) -> None:
    """One step of gradient descent on J = Σ w e² / Σ w + γ/n Σ Mᵢ⁴, e the leave-one-out residual."""
    n = len(x)
    weight = fields.weight[k]
    error = fields.left_out_error[k, fields.n_projections[k] - 1]
    memory = 0.0
    for r in range(n):
        memory += fit.scaled[r] * (fit.scaled[r] * fields.trace_r[k, r] + fit.e * fields.trace_h[k, r])
    dJ_dw = (fit.left_out_e**2 - 2 * memory - error / weight) / weight
    weighted_e = w * fit.left_out_e / max(1 - fit.leverage, _TINY)
    forget = fields.forgetting[k]
    for r in range(n):
        fields.trace_h[k, r] = forget * fields.trace_h[k, r] + weighted_e * fit.scores[r]
        fields.trace_r[k, r] = forget * fields.trace_r[k, r] + weighted_e * w * fit.left_out_e * fit.scores[r] ** 2
    transient = min(fields.error[k] / (error + _TINY), 1.0) ** 4
    max_step = _MAX_METRIC_STEP * fields.metric[k].max()
    for i in range(n):
        M = fields.metric[k, i]
        dw_dM = -w * M * (x[i] - fields.center[k, i]) ** 2
        gradient = dJ_dw * dw_dM + 4 * penalty / n * w / weight * M**3
        step = -fields.rate[k, i] * transient * gradient
        if abs(step) > max_step:
            fields.rate[k, i] /= 2
        else:
            fields.metric[k, i] += step
