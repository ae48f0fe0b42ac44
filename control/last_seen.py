"""Where an object is while the robot's own hand hides it, coming to it: where it was last seen, if it was at rest."""

from dataclasses import dataclass, replace

import numpy as np

from pps_vision.types import Status, Track3D


@dataclass(frozen=True)
class LastSeenParams:
    """What was seen at rest, no faster than `rest_m_s`, is believed to be there for `longest_s`, and only while its
    place is known to `most_std_m`: a standard deviation, in the worst direction."""

    longest_s: float = 2.5
    most_std_m: float = 0.01
    rest_m_s: float = 0.02

    def __post_init__(self) -> None:
        if not all(limit >= 0 for limit in (self.longest_s, self.most_std_m, self.rest_m_s)):  # NaN is not
            raise ValueError(f"{self}; expected no limit below 0")


def step(
    params: LastSeenParams, last: Track3D | None, track: Track3D, hidden: bool
) -> tuple[Track3D | None, Track3D | None]:
    """What is remembered (the `last` track of an object in free view) and what may be acted on, from this frame's.

    With the object `hidden`, be it in part, or not measured in this frame, that is the remembered place, its covariance
    grown by what the velocity may have been; None where there is none, or it has become too old or too uncertain, or
    the object was moving: then whoever acts must stop.
    """
    if track.status == Status.TRACKING and not hidden:
        return track, track
    if last is None:
        return None, None
    age_s = track.stamp_s - last.stamp_s
    if age_s > params.longest_s or float(np.linalg.norm(last.velocity)) > params.rest_m_s:
        return last, None
    slope = np.hstack([np.eye(3), age_s * np.eye(3)])
    grown = slope @ last.cov[:6, :6] @ slope.T
    if float(np.linalg.eigvalsh(grown)[-1]) > params.most_std_m**2:
        return last, None
    mean, cov = np.zeros((4, 3)), last.cov.copy()
    mean[0], cov[:3, :3] = last.position, grown
    return last, replace(last, stamp_s=track.stamp_s, mean=mean, cov=cov, status=Status.COASTING)
