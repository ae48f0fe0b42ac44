"""Severity of six disturbances of babbling and labels: where forward model and reachable-space map break.

The map is judged against the closed-form inverse kinematics of the true arm. J's method is past the break undisturbed:
inverse kinematics on LWPR is wrong where the hand was never seen.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.reach.labels import Labels, ReachOracle
from learning.reach.params import MapParams
from learning.reach.training import learned_from
from pps_vision.experiments.babbling import Babbled, babble
from pps_vision.experiments.baselines import jamone
from pps_vision.experiments.charts import severities
from pps_vision.experiments.reach_truth import closed_form, first, learn_hand
from pps_vision.experiments.study import Axis, Break, Metric, Values, compare_severities, percent
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.inverse_kinematics import IKParams
from pps_vision.robot.self_motion import TwoStageParams, WalkParams
from pps_vision.types import Array, Mask

_N_TRIED = 5800
_N_SAMPLES = 1500
_ELBOW = 3
_STUCK_RAD = np.deg2rad(60)
_LIMITS = GazeLimits()
_BREAK = Break("je", jamone.PUBLISHED["je"])
_METRICS = {"je": Metric("misjudged", percent)}
_MAP_PARAMS = MapParams(
    n_babble=20_000,
    lattice=0.06,
    inverse=TwoStageParams(IKParams(tolerance=1e-4, max_steps=40, min_step_rad=3e-4), WalkParams(steps=0, finer=1)),
)  # no second stage: JE does not depend on the degree

Disturb = Callable[[Babbled, float, np.random.Generator], Babbled]  # samples and a severity to disturbed samples


@dataclass(frozen=True)
class Training:
    """Training data of a map, and the truth for it."""

    babbled: Babbled  # samples of arm and gaze posture
    flipped: float  # share of labels reported as their opposite
    gaze_rad: Array  # (N, 3) gaze postures without disturbance
    reachable: Mask  # (N,) whether the true arm reaches their fixation points


def _noise(babbled: Babbled, sigma_deg: float, rng: np.random.Generator) -> Babbled:
    """Gaussian noise on the three gaze angles of each fixation."""
    noise = np.deg2rad(sigma_deg) * rng.standard_normal(babbled.gaze_rad.shape)
    return replace(babbled, gaze_rad=np.clip(babbled.gaze_rad + noise, _LIMITS.lower, _LIMITS.upper))


def _outliers(babbled: Babbled, share: float, rng: np.random.Generator) -> Babbled:
    """Another object is fixated, anywhere within the limits, in a share (%) of the samples."""
    wrong = rng.random((len(babbled.gaze_rad), 1)) < share / 100
    elsewhere = rng.uniform(_LIMITS.lower, _LIMITS.upper, babbled.gaze_rad.shape)
    return replace(babbled, gaze_rad=np.where(wrong, elsewhere, babbled.gaze_rad))


def _offset(babbled: Babbled, degrees: float, _: np.random.Generator) -> Babbled:
    """The elbow's encoder has a constant offset."""
    return replace(babbled, arm_rad=babbled.arm_rad + np.deg2rad(degrees) * np.eye(4)[_ELBOW])


def _stuck(babbled: Babbled, share: float, rng: np.random.Generator) -> Babbled:
    """The elbow's encoder reports 60° in a share (%) of the samples."""
    arm = babbled.arm_rad.copy()
    arm[rng.random(len(arm)) < share / 100, _ELBOW] = _STUCK_RAD
    return replace(babbled, arm_rad=arm)


DISTURBANCES: dict[str, tuple[Axis, Disturb | None]] = {
    "fixation noise": (Axis("σ (°)", (0, 0.3, 1, 3, 6)), _noise),
    "another object fixated": (Axis("share of samples (%)", (0, 5, 10, 25, 50)), _outliers),
    "elbow encoder offset": (Axis("offset (°)", (0, 1, 2, 5, 10)), _offset),
    "elbow encoder stuck": (Axis("share of samples (%)", (0, 10, 25, 100)), _stuck),
    "fewer samples": (Axis("samples", (_N_SAMPLES, 400, 200, 100, 50)), lambda babbled, n, _: first(babbled, int(n))),
    "labels flipped": (Axis("share of labels (%)", (0, 1, 2, 5, 10)), None),
}
"""Disturbance to its severities, the first of them none, and the change of the samples (None: the labels change)."""


def disturbed(name: str, n_test: int, seed: int, severity: float) -> Training:
    """Return 1500 babbled samples, or labels, with one disturbance, and gaze postures from another seed."""
    robot = load_icub()
    babbled = first(babble(robot, _N_TRIED, np.random.default_rng(seed)), _N_SAMPLES)
    gaze = np.random.default_rng(seed + 1_000_000).uniform(_LIMITS.lower, _LIMITS.upper, (n_test, 3))
    reachable = np.isfinite(closed_form(robot).solve(fixation_points(robot, gaze))[:, 0])
    _, change = DISTURBANCES[name]
    if change is not None:
        babbled = change(babbled, severity, np.random.default_rng(seed + 1))
    return Training(babbled, 0.0 if change else severity / 100, gaze, reachable)


def learn_and_judge(n_labels: int, data: Training, seed: int) -> Values:
    """Return which gaze postures are misjudged; where nothing can be learned, the verdict is unreachable."""
    rng = np.random.default_rng(seed + 2_000_000)
    params = replace(_MAP_PARAMS, n_labels=n_labels, round_labels=n_labels // 2)
    reachable = np.zeros(len(data.gaze_rad), dtype=bool)
    try:
        oracle = ReachOracle(load_icub(), "right", params, rng, learn_hand(data.babbled))
        label = partial(_flipped, oracle.label, data.flipped, rng)
        reachable = learned_from(label, "right", rng, params).query(data.gaze_rad).reachable
    except ValueError:  # the learner's: too few samples, no label beyond the border
        pass
    return {"misjudged": reachable != data.reachable}


def _flipped(label: Callable[[Array], Labels], share: float, rng: np.random.Generator, gaze: Array) -> Labels:
    """Labels with a share of the answers reversed, which have no border point."""
    labels = label(gaze)
    flip = rng.random(len(gaze)) < share
    return replace(
        labels,
        reachable=labels.reachable ^ flip,
        optimality=np.where(flip, 0.5, labels.optimality),
        border_rad=np.where(flip[:, None], np.nan, labels.border_rad),
    )


def run(study: Any) -> dict[str, Any]:
    """Return by disturbance the results of `compare_severities`: JE (%)."""
    methods = {"ours": partial(learn_and_judge, study.n_labels)}
    return {
        name: compare_severities(partial(disturbed, name, study.n_test), axis, methods, _METRICS, study.seeds, _BREAK)
        for name, (axis, _) in DISTURBANCES.items()
        if name in (study.disturbances or DISTURBANCES)
    }


def chart(numbers: dict[str, Any]) -> Figure:
    """Draw misjudged gaze postures over severity."""
    shown = {name: numbers[name] for name in DISTURBANCES if name in numbers}
    figure = severities(shown, "je", "misjudged, JE (%)", _BREAK.bound, 3)
    for axis in figure.axes:
        axis.set_yscale("log")
    return figure
