"""What looks larger or smaller than it is known to be is not alone, or partly hidden: its middle is off as well."""

from dataclasses import replace

import numpy as np

from pps_vision.types import Observation3D

_USUAL = 0.05  # of the radius: how much an outline's size varies when nothing is wrong
_MIDDLE_OFF = 6.0  # metres by which the middle may be off per metre of radius that is too much or missing


def doubted(seen: Observation3D, radius_m: float) -> Observation3D:
    """The observation `seen`, less sure the less its radius agrees with the known `radius_m`; itself where that
    is as usual."""
    off_m = max(abs(seen.radius_m - radius_m) - _USUAL * radius_m, 0.0)
    if off_m == 0:
        return seen
    cov = seen.cov_root + (_MIDDLE_OFF * off_m) ** 2 * np.eye(3)
    return replace(seen, cov_root=cov, radius_var_m2=seen.radius_var_m2 + (2 * off_m) ** 2)
