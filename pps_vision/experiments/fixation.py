"""How fast and how well the eyes fixate what they see: J IV.1 and six joints, by speed, latency and noise.

Kinematic, 20 Hz: the true point is projected into both eyes with pixel noise, triangulated and filtered; the
controllers get the filter's track, and their commands, limited as all are, take effect late.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from tqdm import tqdm

from control import fixation, limits, neck_and_eyes, search
from control.fixation import FixationParams, fixation_error, gaze_at
from control.head import gaze_of
from control.latency import posture_after
from control.limits import MAX_HOLD_S, LimitParams
from control.neck_and_eyes import NeckAndEyesParams, joints
from control.search import SearchParams, SearchState
from pps_vision.experiments import charts
from pps_vision.experiments.scenarios import EYES_M
from pps_vision.experiments.study import SampledStudy, interval, mean, median
from pps_vision.experiments.tables import Table, estimate
from pps_vision.geometry.camera import View
from pps_vision.geometry.triangulation import triangulate
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import home, icub_rig, load_icub, set_gaze
from pps_vision.robot.model import Posture
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.types import Array, JointVelocity, Mask, Status, Track3D
from rendering.motions import Motion, Static, make_motion
from rendering.names import MotionName
from tracking import kalman
from tracking.kalman import Belief, KalmanParams

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DT_S, _DEG, _COAST_S = 0.05, np.pi / 180, 0.5
_MOVING: tuple[MotionName, ...] = ("linear", "circle", "figure8", "jerk")
_EYES_DEG, _NECK_DEG, _NEAR_DEG = 0.1, 0.5, 1.5
_FOUND_S = (2.0, 5.0, 15.0)

Axis = Literal["speed", "latency", "noise"]
AXES: Mapping[Axis, tuple[str, tuple[float, ...]]] = {
    "speed": ("speed (cm/s)", (5, 10, 20, 30, 40)),
    "latency": ("latency (ms)", (0, 50, 100, 150, 200)),
    "noise": ("pixel noise σ (px)", (0, 0.02, 0.1, 0.3, 1)),
}


@dataclass(frozen=True)
class Condition:
    """What the eyes are up against."""

    speed_m_s: float = 0.3
    """Speed of the target."""
    latency_s: float = 0.05
    """Time from a frame until its command takes effect."""
    noise_px: float = 0.02
    """Standard deviation of the target's centre in either image: as of rendered objects, whose 3D error before the
    filter is 0.2–0.5 mm (`bench fidelity`)."""

    def at(self, axis: Axis, value: float) -> "Condition":
        """The same with another speed (cm/s), latency (ms) or noise (px)."""
        changes = {"speed": {"speed_m_s": value / 100}, "latency": {"latency_s": value / 1000}}
        return replace(self, **changes.get(axis, {"noise_px": value}))


@dataclass(frozen=True)
class Method:
    """A gaze controller and what it is told."""

    params: FixationParams | NeckAndEyesParams
    """J IV.1, or six joints."""
    compensates: bool = True
    """Whether target and posture are predicted to when the command takes effect."""
    knows: bool = False
    """Whether it is told where the target truly will be then, and how fast."""

    def command(
        self, posture: Posture, p: Array, v: Array, stamp_s: float, last: JointVelocity | None
    ) -> JointVelocity:
        """The command for a target."""
        if isinstance(self.params, NeckAndEyesParams):
            return neck_and_eyes.step(self.params, posture, p, v, MAX_HOLD_S, stamp_s, last)
        return fixation.step(self.params, posture, p, v, MAX_HOLD_S, stamp_s)


_J, _SIX = FixationParams(), NeckAndEyesParams()
METHODS = {
    "J IV.1": Method(_J),
    "six joints": Method(_SIX),
    "J IV.1, latency ignored": Method(_J, compensates=False),
    "six joints, latency ignored": Method(_SIX, compensates=False),
    "six joints, motion known": Method(_SIX, knows=True),
}


class _Robot:
    """A head that obeys late, and its measurements of a target."""

    def __init__(self) -> None:
        self.robot = load_icub()
        self.rig, self.self_collision = icub_rig(self.robot), SelfCollision(self.robot)

    def follow(
        self, method: Method, q: Array, motion: Motion, condition: Condition, seconds: float, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Fixation errors (deg) of the 25 ms steps from posture `q` on, and the postures (n, n_joints)."""
        belief: Belief | None = None
        commands: list[JointVelocity] = []
        last_q: Array | None = None
        errors, postures, latency_s = [], [], condition.latency_s
        for k in range(int(seconds / _DT_S)):
            t = k * _DT_S
            belief = self._see(belief, q, motion(t)[0], t, condition.noise_px, rng)
            last = commands[-1] if commands else None
            then = self.robot.at(posture_after(q, commands, t, t + latency_s, latency_s) if method.compensates else q)
            target = self._target(method, belief, motion, t, latency_s)
            rest = JointVelocity(t, np.zeros(self.robot.n_joints), MAX_HOLD_S)
            wanted = rest if target is None else method.command(then, *target, t, last)
            commands.append(limits.limit(LimitParams(), self.self_collision, then, wanted, last, last_q))
            last_q, commands = then.q_rad, commands[-12:]
            for since in (0.5, 1.0):
                until_s = t + since * _DT_S
                q = self.robot.clamp(posture_after(q, commands, until_s - 0.5 * _DT_S, until_s, latency_s))
                errors.append(fixation_error(self.robot.at(q), motion(until_s)[0]) / _DEG)
                postures.append(q)
        return np.array(errors), np.array(postures)

    def _see(
        self, belief: Belief | None, q: Array, p: Array, t: float, noise_px: float, rng: np.random.Generator
    ) -> Belief | None:
        """The filter after a frame; None once nothing was seen for half a second."""
        view, cov = self.rig.view(q), max(noise_px, 0.01) ** 2 * np.eye(2)
        pixels = [eye.project(p) + noise_px * rng.standard_normal(2) for eye in (view.left, view.right)]
        if belief is not None:
            belief = kalman.predict(KalmanParams(), belief, t)
        visible = view.left.sees(p) and view.right.sees(p)
        seen = triangulate(view, pixels[0], pixels[1], cov, cov) if visible else None
        if seen is not None and belief is None:
            return kalman.start(KalmanParams(), t, seen.p_root, seen.cov_root)
        if seen is not None and belief is not None:
            return kalman.update(KalmanParams(), belief, seen.p_root, seen.cov_root)
        return belief if belief is not None and t - belief.updated_s < _COAST_S else None

    def _target(
        self, method: Method, belief: Belief | None, motion: Motion, t: float, latency_s: float
    ) -> tuple[Array, Array] | None:
        """Position and velocity for the controller; None of what is not seen."""
        if method.knows:
            return motion(t + latency_s)[0], motion(t + latency_s + 0.5 * _DT_S)[1]
        if belief is None:
            return None
        track = Track3D(t, belief.mean, belief.cov, 0.03, 0.0, Status.TRACKING)  # the default filter is of order 4
        return kalman.ahead(KalmanParams(), track, latency_s if method.compensates else 0.0, _DT_S)


