"""The receptive fields of an LWPR model: rows of one table that grows in blocks."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pps_vision.jit import njit
from pps_vision.types import Array

Rows = NDArray[np.void]
_FIRST_BLOCK = 64
LITTLE = 1e-10  # weight of what was never seen; keeps first divisions finite


_WHOLE = "output", "n_projections", "stale"
_SCALARS = "mean_y", "forgetting", "weight", "n_seen", "sum_e2", "offset"
_VECTORS = "center", "mean_x", "xy", "slope", "trace_h", "trace_r", "sum_e2_cv"
_MATRICES = "xx", "metric", "log_rate", "rate_trace"


OUTPUT, N_PROJECTIONS, STALE = range(3)
MEAN_Y, FORGETTING, WEIGHT, N_SEEN, SUM_E2, OFFSET = range(6)
CENTER, MEAN_X, XY, SLOPE, TRACE_H, TRACE_R, SUM_E2_CV = range(7)
XX, METRIC, LOG_RATE, RATE_TRACE = range(4)


class Groups(NamedTuple):
    """Columns of one kind together, of the table or of one row, for compiled code: `whole` numbers (…, 3), `scalars`
    (…, 6), `vectors` (…, 7, inputs) and `matrices` (…, 4, inputs, inputs)."""

    whole: NDArray[np.intp]
    scalars: Array
    vectors: Array
    matrices: Array


@njit(cache=True, error_model="numpy")
def row_of(table: Groups, k: int) -> Groups:
    """Views of one row."""
    return Groups(table.whole[k], table.scalars[k], table.vectors[k], table.matrices[k])


def field_type(n: int) -> np.dtype[np.void]:
    """One field of `n` inputs.  `metric` M (upper triangular) gives the activation exp(−½|M(x − centre)|²); `xx`, `xy`
    the weighted co-moments; per number of projections the left-out errors `sum_e2_cv`; what queries need (`offset`,
    `slope`) is worked out from them where it is `stale` (1)."""
    kinds = ((_WHOLE, np.intp, ()), (_SCALARS, np.float64, ()), (_VECTORS, np.float64, (n,)))
    names = [(name, kind, shape) for group, kind, shape in kinds for name in group]
    return np.dtype([*names, *((name, np.float64, (n, n)) for name in _MATRICES)])


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
    i, j = _pairs(x.shape[1])
    return np.concatenate([np.ones((len(x), 1)), x, x[:, i] * x[:, j]], axis=1)


@njit(cache=True, error_model="numpy")
def write_form(form: Array, M: Array, center: Array) -> None:
    """Write the coefficients (m,) of |M(x − center)|² in `quadratic`."""
    n, k = len(center), 1 + len(center)
    form[:k] = 0.0
    for i in range(n):
        for j in range(n):
            D = 0.0
            for r in range(n):
                D += M[r, i] * M[r, j]
            form[0] += center[i] * D * center[j]
            form[1 + i] -= 2 * D * center[j]
            if j >= i:
                form[k] = D if i == j else 2 * D
                k += 1


@cache
def _pairs(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """i ≤ j."""
    i, j = np.triu_indices(n)
    return i, j


class Fields:
    """`rows` (fields,) and the `forms` (fields, m) of their activations, kept beside them for one product a query."""

    def __init__(self, n_inputs: int) -> None:
        self.n, self._rows = 0, np.zeros(_FIRST_BLOCK, field_type(n_inputs))
        self._forms = np.zeros((_FIRST_BLOCK, 1 + n_inputs + n_inputs * (n_inputs + 1) // 2))
        self.groups = self._groups()

    def _groups(self) -> Groups:
        size, n = len(self._rows), self._rows.dtype["center"].shape[0]
        whole, numbers = self._rows.view(np.intp).reshape(size, -1), self._rows.view(np.float64).reshape(size, -1)
        scalars, vectors, matrices = np.split(numbers[:, len(_WHOLE) :], (len(_SCALARS), len(_SCALARS) + 7 * n), axis=1)
        return Groups(whole[:, :3], scalars, vectors.reshape(size, 7, n), matrices.reshape(size, 4, n, n))

    @property
    def rows(self) -> Rows:
        return self._rows[: self.n]

    @property
    def forms(self) -> Array:
        return self._forms[: self.n]

    def append(self, row: Rows) -> None:
        if self.n == len(self._rows):
            more = self.n
            self._rows = np.concatenate([self._rows, np.zeros(more, self._rows.dtype)])
            self._forms = np.concatenate([self._forms, np.zeros((more, self._forms.shape[1]))])
            self.groups = self._groups()
        self._rows[self.n] = row[0]
        write_form(self._forms[self.n], row["metric"][0], row["center"][0])
        self.n += 1
