"""One map for all postures and modalities: does what was learned in one hold in the others?"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from control.fixation import gaze_at
from learning.pps.trials import TouchTrial
from pps_vision.experiments.charts import bars, panels
from pps_vision.experiments.pps.movements import TRIALS, SessionName
from pps_vision.experiments.pps.perceived import FOREARM, in_taxel_frames
from pps_vision.experiments.pps.predictors import Trials, by_map, scored
from pps_vision.experiments.pps.robot_errors import ErringRobot, ErrorSources, only
from pps_vision.experiments.pps.trials import SessionStudy, exact_trials
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot

POSTURES = 50
MODALITIES: dict[SessionName, str] = {"motor": "finger, felt", "visual": "finger, seen", "inner": "objects, seen"}
_TRIALS: dict[SessionName, int] = {"motor": 45, "visual": 45, "inner": 53}
_RANGE_RAD = {"torso": np.deg2rad(10.0), "neck": np.deg2rad(12.0), "arm": np.deg2rad(25.0)}


@dataclass(frozen=True)
class Invariance(SessionStudy):
    """AUROC of R's map 0.15 s before the touch, trained in one posture or modality and tested in others.

    Postures: paths carried along with the forearm into 50 postures of torso, arm and head. Without model errors nothing
    changes by construction; with R's errors the error depends on the posture.
    Modalities: double touch felt or seen, and objects seen; two thirds of the trials train, the last third tests.
    """

    n: int = 2
    """Robots that err."""

    def run(self) -> dict[str, Any]:
        """Return the scores by posture and by modality."""
        return {"postures": self._postures(), "modalities": self._modalities()}

    def _postures(self) -> dict[str, Any]:
        rng = np.random.default_rng(self.seed)
        model = load_icub()
        training = exact_trials("inner", self.size(TRIALS["inner"]), self.seed)
        test = exact_trials("inner", self.size(POSTURES), self.seed + 1)
        at_home = (training, test)
        elsewhere = tuple(tuple(in_other_posture(t, model, rng) for t in trials) for trials in at_home)
        robots = {
            "no errors": [ErringRobot.draw(only(), rng)],
            "R's errors": [ErringRobot.draw(ErrorSources(), rng) for _ in range(self.n)],
        }
        found: dict[str, Any] = {}
        for name, some in robots.items():
            sets = [[[_perceived(r, t, rng) for t in where] for where in (at_home, elsewhere)] for r in some]
            found[name] = {
                "home → home": scored(by_map, [(home[0], home[1]) for home, _ in sets]),
                "home → others": scored(by_map, [(home[0], others[1]) for home, others in sets]),
                "others → others": scored(by_map, [(others[0], others[1]) for _, others in sets]),
            }
        return found

    def _modalities(self) -> dict[str, Any]:
        sets = {}
        for name, n in _TRIALS.items():
            perceived = in_taxel_frames(self.seen(name, n))
            k = 2 * len(perceived) // 3
            sets[name] = perceived[:k], perceived[k:]
        return {
            a: {b: scored(by_map, [(training, test)]) for b, (_, test) in sets.items()}
            for a, (training, _) in sets.items()
        }

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw AUROC by posture and by modality."""
        postures, (axis,) = panels(1, width=5.6)
        of = numbers["postures"]
        groups = list(next(iter(of.values())))
        bars(axis, groups, {name: [row[g]["auroc"] for g in groups] for name, row in of.items()}, "AUROC")
        axis.set(ylim=(0.5, 1), xlabel="trained in → tested in")
        axis.legend(fontsize=8)
        modalities, (axis,) = panels(1, width=5.6)
        rows = {
            f"trained on: {MODALITIES[a]}": [of[b]["auroc"] for b in MODALITIES]
            for a, of in numbers["modalities"].items()
        }
        bars(axis, list(MODALITIES.values()), rows, "AUROC")
        axis.set(ylim=(0.5, 1), xlabel="tested on")
        axis.legend(fontsize=8)
        return {"postures": postures, "modalities": modalities}


def in_other_posture(trial: TouchTrial, robot: Robot, rng: np.random.Generator) -> TouchTrial:
    """Return the same approach to the forearm with torso, left arm and head in a random posture, the eyes on it."""
    q_home = trial.joints_rad[0]
    spread = np.zeros(robot.n_joints)
    for joints, range_rad in (
        (("torso_yaw", "torso_roll", "torso_pitch"), _RANGE_RAD["torso"]),
        (("neck_pitch", "neck_roll", "neck_yaw"), _RANGE_RAD["neck"]),
        (robot.names.arm("left"), _RANGE_RAD["arm"]),
    ):
        spread[robot.indices(joints)] = range_rad
    q = robot.clamp(q_home + rng.uniform(-spread, spread))
    T = robot.at(q).T_root(FOREARM) @ inverse(robot.at(q_home).T_root(FOREARM))
    path, R = move_points(T, trial.positions), T[:3, :3]
    joints_rad = np.tile(gaze_at(robot, q, path[len(path) // 2]), (len(path), 1))
    covs = R @ trial.velocity_covs @ R.T
    return replace(trial, joints_rad=joints_rad, positions=path, velocities=trial.velocities @ R.T, velocity_covs=covs)


def _perceived(robot: ErringRobot, trials: tuple[TouchTrial, ...], rng: np.random.Generator) -> Trials:
    """Trials as a robot observes and perceives them."""
    return in_taxel_frames([robot.observe(trial, True, rng) for trial in trials], robot.model, robot.skin)
