"""Severity study of learning from babbling: one disturbance at a time, from none to past the break point.

Two methods learn arm and map from the same samples with the same number of inverse-kinematics solutions.  Ours: model
of revolute joints, labels at the border, signed distance.  J's: LWPR of the arm, labels everywhere, LWPR of 0.75 and
0.25.  Both are judged against the closed-form inverse kinematics of the true arm.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from learning.reach.babbling import Babbled, babble
from learning.reach.forward_model import RevoluteArm
from learning.reach.map import Labels, MapPrediction
from learning.reach.training import HandModel, MapParams, ReachOracle, learned_from
from pps_vision.experiments import charts
from pps_vision.experiments.reach import jamone
from pps_vision.experiments.reach.map_truth import closed_form, first
from pps_vision.experiments.study import Axis, Break, Metric, Study, Values, compare_severities, percent, rms
from pps_vision.experiments.tables import Table
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.inverse_kinematics import IKParams
from pps_vision.robot.self_motion import WalkParams
from pps_vision.robot.two_stage import TwoStageParams
from pps_vision.types import Array, Mask

_N_TRIED, _N_SAMPLES, _N_TEST_SAMPLES = 5800, 1500, 300
_ELBOW, _STUCK_RAD = 3, np.deg2rad(60)
_CONFIDENT = 0.99
_BREAK = Break("je", jamone.RESULTS["je"])
_LWPR_ARM = replace(jamone.LWPR_ARM, init_D=40)  # wider fields than for 4400 samples
_PARAMS = MapParams(
    n_babble=20_000,
    lattice=0.06,
    inverse=TwoStageParams(IKParams(tolerance=1e-4, max_steps=40, min_step_rad=3e-4), WalkParams(steps=0, finer=1)),
)  # no second stage: JE, FN and FP do not depend on the degree


@dataclass(frozen=True)
class Training:
    """What a map is learned from, and the truth that it is judged by."""

    babbled: Babbled
    """Samples of arm and gaze posture."""
    flipped: float
    """Share of labels reported as their opposite."""
    test: Babbled
    """Samples without disturbance."""
    gaze_rad: Array
    """(N, 3) gaze postures without disturbance."""
    reachable: Mask
    """(N,) whether the true arm reaches what they fixate."""

    @classmethod
    def undisturbed(cls, seed: int, n_test: int) -> "Training":
        """Babble 1500 fixated postures, and draw postures to judge on from another seed."""
        robot, rng, limits = load_icub(), np.random.default_rng(seed), GazeLimits()
        babbled = babble(robot, "right", _N_TRIED, rng)
        gaze = np.random.default_rng(seed + 1_000_000).uniform(limits.lower, limits.upper, (n_test, 3))
        reachable = np.isfinite(closed_form(robot).solve(fixation_points(robot, gaze))[:, 0])
        test = babble(robot, "right", 4 * _N_TEST_SAMPLES, rng)
        return cls(first(babbled, _N_SAMPLES), 0.0, test, gaze, reachable)


Disturb = Callable[[Training, float, np.random.Generator], Training]


def _noise(babbled: Babbled, sigma_deg: float, rng: np.random.Generator) -> Babbled:
    """Gaussian noise on the three gaze angles of each fixation."""
    limits, noise = GazeLimits(), np.deg2rad(sigma_deg) * rng.standard_normal(babbled.gaze_rad.shape)
    return replace(babbled, gaze_rad=np.clip(babbled.gaze_rad + noise, limits.lower, limits.upper))


def _outliers(babbled: Babbled, percent: float, rng: np.random.Generator) -> Babbled:
    """Another object is fixated, anywhere within the limits."""
    gaze, limits = babbled.gaze_rad, GazeLimits()
    wrong = rng.random((len(gaze), 1)) < percent / 100
    return replace(babbled, gaze_rad=np.where(wrong, rng.uniform(limits.lower, limits.upper, gaze.shape), gaze))


def _offset(babbled: Babbled, degrees: float, _: np.random.Generator) -> Babbled:
    """The elbow's encoder has a constant offset."""
    return replace(babbled, arm_rad=babbled.arm_rad + np.deg2rad(degrees) * np.eye(4)[_ELBOW])


