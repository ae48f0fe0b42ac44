"""The eyes' views by the independent ray caster, with the interface of the renderer's `Eyes`."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pps_vision.experiments.independent_films import T_ROOT_STAGE_HEAD, head_pose
from pps_vision.experiments.independent_scenes import (
    EDGE_SAMPLES,
    Arrangement,
    Ball,
    Caster,
    Lens,
    Panel,
    Room,
    Surface,
    visible_share,
)
from pps_vision.experiments.sensor_chain import SensorChain, noise_tape
from pps_vision.experiments.study import DATA, SceneSource
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.robot.model import Robot
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, Image, Mask, StereoFrame, Truth
from rendering.eyes import Eyes
from rendering.scene import PropPose, SceneState
from rendering.sensor import Sensor
from rendering.shapes import Part
from rendering.stimuli import Stimulus

T_STAGE_ROOT = np.linalg.inv(T_ROOT_STAGE_HEAD)
_ROOM = Room(0, 1.3)
_ROUND = 1.05  # a prop's extents differ by less if it is a ball
_POINT_M = 1e-4


def eyes_of(source: SceneSource, photo: int) -> Callable[..., Any]:
    """What draws the eyes' views, called like `rendering.eyes.Eyes`; `photo` is behind independent scenes."""
    return Eyes if source == "rendered" else partial(IndependentEyes, room=Room(photo, _ROOM.ahead_m))


def own_body_of(source: SceneSource, robot: Robot) -> Silhouette:
    """Where the robot sees itself: independent scenes do not show it."""
    return Silhouette(robot) if source == "rendered" else _NoBody(robot)


class _NoBody(Silhouette):
    """A robot that is not in the picture."""

    def __call__(self, joints_rad: Array, view: Any) -> Mask:
        """(H, W) nothing."""
        return np.zeros((view.camera.height, view.camera.width), bool)