@dataclass(frozen=True)
class Fixation(SampledStudy):
    """Gaze on seen targets: settling on a point at rest, error of following, and time until a lost target is seen."""

    n: int = 16
    """Targets of each kind."""
    seconds: float = 4.0
    """Duration of following; the first second is not counted."""
    axes: tuple[Axis, ...] = ("speed", "latency", "noise")
    """What is varied."""

    def run(self) -> dict[str, Any]:
        """Return medians over targets with their 95 % intervals, in degrees and seconds."""
        eyes = _Robot()
        first = dict(list(METHODS.items())[:2])
        told = {name: METHODS[name] for name in (*first, "six joints, motion known")}
        return {
            "static": {name: self._static(eyes, method) for name, method in first.items()},
            "motions": {
                kind: {name: self._moving(eyes, method, Condition(), (kind,)) for name, method in told.items()}
                for kind in tqdm(_MOVING, "motions", disable=None)
            },
            "axes": {axis: self._axis(eyes, axis, METHODS if axis == "latency" else told) for axis in self.axes},
            "search": self._search(eyes),
        }

    def chart(self, numbers: dict[str, Any]) -> "Figure":
        """Draw the error of following over speed, latency and noise."""
        figure, panels = charts.panels(len(numbers["axes"]))
        for axis, (label, values) in zip(
            panels, ((AXES[name][0], of) for name, of in numbers["axes"].items()), strict=True
        ):
            series = {name: [cell["rms_deg"] for cell in cells] for name, cells in values["methods"].items()}
            charts.curves(axis, values["severities"], series, label, "RMS fixation error (°)")
            axis.set_yscale("log")
            axis.legend(fontsize=6)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return settling, following by kind of motion, and search."""
        columns = {"eyes within 0.1° (s)": "eyes_s", "neck within 0.5° (s)": "neck_s", "within 0.75 s (%)": "in_time"}
        static = [
            [name, *(estimate(cell[key]) for key in columns.values())] for name, cell in numbers["static"].items()
        ]
        measures = {"RMS (°)": "rms_deg", "worst (°)": "worst_deg", "time within 1.5° (%)": "near_percent"}
        motions = [
            [kind, name, *(estimate(cell[key]) for key in measures.values())]
            for kind, cells in numbers["motions"].items()
            for name, cell in cells.items()
        ]
        found = [[name, *(estimate(value) for value in cell.values())] for name, cell in numbers["search"].items()]
        within = [f"seen within {t:g} s (%)" for t in _FOUND_S]
        return {
            "static": Table(["controller", *columns], static),
            "motions": Table(["motion, 30 cm/s", "controller", *measures], motions),
            "search": Table(["search", *within], found),
        }

    def _static(self, eyes: _Robot, method: Method) -> dict[str, Any]:
        """Time until the eyes are within 0.1° for good, the neck within 0.5° of where it comes to rest."""
        settled = []
        neck = joints(eyes.robot)[0]
        for seed in tqdm(self.seeds, "static", disable=None):
            rng = np.random.default_rng(seed)
            q, point = _start_and_point(eyes, rng)
            errors, postures = eyes.follow(method, q, Static(point), Condition(), 3.0, rng)
            turned = np.abs(postures[:, neck] - postures[-1, neck]).max(axis=1) / _DEG
            settled.append((_last_above(errors, _EYES_DEG), _last_above(turned, _NECK_DEG)))
        eyes_s, neck_s = np.array(settled).T[..., None]
        in_time = 100.0 * (np.maximum(eyes_s, neck_s) <= 0.75)
        return {"eyes_s": interval(eyes_s, median), "neck_s": interval(neck_s, median), "in_time": interval(in_time)}

    def _moving(
        self, eyes: _Robot, method: Method, condition: Condition, kinds: tuple[MotionName, ...] = _MOVING
    ) -> dict[str, Any]:
        """Error from the first second on; every method follows the same targets."""
        runs = []
        for seed in self.seeds:
            rng = np.random.default_rng((seed, 1))
            way = np.array([-1.0, rng.uniform(-0.4, 0.4), rng.uniform(-0.6, 0.1)])
            center = EYES_M + 0.4 * way / np.linalg.norm(way)
            motion = make_motion(kinds[seed % len(kinds)], rng, center, condition.speed_m_s)
            q = gaze_at(eyes.robot, home(eyes.robot), motion(0.0)[0])
            errors = eyes.follow(method, q, motion, condition, self.seconds, rng)[0]
            runs.append(errors[int(1.0 / _DT_S) * 2 :])
        return {
            "rms_deg": interval([[float(np.sqrt(np.mean(run**2)))] for run in runs], median),
            "worst_deg": interval([[run.max()] for run in runs], median),
            "near_percent": interval([100.0 * (run <= _NEAR_DEG) for run in runs], mean),
        }

    def _axis(self, eyes: _Robot, axis: Axis, methods: Mapping[str, Method]) -> dict[str, Any]:
        """The same, in one respect from mild to hard."""
        cells: dict[str, list[Any]] = {name: [] for name in methods}
        for value in tqdm(AXES[axis][1], axis, disable=None):
            for name, method in methods.items():
                cells[name].append(self._moving(eyes, method, Condition().at(axis, value)))
        return {"severities": list(AXES[axis][1]), "methods": cells}

    def _search(self, eyes: _Robot) -> dict[str, Any]:
        """Share of points, lost where the eyes look and anywhere that gaze can be, that both eyes see in time."""
        found: dict[str, Any] = {}
        patterns: tuple[Literal["covering", "random"], ...] = ("covering", "random")
        for pattern in patterns:
            params, seen_s = SearchParams(pattern), []
            for seed in tqdm(self.seeds, f"{pattern} search", disable=None):
                rng = np.random.default_rng((seed, 2))
                q = _random_gaze(eyes, rng)
                points = fixation_points(eyes.robot, np.array([_gaze(rng) for _ in range(20)]))
                first_s, state = np.full(20, np.inf), SearchState(gaze_of(eyes.robot.at(q)))
                for k in range(int(_FOUND_S[-1] / _DT_S) + 1):
                    view = eyes.rig.view(q)
                    both = _within_image(view.left, points) & _within_image(view.right, points)
                    first_s = np.minimum(first_s, np.where(both, k * _DT_S, np.inf))
                    state, command = search.step(params, state, eyes.robot.at(q), _DT_S, rng)
                    q = q + _DT_S * command.dq_rad_s
                seen_s.append(first_s[first_s > 0])
            found[pattern] = {f"{t:g} s": interval([100.0 * (one <= t) for one in seen_s]) for t in _FOUND_S}
        return found


def _within_image(eye: View, points: Array) -> Mask:
    """(n,) whether an eye sees points (n, 3)."""
    pixels = eye.project(points)
    return np.asarray(np.all((pixels >= -0.5) & (pixels <= (eye.camera.width - 0.5, eye.camera.height - 0.5)), axis=1))


def _gaze(rng: np.random.Generator) -> Array:
    """(3,) rad within J's limits and the iCub's own pitch."""
    limits_ = GazeLimits()
    return rng.uniform(limits_.lower, np.minimum(limits_.upper, np.array([55, 30, 90]) * _DEG))


def _random_gaze(eyes: _Robot, rng: np.random.Generator) -> Array:
    """A random gaze posture (n_joints,)."""
    yaw, pitch, vergence = _gaze(rng)
    return set_gaze(eyes.robot, home(eyes.robot), yaw, pitch, 0.0, 0.0, vergence)


def _start_and_point(eyes: _Robot, rng: np.random.Generator) -> tuple[Array, Array]:
    """A random gaze posture, and the fixation point of another one that the first has in view."""
    while True:
        q, point = _random_gaze(eyes, rng), fixation_points(eyes.robot, _gaze(rng)[None])[0]
        view = eyes.rig.view(q)
        if view.left.sees(point) and view.right.sees(point):
            return q, point


def _last_above(values: Array, bound: float) -> float:
    """When values every 25 ms are within their bound for good, s; inf if they are not at the end."""
    above = np.flatnonzero(values > bound)
    if not len(above):
        return 0.0
    return float("inf") if above[-1] == len(values) - 1 else 0.5 * _DT_S * (above[-1] + 1)