def _stuck(babbled: Babbled, percent: float, rng: np.random.Generator) -> Babbled:
    """The elbow's encoder reports 60° in a share of the samples."""
    arm = babbled.arm_rad.copy()
    arm[rng.random(len(arm)) < percent / 100, _ELBOW] = _STUCK_RAD
    return replace(babbled, arm_rad=arm)


def _of_samples(change: Callable[[Babbled, float, np.random.Generator], Babbled]) -> Disturb:
    return lambda data, severity, rng: replace(data, babbled=change(data.babbled, severity, rng))


DISTURBANCES: dict[str, tuple[Axis, Disturb]] = {
    "fixation noise": (Axis("σ (°)", (0, 0.3, 1, 3, 6)), _of_samples(_noise)),
    "another object fixated": (Axis("share of samples (%)", (0, 5, 10, 25, 50)), _of_samples(_outliers)),
    "elbow encoder offset": (Axis("offset (°)", (0, 1, 2, 5, 10)), _of_samples(_offset)),
    "elbow encoder stuck": (Axis("share of samples (%)", (0, 10, 25, 100)), _of_samples(_stuck)),
    "fewer samples": (
        Axis("samples", (_N_SAMPLES, 400, 200, 100, 50)), _of_samples(lambda babbled, n, _: first(babbled, int(n)))
    ),
    "labels flipped": (
        Axis("share of labels (%)", (0, 1, 2, 5, 10)), lambda data, percent, _: replace(data, flipped=percent / 100)
    ),
}  # fmt: skip
"""Disturbance to its severities, the first of them none, and how the training data change."""


class Learner(NamedTuple):
    """How arm and map are learned."""

    arm: Callable[[Babbled], tuple[Callable[[Array], Array], HandModel]]
    """Samples to the forward model, and the same for inverse kinematics."""
    map: Callable[[Callable[[Array], Labels], MapParams, np.random.Generator], jamone.MapQuery]
    """What answers gaze postures by inverse kinematics to a map."""


def _revolute(babbled: Babbled) -> tuple[Callable[[Array], Array], HandModel]:
    model = RevoluteArm()
    model.learn(babbled.arm_rad, babbled.gaze_rad)
    return model, HandModel(model.forward, model.points, model.gaze)


def _lwpr(babbled: Babbled) -> tuple[Callable[[Array], Array], HandModel]:
    model = jamone.arm_model(_LWPR_ARM)
    model.learn(babbled.arm_rad, babbled.gaze_rad)
    return model, jamone.hand_model(model, babbled)


def _labels_everywhere(
    label: Callable[[Array], Labels], params: MapParams, rng: np.random.Generator
) -> jamone.MapQuery:
    limits = params.gaze_limits
    labels = label(rng.uniform(limits.lower, limits.upper, (params.n_labels, 3)))
    return jamone.lwpr_map(labels, float(np.nanmax(labels.error_m)), limits)


LEARNERS = {
    "ours": Learner(_revolute, lambda label, params, rng: learned_from(label, "right", rng, params).query),
    "J: LWPR of arm and map": Learner(_lwpr, _labels_everywhere),
}


