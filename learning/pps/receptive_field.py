"""Distance D and time to contact TTC of a stimulus, as a taxel perceives them (R eqs 1–2)."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pps_vision.jit import njit
from pps_vision.types import Array


@dataclass(frozen=True)
class ReceptiveField:
    """Truncated cone along the outward normal of a taxel, its apex behind the skin (R, "Receptive field")."""

    half_angle_rad: float = float(np.arccos(0.75))  # half opening angle of the cone (the authors' code)
    base_radius_m: float = 0.07  # radius of the cone at the skin (the authors' code)
    length_m: float = 0.20  # greatest perceived distance (R)
    distance_to: Literal["centre", "surface"] = "centre"  # the stimulus' centre (R), or its surface (0 at a touch)
    min_closing_sigmas: float = 1.0  # smallest closing speed with a TTC, in standard deviations of the velocity

    def __post_init__(self) -> None:
        if self.distance_to not in ("centre", "surface"):
            raise ValueError(f"distance_to {self.distance_to!r}: expected centre or surface")
        if not (0 < self.half_angle_rad < np.pi / 2 and self.base_radius_m >= 0 and self.length_m > 0):
            raise ValueError(f"{self}: expected an angle between 0 and 90°, a radius ≥ 0 and a length > 0")


CONE = ReceptiveField(distance_to="surface")
"""R's, for R's maps."""
NEAR = ReceptiveField(base_radius_m=0.20, distance_to="surface")
"""Ours: all within 20 cm before the skin, because objects that graze it come from the side (`bench encounters`, part
`activation`)."""


def perceive(
    field: ReceptiveField,
    positions_root: ArrayLike,
    normals_root: ArrayLike,
    p_root: ArrayLike,
    v_root: ArrayLike,
    radius_m: float = 0.0,
    cov_v: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Distance D in m and time to contact TTC in s of a stimulus for every taxel, (…, n) each (R eqs 1–2).

    Taxels at `positions_root` with unit `normals_root` (…, n, 3); the stimulus's centre `p_root`, velocity `v_root`
    (…, 3) relative to them and its covariance `cov_v` (…, 3, 3).  Leading axes (time) broadcast.

    D = sgn(d·z)‖d‖ and TTC = −sgn(d·v)‖d‖/‖v_d‖ of the displacement d from taxel to stimulus, the relative velocity v
    and the normal z; both NaN outside the receptive field or where the input is NaN.  In the plane of the skin D counts
    as positive.  TTC is negative for a receding stimulus, inf for one that does not approach significantly, 0 for one
    that touches.  To the surface of a stimulus of radius r both have ‖d‖ − r in place of ‖d‖.
    """
    d = np.asarray(p_root, dtype=float)[..., None, :] - np.asarray(positions_root, dtype=float)
    v = np.asarray(v_root, dtype=float)[..., None, :]
    z = np.asarray(normals_root, dtype=float)
    shape = np.broadcast(d, v, z).shape
    shell = radius_m if field.distance_to == "surface" else 0.0
    farthest_m = (field.length_m + max(shell, 0.0)) * (1 + 1e-9)  # a cheap bound: most taxels are far away
    close = _as(shape[:-1], (d * d) @ np.ones(3) <= farthest_m**2)
    n_close = np.count_nonzero(close)
    D, ttc = np.full((2, *shape[:-1]), np.nan)
    if n_close:
        near = np.nonzero(close) if 2 * n_close < close.size else ...  # sorting out most would cost more than it saves
        cov = np.zeros((3, 3)) if cov_v is None else np.asarray(cov_v, dtype=float)[..., None, :, :]
        covs = cov.reshape(1, 3, 3) if cov.size == 9 else _as((*shape, 3), cov)[near].reshape(-1, 3, 3)
        d, z, v = (np.ascontiguousarray(_as(shape, a)[near].reshape(-1, 3)) for a in (d, z, v))
        cone = field.length_m, field.base_radius_m, float(np.tan(field.half_angle_rad))
        perceived = _within_reach(d, z, v, np.ascontiguousarray(covs), shell, cone, field.min_closing_sigmas)
        D[near], ttc[near] = perceived.reshape(2, *D[near].shape)
    return D, ttc


def _as(shape: tuple[int, ...], a: NDArray[Any]) -> NDArray[Any]:
    """np.broadcast_to, at no cost where nothing is to be done."""
    return a if a.shape == shape else np.broadcast_to(a, shape)


@njit(cache=True, error_model="numpy")
def _within_reach(
    d: Array, z: Array, v: Array, cov_v: Array, shell: float, cone: tuple[float, float, float], sigmas: float
) -> Array:
    """(2, n) D and TTC of displacements, normals and velocities (n, 3), with a covariance (3, 3) each or one of all;
    `cone`: length, radius at the skin, tangent of the half angle."""
    length, base, tangent = cone
    perceived = np.full((2, len(d)), np.nan)
    for i in range(len(d)):
        cov = cov_v[i if len(cov_v) > 1 else 0]
        square = height = nearing = variance = 0.0
        for j in range(3):
            square += d[i, j] * d[i, j]
            height += d[i, j] * z[i, j]
            nearing -= d[i, j] * v[i, j]
            for k in range(3):
                variance += d[i, j] * cov[j, k] * d[i, k]
        distance = math.sqrt(square)
        aside = math.sqrt(max(square - height * height, 0.0))
        if not (aside <= base + height * tangent and distance - shell <= length and math.isfinite(nearing)):
            continue
        perceived[0, i] = (distance if height >= 0 else -distance) - shell
        if distance <= max(shell, 0.0):
            perceived[1, i] = 0.0
        elif abs(nearing) > sigmas * math.sqrt(max(variance, 0.0)):  # both times the distance
            perceived[1, i] = (distance - shell) * distance / nearing
        else:
            perceived[1, i] = math.inf
    return perceived
