"""Planning with the torso in the rendered loop: an object is seen, tracked and fixated by the eyes, the map says that
it is out of reach, the torso turns, the map says that it is within reach, and the hand goes to it, blind over the last
centimetres where it hides the object.

Nothing but the rendered images tells the robot where the object is.
"""

from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from control import fixation, into_reach, last_seen
from control.fixation import FixationParams, fixation_error, gaze_at
from control.into_reach import IntoReachParams, IntoReachState
from control.last_seen import LastSeenParams
from pps_vision.app.in_view import can_follow
from pps_vision.experiments.reach.planning_world import GAZE, PlanningWorld, Truth
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.robot.gaze import fixated_gaze
from pps_vision.robot.icub import icub_rig
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, Status, Track3D
from rendering.eyes import Eyes
from rendering.motions import Recede
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus
from tracking.tracker import Tracker, TrackerParams

_DT_S, _LONGEST_S = 0.05, 25.0
_TOUCH_M, _HELD_RAD = 0.01, np.deg2rad(2.0)
_SHOWN_S, _SHOWN_M_S = 1.0, 0.10  # the object comes to its place, so that the eyes notice it
_MOMENTS = ("out of reach: the torso begins to turn", "within reach: the hand sets out", "the hand is there")


@dataclass(frozen=True)
class Film:
    """One run, per frame: what the planner does, the degree, how far fixation and what is believed are off, whether the
    object is seen, the torso, and the palm's distance from the object; and the joints (3, n) at the three moments."""

    modes: tuple[str, ...]
    degree: Array
    fixation_rad: Array
    believed_m: Array
    seen: Array
    torso_rad: Array
    palm_m: Array
    moments: tuple[Array, ...]
    point: Array

    @property
    def blind_s(self) -> float:
        """The longest time acted on what was believed without sight of the object."""
        longest = now = 0
        for seen, known in zip(self.seen, np.isfinite(self.believed_m), strict=True):
            now = now + 1 if known and not seen else 0
            longest = max(longest, now)
        return longest * _DT_S

    @property
    def palm_last_seen_m(self) -> float:
        """How far the palm was from the object when that was last seen."""
        return float(self.palm_m[np.flatnonzero(self.seen)[-1]]) if self.seen.any() else np.nan

    @property
    def held_rad(self) -> float:
        """The worst fixation error while the torso turned."""
        turning = np.array([mode == "turning" for mode in self.modes])
        return float(self.fixation_rad[turning].max(initial=0.0))


