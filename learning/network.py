"""A small neural network as a regressor."""

from itertools import pairwise

import numpy as np
import torch

from pps_vision.types import Array


class Network:
    """Two hidden layers of `width` tanh units; each batch is remembered and followed by `epochs` of Adam over all that
    was seen, the rate falling along a cosine."""

    def __init__(
        self, n_inputs: int, n_outputs: int, rng: np.random.Generator, width: int = 64, epochs: int = 200
    ) -> None:
        self.epochs, self._rng = epochs, rng
        generator = torch.Generator().manual_seed(int(rng.integers(2**31)))
        sizes = (n_inputs, width, width, n_outputs)
        self._layers = [(torch.randn(a, b, generator=generator) / a**0.5, torch.zeros(b)) for a, b in pairwise(sizes)]
        self._x: Array = np.zeros((0, n_inputs))
        self._y: Array = np.zeros((0, n_outputs))

    def _forward(self, x: torch.Tensor) -> torch.Tensor:
        *hidden, (W, b) = self._layers
        for weights, bias in hidden:
            x = torch.tanh(x @ weights + bias)
        return x @ W + b

    def update(self, x: Array, y: Array) -> None:
        self._x, self._y = np.concatenate([self._x, x]), np.concatenate([self._y, y])
        X, Y = torch.tensor(self._x, dtype=torch.float32), torch.tensor(self._y, dtype=torch.float32)
        parameters = [p.requires_grad_() for layer in self._layers for p in layer]
        adam = torch.optim.Adam(parameters, lr=1e-2)
        steps = torch.optim.lr_scheduler.CosineAnnealingLR(adam, self.epochs)
        for _ in range(self.epochs):
            order = torch.from_numpy(self._rng.permutation(len(X)))
            for part in torch.split(order, 128):
                adam.zero_grad()
                torch.mean((self._forward(X[part]) - Y[part]) ** 2).backward()  # type: ignore[no-untyped-call]
                adam.step()
            steps.step()

    def predict(self, x: Array) -> Array:
        with torch.no_grad():
            answer: Array = self._forward(torch.tensor(x, dtype=torch.float32)).numpy().astype(float)
        return answer

    @property
    def nbytes(self) -> int:
        return 4 * sum(p.numel() for layer in self._layers for p in layer) + self._x.nbytes + self._y.nbytes
