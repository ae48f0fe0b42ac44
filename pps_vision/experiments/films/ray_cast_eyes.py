"""The ray caster in place of the renderer's eyes, and its solids as meshes."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from pps_vision.experiments.films.caster import (
    INSTANTS,
    Ball,
    FilmLens,
    Paint,
    Panel,
    RayCaster,
    SensorChain,
    Solid,
    Solids,
    noise_tape,
    visible_share,
)
from pps_vision.experiments.films.scenes import T_ROOT_STAGE_HEAD, head_pose
from pps_vision.experiments.study import DATA
from pps_vision.geometry.camera import StereoRig
from pps_vision.geometry.se3 import move_points
from pps_vision.robot.model import Robot
from pps_vision.types import Array, StereoFrame, Truth
from rendering.scene import PropPose, SceneState
from rendering.sensor import Sensor
from rendering.shapes import Color, Part, sphere
from rendering.stimuli import Stimulus

_SQUARES = 5  # squares of a chequered ball from pole to pole
_T_STAGE_ROOT = np.linalg.inv(T_ROOT_STAGE_HEAD)
_FRONT_WALL_M = 1.3
_ROUND = 1.05  # largest ratio of the extents of a prop that is a ball
_POINT_M = 1e-4


def chequered_ball(radius_m: float, color: Color, color2: Color) -> tuple[Part, ...]:
    """Return the meshes of a ball in two colours, about its centre: squares by longitude and latitude."""
    mesh = sphere(radius_m, color, fineness=5).mesh  # the edges are right to 1/40 of the radius
    x, y, z = mesh.triangles_center.T / np.linalg.norm(mesh.triangles_center, axis=1)
    u = (np.arctan2(y, x) / np.pi + 1) / 2
    v = np.arcsin(z.clip(-1, 1)) / np.pi + 0.5
    is_second = (np.floor(2 * _SQUARES * u) + np.floor(_SQUARES * v)) % 2 == 1
    first, second = mesh.submesh([np.flatnonzero(~is_second), np.flatnonzero(is_second)], repair=False)
    return Part(first, color), Part(second, color2)


class RayCastEyes(AbstractContextManager["RayCastEyes"]):
    """Ray-cast views of an iCub's eyes, with the interface of `rendering.eyes.Eyes`.

    States, stimuli (balls of one colour, or of two in squares) and props (boards, balls) are those of `rendering`;
    lens, eye poses, images and pixel truth are not. The robot is not shown.
    """

    def __init__(
        self,
        robot: Robot,
        rig: StereoRig,
        stimulus: Stimulus,
        sensor: Sensor | None = None,
        props: tuple[tuple[Part, ...], ...] = (),
        photo: int = 0,
        data: Path = DATA,
    ) -> None:
        if stimulus.name not in ("ball", "marker"):
            raise ValueError(f"stimulus {stimulus.name!r} in a ray-cast scene; expected ball or marker")
        self._joint_names = robot.joint_names
        self._sensor = sensor or Sensor()
        self._lenses = [FilmLens(eye.width, eye.height, eye.K, eye.lens) for eye in (rig.left, rig.right)]
        self._casters = [RayCaster(lens, photo, data, _FRONT_WALL_M) for lens in self._lenses]
        self._props = [_prop(parts) for parts in props]
        self._tape: Array | None = None
        self._radius_m = stimulus.radius_m
        self._paint = _paint_of(stimulus.parts)

    def __exit__(self, *_: object) -> None:
        """Free nothing."""

    def render(self, state: SceneState, stamp_s: float, rng: np.random.Generator) -> StereoFrame:
        """Return both eyes' images at one stamp; `rng` drives the sensor's noise."""
        n = INSTANTS if self._sensor.blur_s > 0 else 1
        states = [state.moved(self._sensor.blur_s * ((k + 0.5) / n - 0.5)) for k in range(n)]
        solids = [self._solids(moved) for moved in states]
        poses = [self._poses(moved) for moved in states]
        self._tape = noise_tape(rng) if self._tape is None else self._tape
        chain = SensorChain(read_noise=self._sensor.noise_sigma, shot=self._sensor.shot)
        left, right = (
            chain.expose(caster.light([pose[eye] for pose in poses], solids), self._sensor.exposure, rng, self._tape)
            for eye, caster in enumerate(self._casters)
        )
        q_rad = state.q_rad.copy()
        return StereoFrame(left, right, stamp_s, stamp_s, q_rad, q_rad)

    def truth(self, state: SceneState, stamp_s: float) -> Truth:
        """Return the stimulus's true position and pixels; NaN and not visible without a stimulus."""
        if state.position is None:
            nowhere = np.full(2, np.nan)
            return Truth(stamp_s, np.full(3, np.nan), state.velocity, self._radius_m, nowhere, nowhere, False, False)
        solids = self._solids(state)
        middle = Ball(solids[0].center, _POINT_M, self._paint)
        views = list(zip(self._lenses, self._poses(state), strict=True))
        left_px, right_px = (lens.project(pose, middle.center)[0] for lens, pose in views)
        visible = [visible_share(lens, pose, solids[1:], middle) > 0.5 for lens, pose in views]
        return Truth(stamp_s, state.position, state.velocity, self._radius_m, left_px, right_px, *visible)

    def _poses(self, state: SceneState) -> tuple[Array, Array]:
        joints = dict(zip(self._joint_names, state.q_rad.tolist(), strict=True))
        return _T_STAGE_ROOT @ head_pose(joints, "left"), _T_STAGE_ROOT @ head_pose(joints, "right")

    def _solids(self, state: SceneState) -> Solids:
        """The stimulus first, then the placed props."""
        if len(state.props) > len(self._props):
            raise ValueError(f"the scene's state places {len(state.props)} props; there are {len(self._props)}")
        solids: list[Solid] = []
        if state.position is not None:
            rotation = np.eye(3) if state.rotation is None else state.rotation
            R_stage_body = _T_STAGE_ROOT[:3, :3] @ rotation
            solids.append(Ball(move_points(_T_STAGE_ROOT, state.position), self._radius_m, self._paint, R_stage_body))
        placed = zip(state.props, self._props, strict=False)
        return (*solids, *(prop(place) for place, prop in placed if place is not None))


def _paint_of(parts: tuple[Part, ...]) -> Paint:
    colors = [(255.0 * part.color[0], 255.0 * part.color[1], 255.0 * part.color[2]) for part in parts]
    return Paint(colors[0]) if len(colors) == 1 else Paint(colors[0], "chequered", colors[1], _SQUARES)


def _prop(parts: tuple[Part, ...]) -> Callable[[PropPose], Ball | Panel]:
    """A ball if the extents are equal, else a board: x and y its edges, z its normal."""
    x, y, z = (float(side) for side in parts[0].mesh.extents)
    paint = _paint_of(parts)

    def solid(place: PropPose) -> Ball | Panel:
        center = move_points(_T_STAGE_ROOT, place.position)
        if max(x, y, z) < _ROUND * min(x, y, z):
            return Ball(center, max(x, y, z) / 2, paint)
        R = _T_STAGE_ROOT[:3, :3] @ (np.eye(3) if place.rotation is None else place.rotation)
        return Panel(center, x / 2 * R[:, 0], y / 2 * R[:, 1], paint)

    return solid
