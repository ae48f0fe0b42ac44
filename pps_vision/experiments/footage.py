"""Stereo frames with their truth: what a camera crew would bring back, and who films it."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from control.fixation import gaze_at
from pps_vision.experiments.peers import BoxPx, sphere_box
from pps_vision.experiments.scene_sources import eyes_of, own_body_of
from pps_vision.experiments.study import SceneSource
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import home, icub_rig, load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, Mask, StereoFrame
from rendering.motions import Motion
from rendering.scene import Placed, SceneState
from rendering.shapes import Part
from rendering.stimuli import Stimulus, make_stimulus

Posing = Callable[[float, Array, Array], Array]  # time, configuration a frame ago, object's place → configuration

EYES_M = np.array([-0.063, 0.0, 0.341])  # between the eyes of the robot at home, root frame
_SWAY_RAD, _SWAY_HZ = np.deg2rad([4.0, 2.5]), np.array([0.31, 0.23])  # the head's own motion: yaw, pitch


@dataclass(frozen=True)
class Footage:
    """`frames` (n), the true `position` (n, 3) m of an object of `radius_m` in the root frame at each, `seen`
    (n,) whether both eyes can see it, its true `boxes` in the first frame, and the `rig` as the tracker is told;
    (n,) which frames are `asked` about, if not all, and where an equally good object is (`or_position`), if any;
    and where the robot sees itself."""

    frames: tuple[StereoFrame, ...]
    position: Array
    seen: Mask
    boxes: tuple[BoxPx, BoxPx]
    radius_m: float
    rig: StereoRig
    own_body: Silhouette
    asked: Mask | None = None
    or_position: Array | None = None

    @property
    def stamps_s(self) -> Array:
        """(n,) of the pairs."""
        return np.array([frame.stamp_s for frame in self.frames])

    def judged(self, settle_s: float) -> Mask:
        """(n,) where the object has been in sight for `settle_s`: there a tracker should know where it is."""
        stamps, since, judged = self.stamps_s, np.nan, np.zeros(len(self.frames), bool)
        for k, (stamp, seen) in enumerate(zip(stamps, self.seen, strict=True)):
            since = (since if np.isfinite(since) else stamp) if seen else np.nan
            judged[k] = seen and stamp - since >= settle_s - 1e-6
        return judged if self.asked is None else judged & self.asked


class Studio:
    """Films a robot's view of an object, and of `props` by their names; made by `open_studio`."""

    def __init__(self, robot: Robot, rig: StereoRig, eyes: Any, props: tuple[str, ...], own_body: Silhouette) -> None:
        self.robot, self.rig, self._eyes, self._props = robot, rig, eyes, props
        self.own_body = own_body

    def film(
        self,
        motion: Motion,
        seconds: float,
        pose: Posing,
        fps: float = 20.0,
        stimulus: Stimulus | None = None,
        props: Callable[[float], Mapping[str, Placed]] = lambda _: {},
        empty: bool = False,
    ) -> Footage:
        """Noiseless; `empty` films the scene without the object.  What props hide is not `seen`."""
        stimulus = stimulus or make_stimulus("ball")
        self._eyes.set_stimulus(stimulus)
        q, frames, path, seen = home(self.robot), [], [], []
        for t in np.arange(round(seconds * fps)) / fps:
            p, v = motion(t)
            q = pose(t, q, p)
            placed = props(t)
            state = SceneState(q, None if empty else p, v, props=tuple(placed.get(name) for name in self._props))
            frames.append(self._eyes.render(state, t))
            path.append(p)
            seen.append(self._is_seen(state, p, bool(placed)))
        first = self.rig.view_of(frames[0])
        left, right = (sphere_box(eye, path[0], stimulus.radius_m) for eye in (first.left, first.right))
        if left is None or right is None:
            raise ValueError(f"footage begins at {path[0]}, out of an eye's view; expected both to see it there")
        return Footage(
            tuple(frames), np.array(path), np.array(seen), (left, right), stimulus.radius_m, self.rig, self.own_body
        )

    def _is_seen(self, state: SceneState, p: Array, something_may_hide_it: bool) -> bool:
        if something_may_hide_it:
            truth = self._eyes.truth(state, 0.0)
            return truth.visible_left and truth.visible_right
        view = self.rig.view(state.q_rad)
        return view.left.sees(p) and view.right.sees(p)

    def follow(self, t: float, q: Array, p: Array) -> Array:
        """The eyes on the object, the head swaying by itself."""
        q = gaze_at(self.robot, q, p)
        yaw_pitch = self.robot.indices(self.robot.names.gaze_joints)[:2]
        q[yaw_pitch] += _SWAY_RAD * np.sin(2 * np.pi * _SWAY_HZ * t)
        return self.robot.clamp(q)

    def stare_at(self, p: Array) -> Posing:
        """The head still, the eyes on a point (3,)."""
        q = gaze_at(self.robot, home(self.robot), p)
        return lambda *_: q


@contextmanager
def open_studio(
    props: Mapping[str, tuple[Part, ...]], source: SceneSource = "rendered", photo: int = 0
) -> Iterator[Studio]:
    """A studio with its props; leaving gives the graphics memory back.  `photo` is behind independent scenes."""
    robot = load_icub()
    rig = icub_rig(robot)
    with eyes_of(source, photo)(robot, rig, make_stimulus("ball"), props=tuple(props.values())) as eyes:
        yield Studio(robot, rig, eyes, tuple(props), own_body_of(source, robot))
