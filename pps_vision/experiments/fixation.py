"""How fast and how well the eyes fixate what they see: J IV.1 and six joints, by speed, latency and noise.

Kinematic, 20 Hz: the true point is projected into both eyes with pixel noise, triangulated and filtered; the
controllers get the filter's track, and their commands, limited as all are, take effect late.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from tqdm import tqdm

from control import fixation, limits, neck_and_eyes, search
from control.fixation import FixationParams, fixation_error, gaze_at
from control.head import gaze_of
from control.latency import posture_after
from control.limits import MAX_HOLD_S, LimitParams
from control.neck_and_eyes import NeckAndEyesParams, joints
from control.search import SearchParams, SearchState
from pps_vision.app.simulation import at_taxel
from pps_vision.experiments import charts
from pps_vision.experiments.scenarios import EYES_M
from pps_vision.experiments.study import SampledStudy, interval, mean, median
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.geometry.camera import View
from pps_vision.geometry.triangulation import triangulate
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import home, icub_rig, load_icub, set_gaze
from pps_vision.robot.model import Posture
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import INNER_FOREARM, icub_skin
from pps_vision.types import Array, JointVelocity, Mask, Status, Track3D
from rendering.motions import Motion, Static, make_approach, make_motion
from rendering.names import MotionName
from tracking import kalman
from tracking.kalman import Belief, KalmanParams

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DT_S, _DEG, _COAST_S = 0.05, np.pi / 180, 0.5
_MOVING: tuple[MotionName, ...] = ("linear", "circle", "figure8", "jerk", "approach")
_RADIUS_M = 0.03  # of the object
_NEAREST_M = 0.3  # of an approach to the eyes
_JUMP_M_S2 = 50.0  # what changes the velocity faster is no acceleration but a turn on the spot
_EYES_DEG, _NECK_DEG, _NEAR_DEG = 0.1, 0.5, 1.5
_SETTLED_S, _NEAR_PERCENT = 0.75, 95.0  # the goals
_STATIC_S, _START_DEG = 3.0, 2.5  # duration, and tolerance of the start angle
_FOUND_S = (5.0, 15.0, 30.0)
_HALF_BASELINE_M = 0.034  # between the eyes
_FROM_M = 0.08  # the covering search sees what is farther on its first visit to the grid (`control.search`)

Axis = Literal["speed", "angle", "latency", "noise"]
AXES: Mapping[Axis, tuple[str, tuple[float, ...]]] = {
    "speed": ("speed (cm/s)", (5, 10, 20, 30, 40)),
    "angle": ("fixation error at the start (°)", (5, 10, 20, 30, 40)),
    "latency": ("latency (ms)", (0, 50, 100, 150, 200)),
    "noise": ("pixel noise σ (px)", (0, 0.02, 0.1, 0.3, 1)),
}
_FOLLOWING: tuple[Axis, ...] = ("speed", "latency", "noise")
_SETTLING: tuple[Axis, ...] = ("angle", "latency", "noise")


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
    start_deg: float | None = None
    """Fixation error at the start, of a target at rest; None: any."""

    def at(self, axis: Axis, value: float) -> "Condition":
        """The same with another speed (cm/s), start angle (°), latency (ms) or noise (px)."""
        field, unit = {
            "speed": ("speed_m_s", 0.01),
            "angle": ("start_deg", 1.0),
            "latency": ("latency_s", 0.001),
            "noise": ("noise_px", 1.0),
        }[axis]
        return replace(self, **{field: unit * value})


@dataclass(frozen=True)
class Method:
    """A gaze controller and what it is told."""

    params: FixationParams | NeckAndEyesParams
    """J IV.1, or six joints."""
    compensates: bool = True
    """Whether target and posture are predicted to when the command takes effect."""
    knows: Literal["track", "present", "future"] = "track"
    """What it is told: the filter's track, the true motion at the frame (position, velocity and acceleration, taken to
    last), or the true motion when the command takes effect."""
    hold_s: float = MAX_HOLD_S
    """Time for which a command may be held."""

    def command(
        self, posture: Posture, p: Array, v: Array, stamp_s: float, last: JointVelocity | None
    ) -> JointVelocity:
        """The command for a target."""
        if isinstance(self.params, NeckAndEyesParams):
            return neck_and_eyes.step(self.params, posture, p, v, self.hold_s, stamp_s, last)
        return fixation.step(self.params, posture, p, v, self.hold_s, stamp_s)


_J, _SIX = FixationParams(), NeckAndEyesParams()
METHODS = {
    "J IV.1": Method(_J),
    "six joints": Method(_SIX),
    "six joints, present known": Method(_SIX, knows="present"),
    "six joints, motion known": Method(_SIX, knows="future"),
    "J IV.1, latency ignored": Method(_J, compensates=False),
    "six joints, latency ignored": Method(_SIX, compensates=False),
    "six joints, held 0.1 s": Method(_SIX, hold_s=0.1),
}
_CONTROLLERS = ("J IV.1", "six joints")
_TOLD = (*_CONTROLLERS, "six joints, present known", "six joints, motion known")
_IGNORING = ("J IV.1, latency ignored", "six joints, latency ignored")


class _Robot:
    """A head that obeys late, and its measurements of a target."""

    def __init__(self) -> None:
        self.robot = load_icub()
        self.rig, self.self_collision = icub_rig(self.robot), SelfCollision(self.robot)
        self.home, self.skin = home(self.robot), icub_skin(("left_forearm",))

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
            rest = JointVelocity(t, np.zeros(self.robot.n_joints), method.hold_s)
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
        if method.knows == "future":
            return motion(t + latency_s)[0], motion(t + latency_s + 0.5 * _DT_S)[1]
        if method.knows == "present":
            (p, v), since_s = motion(t), min(t, 1e-3)
            a = (v - motion(t - since_s)[1]) / since_s if since_s else np.zeros(3)
            a = a * (np.linalg.norm(a) < _JUMP_M_S2)
            return p + latency_s * v + 0.5 * latency_s**2 * a, v + (latency_s + 0.5 * _DT_S) * a
        if belief is None:
            return None
        track = Track3D(t, belief.mean, belief.cov, _RADIUS_M, 0.0, Status.TRACKING)  # the default filter is of order 4
        return kalman.extrapolate(KalmanParams(), track, latency_s if method.compensates else 0.0, _DT_S)


@dataclass(frozen=True)
class Fixation(SampledStudy):
    """Gaze on seen targets: settling on a point at rest, error of following, and time until a lost target is seen."""

    SHORT: ClassVar[Mapping[str, Any]] = {"axes": ("angle",)}

    n: int = 16
    """Targets of each kind."""
    seconds: float = 4.0
    """Duration of following; the first second is not counted."""
    axes: tuple[Axis, ...] = ("speed", "angle", "latency", "noise")
    """What is varied: for following all but the start angle, for settling all but the speed."""

    def run(self) -> dict[str, Any]:
        """Return medians over targets with their 95 % intervals, in degrees and seconds."""
        eyes = _Robot()
        return {
            "static": {
                name: self._static(eyes, name, Condition()) for name in (*_CONTROLLERS, "six joints, held 0.1 s")
            },
            "motions": {
                kind: {name: self._moving(eyes, name, Condition(), (kind,)) for name in _TOLD}
                for kind in tqdm(_MOVING, "motions", disable=None)
            },
            "axes": {axis: self._axis(eyes, axis, self._moving, _TOLD) for axis in self.axes if axis in _FOLLOWING},
            "settling": {
                axis: self._axis(eyes, axis, self._static, _CONTROLLERS) for axis in self.axes if axis in _SETTLING
            },
            "search": self._search(eyes),
        }

    def chart(self, numbers: dict[str, Any]) -> "Figure":
        """Draw the error of following over speed, latency and noise, and settling over start angle, latency, noise."""
        rows = {"axes": ("rms_deg", "RMS fixation error (°)"), "settling": ("settled_s", "settled after (s)")}
        drawn = [(row, axis) for row in rows for axis in numbers[row]]
        figure, panels = charts.panels(len(drawn), len(numbers["axes"]))
        for panel, (row, axis) in zip(panels, drawn, strict=True):
            metric, label = rows[row]
            values = numbers[row][axis]
            series = {name: [cell[metric] for cell in cells] for name, cells in values["methods"].items()}
            charts.curves(panel, values["severities"], series, AXES[axis][0], label)
            if row == "axes":
                panel.set_yscale("log")
            else:
                panel.axhline(_SETTLED_S, color="0.25", lw=1, ls="--", label="goal")
                panel.set_ylim(0, 1.05 * _STATIC_S)
            panel.legend(fontsize=7)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return settling, following by kind of motion, and search; what misses its goal is bold."""
        static = [
            [
                name,
                *(judged(estimate(cell[key]), cell[key][0] > _SETTLED_S) for key in ("eyes_s", "neck_s")),
                estimate(cell["in_time"]),
            ]
            for name, cell in numbers["static"].items()
        ]
        motions = [
            [
                *(kind, name, *(estimate(cell[key]) for key in ("rms_deg", "worst_deg"))),
                judged(estimate(cell["near_percent"]), cell["near_percent"][0] < _NEAR_PERCENT),
            ]
            for kind, cells in numbers["motions"].items()
            for name, cell in cells.items()
        ]
        found = []
        for name, cell in numbers["search"].items():
            *before, last = cell.values()
            found.append(
                [
                    name,
                    *(estimate(one) for one in before),
                    judged(estimate(last), name.startswith("covering") and last[0] < 100.0),
                ]
            )
        settled = [f"{what} (s), goal ≤ {_SETTLED_S}" for what in ("eyes within 0.1°", "neck within 0.5°")]
        near = f"time within 1.5° (%), goal ≥ {_NEAR_PERCENT:g}"
        *within, last_s = (f"seen within {name} (%)" for name in next(iter(numbers["search"].values())))
        return {
            "static": Table(["controller", *settled, f"both within {_SETTLED_S} s (%)"], static),
            "motions": Table(["motion, 30 cm/s", "controller", "RMS (°)", "worst (°)", near], motions),
            "search": Table(["search", *within, f"{last_s}, goal 100"], found),
        }

    def _static(self, eyes: _Robot, name: str, condition: Condition) -> dict[str, Any]:
        """Time until the eyes are within 0.1° for good, the neck within 0.5° of where it comes to rest, and both."""
        settled = []
        neck = joints(eyes.robot)[0]
        for seed in self.seeds:
            rng = np.random.default_rng(seed)
            q, point = _start_and_point(eyes, rng, condition.start_deg)
            errors, postures = eyes.follow(METHODS[name], q, Static(point), condition, _STATIC_S, rng)
            turned = np.abs(postures[:, neck] - postures[-1, neck]).max(axis=1) / _DEG
            settled.append((_last_above(errors, _EYES_DEG), _last_above(turned, _NECK_DEG)))
        eyes_s, neck_s = np.array(settled).T[..., None]
        both_s = np.maximum(eyes_s, neck_s)
        times = {"eyes_s": eyes_s, "neck_s": neck_s, "settled_s": both_s}
        return {
            **{key: interval(of, median) for key, of in times.items()},
            "in_time": interval(100.0 * (both_s <= _SETTLED_S)),
        }

    def _moving(
        self, eyes: _Robot, name: str, condition: Condition, kinds: tuple[MotionName, ...] = _MOVING
    ) -> dict[str, Any]:
        """Error from the first second on; every method follows the same targets."""
        runs = []
        for seed in self.seeds:
            rng = np.random.default_rng((seed, 1))
            motion = _motion(eyes, kinds[seed % len(kinds)], rng, condition.speed_m_s)
            q = gaze_at(eyes.robot, eyes.home, motion(0.0)[0])
            errors = eyes.follow(METHODS[name], q, motion, condition, self.seconds, rng)[0]
            runs.append(errors[int(1.0 / _DT_S) * 2 :])
        return {
            "rms_deg": interval([[float(np.sqrt(np.mean(run**2)))] for run in runs], median),
            "worst_deg": interval([[run.max()] for run in runs], median),
            "near_percent": interval([100.0 * (run <= _NEAR_DEG) for run in runs], mean),
        }

    def _axis(
        self,
        eyes: _Robot,
        axis: Axis,
        measure: Callable[[_Robot, str, Condition], dict[str, Any]],
        names: Sequence[str],
    ) -> dict[str, Any]:
        """The same, in one respect from mild to hard; over latency also of those who ignore it."""
        names = (*names, *_IGNORING) if axis == "latency" else names
        cells: dict[str, list[Any]] = {name: [] for name in names}
        for value in tqdm(AXES[axis][1], axis, disable=None):
            for name in names:
                cells[name].append(measure(eyes, name, Condition().at(axis, value)))
        return {"severities": list(AXES[axis][1]), "methods": cells}

    def _search(self, eyes: _Robot) -> dict[str, Any]:
        """Share of the points that both eyes see in time: anywhere that gaze can be, but not in view at first."""
        found: dict[str, Any] = {}
        patterns: tuple[Literal["covering", "random"], ...] = ("covering", "random")
        for pattern in patterns:
            params, seen_s, far_s = SearchParams(pattern), [], []
            for seed in tqdm(self.seeds, f"{pattern} search", disable=None):
                rng = np.random.default_rng((seed, 2))
                q = _random_gaze(eyes, rng)
                gazes = np.array([_gaze(rng) for _ in range(20)])
                points, distance_m = fixation_points(eyes.robot, gazes), _HALF_BASELINE_M / np.tan(gazes[:, 2] / 2)
                first_s, state = np.full(20, np.inf), SearchState(gaze_of(eyes.robot.at(q)))
                for k in range(int(_FOUND_S[-1] / _DT_S) + 1):
                    view = eyes.rig.view(q)
                    both = _within_image(view.left, points) & _within_image(view.right, points)
                    first_s = np.minimum(first_s, np.where(both, k * _DT_S, np.inf))
                    state, command = search.step(params, state, eyes.robot.at(q), _DT_S, rng)
                    q = q + _DT_S * command.dq_rad_s
                seen_s.append(first_s[first_s > 0])
                far_s.append(first_s[(first_s > 0) & (distance_m >= _FROM_M)])
            for name, first in ((pattern, seen_s), (f"{pattern}, from {100 * _FROM_M:g} cm on", far_s)):
                found[name] = {f"{t:g} s": interval([100.0 * (one <= t) for one in first]) for t in _FOUND_S}
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
    return set_gaze(eyes.robot, eyes.home, yaw, pitch, 0.0, 0.0, vergence)


