"""How far a tracked object is from a point, and when it will touch it, each with what is not known of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.types import Track3D


@dataclass(frozen=True, slots=True)
class Contact:
    """`distance_m` from the object's surface to a point, `closing_m_s` the speed at which it shrinks
    (both along the line between them, at constant velocity), their variances and covariance."""

    distance_m: float
    closing_m_s: float
    distance_var: float
    closing_var: float
    covariance: float

    @property
    def distance_std_m(self) -> float:
        """Standard deviation of the distance."""
        return float(np.sqrt(self.distance_var))

    @property
    def ttc_s(self) -> float:
        """Time to contact: distance over closing speed; inf where it does not come closer."""
        return self.distance_m / self.closing_m_s if self.closing_m_s > 0 else np.inf

    @property
    def ttc_std_s(self) -> float:
        """Its standard deviation to first order, for closing speeds well above their own; inf where `ttc_s` is."""
        if self.closing_m_s <= 0:
            return np.inf
        tau = self.ttc_s
        var = self.distance_var - 2 * tau * self.covariance + tau**2 * self.closing_var
        return float(np.sqrt(max(var, 0.0))) / self.closing_m_s

    def ttc_interval_s(self, sigmas: float = 1.96) -> tuple[float, float]:
        """All times τ at which the distance may be used up, |d − τc| ≤ sigmas·std(d − τc) (Fieller 1954);
        up to inf where the closing speed may be zero, (inf, inf) where no time to come will do."""
        k = sigmas**2
        a = self.closing_m_s**2 - k * self.closing_var
        b = self.distance_m * self.closing_m_s - k * self.covariance
        c = self.distance_m**2 - k * self.distance_var
        root = float(np.sqrt(max(b * b - a * c, 0.0)))
        if c <= 0:  # it may touch already
            return 0.0, (b + root) / a if a > 0 else np.inf
        if b + root <= 0:
            return np.inf, np.inf
        return c / (b + root), (b + root) / a if a > 0 else np.inf


def time_to_contact(
    track: Track3D, point: ArrayLike, point_velocity: ArrayLike = (0.0, 0.0, 0.0), subtract_radius: bool = True
) -> Contact:
    """The object of a track against a `point` (3,) m in the root frame that moves at `point_velocity` m/s.

    Distances are to the object's surface, to its centre without `subtract_radius`.  NaN for an
    unknown track; ValueError for a point in the object's very centre, where no line is defined.
    """
    line = track.position - np.asarray(point, dtype=float)
    length = float(np.linalg.norm(line))
    if length == 0:
        raise ValueError("the point is the object's centre; expected another, to which there is a line")
    u = line / length
    v = track.velocity - np.asarray(point_velocity, dtype=float)
    closing = -float(u @ v)
    across = -(v + closing * u) / length  # how the closing speed changes with the position
    P, C, V = track.cov[:3, :3], track.cov[:3, 3:6], track.cov[3:6, 3:6]
    closing_var = float(across @ P @ across - 2 * across @ C @ u + u @ V @ u)
    radius, radius_var = (track.radius_m, track.radius_var_m2) if subtract_radius else (0.0, 0.0)
    return Contact(
        distance_m=length - radius,
        closing_m_s=closing,
        distance_var=float(u @ P @ u) + radius_var,
        closing_var=closing_var,
        covariance=float(u @ P @ across - u @ C @ u),
    )
