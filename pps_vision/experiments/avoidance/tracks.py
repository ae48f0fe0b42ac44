"""The track of an object without rendering: truth, the measured track error, and the tracker's own Kalman filter.

An observation is the truth, an error that stays during the encounter (the centre of what is seen is not that of the
object), and an error that is new in every frame. The filter is told their covariance.
"""

from collections.abc import Sequence

import numpy as np

from pps_vision.app.simulation import PERIOD_S
from pps_vision.experiments.avoidance.encounter import Encounter
from pps_vision.types import Array, Status, Track3D
from tracking import kalman
from tracking.kalman import KalmanParams
from tracking.tracker import TrackerParams

ERROR_M = {"ball": 0.37e-3, "marker": 0.48e-3, "cube": 12.6e-3, "octopus": 12.6e-3}
"""RMS error of the track: docs/results/tracking.json (rendered ball and marker, seed 9756) and docs/results/loop.json
(octopus, avoidance on, seed 9755), which stands for the cube too: both are angular and show other sides when they
turn."""
_RADIUS_STD = 0.05  # of the tracked radius, relative


def track_of(encounter: Encounter, rng: np.random.Generator) -> Sequence[Track3D]:
    """Return the track of every frame of an encounter, unknown until it is confirmed."""
    params, kalman_params = TrackerParams(), KalmanParams()
    white = kalman_params.white_share
    error_m = ERROR_M[encounter.stimulus] / np.sqrt(3)
    cov = error_m**2 * np.eye(3)
    lasting = np.sqrt(1 - white) * error_m * rng.standard_normal(3)
    radius = encounter.radius_m * (1 + _RADIUS_STD * (error_m > 1e-3) * rng.standard_normal())
    found: list[Track3D] = []
    belief = None
    for k in range(frames(encounter)):
        t = k * PERIOD_S
        if k == 0:  # motion is seen from the second frame on
            found.append(Track3D.unknown(t))
            continue
        observed = encounter.motion(t)[0] + lasting + np.sqrt(white) * error_m * rng.standard_normal(3)
        if belief is None:
            belief = kalman.start(kalman_params, t, observed, cov)
        else:
            belief = kalman.update(kalman_params, kalman.predict(kalman_params, belief, t), observed, cov)
        if k < params.confirm_frames:
            found.append(Track3D.unknown(t))
        else:
            found.append(_track(t, belief.mean, belief.cov, belief.correlated_cov, radius))
    return found


def true_track_of(encounter: Encounter) -> Sequence[Track3D]:
    """Return the truth of every frame as a track without error."""
    found = []
    for k in range(frames(encounter)):
        p, v = encounter.motion(k * PERIOD_S)
        found.append(_track(k * PERIOD_S, np.array([p, v]), np.zeros((6, 6)), np.zeros((3, 3)), encounter.radius_m))
    return found


def frames(encounter: Encounter) -> int:
    """Return how many frames an encounter has."""
    return int(np.ceil(encounter.seconds / PERIOD_S))


def _track(stamp_s: float, mean: Array, cov: Array, correlated_cov: Array, radius_m: float) -> Track3D:
    full_mean, full_cov, n = np.zeros((4, 3)), np.zeros((12, 12)), len(cov)
    full_mean[: len(mean)], full_cov[:n, :n] = mean, cov
    full_cov[:3, :3] += correlated_cov
    return Track3D(stamp_s, full_mean, full_cov, radius_m, 0.0, Status.TRACKING)
