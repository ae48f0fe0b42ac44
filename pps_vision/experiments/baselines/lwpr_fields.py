"""The receptive fields of an LWPR model: rows of one table that grows in blocks."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from pps_vision.types import Array

Rows = NDArray[np.void]
_FIRST_BLOCK = 64
LITTLE = 1e-10  # weight of what was never seen; keeps first divisions finite


def field_type(n: int) -> np.dtype[np.void]:
    """One field of `n` inputs.  `metric` M (upper triangular) gives the activation exp(−½|M(x − centre)|²); `xx`, `xy`
    the weighted co-moments; per number of projections the left-out errors `sum_e2_cv`; what queries need (`offset`,
    `slope`) is worked out from them where it is `stale`."""
    vector, matrix = (np.float64, (n,)), (np.float64, (n, n))
    names: list[tuple[str, type[np.generic], tuple[int, ...]]] = [
        *(("output", np.intp, ()), ("n_projections", np.intp, ())),
        *((name, *vector) for name in ("center", "mean_x", "xy", "slope", "trace_h", "trace_r", "sum_e2_cv")),
        *((name, *matrix) for name in ("xx", "metric", "log_rate", "rate_trace")),
        *((name, np.float64, ()) for name in ("mean_y", "forgetting", "weight", "n_seen")),
        *((name, np.float64, ()) for name in ("sum_e2", "offset")),
        ("stale", np.bool_, ()),
    ]
    return np.dtype(names)


def new_field(
    x: Array, y: float, output: int, metric: Array, log_rate: float, forgetting: float, n_projections: int = 2
) -> Rows:
    """(1,) a field about x that has seen nothing, with as many of `n_projections` as it has inputs."""
    row = np.zeros(1, field_type(len(x)))
    row["output"], row["n_projections"] = output, min(n_projections, len(x))
    row["center"] = row["mean_x"] = x
    row["mean_y"], row["metric"], row["log_rate"], row["forgetting"] = y, metric, log_rate, forgetting
    row["weight"] = row["n_seen"] = LITTLE
    row["stale"] = True
    return row


def quadratic(x: Array) -> Array:
    """(N, m) the monomials 1, x_i, x_i x_j (i ≤ j) of points (N, inputs): activations are linear in them."""
    i, j, _ = _pairs(x.shape[1])
    return np.concatenate([np.ones((len(x), 1)), x, x[:, i] * x[:, j]], axis=1)


def quadratic_form(rows: Rows) -> Array:
    """(fields, m) the coefficients of |M(x − centre)|² in `quadratic`."""
    M, center = rows["metric"], rows["center"]
    D = np.swapaxes(M, 1, 2) @ M
    i, j, times = _pairs(M.shape[-1])
    Dc = (D @ center[..., None])[..., 0]
    constant = (center * Dc).sum(axis=1, keepdims=True)
    return np.concatenate([constant, -2 * Dc, times * D[:, i, j]], axis=1)


@cache
def _pairs(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """i ≤ j, and how often the pair occurs in a symmetric matrix."""
    i, j = np.triu_indices(n)
    return i, j, np.where(i == j, 1.0, 2.0)


class Fields:
    """`rows` (fields,) and the `forms` (fields, m) of their activations, kept beside them for one product a query."""

    def __init__(self, rows: Rows) -> None:
        self.n, self._rows = len(rows), rows
        self._forms = quadratic_form(rows)

    @property
    def rows(self) -> Rows:
        return self._rows[: self.n]

    @property
    def forms(self) -> Array:
        return self._forms[: self.n]

    def put(self, index: NDArray[np.intp], rows: Rows, same_metric: bool = False) -> None:
        self._rows[index] = rows
        if not same_metric:
            self._forms[index] = quadratic_form(rows)

    def append(self, row: Rows) -> None:
        if self.n == len(self._rows):
            more = max(_FIRST_BLOCK, self.n)
            self._rows = np.concatenate([self._rows, np.zeros(more, self._rows.dtype)])
            self._forms = np.concatenate([self._forms, np.zeros((more, self._forms.shape[1]))])
        self.n += 1
        self.put(np.array([self.n - 1]), row)

    def remove(self, index: list[int]) -> None:
        keep = np.delete(np.arange(self.n), index)
        self._rows[: len(keep)], self._forms[: len(keep)] = self._rows[keep], self._forms[keep]
        self.n = len(keep)
