"""Activation and reachability of very many cases at once on a torch device; `memory.activation` and
`ReachableMap.query` compute single ones."""

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from learning.pps.memory import PPSMemory
from pps_vision.types import Array, Mask

if TYPE_CHECKING:
    from learning.reach.map import ReachableMap

_ROWS = 1 << 18  # cases at a time, which take about 100 MB


def activation(memory: PPSMemory, distance_m: Array, ttc_s: Array, inside: Mask, device: str) -> Array:
    """(k,) R eqs 4–5 as in `memory.activation`, of the k cases D and TTC (…, n) that are `inside`."""
    taxel = np.nonzero(inside)[-1]
    frequency, p = torch.from_numpy(memory.frequency).to(device), memory.params
    found = []
    for begin in range(0, len(taxel), _ROWS):
        rows = slice(begin, begin + _ROWS)
        D, TTC = (torch.from_numpy(part[inside][rows]).to(device) for part in (distance_m, ttc_s))
        w_distance = _window(p.sigma_bins, D, p.distance_range_m, p.bins[0])
        w_ttc = _window(p.sigma_bins, TTC, p.ttc_range_s, p.bins[1])
        f = frequency[torch.from_numpy(taxel[rows]).to(device)]
        found.append(torch.einsum("kd,kdt,kt->k", w_distance, f, w_ttc))
    whole: Array = torch.cat(found).cpu().numpy()
    return whole


def _window(sigma_bins: float, value: Tensor, limits: tuple[float, float], n: int) -> Tensor:
    """(k, n) Gaussian weights of the bin centres about values (k,), adding up to 1."""
    if n == 1:
        return torch.ones_like(value)[:, None]
    per_unit = n / (limits[1] - limits[0])
    bins = torch.arange(n, device=value.device, dtype=value.dtype)
    away = (value * per_unit)[:, None] - (limits[0] * per_unit + 0.5 + bins)
    return torch.softmax(-away.square() / (2 * sigma_bins**2), dim=1)


def reachability(reachable_map: "ReachableMap", gaze_rad: Array, device: str) -> tuple[Array, Array]:
    """Probability of being reachable and degree (N,) as in `ReachableMap.query`, of gaze postures (N, 3) within the
    map's limits."""
    m = reachable_map
    values = np.stack([m.signed_distance, m.optimality, m.error_m / m.max_error_m])
    field = torch.from_numpy(values)[None].to(device)
    low, high = (_isotropic(torch.from_numpy(end).to(device)) for end in (m.limits.lower, m.limits.upper))
    found = []
    for begin in range(0, len(gaze_rad), _ROWS):
        at = _isotropic(torch.from_numpy(gaze_rad[begin : begin + _ROWS]).to(device))
        place = (2 * (at - low) / (high - low) - 1).flip(-1).view(1, -1, 1, 1, 3)  # the last axis comes first
        between = functional.grid_sample(field, place, "bilinear", "border", align_corners=True)
        signed, good, bad = between.view(len(values), -1)
        degree = torch.where(signed > 0, 0.5 + 0.5 * good, 0.5 - 0.5 * bad).clamp(0, 1)
        found.append(torch.stack([torch.sigmoid(signed / m.softness), degree]))
    probability, degrees = torch.cat(found, dim=1).cpu().numpy()
    return probability, degrees


def _isotropic(gaze_rad: Tensor) -> Tensor:
    """As `lattice.isotropic`."""
    return torch.cat([gaze_rad[..., :2], torch.tan(gaze_rad[..., 2:] / 2).log()], dim=-1)
