"""What a taxel perceives of a stimulus: its distance D and its time to contact TTC (R eqs 1–2)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.types import Array


@dataclass(frozen=True)
class ReceptiveField:
    """A cone along the outward normal, cut by the skin where it is `base_radius_m` wide, so that its
    apex lies behind the taxel; nothing farther than `length_m` is perceived (FACTS §3).

    With `subtract_radius` D and TTC are those of the stimulus's surface, not of its centre (R
    takes the centre).  A stimulus counts as approaching only when its closing speed exceeds
    `min_closing_sigmas` standard deviations of the velocity estimate (2 would miss what comes slowly;
    what does not approach is told apart by the time an activation lasts, see `control/avoidance.py`).
    """

    half_angle_rad: float = float(np.arccos(0.75))
    base_radius_m: float = 0.07
    length_m: float = 0.20
    subtract_radius: bool = False
    min_closing_sigmas: float = 1.0

    def __post_init__(self) -> None:
        if not (0 < self.half_angle_rad < np.pi / 2 and self.base_radius_m >= 0 and self.length_m > 0):
            raise ValueError(f"{self}: expected an angle between 0 and 90°, a radius ≥ 0 and a length > 0")


def perceive(
    field: ReceptiveField,
    positions_root: ArrayLike,
    normals_root: ArrayLike,
    p_root: ArrayLike,
    v_root: ArrayLike,
    radius_m: float = 0.0,
    cov_v: ArrayLike | None = None,
    taxel_velocities_root: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """D in m and TTC in s of a stimulus for every taxel, (…, n) each; see `distance_and_ttc`.

    Taxels at `positions_root` with unit `normals_root` (…, n, 3), moving with the body at
    `taxel_velocities_root` (…, n, 3) m/s (default: still); the stimulus's centre `p_root`,
    velocity `v_root` (…, 3) and its covariance `cov_v` (…, 3, 3).  Leading axes (time) broadcast.
    """
    d = np.asarray(p_root, dtype=float)[..., None, :] - np.asarray(positions_root, dtype=float)
    v = np.asarray(v_root, dtype=float)[..., None, :]
    if taxel_velocities_root is not None:
        v = v - np.asarray(taxel_velocities_root, dtype=float)
    cov = None if cov_v is None else np.asarray(cov_v, dtype=float)[..., None, :, :]
    return distance_and_ttc(field, d, normals_root, v, radius_m, cov)


def distance_and_ttc(
    field: ReceptiveField,
    d: ArrayLike,
    normals: ArrayLike,
    v: ArrayLike,
    radius_m: float = 0.0,
    cov_v: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """R eqs 1–2 of displacements `d` from taxel to stimulus and relative velocities `v`, both (…, 3).

    D = sgn(d·z)‖d‖ and TTC = −sgn(d·v)‖d‖/‖v_d‖; both NaN outside the receptive field or where
    the input is NaN.  In the plane of the skin D counts as positive.  TTC is negative for a
    receding stimulus, inf for one that does not surely approach, 0 on the taxel itself.
    """
    d, v, z = (np.asarray(a, dtype=float) for a in (d, v, normals))
    height = np.einsum("...i,...i->...", d, z)
    distance = np.sqrt(np.einsum("...i,...i->...", d, d))
    at_taxel = distance == 0
    u = d / np.where(at_taxel, 1.0, distance)[..., None]
    closing = -np.einsum("...i,...i->...", u, v)
    doubt = np.zeros_like(closing)
    if cov_v is not None:
        variance = np.einsum("...i,...ij,...j->...", u, np.asarray(cov_v, dtype=float), u)
        doubt = field.min_closing_sigmas * np.sqrt(np.maximum(variance, 0.0))
    shell = radius_m if field.subtract_radius else 0.0
    gap = np.maximum(distance - shell, 0.0)
    surely = (np.abs(closing) > doubt) & ~at_taxel
    ttc = np.where(surely, gap / np.where(surely, closing, 1.0), np.where(at_taxel, 0.0, np.inf))
    D = np.where(height >= 0, distance, -distance) - shell
    aside = np.sqrt(np.maximum(distance**2 - height**2, 0.0))
    reach = field.base_radius_m + height * np.tan(field.half_angle_rad)
    inside = (aside <= reach) & (distance - shell <= field.length_m) & np.isfinite(closing)
    return np.where(inside, D, np.nan), np.where(inside, ttc, np.nan)
