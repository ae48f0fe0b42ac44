"""The films of `independent_films` by our own renderer: an iCub's eyes before the rendered room."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
import trimesh

from pps_vision.experiments.independent_films import Film, IndependentScene, camera_of, robot_joints
from pps_vision.experiments.independent_scenes import Ball, Color, Panel, Surface, Thing
from pps_vision.experiments.sensor_chain import noise_tape
from pps_vision.experiments.study import DATA
from pps_vision.geometry.camera import StereoRig
from pps_vision.geometry.se3 import rotation_to
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.types import Array, Mask, StereoFrame
from rendering.eyes import Eyes
from rendering.scene import PropPose, SceneState
from rendering.sensor import Sensor
from rendering.shapes import Part, board, sphere
from rendering.stimuli import Stimulus

_FINENESS = {"plain": 4, "striped": 5, "chequered": 5}  # of balls; a pattern's edges are right to 1/40 of the radius
_NECK_AT_REST = {"neck_pitch": 0.0, "neck_yaw": 0.0, "neck_roll": 0.0}
_INSTANT_S = 1e-4  # over which velocities are taken


class RenderedFilm(Film):
    """A scene's film by our renderer.  Motion, sensor and truth are those of `Film`, the images are not.

    The eyes are an iCub's, 68 mm apart, and its neck does what turns or shakes a rig.  The room takes the place of the
    photographs.  ValueError for a square or a texture, which the renderer does not have.
    """

    def __init__(self, scene: IndependentScene, seed: int, data: Path = DATA) -> None:
        if not can_render(scene):
            raise ValueError(f"a {scene.pattern} {scene.shape}; expected a ball without texture")
        super().__init__(replace(scene, rig="head", rig_known=False), seed, data)
        self._moves, self._is_told = scene.rig, scene.rig == "head" or scene.rig_known

    def head_joints(self, t_s: float) -> dict[str, float]:
        """The head at a moment, rad."""
        if self._moves == "head":
            return super().head_joints(t_s)
        half = float(np.arctan2(0.034, self.scene.distance_m))
        turn = self.turn(self._moves, t_s).tolist()
        neck = dict(zip(("neck_pitch", "neck_yaw", "neck_roll"), turn, strict=True))
        return {**neck, "left_eye_pan": half, "right_eye_pan": -half}

    def joints(self, t_s: float) -> Array | None:
        """What comes with an image of that stamp: the head's configuration, if the rig is not declared fixed."""
        return super().joints(t_s) if self._is_told else None

    @cached_property
    def _true_rig(self) -> StereoRig:
        return icub_rig(load_icub(), *(camera_of(lens) for lens in self._eyes))

    @cached_property
    def rig(self) -> StereoRig:
        """The cameras, and their poses by the frame's joints, or at rest if they are declared fixed."""
        true = self._true_rig
        at_rest = true.eye_poses(self._configuration({**self.head_joints(0.0), **_NECK_AT_REST}))
        return true if self._is_told else StereoRig(true.left, true.right, lambda _: at_rest)

    @staticmethod
    def _configuration(joints: dict[str, float]) -> Array:
        return np.array([joints.get(name, 0.0) for name in robot_joints()])

    @cached_property
    def _background_mean(self) -> Array:
        plain = Stimulus("ball", 0.01, (sphere(0.01, (1.0, 1.0, 1.0)),))
        with Eyes(load_icub(), self._true_rig, plain) as eyes:
            empty = eyes.render(SceneState(self._configuration(self.head_joints(0.0))), 0.0)
        return np.asarray(empty.left.mean(axis=(0, 1)))

    def _things(self, t_s: float) -> tuple[Thing, ...]:
        return (*self.arrangement(t_s).things, *self._still)

    def _state(self, t_s: float) -> SceneState:
        """The scene for the renderer, with the velocities that blur it."""
        R, o = self.T_root_stage[:3, :3], self.T_root_stage[:3, 3]
        before, after = t_s - _INSTANT_S / 2, t_s + _INSTANT_S / 2
        q_rad, ahead = (self._configuration(self.head_joints(t)) for t in (t_s, after))
        dq_rad_s = 2 * (ahead - q_rad) / _INSTANT_S
        ends = zip(self._things(before), self._things(after), strict=True)
        rates = [R @ (end.center - begin.center) / _INSTANT_S for begin, end in ends]
        places = [
            PropPose(R @ one.center + o, rate, R @ _turn(one))
            for one, rate in zip(self._things(t_s), rates, strict=True)
        ]
        ball, *props = places
        return SceneState(q_rad, ball.position, ball.velocity, dq_rad_s, ball.rotation, props=tuple(props))

    def __iter__(self) -> Iterator[StereoFrame]:
        """The frames, in the order of their stamps."""
        ball, *props = (_parts(one) for one in self._things(0.0))
        rng = np.random.default_rng((self.seed, 1))
        tape = noise_tape(rng)
        stimulus, light = Stimulus("ball", self.scene.radius_m, ball), Sensor(blur_s=self.scene.shutter_s)
        with Eyes(load_icub(), self._true_rig, stimulus, "none", light, tuple(props)) as eyes:
            for t in self.stamps_s.tolist():
                drawn = eyes.render(self._state(t), t)
                images = [
                    self.scene.sensor.expose(image.astype(np.float32), self.gain(eye, t), rng, tape)
                    for eye, image in enumerate((drawn.left, drawn.right))
                ]
                joints = self.joints(t)
                yield StereoFrame(images[0], images[1], t, t, joints, joints)


