"""Severity study of learning from babbling: one disturbance at a time, from none to past the break point.

Two methods learn arm and map from the same samples with the same number of inverse-kinematics solutions.  Ours: model
of revolute joints, labels at the border, signed distance.  J's: LWPR of the arm, labels everywhere, LWPR of 0.75 and
0.25.  Both are judged against the closed-form inverse kinematics of the true arm.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure

from learning.reach.babbling import Babbled, babble
from learning.reach.forward_model import RevoluteArm
from learning.reach.labels import HandModel, Labels, ReachOracle
from learning.reach.map import MapPrediction
from learning.reach.params import MapParams
from learning.reach.training import learned_from
from pps_vision.experiments.charts import severities
from pps_vision.experiments.reach import jamone
from pps_vision.experiments.reach.map_truth import closed_form, first
from pps_vision.experiments.study import Axis, Break, Metric, SampledStudy, Values, compare_severities, percent
from pps_vision.experiments.tables import Table, break_points
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.inverse_kinematics import IKParams
from pps_vision.robot.self_motion import WalkParams
from pps_vision.robot.two_stage import TwoStageParams
from pps_vision.types import Array, Mask

_N_TRIED, _N_SAMPLES = 5800, 1500
_ELBOW, _STUCK_RAD, _LIMITS = 3, np.deg2rad(60), GazeLimits()
_CONFIDENT = 0.99
_BREAK = Break("je", jamone.RESULTS["je"])
_METRICS = {"je": Metric("misjudged", percent), "confident_and_wrong": Metric("confident_and_wrong", percent)}
_LWPR_ARM = replace(jamone.LWPR_ARM, init_D=40)  # wider fields than for 4400 samples
_PARAMS = MapParams(
    n_babble=20_000,
    lattice=0.06,
    inverse=TwoStageParams(IKParams(tolerance=1e-4, max_steps=40, min_step_rad=3e-4), WalkParams(steps=0, finer=1)),
)  # no second stage: JE does not depend on the degree


@dataclass(frozen=True)
class Training:
    """What a map is learned from, and the truth that it is judged by."""

    babbled: Babbled
    """Samples of arm and gaze posture."""
    flipped: float
    """Share of labels reported as their opposite."""
    gaze_rad: Array
    """(N, 3) gaze postures without disturbance."""
    reachable: Mask
    """(N,) whether the true arm reaches what they fixate."""

    @classmethod
    def undisturbed(cls, seed: int, n_test: int) -> "Training":
        """Babble 1500 fixated postures, and draw postures to judge on from another seed."""
        robot = load_icub()
        babbled = first(babble(robot, "right", _N_TRIED, np.random.default_rng(seed)), _N_SAMPLES)
        gaze = np.random.default_rng(seed + 1_000_000).uniform(_LIMITS.lower, _LIMITS.upper, (n_test, 3))
        return cls(babbled, 0.0, gaze, np.isfinite(closed_form(robot).solve(fixation_points(robot, gaze))[:, 0]))


Disturb = Callable[[Babbled, float, np.random.Generator], Babbled]


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
"""Disturbance to its severities, the first of them none, and how the samples change (None: the labels do)."""


def disturbed(name: str, n_test: int, seed: int, severity: float) -> Training:
    """Return training data with one disturbance."""
    data, (_, change) = Training.undisturbed(seed, n_test), DISTURBANCES[name]
    if change is None:
        return replace(data, flipped=severity / 100)
    return replace(data, babbled=change(data.babbled, severity, np.random.default_rng(seed + 1)))


Oracle = Callable[[Array], Labels]
"""Gaze postures (N, 3) to labels."""


def our_hand(babbled: Babbled) -> HandModel:
    """Return the model of revolute joints."""
    model = RevoluteArm()
    model.learn(babbled.arm_rad, babbled.gaze_rad)
    return HandModel(model.forward, model.points, model.gaze)


def hand_of_j(babbled: Babbled) -> HandModel:
    """Return J's LWPR of the arm."""
    model = jamone.arm_model(_LWPR_ARM)
    model.learn(babbled.arm_rad, babbled.gaze_rad)
    return jamone.hand_model(model, babbled)