def _motion(eyes: _Robot, kind: MotionName, rng: np.random.Generator, speed_m_s: float) -> Motion:
    """A motion about a point 0.4 m before the eyes; approaches, one after the other, go to the left inner forearm at
    home and back, whose way can be fixated and is nowhere near the eyes."""
    way = np.array([-1.0, rng.uniform(-0.4, 0.4), rng.uniform(-0.6, 0.1)])
    if kind != "approach":
        return make_motion(kind, rng, EYES_M + 0.4 * way / np.linalg.norm(way), speed_m_s)
    posture = eyes.robot.at(eyes.home)
    while True:
        taxel = eyes.skin.index(f"left_forearm:{rng.choice(INNER_FOREARM)}")
        visit = make_approach(rng, at_taxel(eyes.skin, posture, taxel, _RADIUS_M), speed_m_s)
        whole_s = 2 * visit.contact_s + visit.dwell_s
        path = [visit(t)[0] for t in np.linspace(0.0, visit.contact_s, 9)]
        ends = [(eyes.robot.at(gaze_at(eyes.robot, eyes.home, p)), p) for p in path]
        if all(fixation_error(at, p) < _EYES_DEG * _DEG and np.linalg.norm(p - EYES_M) > _NEAREST_M for at, p in ends):
            return lambda t: visit(t % whole_s)


def _start_and_point(eyes: _Robot, rng: np.random.Generator, start_deg: float | None = None) -> tuple[Array, Array]:
    """A random gaze posture, and the fixation point of another one that the first has in view, so far off."""
    while True:
        q, point = _random_gaze(eyes, rng), fixation_points(eyes.robot, _gaze(rng)[None])[0]
        view, error_deg = eyes.rig.view(q), fixation_error(eyes.robot.at(q), point) / _DEG
        is_so_far = start_deg is None or abs(error_deg - start_deg) <= _START_DEG
        if is_so_far and view.left.sees(point) and view.right.sees(point):
            return q, point


def _last_above(values: Array, bound: float) -> float:
    """When values every 25 ms are within their bound for good, s; the whole time if they are not at the end."""
    above = np.flatnonzero(values > bound)
    return 0.5 * _DT_S * float(above[-1] + 1) if len(above) else 0.0
