"""Where babbling breaks: one fault at a time, from mild to hopeless, and the forward model it teaches."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.babbling import Babbled, score
from learning.reach.gaussian_process import GaussianProcess
from learning.reach.turning_joints import TurningJoints
from pps_vision.experiments.baselines.regressors import ArmToGaze, LocalModels
from pps_vision.experiments.chart import panels
from pps_vision.experiments.reach.forward_model import LWPR_OF_THE_ARM, Model, babbled_sets
from pps_vision.experiments.study import Study
from pps_vision.robot.gaze import GazeLimits
from pps_vision.types import Array

_N_TRAIN, _BREAKS_DEG = 1500, 3.0
_LEAST_DEG = 1e-3  # what is less is drawn as that
_COLORS = ("tab:blue", "tab:green", "tab:orange")
_ELBOW, _STUCK_RAD = 3, np.deg2rad(60)

Fault = Callable[[Babbled, float, np.random.Generator], Babbled]


def _noise(babbled: Babbled, sigma_deg: float, rng: np.random.Generator) -> Babbled:
    noise = np.deg2rad(sigma_deg) * rng.standard_normal(babbled.gaze_rad.shape)
    gaze = np.clip(babbled.gaze_rad + noise, *_gaze_range())
    return Babbled(babbled.arm_rad, gaze, babbled.n_tried)


def _something_else(babbled: Babbled, percent: float, rng: np.random.Generator) -> Babbled:
    wrong = rng.random(len(babbled.gaze_rad)) < percent / 100
    gaze = np.where(wrong[:, None], rng.uniform(*_gaze_range(), babbled.gaze_rad.shape), babbled.gaze_rad)
    return Babbled(babbled.arm_rad, gaze, babbled.n_tried)


def _offset(babbled: Babbled, degrees: float, rng: np.random.Generator) -> Babbled:
    return Babbled(babbled.arm_rad + np.deg2rad(degrees) * np.eye(4)[_ELBOW], babbled.gaze_rad, babbled.n_tried)


def _stuck(babbled: Babbled, percent: float, rng: np.random.Generator) -> Babbled:
    arm = babbled.arm_rad.copy()
    arm[rng.random(len(arm)) < percent / 100, _ELBOW] = _STUCK_RAD
    return Babbled(arm, babbled.gaze_rad, babbled.n_tried)


def _fewer(babbled: Babbled, n: float, rng: np.random.Generator) -> Babbled:
    return Babbled(babbled.arm_rad[: int(n)], babbled.gaze_rad[: int(n)], babbled.n_tried)


def _gaze_range() -> tuple[Array, Array]:
    limits = GazeLimits()
    return limits.lower, limits.upper


CASES: dict[str, tuple[str, tuple[float, ...], Fault]] = {
    "fixation noise": ("σ (°)", (0, 0.03, 0.1, 0.3, 1, 3), _noise),
    "something else fixated": ("share (%)", (0, 0.5, 2, 5, 10, 25), _something_else),
    "elbow read wrongly": ("by (°)", (0, 0.5, 1, 2, 5, 10), _offset),
    "elbow's encoder stuck": ("share of samples (%)", (0, 2, 5, 10, 25, 100), _stuck),
    "fewer samples": ("samples", (1500, 800, 400, 200, 100, 50), _fewer),
}
METHODS: dict[str, Callable[[], Model]] = {
    "turning joints": TurningJoints,
    "Gaussian process": lambda: ArmToGaze(GaussianProcess(n_tune=300)),
    "LWPR, each sample once": lambda: ArmToGaze(LocalModels(4, 3, LWPR_OF_THE_ARM)),
}


@dataclass(frozen=True)
class BabblingFailures(Study):
    """1500 fixated postures with one fault, judged on 700 without."""

    seed: int = 0
    """Seed of the babbling and of the faults."""

    def run(self) -> dict[str, Any]:
        """By fault, by method: RMSE in degrees over what is answered, the share that is not, where it breaks."""
        train, test = babbled_sets(self.seed)
        train = Babbled(train.arm_rad[:_N_TRAIN], train.gaze_rad[:_N_TRAIN], train.n_tried)
        cases = {
            name: {
                "axis": axis,
                "severities": list(severities),
                "methods": {
                    method: self._judge(
                        make, [fault(train, value, self._rng()) for value in severities], test, severities
                    )
                    for method, make in METHODS.items()
                },
            }
            for name, (axis, severities, fault) in tqdm(CASES.items(), desc="faults", disable=None)
        }
        return {"criterion": f"breaks: RMSE above {_BREAKS_DEG:g}° or more than 1 % unanswered", "cases": cases}

    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(self.seed + 1)

    def _judge(
        self,
        make: Callable[[], Model],
        sets: list[Babbled],
        test: Babbled,
        severities: tuple[float, ...],
    ) -> dict[str, Any]:
        errors, unanswered = [], []
        for babbled in sets:
            model = make()
            model.learn(babbled.arm_rad, babbled.gaze_rad)
            error, silent = score(model, test)
            errors.append(round(error, 4) if np.isfinite(error) else None)
            unanswered.append(round(silent, 4))
        bad = [e is None or e > _BREAKS_DEG or u > 0.01 for e, u in zip(errors, unanswered, strict=True)]
        return {
            "rmse_deg": errors,
            "unanswered": unanswered,
            "breaks_at": severities[bad.index(True)] if True in bad else None,
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Error over severity, one panel a fault; × where it breaks."""
        figure, axes = panels(len(numbers["cases"]), 3.1, 3.4)
        for axis, (name, case) in zip(axes, numbers["cases"].items(), strict=True):
            places = np.arange(len(case["severities"]))
            for color, (method, found) in zip(_COLORS, case["methods"].items(), strict=True):
                error = np.maximum(np.array(found["rmse_deg"], dtype=float), _LEAST_DEG)
                axis.plot(places, error, "o-", color=color, ms=4, label=method)
                if found["breaks_at"] is not None:
                    k = case["severities"].index(found["breaks_at"])
                    axis.plot(places[k], error[k], "x", color=color, ms=11, mew=2)
            axis.axhline(_BREAKS_DEG, color="0.4", lw=0.8, ls="--")
            axis.set_xticks(places, [f"{value:g}" for value in case["severities"]])
            axis.set_yscale("log")
            axis.set_ylim(0.7 * _LEAST_DEG, 60)
            axis.set_xlabel(case["axis"], fontsize=9)
            axis.set_title(name, fontsize=10)
            axis.grid(alpha=0.25)
        axes[0].set_ylabel(f"gaze RMSE (°; {_LEAST_DEG:g}: that or less)")
        axes[0].legend(fontsize=7)
        return figure
