"""The method of Jamone et al. (J IV): LWPR as forward model of the arm, and as map of labels drawn everywhere."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from learning.reach.babbling import Babbled, crossing, gaze_at
from learning.reach.labels import HandModel, Labels
from learning.reach.map import MapPrediction
from pps_vision.experiments.baselines.lwpr import LWPR, LWPRParams
from pps_vision.experiments.baselines.lwpr_metric import MetricParams
from pps_vision.experiments.baselines.lwpr_regression import RegressionParams
from pps_vision.experiments.baselines.regressors import ArmToGaze, LocalModels
from pps_vision.robot.gaze import GazeLimits
from pps_vision.types import Array, Mask

RESULTS = {"forward_model_deg": 0.84, "je": 1.3, "fn": 4.7, "fp": 0.4, "degree_rmse": 0.022, "labels": 52_000}
"""What J reports: degrees, percent, RMS error of R, inverse-kinematics solutions."""

LWPR_ARM = LWPRParams(
    init_D=80, w_gen=0.2, metric=MetricParams(rate=0), regression=RegressionParams(first_projections=4)
)
"""For 4400 samples: all four projections from the start, since a field sees few samples; constant metrics, since
adapting them takes more samples than there are."""

LWPR_MAP = LWPRParams(init_D=600, w_gen=0.2, metric=MetricParams(rate=0))
"""For 52 000 labels; about 10 000 receptive fields, as many as in J."""

_BASELINE_M = 0.068  # between the eyes

MapQuery = Callable[[Array], MapPrediction]
"""Gaze postures (N, 3) to what a map predicts of them."""


def arm_model(params: LWPRParams = LWPR_ARM, n_epochs: int = 1) -> ArmToGaze:
    """Return an untrained LWPR forward model, four arm joints to gaze, that sees every sample `n_epochs` times."""
    return ArmToGaze(LocalModels(4, 3, params, n_epochs))


def hand_model(model: ArmToGaze, babbled: Babbled) -> HandModel:
    """Return a trained forward model in the form inverse kinematics takes, positions in eye coordinates (m).

    Positions are NaN where no receptive field responds; inverse kinematics starts from the babbled postures where one
    does.  ValueError where fewer than two of them are answered.
    """
    local = model.regressor
    if not isinstance(local, LocalModels):
        raise TypeError(f"forward model of {type(local).__name__}; expected one of LocalModels")

    def forward(arm: Array) -> tuple[Array, Array]:
        x = (arm - model.middle) / model.half
        return _BASELINE_M * local.predict(x), _BASELINE_M * local.model.jacobian(x) / model.half

    def gaze(points: Array, limits: GazeLimits) -> Array:
        found = gaze_at(points / _BASELINE_M)
        within = ((found >= limits.lower) & (found <= limits.upper)).all(axis=1, keepdims=True)
        return np.where(within, found, np.nan)

    answered = np.isfinite(forward(babbled.arm_rad)[0]).all(axis=1)
    if answered.sum() < 2:
        raise ValueError("LWPR answers nowhere: too few samples for its receptive fields")
    return HandModel(forward, lambda gaze: _BASELINE_M * crossing(gaze), gaze, tried=babbled.arm_rad[answered])


def degree(reachable: Mask, optimality: Array, error_m: Array, max_error_m: float) -> Array:
    """(N,) degree of reachability R (J IV.6 and IV.7; in the printed IV.6 R would leave [0, 1])."""
    return np.where(reachable, 0.5 + 0.5 * optimality, 0.5 - 0.5 * np.minimum(error_m / max_error_m, 1))


def lwpr_map(labels: Labels, max_error_m: float, limits: GazeLimits) -> MapQuery:
    """Learn Basic map S (0.75 reachable, 0.25 not) and Enhanced map R from labels; reachable where S > 0.5.

    The receptive fields keep their number of labels: init_D follows the density of the labels to the power 2/3.
    """
    labels = labels.only(labels.answered)
    scale = (len(labels.gaze_rad) / RESULTS["labels"]) ** (2 / 3)
    model = LWPR(3, 2, replace(LWPR_MAP, init_D=LWPR_MAP.init_D * scale))
    middle, half = (limits.lower + limits.upper) / 2, (limits.upper - limits.lower) / 2
    S = np.where(labels.reachable, 0.75, 0.25)
    R = degree(labels.reachable, labels.optimality, labels.error_m, max_error_m)
    for x, y in zip((labels.gaze_rad - middle) / half, np.stack([S, R], axis=1), strict=True):
        model.update(x, y)

    def query(gaze: Array) -> MapPrediction:
        mean = model.predict((gaze - middle) / half)
        within = np.ones(len(gaze), dtype=bool)
        return MapPrediction(within, mean[:, 0] > 0.5, np.clip(2 * mean[:, 0] - 0.5, 0, 1), mean[:, 1])

    return query
