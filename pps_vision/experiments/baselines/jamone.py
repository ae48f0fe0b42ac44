"""The method of Jamone et al. (J IV): LWPR as forward model of the arm, and as map learned from labels everywhere."""

from collections.abc import Callable

import numpy as np

from learning.reach.labels import Labels
from learning.reach.map import MapPrediction
from pps_vision.experiments.baselines.lwpr import LWPR, LWPRParams
from pps_vision.robot.gaze import GazeLimits
from pps_vision.types import Array, Mask

PUBLISHED = {"forward_model_deg": 0.84, "je": 1.3, "fn": 4.7, "fp": 0.4, "degree_rmse": 0.022, "labels": 52_000}
"""What J reports: degrees, percent, RMS error of R, inverse-kinematics solutions."""

ARM_PARAMS = LWPRParams(init_D=80, w_gen=0.2, first_projections=4)
"""For 4400 samples: all four projections from the start, because a field has few samples."""
_MAP_PARAMS = LWPRParams(init_D=600, w_gen=0.2)  # for 52 000 labels: about 10 000 receptive fields, as in J

MapQuery = Callable[[Array], MapPrediction]  # gaze postures (N, 3) to the predictions of a map


def degree(reachable: Mask, optimality: Array, error_m: Array, max_error_m: float) -> Array:
    """Return (N,) degree of reachability R (J IV.6 and IV.7; with the printed IV.6, R would leave [0, 1])."""
    return np.where(reachable, 0.5 + 0.5 * optimality, 0.5 - 0.5 * np.minimum(error_m / max_error_m, 1))


def learn_map(labels: Labels, max_error_m: float, limits: GazeLimits) -> MapQuery:
    """Learn Basic map S (0.75 reachable, 0.25 not) and Enhanced map R; reachable where S > 0.5.

    The number of labels per receptive field is constant: init_D is proportional to the density of labels to the power
    2/3.
    """
    labels = labels.only(labels.answered)
    scale = (len(labels.gaze_rad) / PUBLISHED["labels"]) ** (2 / 3)
    model = LWPR(3, 2, _MAP_PARAMS._replace(init_D=_MAP_PARAMS.init_D * scale))
    middle = (limits.lower + limits.upper) / 2
    half = (limits.upper - limits.lower) / 2
    S = np.where(labels.reachable, 0.75, 0.25)
    R = degree(labels.reachable, labels.optimality, labels.error_m, max_error_m)
    model.update((labels.gaze_rad - middle) / half, np.stack([S, R], axis=1))

    def query(gaze: Array) -> MapPrediction:
        mean = model.predict((gaze - middle) / half)
        within = np.ones(len(gaze), dtype=bool)
        return MapPrediction(within, mean[:, 0] > 0.5, np.clip(2 * mean[:, 0] - 0.5, 0, 1), mean[:, 1])

    return query
