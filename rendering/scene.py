"""State of the scene at one moment, and the drawable nodes that show it."""

from dataclasses import dataclass, field, replace

import numpy as np

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import move_points, transform
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from rendering.names import CarrierName
from rendering.renderer import Node
from rendering.shapes import Part, body_part, surface_of
from rendering.stimuli import Stimulus, carrier_parts, carrier_pose

TOWARDS_EXPERIMENTER = (-0.75, 0.25, 0.61)  # direction, root frame: the object is held from behind and above


@dataclass(frozen=True, slots=True)
class PropPose:
    """Pose of a prop in the root frame: position m, velocity m/s (used by motion blur only), rotation (3, 3)."""

    position: Array
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    rotation: Array | None = None

    def moved(self, dt_s: float) -> "PropPose":
        """The same `dt_s` later, at constant velocity."""
        return replace(self, position=self.position + dt_s * self.velocity)


@dataclass(frozen=True, slots=True)
class SceneState:
    """The scene at one stamp, root frame: the robot's joints and, unless `position` is None, the stimulus.

    `velocity` (m/s) and `dq_rad_s` are used by motion blur only; `rotation` (3, 3) is that of the stimulus;
    `carrier_direction` points from the stimulus to its carrier.  `props` holds the poses of the props that `Eyes`
    was given, in their order; None or a missing entry: not in the scene.  A board and a second ball:

        eyes = Eyes(robot, rig, ball, props=(make_stimulus("ball").parts, (board(0.1, 0.2),)))
        eyes.render(SceneState(q, p, v, props=(PropPose(p2, v2), PropPose(between, rotation=facing))), t)
    """

    q_rad: Array
    position: Array | None = None
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    dq_rad_s: Array | None = None
    rotation: Array | None = None
    carrier_direction: tuple[float, float, float] | Array = TOWARDS_EXPERIMENTER
    props: tuple[PropPose | None, ...] = ()

    def moved(self, dt_s: float) -> "SceneState":
        """The state `dt_s` later (or earlier), at constant velocities."""
        q = self.q_rad if self.dq_rad_s is None else self.q_rad + dt_s * self.dq_rad_s
        position = None if self.position is None else self.position + dt_s * self.velocity
        props = tuple(None if prop is None else prop.moved(dt_s) for prop in self.props)
        return replace(self, q_rad=q, position=position, props=props)


class Scene:
    """Nodes of a scene, of which only the poses change: arms, props, stimulus and its carrier, room.

    `held` lists all nodes but the room, which belongs to the renderer.
    """

    def __init__(
        self,
        robot: Robot,
        stimulus: Stimulus,
        carrier: CarrierName,
        props: tuple[tuple[Part, ...], ...],
        room: Node,
        fineness: int,
    ) -> None:
        self._robot = robot
        self._carrier_name = carrier
        self._room = room
        self._fineness = fineness
        frames = dict.fromkeys(body.frame for body in robot.bodies)
        self._bodies = {
            frame: Node(surface_of(body_part(b, fineness) for b in robot.bodies if b.frame == frame))
            for frame in frames
        }
        self._props = [Node(surface_of(parts)) for parts in props]
        self.held: list[Node] = []
        self.set_stimulus(stimulus)

    def set_stimulus(self, stimulus: Stimulus) -> None:
        """Replace the stimulus, and its carrier by one of the new size."""
        self.object = Node(surface_of(stimulus.parts))
        parts = carrier_parts(self._carrier_name, stimulus.radius_m, self._fineness)
        self._carrier = [Node(surface_of(parts))] if parts else []
        self.held[:] = [*self._bodies.values(), *self._props, self.object, *self._carrier]

    def arrange(self, state: SceneState) -> None:
        """Set the pose of every node; ValueError if the state has more props than the scene."""
        if len(state.props) > len(self._props):
            raise ValueError(f"the scene's state places {len(state.props)} props; there are {len(self._props)}")
        posture = self._robot.at(state.q_rad)
        for frame, node in self._bodies.items():
            node.T_root_node = posture.T_root(frame)
        self.nodes = [*self._bodies.values(), self._room]
        if state.position is not None:
            self.object.T_root_node = transform(state.rotation, state.position)
            for node in self._carrier:
                node.T_root_node = carrier_pose(state.position, state.carrier_direction)
            self.nodes += [self.object, *self._carrier]
        for prop, node in zip(state.props, self._props, strict=False):
            if prop is not None:
                node.T_root_node = transform(prop.rotation, prop.position)
                self.nodes.append(node)
        self._boxes_root = np.array([node.box_root for node in self.nodes])

    def in_view(self, view: View, slopes: tuple[float, float, float, float]) -> list[Node]:
        """Return the nodes whose boxes reach into a view between `slopes` (least x/z and y/z, greatest x/z and y/z);
        may include others."""
        left, top, right, bottom = slopes
        x, y, z = np.moveaxis(move_points(view.T_camera_root, self._boxes_root), -1, 0)
        beside = np.array([x < left * z, x > right * z, y < top * z, y > bottom * z, z < 0])
        is_outside = np.asarray(beside.all(axis=-1).any(axis=0))
        return [node for node, outside in zip(self.nodes, is_outside, strict=True) if not outside]
