"""Recordings of moving objects with their truth, drawn by our renderer or by the ray caster."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from control.fixation import gaze_at
from pps_vision.app.render import scene, stimulus_of
from pps_vision.app.render_params import RenderParams
from pps_vision.experiments.baselines.image_trackers import BoxPx, sphere_box
from pps_vision.experiments.films.ray_cast_eyes import RayCastEyes
from pps_vision.experiments.films.scenes import Film
from pps_vision.experiments.study import NOISE_SIGMA, SceneSource
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import home, icub_rig, icub_setup, load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, Mask, StereoFrame, Truth
from rendering.eyes import Eyes
from rendering.motions import Motion
from rendering.names import MotionName
from rendering.scene import PropPose, SceneState
from rendering.sensor import Sensor
from rendering.shapes import Part
from rendering.stimuli import Stimulus
from tracking.marker import MarkerParams
from tracking.tracker import TrackerParams

FPS = 20.0
EYES_M = np.array([-0.063, 0.0, 0.341])  # midway between the eyes of the robot at home, root frame
MOTIONS: tuple[MotionName, ...] = ("approach", "linear", "circle", "figure8", "jerk")
APPROACHES = {
    f"{100 * v:g} cm/s": {"motion": "approach", "speed": v, "seconds": 0.31 / v + 0.2} for v in (0.05, 0.1, 0.2, 0.3)
}
"""Approaches that end on the skin, by speed."""
KINDS: dict[str, dict[str, Any]] = {
    f"{stimulus}, {name}": {"stimulus": stimulus, **options}
    for group in ({motion: {"motion": motion} for motion in MOTIONS}, APPROACHES)
    for stimulus in ("ball", "marker")
    for name, options in group.items()
}
"""Recordings that judge covariances and filters: every motion, and approaches at every speed."""
HUES_DEG = {"ball": 0.0, "marker": 120.0}
Boxes = tuple[BoxPx | None, BoxPx | None]
PosePolicy = Callable[[float, Array, Array], Array]
"""(time, configuration of the last frame, object's position) → configuration."""
_JUMP_M_S = 0.04  # change of the velocity between two frames
_SWAY_RAD = np.deg2rad([4.0, 2.5])
_SWAY_HZ = np.array([0.31, 0.23])


@dataclass(frozen=True)
class Footage:
    """Stereo frames of one object with their truth; arrays have one row a frame, in the root frame."""

    frames: tuple[StereoFrame, ...]  # (n) stereo pairs
    position: Array  # (n, 3) m, the object's centre
    velocity: Array  # (n, 3) m/s
    visible: Mask  # (n,) whether both eyes see the object
    boxes: tuple[Boxes, ...]
    """(n) true boxes in the left and the right image; None where an eye does not see the object."""
    radius_m: float  # the object's radius
    rig: StereoRig  # cameras and poses for the tracker
    own_body: Silhouette | None  # the robot's silhouette for the tracker; None: it is not shown
    stimulus: str = "ball"  # name of the object
    in_question: Mask | None = None  # (n,) frames that count, if not all

    @property
    def stamps_s(self) -> Array:
        """(n,) of the pairs."""
        return np.array([frame.stamp_s for frame in self.frames])

    @property
    def first_boxes(self) -> tuple[int, tuple[BoxPx, BoxPx]]:
        """Index and true boxes of the first frame in which both eyes see the object: input of the baselines."""
        for k, (left, right) in enumerate(self.boxes):
            if left is not None and right is not None:
                return k, (left, right)
        raise ValueError("the object is never in view of both eyes; expected boxes to start with")

    @property
    def jumped(self) -> Mask:
        """(n,) frames within two frames after a jump of the velocity, which no hand makes."""
        jump = np.concatenate([[False], np.linalg.norm(np.diff(self.velocity, axis=0), axis=1) > _JUMP_M_S])
        return jump | np.concatenate([[False], jump[:-1]])

    def touch(self) -> tuple[Array, Array]:
        """Return the point (3,) at which an object on a straight path stops and touches, and the time (n,) until then.

        NaN where the object does not come to rest, or did not move uniformly before.
        """
        speed = np.linalg.norm(self.velocity, axis=1)
        ttc = np.full(len(speed), np.nan)
        rests = np.flatnonzero(speed < 1e-9)
        if not len(rests) or rests[0] == 0 or np.ptp(speed[: rests[0]]) > 1e-6:
            return np.full(3, np.nan), ttc
        first = int(rests[0])
        path = self.position[first] - self.position[0]
        ttc[:first] = np.linalg.norm(self.position[first] - self.position[:first], axis=1) / speed[:first]
        return self.position[first] + self.radius_m * path / np.linalg.norm(path), ttc

    def judged(self, settle_s: float) -> Mask:
        """Return the frames (n,) that count: in question, and the object visible for `settle_s`."""
        since_s = np.nan
        judged = np.zeros(len(self.frames), bool)
        for k, (stamp_s, visible) in enumerate(zip(self.stamps_s, self.visible, strict=True)):
            since_s = (since_s if np.isfinite(since_s) else stamp_s) if visible else np.nan
            judged[k] = visible and stamp_s - since_s >= settle_s - 1e-6
        return judged if self.in_question is None else judged & self.in_question


def tracker_params(recording: Footage, mode: str | None = None) -> TrackerParams:
    """Return the tracker's defaults in the mode for the recording's object, or in the given mode."""
    if (mode or {"ball": "generic"}.get(recording.stimulus, "marker")) == "generic":
        return TrackerParams()
    return TrackerParams("marker", marker=MarkerParams(HUES_DEG[recording.stimulus]))


def film(
    states: Iterable[tuple[float, SceneState]],
    stimulus: Stimulus,
    source: SceneSource = "rendered",
    sensor: Sensor | None = None,
    seed: int = 0,
    rng: np.random.Generator | None = None,
    props: tuple[tuple[Part, ...], ...] = (),
) -> Footage:
    """Draw a robot's views at stamps and states.

    The seed chooses the photograph behind ray-cast scenes, and drives the sensor unless `rng` does.
    """
    robot = load_icub()
    rig = icub_rig(robot)
    rng = np.random.default_rng(seed) if rng is None else rng
    frames = []
    truth = []
    draw: Callable[..., Any] = Eyes if source == "rendered" else partial(RayCastEyes, photo=seed)
    with draw(robot, rig, stimulus, sensor=sensor or Sensor(), props=props) as eyes:
        for t, state in states:
            truth.append(eyes.truth(state, t))
            frames.append(eyes.render(state, t, rng))
    boxes = []
    for frame, row in zip(frames, truth, strict=True):
        view = rig.view_of(frame)
        eye_visible = ((view.left, row.visible_left), (view.right, row.visible_right))
        left, right = (sphere_box(eye, row.position, row.radius_m) if visible else None for eye, visible in eye_visible)
        boxes.append((left, right))
    own_body = Silhouette(robot) if source == "rendered" else None
    return _footage(frames, truth, boxes, rig, own_body, stimulus.name)


def _footage(
    frames: Sequence[StereoFrame],
    truth: Sequence[Truth],
    boxes: Sequence[Boxes],
    rig: StereoRig,
    own_body: Silhouette | None,
    stimulus: str,
) -> Footage:
    visible = np.array([row.visible_left and row.visible_right for row in truth])
    position = np.array([row.position for row in truth])
    velocity = np.array([row.velocity for row in truth])
    radius_m = float(truth[0].radius_m)
    return Footage(tuple(frames), position, velocity, visible, tuple(boxes), radius_m, rig, own_body, stimulus)


def from_film(independent: Film) -> Footage:
    """Return the recording of a ray-cast film, which shows no robot."""
    boxes = ((None, None),) * len(independent)
    return _footage(list(independent), independent.truth, boxes, independent.rig, None, "ball")


def moving(
    stimulus: Any,
    motion: Any,
    seed: int,
    seconds: float,
    source: SceneSource = "rendered",
    noise: float = NOISE_SIGMA,
    **options: Any,
) -> Footage:
    """Return the recording that `pps-vision render` writes of one of its motions, or its states by ray casting."""
    params = RenderParams(stimulus, motion, Path(), seconds=seconds, noise=noise, seed=seed, **options)
    rng = np.random.default_rng(seed)
    states = list(scene(params, icub_setup(), rng))
    sensor = Sensor(params.noise, params.shot, params.exposure, params.blur_s)
    return film(states, stimulus_of(params, 3), source, sensor, seed, rng)


def of_kind(kind: str, source: SceneSource, seconds: float, seed: int) -> Footage:
    """Return a recording of one of `KINDS`; `seconds` is the length of all but approaches at a given speed."""
    return moving(**{"seconds": seconds, **KINDS[kind]}, seed=seed, source=source)


def watching(
    motion: Motion,
    seconds: float,
    pose: PosePolicy,
    fps: float = FPS,
    props: Callable[[float], tuple[PropPose | None, ...]] = lambda _: (),
    empty: bool = False,
) -> Iterator[tuple[float, SceneState]]:
    """Yield stamps and states of a robot that watches a motion; `empty` leaves the object out."""
    q = home(load_icub())
    for t in np.arange(round(seconds * fps)) / fps:
        p, v = motion(t)
        q = pose(t, q, p)
        yield float(t), SceneState(q, None if empty else p, v, props=props(t))


def follow(robot: Robot) -> PosePolicy:
    """Keep the eyes on the object while the neck sways."""
    yaw_pitch = robot.indices(robot.names.gaze_joints)[:2]

    def pose(t: float, q: Array, p: Array) -> Array:
        q = gaze_at(robot, q, p)
        q[yaw_pitch] += _SWAY_RAD * np.sin(2 * np.pi * _SWAY_HZ * t)
        return robot.clamp(q)

    return pose


def stare_at(robot: Robot, point: Array) -> PosePolicy:
    """Keep the head still and the eyes on a point (3,)."""
    q = gaze_at(robot, home(robot), point)
    return lambda *_: q
