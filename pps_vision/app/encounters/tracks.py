"""The track of an object without rendering: truth, the measured track error, and the tracker's own Kalman filter.

An observation is the truth, an error that is constant during the encounter (the centre of the visible part differs from
the object's), and an error drawn anew in every frame. The filter is given their covariance.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from pps_vision.app.encounters.encounter import Encounter, EncounterScene
from pps_vision.app.simulation import PERIOD_S
from pps_vision.types import Array, Status, Track3D
from tracking import kalman
from tracking.kalman import KalmanParams
from tracking.tracker import TrackerParams

Perception = Literal["truth", "track", "noisy track"]
"""What a controller is given of the object: its exact motion, the tracker's errors, or more."""
NOISE = 3.0  # factor of the errors of a noisy track


class TrackError(NamedTuple):
    """RMS errors of the triangulated position of an object, m: along the line of sight, and across it per axis."""

    constant_m: tuple[float, float]  # constant during an encounter
    random_m: tuple[float, float]  # drawn anew in every frame


ERRORS = {
    "ball": TrackError((0.21e-3, 0.03e-3), (0.24e-3, 0.05e-3)),
    "marker": TrackError((0.29e-3, 0.07e-3), (0.34e-3, 0.06e-3)),
    "cube": TrackError((5.2e-3, 1.2e-3), (0.58e-3, 0.07e-3)),
    "octopus": TrackError((6.1e-3, 3.5e-3), (1.6e-3, 0.22e-3)),
}
"""As rendered: 24 encounters with each object of seed 500. Constant: the median error of an encounter; random: half the
variance of the difference of successive errors, from its median size. Of these, studies measure the ball alone: 0.28 mm
in all for a rendered ball at 0.4 m (`bench stages`, part `stereo`), here 0.33 mm."""
_RADIUS_STD = 0.05  # relative standard deviation of the tracked radius


def track_of(
    scene: EncounterScene, encounter: Encounter, rng: np.random.Generator, noise: float = 1.0
) -> Sequence[Track3D]:
    """Return the track of every frame of an encounter, unknown until it is confirmed; `noise`: factor of the errors."""
    params = TrackerParams()
    kalman_params = KalmanParams()
    constant_m, random_m = (noise * np.array(rms_m)[[1, 1, 0]] for rms_m in ERRORS[encounter.stimulus])
    cov = np.diag(constant_m**2 + random_m**2)
    view = scene.rig.view(encounter.q_rad)
    baseline = view.right.center - view.left.center
    constant = constant_m * rng.standard_normal(3)
    is_angular = encounter.stimulus in ("cube", "octopus")
    radius = encounter.radius_m * (1 + _RADIUS_STD * is_angular * rng.standard_normal())
    tracks: list[Track3D] = []
    belief = None
    for k in range(frames(encounter)):
        t = k * PERIOD_S
        if k == 0:  # motion is seen from the second frame on
            tracks.append(Track3D.unknown(t))
            continue
        position, _ = encounter.motion(t)
        turn = _line_of_sight(position - view.midpoint, baseline)
        observed = position + turn @ (constant + random_m * rng.standard_normal(3))
        observed_cov = turn @ cov @ turn.T
        correlated = turn @ np.diag(constant_m**2) @ turn.T
        if belief is None:
            belief = kalman.start(kalman_params, t, observed, observed_cov, correlated)
        else:
            predicted = kalman.predict(kalman_params, belief, t)
            belief = kalman.update(kalman_params, predicted, observed, observed_cov, correlated)
        if k < params.confirm_frames:
            tracks.append(Track3D.unknown(t))
        else:
            tracks.append(_track(t, belief.mean, belief.cov, belief.correlated_cov, radius))
    return tracks


def _line_of_sight(direction: Array, baseline: Array) -> Array:
    """Return the rotation (3, 3) whose z axis points along a direction (3,), its x axis as far as possible along the
    eyes' baseline (3,): it turns as steadily as the direction does."""
    z = direction / np.linalg.norm(direction)
    y = np.cross(z, baseline)
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, z), y, z])


def true_track_of(encounter: Encounter) -> Sequence[Track3D]:
    """Return the truth of every frame as a track without error."""
    tracks = []
    for k in range(frames(encounter)):
        p, v = encounter.motion(k * PERIOD_S)
        tracks.append(_track(k * PERIOD_S, np.array([p, v]), np.zeros((6, 6)), np.zeros((3, 3)), encounter.radius_m))
    return tracks


def frames(encounter: Encounter) -> int:
    """Return how many frames an encounter has."""
    return int(np.ceil(encounter.seconds / PERIOD_S))


def _track(stamp_s: float, mean: Array, cov: Array, correlated_cov: Array, radius_m: float) -> Track3D:
    full_mean = np.pad(mean, ((0, 4 - len(mean)), (0, 0)))
    full_cov = np.pad(cov, (0, 12 - len(cov)))
    full_cov[:3, :3] += correlated_cov
    return Track3D(stamp_s, full_mean, full_cov, radius_m, 0.0, Status.TRACKING)
