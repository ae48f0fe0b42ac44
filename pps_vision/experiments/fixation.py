"""Fixation of targets in view: settling, error of following and search, with J IV.1 and six joints.

Kinematic, 20 Hz: the true point is projected into both eyes with pixel noise, triangulated and filtered; the
controllers get the filter's track, and their commands, limited as all are, take effect late.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from tqdm import tqdm

from control import fixation, limits, neck_and_eyes, search
from control.commands import posture_after
from control.fixation import FixationParams, fixation_error, gaze_at
from control.head import gaze_of
from control.limits import MAX_HOLD_S, LimitParams
from control.neck_and_eyes import NeckAndEyesParams, joints
from control.search import SearchParams, SearchState
from pps_vision.app.simulation import at_taxel
from pps_vision.experiments import charts
from pps_vision.experiments.films.recordings import EYES_M
from pps_vision.experiments.study import SampledStudy, interval, median, percent, rms
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.geometry.triangulation import triangulate
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import home, icub_rig, load_icub, set_gaze
from pps_vision.robot.model import Posture
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import INNER_FOREARM, icub_skin
from pps_vision.types import Array, JointVelocity, Status, Track3D
from rendering.motions import Motion, Static, make_approach, make_motion
from rendering.names import MotionName
from tracking import kalman
from tracking.kalman import Belief, KalmanParams

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DT_S = 0.05
_DEG = np.pi / 180
_COAST_S = 0.5
_MOVING: tuple[MotionName, ...] = ("linear", "circle", "figure8", "jerk", "approach")
_RADIUS_M = 0.03  # radius of the object
_NEAREST_M = 0.3  # least distance from the eyes in an approach
_EYES_DEG = 0.1  # fixation error of settled eyes
_NECK_DEG = 0.5  # angle of a settled neck from its rest
_NEAR_DEG = 1.5  # fixation error that counts as near
_SETTLED_S = 0.75  # goal
_NEAR_PERCENT = 95.0  # goal
_STATIC_S = 3.0  # duration of settling
_SEARCH_S = (5.0, 15.0, 30.0)

Axis = Literal["speed", "latency", "noise"]


@dataclass(frozen=True)
class Condition:
    """Difficulty of a target."""

    speed_m_s: float = 0.3  # speed of the target
    latency_s: float = 0.05  # time from a frame until its command takes effect
    noise_px: float = 0.02  # noise of the centre in an image; rendered objects: 3D error before the filter 0.2–0.5 mm


AXES: Mapping[Axis, tuple[str, Mapping[float, Condition]]] = {
    "speed": ("speed (cm/s)", {v: Condition(speed_m_s=0.01 * v) for v in (5, 10, 20, 30, 40)}),
    "latency": ("latency (ms)", {v: Condition(latency_s=0.001 * v) for v in (0, 50, 100, 150, 200)}),
    "noise": ("pixel noise σ (px)", {v: Condition(noise_px=v) for v in (0, 0.02, 0.1, 0.3, 1)}),
}
"""Label of each axis, and conditions by severity."""


@dataclass(frozen=True)
class Method:
    """A gaze controller and its inputs."""

    step: Callable[..., JointVelocity]  # J IV.1, or six joints
    compensates: bool = True  # whether target and posture are predicted to the time at which the command takes effect
    knows_motion: bool = False  # whether the true motion at that time is given in place of the filter's track


def _j(posture: Posture, p: Array, v: Array, hold_s: float, stamp_s: float, _: JointVelocity | None) -> JointVelocity:
    return fixation.step(FixationParams(), posture, p, v, hold_s, stamp_s)


_six = partial(neck_and_eyes.step, NeckAndEyesParams())
METHODS = {
    "J IV.1": Method(_j),
    "six joints": Method(_six),
    "six joints, motion known": Method(_six, knows_motion=True),
    "J IV.1, latency ignored": Method(_j, compensates=False),
    "six joints, latency ignored": Method(_six, compensates=False),
}
_CONTROLLERS = ("J IV.1", "six joints")
_FOLLOWING = (*_CONTROLLERS, "six joints, motion known")


class Head:
    """A robot's head whose commands take effect late, and its measurements of a target."""

    def __init__(self) -> None:
        self.robot = load_icub()
        self.rig = icub_rig(self.robot)
        self.self_collision = SelfCollision(self.robot)
        self.home = home(self.robot)
        self.skin = icub_skin(("left_forearm",))

    def follow(
        self, method: Method, q: Array, motion: Motion, condition: Condition, seconds: float, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Fixation errors (deg) every 25 ms from posture `q` on, and the postures (n, n_joints)."""
        belief: Belief | None = None
        commands: list[JointVelocity] = []
        last_q: Array | None = None
        errors: list[float] = []
        postures: list[Array] = []
        latency_s = condition.latency_s
        for k in range(int(seconds / _DT_S)):
            t = k * _DT_S
            belief = self._update(belief, q, motion(t)[0], t, condition.noise_px, rng)
            last = commands[-1] if commands else None
            future = self.robot.at(posture_after(q, commands, t, t + latency_s, latency_s) if method.compensates else q)
            target = self._target(method, belief, motion, t, latency_s)
            no_motion = JointVelocity(t, np.zeros(self.robot.n_joints), MAX_HOLD_S)
            wanted = no_motion if target is None else method.step(future, *target, MAX_HOLD_S, t, last)
            commands.append(limits.limit(LimitParams(), self.self_collision, future, wanted, last, last_q))
            last_q = future.q_rad
            commands = commands[-12:]
            for periods in (0.5, 1.0):
                until_s = t + periods * _DT_S
                q = self.robot.clamp(posture_after(q, commands, until_s - 0.5 * _DT_S, until_s, latency_s))
                errors.append(fixation_error(self.robot.at(q), motion(until_s)[0]) / _DEG)
                postures.append(q)
        return np.array(errors), np.array(postures)

    def _update(
        self, belief: Belief | None, q: Array, p: Array, t: float, noise_px: float, rng: np.random.Generator
    ) -> Belief | None:
        """The filter after a frame; None after half a second without a measurement."""
        view = self.rig.view(q)
        cov = max(noise_px, 0.01) ** 2 * np.eye(2)
        pixels = [eye.project(p) + noise_px * rng.standard_normal(2) for eye in (view.left, view.right)]
        is_visible = view.left.sees(p) and view.right.sees(p)
        point = triangulate(view, pixels[0], pixels[1], cov, cov) if is_visible else None
        if belief is None:
            return None if point is None else kalman.start(KalmanParams(), t, point.p_root, point.cov_root)
        belief = kalman.predict(KalmanParams(), belief, t)
        if point is None:
            return belief if t - belief.updated_s < _COAST_S else None
        return kalman.update(KalmanParams(), belief, point.p_root, point.cov_root)

    def _target(
        self, method: Method, belief: Belief | None, motion: Motion, t: float, latency_s: float
    ) -> tuple[Array, Array] | None:
        """Position and velocity for the controller; None without a track."""
        if method.knows_motion:
            return motion(t + latency_s)[0], motion(t + latency_s + 0.5 * _DT_S)[1]
        if belief is None:
            return None
        track = Track3D(t, belief.mean, belief.cov, _RADIUS_M, 0.0, Status.TRACKING)  # the default filter is of order 4
        return kalman.extrapolate(KalmanParams(), track, latency_s if method.compensates else 0.0, _DT_S)


@dataclass(frozen=True)
class Fixation(SampledStudy):
    """Settling on a point at rest, error of following by motion, speed, latency and noise, and search."""

    MINUTES: ClassVar[int] = 3
    SHORT: ClassVar[Mapping[str, Any]] = {"axes": ("latency",)}

    n: int = 16  # targets of each kind
    seconds: float = 4.0  # duration of following; the first second is not counted
    axes: tuple[Axis, ...] = ("speed", "latency", "noise")  # varied conditions of following

    def run(self) -> dict[str, Any]:
        """Return medians over targets with their 95 % intervals, in degrees and seconds."""
        head = Head()
        axes: dict[str, Any] = {}
        for axis in self.axes:
            conditions = AXES[axis][1]
            methods = {
                name: [self.follow(head, name, condition) for condition in conditions.values()]
                for name in tqdm(METHODS if axis == "latency" else _FOLLOWING, axis, disable=None)
            }
            axes[axis] = {"severities": list(conditions), "methods": methods}
        return {
            "static": {name: self.settle(head, name) for name in _CONTROLLERS},
            "motions": {
                kind: {name: self.follow(head, name, Condition(), (kind,)) for name in _FOLLOWING}
                for kind in tqdm(_MOVING, "motions", disable=None)
            },
            "axes": axes,
            "search": {pattern: self.search(head, pattern) for pattern in ("covering", "random")},
        }

    def chart(self, numbers: dict[str, Any]) -> "Figure":
        """Draw the error of following over speed, latency and noise."""
        figure, panels = charts.panels(len(numbers["axes"]), len(numbers["axes"]))
        for panel, (axis, values) in zip(panels, numbers["axes"].items(), strict=True):
            series = {name: [cell["rms_deg"] for cell in cells] for name, cells in values["methods"].items()}
            charts.curves(panel, values["severities"], series, AXES[axis][0], "RMS fixation error (°)")
            panel.set_yscale("log")
            panel.legend(fontsize=7)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return settling, and following by kind of motion; a missed goal is bold."""
        static = [
            [name, *(judged(estimate(cell[key]), cell[key][0] > _SETTLED_S) for key in ("eyes_s", "neck_s"))]
            for name, cell in numbers["static"].items()
        ]
        motions = []
        for kind, cells in numbers["motions"].items():
            shares = [cells[name]["near_percent"] for name in _FOLLOWING]
            motions.append([kind, *(judged(estimate(share), share[0] < _NEAR_PERCENT) for share in shares)])
        settled = [f"{part} (s), ≤ {_SETTLED_S}" for part in ("eyes within 0.1°", "neck within 0.5°")]
        return {
            "static": Table(["controller", *settled], static),
            "motions": Table([f"within 1.5° (%), ≥ {_NEAR_PERCENT:g}, at 30 cm/s", *_FOLLOWING], motions),
        }

    def settle(self, head: Head, name: str) -> dict[str, Any]:
        """Return the time until the eyes stay within 0.1°, and the neck within 0.5° of its rest."""
        settled = []
        neck = joints(head.robot)[0]
        for seed in self.seeds:
            rng = np.random.default_rng(seed)
            q, point = _start_and_point(head, rng)
            errors, postures = head.follow(METHODS[name], q, Static(point), Condition(), _STATIC_S, rng)
            turned = np.abs(postures[:, neck] - postures[-1, neck]).max(axis=1) / _DEG
            settled.append((_last_above(errors, _EYES_DEG), _last_above(turned, _NECK_DEG)))
        eyes_s, neck_s = np.array(settled).T[..., None]
        return {"eyes_s": interval(eyes_s, median), "neck_s": interval(neck_s, median)}

    def follow(
        self, head: Head, name: str, condition: Condition, kinds: tuple[MotionName, ...] = _MOVING
    ) -> dict[str, Any]:
        """Return the error after the first second; every method follows the same targets."""
        runs = []
        for seed in self.seeds:
            rng = np.random.default_rng((seed, 1))
            motion = _motion(head, kinds[seed % len(kinds)], rng, condition.speed_m_s)
            q = gaze_at(head.robot, head.home, motion(0.0)[0])
            errors, _ = head.follow(METHODS[name], q, motion, condition, self.seconds, rng)
            runs.append(errors[int(1.0 / _DT_S) * 2 :])
        return {
            "rms_deg": interval([[rms(run)] for run in runs], median),
            "near_percent": interval([run <= _NEAR_DEG for run in runs], percent),
        }

    def search(self, head: Head, pattern: Literal["covering", "random"]) -> dict[str, Any]:
        """Return the share of points in the range of the gaze, out of view at first, that both eyes see in time."""
        times_s = []
        for seed in tqdm(self.seeds, f"{pattern} search", disable=None):
            rng = np.random.default_rng((seed, 2))
            q = _random_gaze(head, rng)
            points = fixation_points(head.robot, np.array([_gaze(rng) for _ in range(20)]))
            first_s = np.full(20, np.inf)
            state = SearchState(gaze_of(head.robot.at(q)))
            for k in range(int(_SEARCH_S[-1] / _DT_S) + 1):
                view = head.rig.view(q)
                is_in_view = [view.left.sees(point) and view.right.sees(point) for point in points]
                first_s = np.minimum(first_s, np.where(is_in_view, k * _DT_S, np.inf))
                state, command = search.step(SearchParams(pattern), state, head.robot.at(q), _DT_S, rng)
                q = q + _DT_S * command.dq_rad_s
            times_s.append(first_s[first_s > 0])
        return {f"{t:g} s": interval([target <= t for target in times_s], percent) for t in _SEARCH_S}


def _gaze(rng: np.random.Generator) -> Array:
    """(3,) rad within J's limits and the iCub's own pitch."""
    limits_ = GazeLimits()
    return rng.uniform(limits_.lower, np.minimum(limits_.upper, np.array([55, 30, 90]) * _DEG))


def _random_gaze(head: Head, rng: np.random.Generator) -> Array:
    """A random gaze posture (n_joints,)."""
    yaw, pitch, vergence = _gaze(rng)
    return set_gaze(head.robot, head.home, yaw, pitch, 0.0, 0.0, vergence)


def _motion(head: Head, kind: MotionName, rng: np.random.Generator, speed_m_s: float) -> Motion:
    """A motion about a point 0.4 m before the eyes; approaches, one after the other, go to the left inner forearm at
    home and back, on a path that can be fixated and stays away from the eyes."""
    way = np.array([-1.0, rng.uniform(-0.4, 0.4), rng.uniform(-0.6, 0.1)])
    if kind != "approach":
        return make_motion(kind, rng, EYES_M + 0.4 * way / np.linalg.norm(way), speed_m_s)
    posture = head.robot.at(head.home)
    while True:
        taxel = head.skin.index(f"left_forearm:{rng.choice(INNER_FOREARM)}")
        visit = make_approach(rng, at_taxel(head.skin, posture, taxel, _RADIUS_M), speed_m_s)
        whole_s = 2 * visit.contact_s + visit.dwell_s
        path = [visit(t)[0] for t in np.linspace(0.0, visit.contact_s, 9)]
        errors = [fixation_error(head.robot.at(gaze_at(head.robot, head.home, p)), p) for p in path]
        if max(errors) < _EYES_DEG * _DEG and np.linalg.norm(path - EYES_M, axis=1).min() > _NEAREST_M:
            return lambda t: visit(t % whole_s)


def _start_and_point(head: Head, rng: np.random.Generator) -> tuple[Array, Array]:
    """A random gaze posture, and the fixation point of another one that is in view of the first."""
    while True:
        q = _random_gaze(head, rng)
        point = fixation_points(head.robot, _gaze(rng)[None])[0]
        view = head.rig.view(q)
        if view.left.sees(point) and view.right.sees(point):
            return q, point


def _last_above(values: Array, bound: float) -> float:
    """When values every 25 ms are within their bound for good, s; the whole time if they are not at the end."""
    above = np.flatnonzero(values > bound)
    return 0.5 * _DT_S * float(above[-1] + 1) if len(above) else 0.0
