"""What babbling teaches: the error of the arm-to-gaze forward model over the number of samples (J Fig 2)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.babbling import Babbled, babble, score
from learning.reach.gaussian_process import GaussianProcess
from learning.reach.turning_joints import TurningJoints
from pps_vision.experiments.baselines.lwpr import LWPRParams
from pps_vision.experiments.baselines.lwpr_metric import MetricParams
from pps_vision.experiments.baselines.lwpr_regression import RegressionParams
from pps_vision.experiments.baselines.regressors import ArmToGaze, LocalModels
from pps_vision.experiments.chart import panels
from pps_vision.experiments.study import Study
from pps_vision.robot.icub import load_icub

LWPR_OF_THE_ARM = LWPRParams(
    init_D=80, w_gen=0.2, metric=MetricParams(rate=0), regression=RegressionParams(first_projections=4)
)
"""Few samples a field and every joint matters: all projections from the start; metrics stay (to adapt them takes more
samples than there are)."""
_N_TRAIN, _N_TEST, _N_TRIED = 4400, 700, 20_000
Model = ArmToGaze | TurningJoints
_PAPER_DEG, _GOALS_DEG = 0.84, {"LWPR": 0.5, "best": 0.02}


def babbled_sets(seed: int, side: str = "right") -> tuple[Babbled, Babbled]:
    """What 20 000 postures teach, and 700 fixated ones to test on."""
    robot, rng = load_icub(), np.random.default_rng(seed)
    train, test = babble(robot, side, _N_TRIED, rng), babble(robot, side, 4 * _N_TEST, rng)
    return train, Babbled(test.arm_rad[:_N_TEST], test.gaze_rad[:_N_TEST], test.n_tried)


@dataclass(frozen=True)
class ForwardModelError(Study):
    """LWPR (each sample once, as in the paper; and all of them again and again), a Gaussian process, turning joints."""

    seed: int = 0
    """Seed of the babbling."""
    n_replays: int = 4
    """How often LWPR sees each sample in the curve with replay."""

    def run(self) -> dict[str, Any]:
        """RMSE (degrees) at each number of samples where there is an answer, and the share where there is none."""
        if self.n_replays < 1:
            raise ValueError(f"bench reach forward_model: --n-replays {self.n_replays}; expected at least 1")
        train, test = babbled_sets(self.seed)
        sizes = [100, 200, 400, 800, 1600, 3000, _N_TRAIN]
        once, process = ArmToGaze(LocalModels(4, 3, LWPR_OF_THE_ARM)), ArmToGaze(GaussianProcess())
        turning = TurningJoints()
        online: tuple[Model, ...] = (once, process, turning)
        names = ("LWPR, each sample once", "LWPR, replayed", "Gaussian process", "turning joints")
        curves: dict[str, list[float]] = {name: [] for name in names}
        silent: dict[str, list[float]] = {name: [] for name in names}
        before = 0
        for n in tqdm(sizes, desc="samples", disable=None):
            new = slice(before, n)
            replayed = ArmToGaze(LocalModels(4, 3, LWPR_OF_THE_ARM))
            rng = np.random.default_rng(self.seed)
            for _ in range(self.n_replays):
                order = rng.permutation(n)
                replayed.learn(train.arm_rad[order], train.gaze_rad[order])
            for model in online:
                model.learn(train.arm_rad[new], train.gaze_rad[new])
            before = n
            judged_now: tuple[Model, ...] = (once, replayed, process, turning)
            for name, judged in zip(names, judged_now, strict=True):
                error, unanswered = score(judged, test)
                curves[name].append(float(f"{error:.4g}"))
                silent[name].append(round(unanswered, 4))
        return {
            "fixated_of_20000": len(train.arm_rad),
            "samples": sizes,
            "rmse_deg": curves,
            "unanswered": silent,
            "paper_deg": _PAPER_DEG,
            "goals_deg": _GOALS_DEG,
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Error over samples, both logarithmic."""
        figure, (axis,) = panels(1, 6.4, 4.4)
        for name, curve in numbers["rmse_deg"].items():
            samples, error = np.array(numbers["samples"]), np.array(curve, dtype=float)
            (line,) = axis.plot(samples, error, "o-", ms=5, label=name)
            partly = np.array(numbers["unanswered"][name]) > 0.01
            axis.plot(samples[partly], error[partly], "o", ms=5, mec=line.get_color(), mfc="white")
        axis.plot([], [], "o", ms=5, mec="0.4", mfc="white", label="no answer to more than 1 %")
        axis.plot(numbers["samples"][-1], numbers["paper_deg"], "k*", ms=10, label="the paper's LWPR")
        for name, goal in numbers["goals_deg"].items():
            axis.axhline(goal, color="0.4", lw=0.8, ls="--")
            axis.annotate(
                f"goal, {name}", (numbers["samples"][len(numbers["samples"]) // 2], goal), va="bottom", fontsize=7
            )
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel("fixated arm postures learned from")
        axis.set_ylabel("gaze RMSE on 700 others (°)")
        axis.set_title("Forward model arm → gaze, taught by babbling (J Fig 2)", fontsize=10)
        axis.legend(fontsize=8, loc="upper right", bbox_to_anchor=(0.99, 0.5))
        axis.grid(alpha=0.25, which="both")
        return figure
