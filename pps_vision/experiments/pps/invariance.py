"""One map for all postures and modalities: does what was learned in one hold in the others?

Postures: the paths of trials are carried along with the forearm into other postures of torso, arm and head.  Without
errors nothing should change; with R's five sources of error the mistake depends on the posture.
Modalities: double touch known by the joints (motor) or seen (visual), and objects seen; learned from one, tested
on each.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from control.fixation import gaze_at
from learning.pps.memory import MemoryParams
from learning.pps.scores import auroc, brier
from learning.pps.touch_trial import TouchTrial
from pps_vision.experiments.pps.count_table import CountTable
from pps_vision.experiments.pps.errors import Belief, ErrorSources, only
from pps_vision.experiments.pps.held_out import Approach, approaches, at_horizon, known_trials, of_part, samples
from pps_vision.experiments.pps.touch_movements import Condition
from pps_vision.experiments.pps.touch_trials import touch_trials
from pps_vision.experiments.study import Study
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import icub_skin

POSTURES, TRIALS = 50, 53
PART = "left_forearm"
_MODALITIES: dict[Condition, int] = {"motor": 45, "visual": 45, "inner": 53}
_LABELS = {"motor": "double touch,\nfelt", "visual": "double touch,\nseen", "inner": "objects,\nseen"}
_SWING_RAD = {"torso": np.deg2rad(10.0), "neck": np.deg2rad(12.0), "arm": np.deg2rad(25.0)}


@dataclass(frozen=True)
class Invariance(Study):
    """AUROC and Brier score 0.15 s before the end, of R's map, across postures and across modalities."""

    seed: int = 0
    """Seed of trials, postures and errors."""
    robots: int = 2
    """Robots that err."""
    trials: Path = Path("build") / "pps"
    """Folder that keeps rendered trials."""

    def run(self) -> dict[str, Any]:
        """Scores by posture and by modality."""
        return {"seed": self.seed, "postures": self._postures(), "modalities": self._modalities()}

    def _postures(self) -> dict[str, Any]:
        """Learned at home or in other postures, tested at home and in 50 others; without and with errors."""
        rng = np.random.default_rng(self.seed)
        robot = load_icub()
        lessons = known_trials("inner", TRIALS, self.seed)
        tests = known_trials("inner", POSTURES, self.seed + 1)
        told = {
            "home": (lessons, tests),
            "others": tuple(tuple(carried(t, robot, rng) for t in trials) for trials in (lessons, tests)),
        }
        erring = [Belief.draw(ErrorSources(), icub_skin(), rng) for _ in range(self.robots)]
        found = {}
        for name, beliefs in {"no errors": [Belief.draw(only(), icub_skin(), rng)], "five sources": erring}.items():
            lives = [
                {where: [_lived(belief, trials, rng) for trials in sets] for where, sets in told.items()}
                for belief in beliefs
            ]
            for learned_at, tested_at in (("home", "home"), ("home", "others"), ("others", "others")):
                scores = [_scores(life[learned_at][0], life[tested_at][1]) for life in lives]
                found[f"{name}: learned {learned_at}, tested {tested_at}"] = _mean(scores)
        return found

    def _modalities(self) -> dict[str, dict[str, Any]]:
        """Learned from the first two thirds of one modality's trials, tested on the last third of each."""
        whole = icub_skin()
        sets: dict[str, tuple[Approach, ...]] = {}
        for condition, n in _MODALITIES.items():
            blind = condition == "motor"
            trials = touch_trials(condition, n, self.seed, not blind, None if blind else self.trials)
            sets[condition] = approaches(trials, load_icub(), of_part(whole, PART), whole)
        split = {name: 2 * len(trials) // 3 for name, trials in sets.items()}
        return {
            taught: {tested: _scores(sets[taught][: split[taught]], sets[tested][split[tested] :]) for tested in sets}
            for taught in sets
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Left: postures; middle and right: modalities."""
        figure, axes = plt.subplots(1, 3, figsize=(14.5, 4.4), width_ratios=(1.5, 1, 1), layout="constrained")
        _postures(axes[0], numbers["postures"])
        for axis, key, label in zip(axes[1:], ("auroc", "brier"), ("AUROC", "Brier score"), strict=True):
            _matrix(axis, numbers["modalities"], key, label)
        return figure


def carried(trial: TouchTrial, robot: Robot, rng: np.random.Generator) -> TouchTrial:
    """The same approach to the forearm with torso, left arm and head in a random other posture, eyes on it."""
    q_home = trial.joints_rad[0]
    swing = np.zeros(robot.n_joints)
    for joints, most in (
        (("torso_yaw", "torso_roll", "torso_pitch"), _SWING_RAD["torso"]),
        (("neck_pitch", "neck_roll", "neck_yaw"), _SWING_RAD["neck"]),
        (robot.names.arm("left"), _SWING_RAD["arm"]),
    ):
        swing[robot.indices(joints)] = most
    q = robot.clamp(q_home + rng.uniform(-swing, swing))
    T = robot.at(q).T_root(PART) @ inverse(robot.at(q_home).T_root(PART))
    path = move_points(T, trial.positions)
    joints_rad = np.tile(gaze_at(robot, q, path[len(path) // 2]), (len(path), 1))
    R = T[:3, :3]
    covs = R @ trial.velocity_covs @ R.T
    return replace(trial, joints_rad=joints_rad, positions=path, velocities=trial.velocities @ R.T, velocity_covs=covs)


def _lived(belief: Belief, trials: Sequence[TouchTrial], rng: np.random.Generator) -> tuple[Approach, ...]:
    told = [belief.tells(trial, True, rng) for trial in trials]
    return approaches(told, belief.robot, of_part(belief.skin, PART), belief.skin)


def _scores(taught: Sequence[Approach], tested: Sequence[Approach]) -> dict[str, float]:
    D, TTC, touched = at_horizon(tested)
    p = CountTable(MemoryParams()).fit(*samples(taught))(D, TTC)
    return {"auroc": auroc(touched, p), "brier": brier(touched, p)}


def _mean(scores: list[dict[str, float]]) -> dict[str, float]:
    return {key: float(np.mean([one[key] for one in scores])) for key in scores[0]}


def _postures(axis: Axes, postures: dict[str, Any]) -> None:
    for y, (name, of) in enumerate(reversed(postures.items())):
        color = "0.55" if name.startswith("no errors") else "tab:blue"
        axis.barh(y, of["auroc"], color=color, height=0.6)
        axis.annotate(f"{of['auroc']:.3f}, Brier {of['brier']:.3f}", (0.51, y), va="center", fontsize=8, color="white")
    axis.set_yticks(range(len(postures)), [name.replace(": ", "\n") for name in reversed(postures)], fontsize=8)
    axis.set_xlim(0.5, 1)
    axis.set_xlabel(f"AUROC ({POSTURES} other postures of torso, arm, head)")
    axis.grid(alpha=0.25, axis="x")


def _matrix(axis: Axes, modalities: dict[str, Any], key: str, label: str) -> None:
    names = list(modalities)
    values = np.array([[modalities[taught][tested][key] for tested in names] for taught in names])
    good = (0.5, 1.0, "Blues") if key == "auroc" else (0.05, 0.3, "Blues_r")
    axis.imshow(values, vmin=good[0], vmax=good[1] + 0.2 * (good[1] - good[0]), cmap=good[2])
    for (row, column), value in np.ndenumerate(values):
        axis.annotate(f"{value:.3f}", (column, row), ha="center", va="center", fontsize=9)
    axis.set_xticks(range(len(names)), [_LABELS[name] for name in names], fontsize=8)
    axis.set_yticks(range(len(names)), [_LABELS[name] for name in names], fontsize=8)
    axis.set_xlabel("tested on")
    axis.set_ylabel("learned from")
    axis.set_title(label, fontsize=10)