def our_map(label: Oracle, params: MapParams, rng: np.random.Generator) -> jamone.MapQuery:
    """Return the map with labels at the border."""
    return learned_from(label, "right", rng, params).query


def map_of_j(label: Oracle, params: MapParams, rng: np.random.Generator) -> jamone.MapQuery:
    """Return J's LWPR of labels everywhere."""
    labels = label(rng.uniform(_LIMITS.lower, _LIMITS.upper, (params.n_labels, 3)))
    return jamone.lwpr_map(labels, float(np.nanmax(labels.error_m)), _LIMITS)


LEARNERS = {"ours": (our_hand, our_map), "J: LWPR of arm and map": (hand_of_j, map_of_j)}


def learn_and_judge(learner: str, n_labels: int, data: Training, seed: int) -> Values:
    """Return which gaze postures are misjudged; where nothing can be learned, nothing is called reachable."""
    learn_hand, learn_map = LEARNERS[learner]
    rng = np.random.default_rng(seed + 2_000_000)
    params = replace(_PARAMS, n_labels=n_labels, round_labels=n_labels // 2)
    unknown = np.full(len(data.gaze_rad), np.nan)
    said = MapPrediction(unknown == 0, unknown > 0, unknown, unknown)
    try:
        oracle = ReachOracle(load_icub(), "right", params, rng, learn_hand(data.babbled))
        said = learn_map(_flipping(oracle.label, data.flipped, rng), params, rng)(data.gaze_rad)
    except ValueError:  # of the learners: too few samples, no receptive field that answers, no label beyond the border
        pass
    wrong = said.reachable != data.reachable
    confident = np.maximum(said.probability, 1 - said.probability) > _CONFIDENT
    return {"misjudged": wrong, "confident_and_wrong": wrong[confident]}


def _flipping(label: Oracle, share: float, rng: np.random.Generator) -> Oracle:
    """Return the same oracle with a share of its answers reversed, those without a border point."""

    def flipped(gaze: Array) -> Labels:
        labels = label(gaze)
        flip = rng.random(len(gaze)) < share
        return replace(
            labels,
            reachable=labels.reachable ^ flip,
            optimality=np.where(flip, 0.5, labels.optimality),
            border_rad=np.where(flip[:, None], np.nan, labels.border_rad),
        )

    return flipped


@dataclass(frozen=True)
class Severity(SampledStudy):
    """Forward model and map under six disturbances of babbling and labels, ours beside J's method."""

    SHORT: ClassVar[Mapping[str, Any]] = {"n_labels": 200}

    n: int = 3
    """Seeds, the independent units."""
    n_labels: int = 1000
    """Inverse-kinematics solutions per map."""
    n_test: int = 4000
    """Gaze postures that each map is judged on."""

    def run(self) -> dict[str, Any]:
        """Return by disturbance what `compare_severities` does: JE and confident errors (%)."""
        methods = {name: partial(learn_and_judge, name, self.n_labels) for name in LEARNERS}
        seeds = self.seeds
        return {
            name: compare_severities(partial(disturbed, name, self.n_test), axis, methods, _METRICS, seeds, _BREAK)
            for name, (axis, _) in DISTURBANCES.items()
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw misjudged gaze postures over severity."""
        figure = severities(_studies(numbers), "je", "misjudged, JE (%)", _BREAK.bound, 3)
        for axis in figure.axes:
            axis.set_yscale("log")
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return where each method breaks."""
        return {"": break_points(_studies(numbers))}


def _studies(numbers: dict[str, Any]) -> dict[str, Any]:
    return {name: numbers[name] for name in DISTURBANCES}
