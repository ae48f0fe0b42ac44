"""Forward model of robots that are no chain of ideal joints: what the structure leaves and what the process learns."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from learning.reach.babbling import Babbled, random_arms
from learning.reach.forward_model import RevoluteArm
from pps_vision.experiments.baselines.regressors import ArmToGaze, gaussian_process
from pps_vision.experiments.reach.map_truth import first, gaze_rmse_deg
from pps_vision.experiments.study import SampledStudy, interval
from pps_vision.experiments.tables import Table, estimate
from pps_vision.experiments.timing import timed
from pps_vision.robot.chain import Chain
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.icub import load_icub
from pps_vision.robot.inverse_kinematics import IKParams, solve_ik
from pps_vision.types import Array

_N_TEST, _FIXATED = 700, 0.2  # less than the share of arm postures that can be fixated
_ROBOT, _LIMITS = load_icub(), GazeLimits()
_ARM = _ROBOT.chain(_ROBOT.names.arm("right")[:4], "right_palm")
_SAG_RAD, _LEVER_M = np.deg2rad(2), 0.05
_TEETH, _GEAR_RAD = 8, np.deg2rad(0.5)
_TALK = 0.015
_TILT_RAD = np.deg2rad(5)
_FINE = IKParams(tolerance=1e-9, max_steps=40)
_H = 1e-6  # rad, of differences

Bend = Callable[[Array], Array]
"""Encoders (N, 4) rad to the joints that the arm has with them."""


def sag(q: Array) -> Array:
    """Return joints that gravity turns by up to 2°, nearly that at a hand 5 cm to the side of the joint."""
    levers = _ARM.positions(q)[1][:, 2]  # ∂height/∂joint: the torque of a weight in the hand
    return np.asarray(q - _SAG_RAD * np.tanh(levers / _LEVER_M))


def gear(q: Array) -> Array:
    """Return joints behind gears with an error of 0.5° eight times a turn."""
    return q + _GEAR_RAD * np.sin(_TEETH * q)


def cross_talk(q: Array) -> Array:
    """Return joints that each move with 1.5 % of the next, and with 1.5 % of its square."""
    following = np.roll(q, -1, axis=1)
    return q + _TALK * (following + following**2)


def head(yaw_first: bool = False, tilt_rad: float = 0.0) -> GazeModel:
    """Return the iCub's head with its neck's axes exchanged, or its yaw axis tilted sideways."""
    model = GazeModel(_ROBOT)
    for name in ("_left", "_right"):
        eye: Chain = getattr(model, name)
        tilt = Rotation.from_rotvec(tilt_rad * eye.T_root_frame[:3, 2]).as_matrix()
        v, w = eye.screws[0, :3], eye.screws[0, 3:]
        turned = tilt @ w
        screws = np.concatenate([[[*np.cross(np.cross(w, v), turned), *turned]], eye.screws[1:]])
        setattr(model, name, replace(eye, screws=screws, order=(0, 1, 2) if yaw_first else eye.order))
    return model


DEVIATIONS: dict[str, tuple[Bend, GazeModel]] = {
    "none": (lambda q: q, head()),
    "sag of up to 2°": (sag, head()),
    "gears, 0.5° sin 8q": (gear, head()),
    "cross-talk, 1.5 %": (cross_talk, head()),
    "neck yaw below pitch": (lambda q: q, head(yaw_first=True)),
    "neck yaw axis tilted by 5°": (lambda q: q, head(tilt_rad=_TILT_RAD)),
    "sag, gears, cross-talk, neck exchanged and tilted": (
        lambda q: sag(gear(cross_talk(q))),
        head(yaw_first=True, tilt_rad=_TILT_RAD),
    ),
}
NOISES_DEG = (0.0, 1.0)


def samples(deviation: str, n: int, rng: np.random.Generator) -> Babbled:
    """Return what `n` postures of a robot with a deviation teach: encoders of the arm and gaze."""
    bend, eyes = DEVIATIONS[deviation]
    arm = random_arms(n, rng)
    hand = _ARM.positions(bend(arm))[0]

    def fixated(gaze: Array) -> tuple[Array, Array]:
        here, *there = eyes.points(np.concatenate([gaze, *(gaze + _H * axis for axis in np.eye(3))])).reshape(4, -1, 3)
        return here, np.stack([(moved - here) / _H for moved in there], axis=2)

    starts = np.clip(np.nan_to_num(GazeModel(_ROBOT).gaze(hand), nan=0.5), _LIMITS.lower, _LIMITS.upper)[None]
    found = solve_ik(fixated, hand, starts, _LIMITS.lower, _LIMITS.upper, _FINE)
    return Babbled(arm[found.converged], found.q_rad[found.converged], n)


METHODS: dict[str, Callable[[], RevoluteArm | ArmToGaze]] = {
    "structure and process (default)": RevoluteArm,
    "structure alone": lambda: RevoluteArm(corrected=False),
    "Gaussian process alone": lambda: ArmToGaze(gaussian_process()),
}


def judge(method: str, train: Babbled, test: Babbled) -> dict[str, float]:
    """Return the RMSE over gaze angles (°), and the processor time of learning (s)."""
    model = METHODS[method]()
    _, learning_ms = timed(partial(model.learn, train.arm_rad, train.gaze_rad))
    _, fitting_ms = timed(partial(model, test.arm_rad[:1]))
    return {"rmse_deg": gaze_rmse_deg(model, test)[0], "seconds": (learning_ms + fitting_ms) / 1000}


@dataclass(frozen=True)
class Deviations(SampledStudy):
    """Gaze RMSE of the forward model on robots that are no chain of ideal joints, with exact and with noisy fixation.

    None of the deviations but the neck's order is in the class of the structure, and none in that of the process.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"samples": 200}

    n: int = 3
    """Sets of babbled postures."""
    samples: int = 4400
    """Fixated postures learned from (J's number)."""

    def run(self) -> dict[str, Any]:
        """Return by noise, deviation and method the RMSE (°) with its interval, and the median time of learning (s)."""
        return {
            "noises": {
                f"{noise:g}": {
                    deviation: self._measure(deviation, noise)
                    for deviation in tqdm(DEVIATIONS, desc=f"noise {noise:g}°", disable=None)
                }
                for noise in NOISES_DEG
            }
        }

    def _measure(self, deviation: str, noise_deg: float) -> dict[str, Any]:
        rows: dict[str, list[dict[str, float]]] = {method: [] for method in METHODS}
        for seed in self.seeds:
            rng = np.random.default_rng(seed)
            train, test = (first(samples(deviation, int(n / _FIXATED), rng), n) for n in (self.samples, _N_TEST))
            noise = np.deg2rad(noise_deg) * rng.standard_normal(train.gaze_rad.shape)
            seen = replace(train, gaze_rad=np.clip(train.gaze_rad + noise, _LIMITS.lower, _LIMITS.upper))
            for method, found in rows.items():
                found.append(judge(method, seen, test))
        return {
            method: {
                "rmse_deg": interval([[row["rmse_deg"]] for row in found]),
                "seconds": float(np.median([row["seconds"] for row in found])),
            }
            for method, found in rows.items()
        }

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the errors by deviation."""
        rows = [
            [
                f"{deviation}; noise {noise}°",
                *(estimate(of[method]["rmse_deg"], 2) for method in METHODS),
                f"{of['structure and process (default)']['seconds']:.2g}",
            ]
            for noise, deviations in numbers["noises"].items()
            for deviation, of in deviations.items()
        ]
        return {"": Table(["gaze RMSE (°) of 700 postures", *METHODS, "learning (s)"], rows)}
