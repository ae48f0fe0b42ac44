"""Regressors that could stand where LWPR does, one interface: learn batches of any size, answer batches."""

from typing import Protocol

import numpy as np
from scipy.linalg import solve
from scipy.sparse import csr_array, eye_array, kron, vstack
from scipy.sparse.linalg import lsmr
from scipy.spatial import cKDTree

from learning.reach.babbling import crossing, gaze_at
from learning.reach.training import ArmLimits
from pps_vision.experiments.baselines.lwpr import LWPR, LWPRParams
from pps_vision.types import Array


class Regressor(Protocol):
    """Learns y (N, outputs) from x (N, inputs), both of the order of 1; what came earlier counts as much as what
    comes later, whatever the sizes of the batches."""

    def update(self, x: Array, y: Array) -> None: ...

    def predict(self, x: Array) -> Array: ...

    @property
    def nbytes(self) -> int: ...


class ArmToGaze:
    """The forward model that babbling teaches: arm posture → the gaze posture that fixates the hand.  The regressor
    sees joint angles scaled to [−1, 1] by their limits, and where the lines of sight cross."""

    def __init__(self, regressor: Regressor, limits: ArmLimits | None = None) -> None:
        self.regressor = regressor
        limits = limits or ArmLimits()
        lower, upper = np.array(limits.lower_rad), np.array(limits.upper_rad)
        self.middle, self.half = (lower + upper) / 2, (upper - lower) / 2

    def learn(self, arm_rad: Array, gaze_rad: Array) -> None:
        """From postures (N, 4) and (N, 3)."""
        self.regressor.update((arm_rad - self.middle) / self.half, crossing(gaze_rad))

    def __call__(self, arm_rad: Array) -> Array:
        """Gaze postures (N, 3) for arm postures (N, 4)."""
        return gaze_at(self.regressor.predict((arm_rad - self.middle) / self.half))


class LocalModels:
    """LWPR; where no field responds, the answer is NaN."""

    def __init__(self, n_inputs: int, n_outputs: int, params: LWPRParams) -> None:
        self.model = LWPR(n_inputs, n_outputs, params)

    def update(self, x: Array, y: Array) -> None:
        for sample in zip(x, y, strict=True):
            self.model.update(*sample)

    def predict(self, x: Array) -> Array:
        return self.model.predict(x).mean

    @property
    def nbytes(self) -> int:
        return self.model.fields.nbytes


class FourierFeatures:
    """Ridge regression on `n_features` random cosines (Rahimi & Recht 2007) of length scale `length`, least squares
    made recursive in information form: AᵀA and Aᵀy are all it keeps."""

    def __init__(
        self, n_inputs: int, n_outputs: int, n_features: int, length: float, ridge: float, rng: np.random.Generator
    ) -> None:
        self.frequency = rng.standard_normal((n_inputs, n_features)) / length
        self.phase = rng.uniform(0, 2 * np.pi, n_features)
        self._AA, self._Ay = ridge * np.eye(n_features), np.zeros((n_features, n_outputs))
        self._weights: Array | None = None

    def _features(self, x: Array) -> Array:
        return np.asarray(np.cos(x @ self.frequency + self.phase))

    def update(self, x: Array, y: Array) -> None:
        A = self._features(x)
        self._AA += A.T @ A
        self._Ay += A.T @ y
        self._weights = None

    def predict(self, x: Array) -> Array:
        if self._weights is None:
            self._weights = np.asarray(solve(self._AA, self._Ay, assume_a="pos"))
        return self._features(x) @ self._weights

    @property
    def nbytes(self) -> int:
        return self._AA.nbytes + 2 * self._Ay.nbytes + self.frequency.nbytes


class Neighbours:
    """The mean of the `k` nearest samples, weighted by 1/distance²."""

    def __init__(self, k: int) -> None:
        self.k = k
        self._x: Array = np.zeros((0, 0))
        self._y: Array = np.zeros((0, 0))
        self._tree: cKDTree | None = None

    def update(self, x: Array, y: Array) -> None:
        self._x, self._y = (np.concatenate([b, a]) if len(b) else a for b, a in ((self._x, x), (self._y, y)))
        self._tree = None

    def predict(self, x: Array) -> Array:
        if self._tree is None:
            self._tree = cKDTree(self._x)
        distance, at = self._tree.query(x, k=np.arange(1, min(self.k, len(self._x)) + 1))
        w = 1 / (distance**2 + 1e-12)
        answer: Array = np.einsum("nk,nko->no", w / w.sum(axis=1, keepdims=True), self._y[at])
        return answer

    @property
    def nbytes(self) -> int:
        return 2 * (self._x.nbytes + self._y.nbytes)


class Grid:
    """Values on a regular grid of `n_nodes` an input over [−1, 1], interpolated linearly; least squares, with
    second differences held small by `stiffness` so that cells without a sample have a value too."""

    def __init__(self, n_inputs: int, n_nodes: int, stiffness: float) -> None:
        self.n_nodes, self.stiffness = n_nodes, stiffness
        self._corners = np.stack(np.meshgrid(*[[0, 1]] * n_inputs, indexing="ij"), axis=-1).reshape(-1, n_inputs)
        self._strides = n_nodes ** np.arange(n_inputs - 1, -1, -1)
        self._x: Array = np.zeros((0, n_inputs))
        self._y: Array = np.zeros((0, 0))
        self._values: Array | None = None

    def update(self, x: Array, y: Array) -> None:
        self._x, self._y = (np.concatenate([b, a]) if len(b) else a for b, a in ((self._x, x), (self._y, y)))
        self._values = None

    def _weights(self, x: Array) -> csr_array:
        """(N, nodes) of linear interpolation."""
        at = np.clip((x + 1) / 2, 0, 1) * (self.n_nodes - 1)
        cell = np.minimum(at.astype(int), self.n_nodes - 2)
        part = (at - cell)[:, None, :]
        w = np.prod(np.where(self._corners == 1, part, 1 - part), axis=2)
        nodes = (cell[:, None, :] + self._corners) @ self._strides
        rows = np.repeat(np.arange(len(x)), len(self._corners))
        return csr_array((w.ravel(), (rows, nodes.ravel())), shape=(len(x), self.n_nodes ** x.shape[1]))

    def _fit(self) -> Array:
        n, inputs = self.n_nodes, self._x.shape[1]
        second = np.diff(np.eye(n), 2, axis=0)
        stiff = [kron(kron(eye_array(n**k), second), eye_array(n ** (inputs - 1 - k))) for k in range(inputs)]
        A = vstack([self._weights(self._x), *(self.stiffness * part for part in stiff)]).tocsr()
        none = np.zeros(A.shape[0] - len(self._x))
        return np.stack([lsmr(A, np.concatenate([y, none]), maxiter=300)[0] for y in self._y.T], axis=1)

    def predict(self, x: Array) -> Array:
        if self._values is None:
            self._values = self._fit()
        return np.asarray(self._weights(x) @ self._values)

    @property
    def nbytes(self) -> int:
        return self.n_nodes ** self._x.shape[1] * self._y.shape[1] * 8 + self._x.nbytes + self._y.nbytes