def learn_and_judge(learner: Learner, n_labels: int, data: Training, seed: int) -> Values:
    """Return gaze errors of the forward model (degrees) and, of gaze postures, which are misjudged.

    Where nothing can be learned, nothing is called reachable and there is no gaze error.
    """
    rng = np.random.default_rng(seed + 2_000_000)
    params = replace(_PARAMS, n_labels=n_labels, round_labels=n_labels // 2)
    nothing, gaze_error = np.full(len(data.gaze_rad), np.nan), np.full(data.test.gaze_rad.shape, np.nan)
    said = MapPrediction(nothing == 0, nothing > 0, nothing, nothing)
    try:
        model, hand = learner.arm(data.babbled)
        gaze_error = np.rad2deg(model(data.test.arm_rad) - data.test.gaze_rad)
        oracle = ReachOracle(load_icub(), "right", params, rng, hand)
        said = learner.map(_flipping(oracle.label, data.flipped, rng), params, rng)(data.gaze_rad)
    except ValueError:  # of the learners: too few samples, no receptive field that answers, no label beyond the border
        pass
    wrong = said.reachable != data.reachable
    return {
        "gaze_error_deg": gaze_error[np.isfinite(gaze_error)],
        "unanswered": ~np.isfinite(gaze_error).all(axis=1),
        "misjudged": wrong,
        "false_negative": wrong[data.reachable],
        "false_positive": wrong[~data.reachable],
        "confident_and_wrong": wrong[np.maximum(said.probability, 1 - said.probability) > _CONFIDENT],
    }


def _flipping(label: Callable[[Array], Labels], share: float, rng: np.random.Generator) -> Callable[[Array], Labels]:
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
class Severity(Study):
    """Forward model and map under six disturbances of babbling and labels, ours beside J's method."""

    seed: int = 0
    """First seed of babbling, disturbance and labels."""
    n: int = 3
    """Seeds, the independent units."""
    n_labels: int = 1000
    """Inverse-kinematics solutions per map."""
    n_test: int = 4000
    """Gaze postures that each map is judged on."""

    def run(self) -> dict[str, Any]:
        """Return by disturbance what `compare_severities` does: JE, FN, FP, confident errors (%), gaze RMSE (°)."""
        metrics = {
            "je": Metric("misjudged", percent),
            "fn": Metric("false_negative", percent),
            "fp": Metric("false_positive", percent),
            "confident_and_wrong": Metric("confident_and_wrong", percent),
            "gaze_rmse_deg": Metric("gaze_error_deg", rms),
            "unanswered": Metric("unanswered", percent),
        }
        methods = {name: partial(learn_and_judge, learner, self.n_labels) for name, learner in LEARNERS.items()}
        seeds = range(self.seed, self.seed + self.n)
        return {
            name: compare_severities(partial(self._disturbed, disturb), axis, methods, metrics, seeds, _BREAK)
            for name, (axis, disturb) in DISTURBANCES.items()
        }

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return JE without and at the worst severity, and where each method breaks."""
        columns = [f"{name}: {what}" for name in LEARNERS for what in ("breaks at", "JE (%)")]
        rows = []
        for disturbance in DISTURBANCES:
            case = numbers[disturbance]
            row = [f"{disturbance}, {case['axis']}", ", ".join(f"{severity:g}" for severity in case["severities"])]
            for cell in case["methods"].values():
                breaks, je = cell["breaks_at"], cell["je"]
                row += ["–" if breaks is None else f"{breaks:g}", f"{je[0][0]:.2g} → {je[-1][0]:.2g}"]
            rows.append(row)
        return {"": Table(["disturbance", "severities", *columns], rows)}

    def _disturbed(self, disturb: Disturb, seed: int, severity: float) -> Training:
        data = Training.undisturbed(seed, self.n_test)
        return disturb(data, severity, np.random.default_rng(seed + 1))

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw misjudged gaze postures, and the forward model's error, over severity."""
        return {
            "": _panels(numbers, "je", "misjudged gaze postures, JE (%)", _BREAK.bound),
            "forward_model": _panels(numbers, "gaze_rmse_deg", "gaze RMSE of the forward model (°)", None),
        }


def _panels(numbers: dict[str, Any], metric: str, label: str, bound: float | None) -> Figure:
    cases = {name: numbers[name] for name in DISTURBANCES if metric == "je" or "label" not in name}
    figure, axes = charts.panels(len(cases), 4, 3.4, 3.2)
    for axis, (name, case) in zip(axes, cases.items(), strict=True):
        charts.severity(axis, case, metric, label if axis in axes[::4] else "", bound)
        axis.set_yscale("log")
        axis.set_title(name, fontsize=10)
    axes[0].legend(fontsize=8)
    return figure