@dataclass(frozen=True)
class PlanningRendered:
    """Balls out of reach with the torso upright, before the rendered eyes: `n` that some torso posture brings into
    reach, and half as many that none does."""

    seed: int = 0
    """Seed of the learning, the objects and the pixel noise."""
    n: int = 12
    """Objects that can be brought into reach."""
    n_labels: int = 12_000
    """Inverse-kinematics solutions the map is learned from."""
    noise_sigma: float = 2.0
    """Pixel noise, grey levels of 255."""

    def run(self) -> dict[str, Any]:
        """Counts; degrees and millimetres, each run's own; the joints at three moments of one run."""
        if self.n < 1:
            raise ValueError(f"bench reach planning_rendered: --n {self.n}; expected at least 1")
        world = PlanningWorld.make(self.seed, self.n_labels)
        rng = np.random.default_rng(self.seed + 1_000_000)
        rig = icub_rig(world.robot)
        possible, hopeless = _objects(world.robot, rig, self.n, rng)
        with Eyes(world.robot, rig, make_stimulus("ball"), sensor=Sensor(noise_sigma=self.noise_sigma)) as eyes:
            films = [film(world, rig, eyes, point, rng) for point in tqdm(possible, desc="objects", disable=None)]
            refused = [film(world, rig, eyes, point, rng) for point in tqdm(hopeless, desc="too far", disable=None)]
        touched = [f.palm_m[-1] <= _TOUCH_M for f in films]
        shown = max((f for f, t in zip(films, touched, strict=True) if t), key=_way, default=films[0])
        return {
            "objects": len(films),
            "said_there": sum(f.modes[-1] == "there" for f in films),
            "touched": int(sum(touched)),
            "held_within_2_deg": sum(f.held_rad <= _HELD_RAD for f in films),
            "too_far": len(refused),
            "too_far_said_so": sum(f.modes[-1] == "out of reach" for f in refused),
            "too_far_turned_deg": [round(float(np.rad2deg(_way(f))), 2) for f in refused],
            "last_said": [f.modes[-1] for f in films],
            "palm_off_mm": [round(1000 * float(f.palm_m[-1]), 2) for f in films],
            "believed_off_mm": [round(1000 * float(np.nanmedian(f.believed_m)), 2) for f in films],
            "worst_fixation_error_turning_deg": [round(float(np.rad2deg(f.held_rad)), 3) for f in films],
            "turned_deg": [round(float(np.rad2deg(_way(f))), 2) for f in films],
            "seconds": [round(_DT_S * len(f.modes), 2) for f in films],
            "longest_blind_s": [round(f.blind_s, 2) for f in films],
            "palm_off_when_last_seen_mm": [round(1000 * f.palm_last_seen_m, 1) for f in films],
            "seen_share": [round(float(f.seen.mean()), 3) for f in films],
            "shown": {
                "joints_rad": [q.round(6).tolist() for q in shown.moments],
                "point_m": shown.point.round(6).tolist(),
                "modes": list(shown.modes),
                "degree": [round(float(d), 4) if np.isfinite(d) else None for d in shown.degree],
                "torso_deg": np.rad2deg(shown.torso_rad).round(3).tolist(),
                "fixation_deg": np.rad2deg(shown.fixation_rad).round(4).tolist(),
                "palm_mm": (1000 * shown.palm_m).round(2).tolist(),
            },
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """The three moments as the left eye and a bystander see them, and the run over time."""
        return _pictures(numbers["shown"])


def film(world: PlanningWorld, rig: StereoRig, eyes: Eyes, point: Array, rng: np.random.Generator) -> Film:
    """One object: it comes to its place in view, then the robot does what it can."""
    robot, params = world.robot, IntoReachParams()
    palm = robot.names.palms[("left", "right").index(params.side)]
    torso = robot.indices(robot.names.torso)
    body = Silhouette(robot)
    tracker, last = Tracker(TrackerParams(), rig, rng, own_body=body), None
    motion = _comes_to(point)
    q = gaze_at(robot, robot.clamp(np.zeros(robot.n_joints)), motion(0.0)[0])
    dq: Array = np.zeros(robot.n_joints)
    state, rows, moments = IntoReachState(), [], dict[str, Array]()
    for k in range(int(_LONGEST_S / _DT_S)):
        t = k * _DT_S
        position, velocity = motion(t)
        posture = robot.at(q)
        track = tracker.step(eyes.render(SceneState(q, position, velocity, dq), t, rng)).track
        last, believed = last_seen.step(LastSeenParams(), last, track, _is_hidden(body, rig, posture, track))
        at_rest = believed is not None and t > _SHOWN_S
        gaze = fixated_gaze(posture, GAZE) if at_rest else None
        state, command = into_reach.step(params, world.learned, state, posture, gaze, _DT_S, t)
        degree = world.learned.judge(np.full((1, 3), np.nan) if gaze is None else gaze[None]).degree[0]
        wrong = fixation_error(posture, position)
        believed_off = np.nan if believed is None else float(np.linalg.norm(believed.position - position))
        hand_off = float(np.linalg.norm(posture.point(palm) - position))
        is_seen = believed is not None and believed.status == Status.TRACKING
        rows.append((state.mode, degree, wrong, believed_off, is_seen, q[torso], hand_off))
        moments.setdefault(state.mode, q)
        if state.mode in ("there", "out of reach"):
            break
        dq = command.dq_rad_s
        if believed is not None:
            ahead = believed.position + believed.velocity * _DT_S
            dq = dq + fixation.step(FixationParams(), posture, ahead, believed.velocity, _DT_S, t).dq_rad_s
        q = robot.clamp(q + _DT_S * dq)
    modes, degree, error, off, seen, turned, away = zip(*rows, strict=True)
    three = tuple(moments.get(mode, q) for mode in ("turning", "reaching", "there"))
    return Film(
        modes,
        np.array(degree),
        np.array(error),
        np.array(off),
        np.array(seen),
        np.array(turned),
        np.array(away),
        three,
        point,
    )


def _is_hidden(body: Silhouette, rig: StereoRig, posture: Posture, track: Track3D) -> bool:
    """Whether the robot's own body stands before what is tracked, in either eye."""
    view = rig.view(posture.q_rad)
    return track.is_known and any(
        body.hides(posture, eye, track.position, track.radius_m) for eye in (view.left, view.right)
    )


def _comes_to(point: Array) -> Recede:
    """5 cm away from before the face to its place, where it stays."""
    towards = point - np.array([-0.06, 0.0, 0.34])
    return Recede(point - 0.05 * towards / np.linalg.norm(towards), point, _SHOWN_M_S)


def _objects(robot: Robot, rig: StereoRig, n: int, rng: np.random.Generator) -> tuple[list[Array], list[Array]]:
    """`n` points out of reach that some torso posture brings into it, by 3° or more, and half as many that none does;
    all of them where both eyes see them."""
    truth, start = Truth(robot), robot.clamp(np.zeros(robot.n_joints))
    possible: list[Array] = []
    hopeless: list[Array] = []
    while len(possible) < n or len(hopeless) < n // 2:
        point = truth.unreachable(1, rng)[0]
        if not can_follow(robot, rig, start, _comes_to(point), _SHOWN_S):
            continue
        least = truth.least_turn(point)
        if np.isfinite(least) and least > np.deg2rad(3) and len(possible) < n:
            possible.append(point)
        elif not np.isfinite(least) and len(hopeless) < n // 2:
            hopeless.append(point)
    return possible, hopeless


def _way(of: Film) -> float:
    """How far the torso turned in all, rad."""
    return float(np.linalg.norm(np.diff(of.torso_rad, axis=0), axis=1).sum())


def _pictures(shown: dict[str, Any]) -> Figure:
    from pps_vision.robot.icub import load_icub

    robot = load_icub()
    figure, axes = plt.subplots(3, 3, figsize=(10.5, 8.6), layout="constrained", height_ratios=(3, 3, 2.4))
    views = {"left eye": icub_rig(robot), "a bystander": _bystander()}
    for row, (who, rig) in zip(axes, views.items(), strict=False):
        with Eyes(robot, rig, make_stimulus("ball")) as eyes:
            for axis, q, moment in zip(row, shown["joints_rad"], _MOMENTS, strict=True):
                frame = eyes.render(SceneState(np.array(q), np.array(shown["point_m"])), 0.0)
                axis.imshow(frame.left)
                axis.set(xticks=[], yticks=[])
                if who == "left eye":
                    axis.set_title(moment, fontsize=10)
        row[0].set_ylabel(who, fontsize=10)
    _curves(axes[2], shown)
    return figure


def _curves(axes: Array, shown: dict[str, Any]) -> None:
    t = _DT_S * np.arange(len(shown["modes"]))
    degree, torso = np.array(shown["degree"], dtype=float), np.array(shown["torso_deg"])
    axes[0].plot(t, torso[:, 0], label="yaw")
    axes[0].plot(t, torso[:, 1], label="pitch")
    axes[0].set(ylabel="torso (°)")
    axes[0].legend(fontsize=8)
    axes[1].plot(t, degree, color="C2")
    axes[1].axhline(0.5, color="0.4", lw=0.8, ls="--")
    axes[1].set(ylabel="degree R (reachable above 0.5)", ylim=(0, 1))
    axes[2].plot(t, shown["fixation_deg"], color="C3", label="fixation error (°)")
    axes[2].plot(t, np.array(shown["palm_mm"]) / 100, color="C0", label="palm to object (dm)")
    axes[2].set(ylabel="° or dm", ylim=(0, None))
    axes[2].legend(fontsize=8)
    for axis in axes:
        axis.set_xlabel("time (s)")
        axis.grid(alpha=0.25)


def _bystander() -> StereoRig:
    """A camera in front of the robot and to its right, in place of both eyes."""
    at, towards = np.array([-0.95, 0.75, 0.55]), np.array([-0.15, 0.05, 0.15])
    z = (towards - at) / np.linalg.norm(towards - at)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, np.cross(z, x), z, at
    camera = Camera(320, 240, 300.0, 300.0, 159.5, 119.5, (0.0,) * 5)
    return StereoRig(camera, camera, lambda _: (T, T))