class IndependentEyes(AbstractContextManager["IndependentEyes"]):
    """The views of an iCub's eyes by ray casting, with the interface of `rendering.eyes.Eyes`.

    States, stimuli (balls: of one colour, or of two in squares) and props (boards, balls) are those of `rendering`;
    lens, poses of the eyes, images and pixel truth are not.  The robot itself is not shown.
    """

    def __init__(
        self,
        robot: Robot,
        rig: StereoRig,
        stimulus: Stimulus,
        carrier: str = "none",
        sensor: Sensor | None = None,
        props: tuple[tuple[Part, ...], ...] = (),
        room: Room = _ROOM,
        data: Path = DATA,
    ) -> None:
        if carrier != "none":
            raise ValueError(f"carrier {carrier!r} in an independent scene; expected none")
        if stimulus.name not in ("ball", "marker"):
            raise ValueError(f"stimulus {stimulus.name!r} in an independent scene; expected ball or marker")
        self._names, self._sensor = robot.joint_names, sensor or Sensor()
        self._lenses = tuple(_lens(camera) for camera in (rig.left, rig.right))
        self._casters = [Caster(lens, room, data) for lens in self._lenses]
        self._props = [_prop(parts) for parts in props]
        self._tape: Array | None = None
        self._radius_m, self._surface = stimulus.radius_m, _surface(stimulus.parts)

    def __exit__(self, *_: object) -> None:
        """Nothing to give back."""

    def render(self, state: SceneState, stamp_s: float, rng: np.random.Generator | None = None) -> StereoFrame:
        """Both eyes' images at one stamp; `rng` drives the sensor's noise."""
        n = EDGE_SAMPLES**2 if self._sensor.blur_s > 0 else 1
        states = [state.moved(self._sensor.blur_s * ((k + 0.5) / n - 0.5)) for k in range(n)]
        arrangements, poses = [self._arrangement(one) for one in states], [self._poses(one) for one in states]
        images = [self._picture(eye, [pose[eye] for pose in poses], arrangements, rng) for eye in (0, 1)]
        q_rad = state.q_rad.copy()
        return StereoFrame(images[0], images[1], stamp_s, stamp_s, q_rad, q_rad)

    def _picture(
        self, eye: int, poses: list[Array], arrangements: list[Arrangement], rng: np.random.Generator | None
    ) -> Image:
        light = self._casters[eye].light(poses, arrangements)
        if rng is None:
            if self._sensor.is_noisy:
                raise ValueError("a noisy sensor asks for a random generator, got None")
            return np.clip(light * self._sensor.exposure + 0.5, 0, 255).astype(np.uint8)
        self._tape = noise_tape(rng) if self._tape is None else self._tape
        chain = SensorChain(read_noise=self._sensor.noise_sigma, shot=self._sensor.shot)
        return chain.expose(light, self._sensor.exposure, rng, self._tape)

    def truth(self, state: SceneState, stamp_s: float) -> Truth:
        """Where the stimulus really is and appears; NaN and not visible where there is none."""
        if state.position is None:
            place, pixel = np.full(3, np.nan), np.full(2, np.nan)
            return Truth(stamp_s, place, state.velocity, self._radius_m, pixel, pixel, False, False)
        scene = self._arrangement(state)
        ball, *others = scene.balls
        middle = Ball(ball.center, _POINT_M, ball.surface)
        arrangement = Arrangement((middle, *others), scene.panels)
        views = list(zip(self._lenses, self._poses(state), strict=True))
        left, right = (lens.project(pose, ball.center)[0] for lens, pose in views)
        seen = [visible_share(lens, pose, arrangement, middle, ()) > 0.5 for lens, pose in views]
        return Truth(stamp_s, state.position, state.velocity, self._radius_m, left, right, seen[0], seen[1])

    def _poses(self, state: SceneState) -> tuple[Array, Array]:
        joints = dict(zip(self._names, state.q_rad.tolist(), strict=True))
        return T_STAGE_ROOT @ head_pose(joints, "left"), T_STAGE_ROOT @ head_pose(joints, "right")

    def _arrangement(self, state: SceneState) -> Arrangement:
        """The stimulus first, then the props that are placed."""
        if len(state.props) > len(self._props):
            raise ValueError(f"the scene's state places {len(state.props)} props; there are {len(self._props)}")
        R, o = T_STAGE_ROOT[:3, :3], T_STAGE_ROOT[:3, 3]
        things: list[Ball | Panel] = []
        if state.position is not None:
            turn = np.eye(3) if state.rotation is None else state.rotation
            things.append(Ball(R @ state.position + o, self._radius_m, self._surface, R @ turn))
        for place, prop in zip(state.props, self._props, strict=False):
            if place is not None:
                things.append(prop(place))
        balls = tuple(one for one in things if isinstance(one, Ball))
        return Arrangement(balls, tuple(one for one in things if isinstance(one, Panel)))


def _lens(camera: Camera) -> Lens:
    return Lens(camera.width, camera.height, camera.K, camera.lens)


def _surface(parts: tuple[Part, ...]) -> Surface:
    colors = [(255.0 * part.color[0], 255.0 * part.color[1], 255.0 * part.color[2]) for part in parts]
    return Surface(colors[0]) if len(colors) == 1 else Surface(colors[0], "chequered", colors[1], 5)


def _prop(parts: tuple[Part, ...]) -> Callable[[PropPose], Ball | Panel]:
    """A ball if it is as long as wide and high, else a board: x and y its edges, z its normal."""
    x, y, z = (float(side) for side in parts[0].mesh.extents)
    surface, R, o = _surface(parts), T_STAGE_ROOT[:3, :3], T_STAGE_ROOT[:3, 3]

    def placed(place: PropPose) -> Ball | Panel:
        center = R @ place.position + o
        if max(x, y, z) < _ROUND * min(x, y, z):
            return Ball(center, max(x, y, z) / 2, surface)
        turn = R @ (np.eye(3) if place.rotation is None else place.rotation)
        return Panel(center, x / 2 * turn[:, 0], y / 2 * turn[:, 1], surface)

    return placed