def can_render(scene: IndependentScene) -> bool:
    """Whether our renderer has what a scene shows."""
    return scene.shape == "ball" and scene.pattern in _FINENESS


def _parts(one: Thing) -> tuple[Part, ...]:
    """Meshes of a thing, about its centre."""
    color, color2 = _color(one.surface.color), _color(one.surface.color2)
    if isinstance(one, Panel):
        return (board(2 * float(np.linalg.norm(one.right)), 2 * float(np.linalg.norm(one.down)), color),)
    if not isinstance(one, Ball):
        length_m = 2 * float(np.linalg.norm(one.half))
        return (Part(trimesh.creation.cylinder(one.radius_m, length_m, sections=48), color),)
    ball = sphere(one.radius_m, color, fineness=_FINENESS[one.surface.pattern])
    if one.surface.pattern == "plain":
        return (ball,)
    second = _is_second(one.surface, ball.mesh.triangles_center)
    parts = ball.mesh.submesh([np.flatnonzero(~second), np.flatnonzero(second)], repair=False)
    return Part(parts[0], color), Part(parts[1], color2)


def _color(levels: Color) -> Color:
    return levels[0] / 255, levels[1] / 255, levels[2] / 255


def _is_second(surface: Surface, points: Array) -> Mask:
    """Where points (n, 3) of a ball have its second colour: stripes across x, or squares by longitude and latitude."""
    x, y, z = (points / np.linalg.norm(points, axis=1, keepdims=True)).T
    if surface.pattern == "striped":
        return np.asarray(np.floor((x + 1) * surface.count) % 2 == 1)
    u, v = (np.arctan2(y, x) / np.pi + 1) / 2, np.arcsin(z.clip(-1, 1)) / np.pi + 0.5
    return np.asarray((np.floor(2 * u * surface.count) + np.floor(v * surface.count)) % 2 == 1)


def _turn(one: Thing) -> Array:
    """(3, 3) from a thing's mesh to the stage: a board's x and y are its edges, a cylinder's z its axis."""
    if isinstance(one, Ball):
        return one.R_stage_body
    if isinstance(one, Panel):
        x, y = (edge / np.linalg.norm(edge) for edge in (one.right, one.down))
        return np.column_stack([x, y, np.cross(x, y)])
    return rotation_to(one.half)
