"""Forward models arm → gaze, also of robots that are no chain of ideal joints."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar
from xml.etree import ElementTree

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from learning.reach.babbling import random_arms
from pps_vision.experiments import charts
from pps_vision.experiments.babbling import Babbled, babble
from pps_vision.experiments.baselines import jamone
from pps_vision.experiments.baselines.lwpr import LWPR
from pps_vision.experiments.baselines.regressors import ArmToGaze, ForwardModel, gaussian_process, quintic_spline
from pps_vision.experiments.baselines.revolute_arm import RevoluteArm
from pps_vision.experiments.reach_truth import N_TEST, first, gaze_rmse_deg
from pps_vision.experiments.study import Part, PartsStudy, SampledStudy, interval
from pps_vision.experiments.tables import Table, judged
from pps_vision.robot.chain import Chain
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.icub import load_icub
from pps_vision.robot.inverse_kinematics import IKParams, solve_ik
from pps_vision.robot.model import Robot
from pps_vision.types import Array

_N_TRIED = 20_000
_N_FIXATED_OF_J = 4400
MODELS: dict[str, Callable[[], ForwardModel]] = {
    "model of revolute joints": RevoluteArm,
    "Gaussian process": lambda: ArmToGaze(gaussian_process()),
    "LWPR, each sample once": lambda: ArmToGaze(LWPR(4, 3, jamone.ARM_PARAMS)),
    "quintic spline (SciPy)": lambda: ArmToGaze(quintic_spline()),
}


def _forward_model(study: "ReachKinematics") -> dict[str, Any]:
    """Return by model and number of samples the RMSE (°) on 700 other postures, with 95 % over sets of postures."""
    robot = load_icub()
    errors: dict[str, list[list[list[float]]]] = {name: [[] for _ in study.sizes] for name in MODELS}
    for seed in tqdm(study.seeds, desc="sets of postures", disable=None):
        rng = np.random.default_rng(seed)
        train = babble(robot, _N_TRIED, rng)
        test = first(babble(robot, 4 * N_TEST, rng), N_TEST)
        for name, make in MODELS.items():
            model = make()
            for units, low, high in zip(errors[name], (0, *study.sizes[:-1]), study.sizes, strict=True):
                model.learn(train.arm_rad[low:high], train.gaze_rad[low:high])
                units.append([gaze_rmse_deg(model, test)[0]])
    models = {name: [{"rmse_deg": interval(units)} for units in sizes] for name, sizes in errors.items()}
    return {"samples": study.sizes, "methods": models}


def _forward_model_chart(numbers: dict[str, Any]) -> Figure:
    """Draw the error over samples (J Fig 2)."""
    figure, (axis,) = charts.panels(1, width=charts.PAGE_IN, height=3.6)
    series = {name: [row["rmse_deg"] for row in rows] for name, rows in numbers["methods"].items()}
    charts.curves(axis, numbers["samples"], series, "fixated postures learned from", "gaze RMSE (°)")
    axis.plot(_N_FIXATED_OF_J, jamone.PUBLISHED["forward_model_deg"], "k*", ms=10, label="J's LWPR")
    axis.set(xscale="log", yscale="log", title="arm → gaze, learned by babbling (J Fig 2)")
    axis.legend(fontsize=7)
    return figure


NOISES_DEG = (0.0, 1.0)
_MIN_FIXATED = 0.2  # lower bound of the share of arm postures that can be fixated
_LIMITS = GazeLimits()
_SAG_RAD = np.deg2rad(2)
_LEVER_M = 0.05
_TEETH = 8
_GEAR_RAD = np.deg2rad(0.5)
_CROSS_TALK = 0.015
_TILT_RAD = np.deg2rad(5)
_PRECISE = IKParams(tolerance=1e-9, max_steps=40)
_H = 1e-6  # rad, of finite differences

Bend = Callable[[Chain, Array], Array]  # arm and encoders (N, 4) rad to the true joint angles


def _ideal(_: Chain, q: Array) -> Array:
    return q


def _sag(arm: Chain, q: Array) -> Array:
    """Gravity turns the joints by up to 2°, nearly that with the hand 5 cm to the side of the joint."""
    levers = arm.positions(q)[1][:, 2]  # ∂height/∂joint: torque of a weight in the hand
    return np.asarray(q - _SAG_RAD * np.tanh(levers / _LEVER_M))


def _gears(_: Chain, q: Array) -> Array:
    """Gears err by 0.5° eight times per turn."""
    return q + _GEAR_RAD * np.sin(_TEETH * q)


def _cross_talk(_: Chain, q: Array) -> Array:
    """Each joint moves with 1.5 % of the next one, and with 1.5 % of its square."""
    following = np.roll(q, -1, axis=1)
    return q + _CROSS_TALK * (following + following**2)


def _head(yaw_first: bool = False, tilt_rad: float = 0.0) -> GazeModel:
    """The iCub's head with its neck's axes exchanged, or its yaw axis tilted sideways."""
    model = GazeModel(load_icub())
    for name in ("_left", "_right"):
        eye: Chain = getattr(model, name)
        tilt = Rotation.from_rotvec(tilt_rad * eye.T_root_frame[:3, 2]).as_matrix()
        v, w = np.split(eye.screws[0], 2)
        tilted = tilt @ w
        screws = np.concatenate([[[*np.cross(np.cross(w, v), tilted), *tilted]], eye.screws[1:]])
        setattr(model, name, replace(eye, screws=screws, order=(0, 1, 2) if yaw_first else eye.order))
    return model


DEVIATIONS: dict[str, tuple[Bend, Callable[[], GazeModel]]] = {
    "none": (_ideal, _head),
    "sag of up to 2°": (_sag, _head),
    "gears, 0.5° sin 8q": (_gears, _head),
    "cross-talk, 1.5 %": (_cross_talk, _head),
    "neck yaw below pitch": (_ideal, partial(_head, yaw_first=True)),
    "neck yaw axis tilted by 5°": (_ideal, partial(_head, tilt_rad=_TILT_RAD)),
    "all of these": (
        lambda arm, q: _sag(arm, _gears(arm, _cross_talk(arm, q))),
        partial(_head, yaw_first=True, tilt_rad=_TILT_RAD),
    ),
}
_STRUCTURES: dict[str, Callable[[], ForwardModel]] = {
    "structure and process (default)": RevoluteArm,
    "structure alone": partial(RevoluteArm, corrected=False),
    "Gaussian process alone": lambda: ArmToGaze(gaussian_process()),
}


def samples(deviation: str, n: int, rng: np.random.Generator) -> Babbled:
    """Return encoders of the arm and gaze of up to `n` fixated postures of a robot with a deviation."""
    bend, make_head = DEVIATIONS[deviation]
    return _samples(load_icub(), bend, make_head(), n, rng)


def _samples(robot: Robot, bend: Bend, head: GazeModel, n: int, rng: np.random.Generator) -> Babbled:
    chain = robot.chain(robot.names.arm("right")[:4], "right_palm")
    arm = random_arms(n, rng)
    hand = chain.positions(bend(chain, arm))[0]

    def fixated(gaze: Array) -> tuple[Array, Array]:
        shifted = np.concatenate([gaze, *(gaze + _H * axis for axis in np.eye(3))])
        point, *moved = head.points(shifted).reshape(4, -1, 3)
        return point, (np.stack(moved, axis=2) - point[:, :, None]) / _H

    starts = np.clip(np.nan_to_num(GazeModel(load_icub()).gaze(hand), nan=0.5), _LIMITS.lower, _LIMITS.upper)[None]
    solution = solve_ik(fixated, hand, starts, _LIMITS.lower, _LIMITS.upper, _PRECISE)
    return Babbled(arm[solution.converged], solution.q_rad[solution.converged], n)


def _deviations(study: "ReachKinematics") -> dict[str, Any]:
    """Return by noise, deviation and model the RMSE (°) with its interval.

    Of the deviations only the order of the neck's axes is in the class of the structure, and none in that of the
    process.
    """
    noises: dict[str, dict[str, Any]] = {f"{noise_deg:g}": {} for noise_deg in NOISES_DEG}
    for noise_deg, deviation in tqdm(list(product(NOISES_DEG, DEVIATIONS)), desc="deviations", disable=None):
        errors: dict[str, list[list[float]]] = {model: [] for model in _STRUCTURES}
        for seed in study.seeds:
            rng = np.random.default_rng(seed)
            train, test = (first(samples(deviation, int(n / _MIN_FIXATED), rng), n) for n in (study.sizes[-1], N_TEST))
            noise = np.deg2rad(noise_deg) * rng.standard_normal(train.gaze_rad.shape)
            gaze = np.clip(train.gaze_rad + noise, _LIMITS.lower, _LIMITS.upper)
            for name, make in _STRUCTURES.items():
                model = make()
                model.learn(train.arm_rad, gaze)
                errors[name].append([gaze_rmse_deg(model, test)[0]])
        noises[f"{noise_deg:g}"][deviation] = {name: {"rmse_deg": interval(e)} for name, e in errors.items()}
    return {"noises": noises}


def _deviations_table(numbers: dict[str, Any]) -> Table:
    """Return the errors by deviation without noise, and of the default with noise."""
    exact, noisy = numbers["noises"].values()
    default = next(iter(_STRUCTURES))
    rows = []
    for deviation, models in exact.items():
        errors = [models[name]["rmse_deg"][0] for name in _STRUCTURES] + [noisy[deviation][default]["rmse_deg"][0]]
        rows.append([deviation, *(f"{error:.2g}" for error in errors)])
    noise = list(numbers["noises"])[1]
    return Table(["gaze RMSE (°)", *_STRUCTURES, f"default, noise {noise}°"], rows)


def _other_robot(tilt_rad: float, rng: np.random.Generator) -> tuple[Robot, GazeModel]:
    """An iCub whose arm's links are 0.75 to 1.3 times as long, each joint turned by 2° (standard deviation), and whose
    eyes are 0.8 to 1.3 times as far apart, each panning about an axis tilted by `tilt_rad` (the same)."""
    tree = ElementTree.fromstring((files("pps_vision.robot") / "icub.urdf").read_text())
    for joint in tree.iter("joint"):
        origin = joint.find("origin")
        if origin is not None and joint.get("name", "").startswith("right_") and "eye" not in joint.get("name", ""):
            xyz, rpy = (np.array(origin.get(name, "0 0 0").split(), dtype=float) for name in ("xyz", "rpy"))
            origin.set("xyz", " ".join(map(repr, (xyz * rng.uniform(0.75, 1.3)).tolist())))
            origin.set("rpy", " ".join(map(repr, (rpy + np.deg2rad(2) * rng.standard_normal(3)).tolist())))
    with TemporaryDirectory() as folder:
        urdf = Path(folder) / "other.urdf"
        urdf.write_bytes(ElementTree.tostring(tree))
        robot = Robot(urdf)
    head = GazeModel(robot)
    left, right = (getattr(head, name).T_root_frame[:3, 3] for name in ("_left", "_right"))
    apart = rng.uniform(0.8, 1.3) * (left - right) / 2
    for name, shift in (("_left", apart), ("_right", -apart)):
        eye: Chain = getattr(head, name)
        T = eye.T_root_frame.copy()
        T[:3, 3] = (left + right) / 2 + shift
        axis = Rotation.from_rotvec(tilt_rad * rng.standard_normal(3)).apply(eye.screws[2, 3:])
        screws = np.vstack([eye.screws[:2], [*np.cross(T[:3, 3], axis), *axis]])
        setattr(head, name, replace(eye, T_root_frame=T, screws=screws))
    return robot, head


_OF_OTHERS: dict[str, tuple[Bend, float]] = {
    "sag of up to 2°": (_sag, 0.0),
    "eyes' axes tilted by 3°": (_ideal, np.deg2rad(3)),
    "gears, 0.5° sin 8q": (_gears, 0.0),
    "cross-talk, 1.5 %": (_cross_talk, 0.0),
}
_GOAL_DEG = 0.05


def _other_robots(study: "ReachKinematics") -> dict[str, Any]:
    """Return by deviation and model the RMSE (°) on each of five robots of other links and eyes, without noise."""
    errors: dict[str, dict[str, list[float]]] = {deviation: {} for deviation in _OF_OTHERS}
    cells = list(product(_OF_OTHERS, range(study.seed, study.seed + study.robots)))
    for deviation, seed in tqdm(cells, desc="other robots", disable=None):
        bend, tilt_rad = _OF_OTHERS[deviation]
        rng = np.random.default_rng(seed)
        robot, head = _other_robot(tilt_rad, rng)
        n = study.sizes[-1]
        train, test = (first(_samples(robot, bend, head, int(m / _MIN_FIXATED), rng), m) for m in (n, N_TEST))
        for name, make in {
            "model of revolute joints": RevoluteArm,
            "quintic spline": MODELS["quintic spline (SciPy)"],
        }.items():
            model = make()
            model.learn(train.arm_rad, train.gaze_rad)
            errors[deviation].setdefault(name, []).append(gaze_rmse_deg(model, test)[0])
    return {"rmse_deg": errors}


def _other_robots_table(numbers: dict[str, Any]) -> Table:
    """Return mean and largest error by deviation and model."""
    rows = []
    for deviation, models in numbers["rmse_deg"].items():
        cells = [f"{np.mean(errors):.2g} / {max(errors):.2g}" for errors in models.values()]
        cells[0] = judged(cells[0], max(next(iter(models.values()))) > _GOAL_DEG)
        rows.append([deviation, *cells])
    return Table(["gaze RMSE (°): mean / largest", *next(iter(numbers["rmse_deg"].values()))], rows)


@dataclass(frozen=True)
class ReachKinematics(SampledStudy, PartsStudy):
    """Kinematics behind the reachable-space map."""

    MINUTES: ClassVar[int] = 19
    PARTS: ClassVar[Mapping[str, Part]] = {
        "forward_model": Part(_forward_model, _forward_model_chart),
        "deviations": Part(_deviations, table=_deviations_table),
        "other_robots": Part(_other_robots, table=_other_robots_table),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {"sizes": (100, 200), "robots": 1}

    n: int = 3  # sets of babbled postures, each with its own test set
    robots: int = 5  # of other links and eyes
    sizes: tuple[int, ...] = (100, 200, 400, 800, 1600, 3000, 4400)
    """Fixated postures after which each forward model is judged; of robots with deviations, the last one only."""
