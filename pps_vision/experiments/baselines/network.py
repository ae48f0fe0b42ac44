"""A small neural network as a regressor."""

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pps_vision.types import Array

if TYPE_CHECKING:
    import torch


class Network:
    """Two hidden layers of `width` tanh units; each batch is remembered and followed by `epochs` of Adam over all that
    was seen, the rate falling along a cosine; on the torch `device` (cpu, cuda, …)."""

    def __init__(
        self,
        n_inputs: int,
        n_outputs: int,
        rng: np.random.Generator,
        width: int = 64,
        epochs: int = 200,
        device: str = "cpu",
    ) -> None:
        import torch  # takes seconds to load

        self.epochs, self._rng, self._device = epochs, rng, device
        generator = torch.Generator().manual_seed(int(rng.integers(2**31)))
        sizes = (n_inputs, width, width, n_outputs)
        first = [(torch.randn(a, b, generator=generator) / a**0.5, torch.zeros(b)) for a, b in pairwise(sizes)]
        self._layers = [(weights.to(device), bias.to(device)) for weights, bias in first]
        self._x: Array = np.zeros((0, n_inputs))
        self._y: Array = np.zeros((0, n_outputs))

    def _forward(self, x: "torch.Tensor") -> "torch.Tensor":
        import torch

        *hidden, (W, b) = self._layers
        for weights, bias in hidden:
            x = torch.tanh(x @ weights + bias)
        return x @ W + b

    def update(self, x: Array, y: Array) -> None:
        import torch

        self._x, self._y = np.concatenate([self._x, x]), np.concatenate([self._y, y])
        X, Y = (torch.tensor(part, dtype=torch.float32, device=self._device) for part in (self._x, self._y))
        parameters = [p.requires_grad_() for layer in self._layers for p in layer]
        adam = torch.optim.Adam(parameters, lr=1e-2)
        steps = torch.optim.lr_scheduler.CosineAnnealingLR(adam, self.epochs)
        for _ in range(self.epochs):
            order = torch.from_numpy(self._rng.permutation(len(X))).to(self._device)
            for part in torch.split(order, 128):
                adam.zero_grad()
                torch.mean((self._forward(X[part]) - Y[part]) ** 2).backward()  # type: ignore[no-untyped-call]
                adam.step()
            steps.step()

    def predict(self, x: Array) -> Array:
        import torch

        with torch.no_grad():
            answer = self._forward(torch.tensor(x, dtype=torch.float32, device=self._device))
            found: Array = answer.cpu().numpy().astype(float)
        return found

    @property
    def nbytes(self) -> int:
        return 4 * sum(p.numel() for layer in self._layers for p in layer) + self._x.nbytes + self._y.nbytes
