"""What is where at one moment, and the drawable stage that is arranged to show it."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from typing import Any

import numpy as np
import trimesh

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import move_points, transform
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask
from rendering.carriers import CarrierName, carrier_parts, carrier_pose
from rendering.offscreen import pyrender
from rendering.room import room_mesh
from rendering.shapes import Part, body_part
from rendering.stimuli import Stimulus

TOWARDS_EXPERIMENTER = (-0.75, 0.25, 0.61)  # who stands before the robot, holding things from behind and above


def _still() -> Array:
    return np.zeros(3)


@dataclass(frozen=True, slots=True)
class Placed:
    """Where a prop is, root frame: m, m/s (for motion blur only), and how it is turned (3, 3)."""

    position: Array
    velocity: Array = field(default_factory=_still)
    rotation: Array | None = None

    def moved(self, dt_s: float) -> "Placed":
        """The same `dt_s` later, at constant velocity."""
        return replace(self, position=self.position + dt_s * self.velocity)


@dataclass(frozen=True, slots=True)
class SceneState:
    """The world at one stamp, root frame: the robot's joints and, unless `position` is None, the stimulus.

    `velocity` (m/s) and `dq_rad_s` matter only to motion blur; `rotation` (3, 3) turns the
    stimulus; `carrier_direction` points from the stimulus to whoever holds it.  `props` says where
    the things are that the `Eyes` were given as props, in their order; None, or beyond the end: not
    there.  So a board hides the stimulus while a second ball passes:

        eyes = Eyes(robot, rig, ball, props=(make_stimulus("ball").parts, (board(0.1, 0.2),)))
        eyes.render(SceneState(q, p, v, props=(Placed(p2, v2), Placed(between, rotation=facing))), t)
    """

    q_rad: Array
    position: Array | None = None
    velocity: Array = field(default_factory=_still)
    dq_rad_s: Array | None = None
    rotation: Array | None = None
    carrier_direction: tuple[float, float, float] | Array = TOWARDS_EXPERIMENTER
    props: tuple[Placed | None, ...] = ()

    def moved(self, dt_s: float) -> "SceneState":
        """The state `dt_s` later (or earlier), at constant velocities."""
        q = self.q_rad if self.dq_rad_s is None else self.q_rad + dt_s * self.dq_rad_s
        position = None if self.position is None else self.position + dt_s * self.velocity
        props = tuple(None if prop is None else prop.moved(dt_s) for prop in self.props)
        return replace(self, q_rad=q, position=position, props=props)


class Stage:
    """A pyrender scene of which only the poses change: room, arms, stimulus and its carrier, props."""

    def __init__(
        self, robot: Robot, stimulus: Stimulus, carrier: CarrierName, props: tuple[tuple[Part, ...], ...] = ()
    ) -> None:
        self.scene = pyrender.Scene(ambient_light=np.ones(3), bg_color=np.zeros(4))
        self._robot, self._carrier_name = robot, carrier
        self.room = self.scene.add(room_mesh())
        self._corners: dict[Any, Array] = {}  # (8, 3) of the box around each movable node, in its frame
        self._boxes_root = np.zeros((0, 8, 3))  # the same where they are now, in the same order
        frames = dict.fromkeys(body.frame for body in robot.bodies)
        self._bodies = {frame: self._add(body_part(b) for b in robot.bodies if b.frame == frame) for frame in frames}
        self._props = [self._add(parts) for parts in props]
        self.object: Any = None
        self._carrier: Any = None
        self.set_stimulus(stimulus)

    def _add(self, parts: Iterable[Part]) -> Any:
        node = self.scene.add(mesh_of(parts))
        self._corners[node] = _corners(node.mesh.bounds)
        return node

    def set_stimulus(self, stimulus: Stimulus) -> None:
        """Put another stimulus, and a carrier of its size, in place of the present one."""
        for node in (self.object, self._carrier):
            if node is not None:
                self.scene.remove_node(node)
                del self._corners[node]
        self.object = self._add(stimulus.parts)
        parts = carrier_parts(self._carrier_name, stimulus.radius_m)
        self._carrier = self._add(parts) if parts else None

    def arrange(self, state: SceneState) -> None:
        """Put everything where the state says it is; ValueError where it places more props than there are."""
        if len(state.props) > len(self._props):
            raise ValueError(f"the scene's state places {len(state.props)} props; there are {len(self._props)}")
        posture = self._robot.at(state.q_rad)
        for frame, node in self._bodies.items():
            self.scene.set_pose(node, posture.T_root(frame))
        if state.position is not None:
            self.scene.set_pose(self.object, transform(state.rotation, state.position))
            if self._carrier is not None:
                self.scene.set_pose(self._carrier, carrier_pose(state.position, state.carrier_direction))
        for prop, node in zip(state.props, self._props, strict=False):
            if prop is not None:
                self.scene.set_pose(node, transform(prop.rotation, prop.position))
        self._boxes_root = np.array([move_points(node.matrix, box) for node, box in self._corners.items()])

    def show(self, state: SceneState, view: View) -> None:
        """Show all that reaches into a pinhole view, and no more: a node drawn costs 0.3 ms."""
        absent = [] if state.position is not None else [self.object, self._carrier]
        absent += [node for node, prop in zip_longest(self._props, state.props) if prop is None]
        for node, is_in_view in zip(self._corners, _reach_into(view, self._boxes_root), strict=True):
            node.mesh.is_visible = bool(is_in_view) and node not in absent
        self.room.mesh.is_visible = True

    def show_only_object(self) -> None:
        """Hide all but the stimulus."""
        for node in self.scene.mesh_nodes:
            node.mesh.is_visible = node is self.object


def _corners(bounds: Array) -> Array:
    """(8, 3) of a box given by its lowest and highest corner (2, 3)."""
    return np.array([[x, y, z] for x in bounds[:, 0] for y in bounds[:, 1] for z in bounds[:, 2]])


def _reach_into(view: View, boxes_root: Array) -> Mask:
    """(n,) which boxes (n, 8, 3) reach into a pinhole's field of view; it may err towards yes."""
    camera = view.camera
    x, y, z = np.moveaxis(move_points(view.T_camera_root, boxes_root), -1, 0)
    left, top = (-0.5 - camera.cx) / camera.fx, (-0.5 - camera.cy) / camera.fy
    right, bottom = left + camera.width / camera.fx, top + camera.height / camera.fy
    beside = np.array([x < left * z, x > right * z, y < top * z, y > bottom * z, z < 0])
    return np.asarray(~beside.all(axis=-1).any(axis=0))


def mesh_of(parts: Iterable[Part]) -> Any:
    """All parts as one pyrender mesh, drawn in one go; edges sharper than 50° stay sharp."""
    vertices, normals, colors, faces, count = [], [], [], [], 0
    for part in parts:
        shaded = trimesh.graph.smooth_shade(part.mesh, angle=np.deg2rad(50))
        vertices.append(shaded.vertices)
        normals.append(shaded.vertex_normals)
        colors.append(np.tile([*part.color, 1.0], (len(shaded.vertices), 1)))
        faces.append(shaded.faces + count)
        count += len(shaded.vertices)
    primitive = pyrender.Primitive(
        positions=np.vstack(vertices), normals=np.vstack(normals), color_0=np.vstack(colors), indices=np.vstack(faces)
    )
    return pyrender.Mesh([primitive])
