"""A robot described by a URDF: poses of its frames, their Jacobians, its bodies; by Pinocchio."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pps_vision.errors import InputError
from pps_vision.geometry.se3 import move_points
from pps_vision.robot.chain import Chain
from pps_vision.robot.urdf import read_urdf
from pps_vision.types import Array

_ARM = (
    *("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow"),
    *("wrist_prosupination", "wrist_pitch", "wrist_yaw"),
)


@dataclass(frozen=True)
class FrameNames:
    """Names of a URDF's links and joints by their function; another robot is used by naming its own."""

    left_eye: str = "left_eye"  # link with the axes of the left camera
    right_eye: str = "right_eye"  # link with the axes of the right camera
    palms: tuple[str, str] = ("left_palm", "right_palm")  # links of the palms
    index_tips: tuple[str, str] = ("left_index_tip", "right_index_tip")  # links at the tips of the index fingers
    gaze_joints: tuple[str, ...] = ("neck_yaw", "neck_pitch", "eyes_tilt", "left_eye_pan", "right_eye_pan")
    """Neck yaw, neck pitch, eyes tilt, and the pans of the eyes in the same sense; vergence is left minus right.
    Empty: cameras that do not turn towards anything."""
    torso: tuple[str, ...] = ("torso_yaw", "torso_pitch")  # yaw and pitch of the torso
    left_arm: tuple[str, ...] = tuple(f"left_{joint}" for joint in _ARM)
    """Joints of the left arm from shoulder to wrist."""
    right_arm: tuple[str, ...] = tuple(f"right_{joint}" for joint in _ARM)
    """Joints of the right arm from shoulder to wrist."""

    def arm(self, side: str) -> tuple[str, ...]:
        """The joint names of the "left" or "right" arm, shoulder first; ValueError for any other."""
        return (self.left_arm, self.right_arm)[_number_of(side)]

    def palm(self, side: str) -> str:
        """The palm's link of the "left" or "right" arm; ValueError for any other."""
        return self.palms[_number_of(side)]


def _number_of(side: str) -> int:
    """0 for "left", 1 for "right"; ValueError for any other."""
    if side not in ("left", "right"):
        raise ValueError(f"side {side!r}: expected left or right")
    return int(side == "right")


@dataclass(frozen=True)
class Body:
    """A rigid body of the robot."""

    name: str  # name of its link and its number there, "left_palm_0"
    frame: str  # its link
    shape: Literal["sphere", "cylinder", "box"]  # a cylinder's axis is z
    size_m: tuple[float, ...]  # (radius,) of a sphere, (radius, length) of a cylinder, the three sides of a box
    T_frame_body: Array  # (4, 4) pose in the link
    color: tuple[float, float, float]  # RGB, 0–1


class Robot:
    """A robot's kinematics and shape.  Immutable; `at(q)` evaluates it at a posture."""

    def __init__(
        self,
        urdf: Path,
        names: FrameNames | None = None,
        root: str | None = None,
        mounted: Mapping[str, tuple[str, Array]] | None = None,
    ) -> None:
        """Read a URDF of revolute, continuous and prismatic joints; InputError for a missing file, link or joint.

        Joints that mimic others are in the configuration too, where they follow their masters.

        Args:
            urdf: File; its meshes are looked for in the folders above it and in ROS_PACKAGE_PATH.
            names: Names of its links and joints by function.
            root: Link that serves as root frame, which no joint moves; default: the URDF's own.
            mounted: Frames that the URDF lacks, by name: their link and pose (4, 4) there.
        """
        names = names or FrameNames()
        self.urdf = urdf
        try:
            text, followers = read_urdf(urdf)
            self.model = pin.buildModelFromXML(text)
            self.geometry = pin.buildGeomFromUrdfString(self.model, text, pin.GeometryType.VISUAL)
        except (ValueError, RuntimeError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(urdf, f"cannot be read as URDF: {str(error).strip().splitlines()[0]}") from error
        self._mount(mounted or {})
        if root is not None:
            self._rebase(root)
        self.names = names
        self.joint_names: tuple[str, ...] = tuple(self.model.names)[1:]
        self.followers = {item.joint: item for item in followers}
        self._following = [  # positions of joint and master, factor, offset
            (self.joint_names.index(item.joint), self.joint_names.index(item.master), item.factor, item.offset)
            for item in followers
        ]
        self.lower_rad: Array = self.model.lowerPositionLimit.copy()
        self.upper_rad: Array = self.model.upperPositionLimit.copy()
        self.lower_rad.flags.writeable = self.upper_rad.flags.writeable = False
        self.frame_ids = {f.name: i for i, f in enumerate(self.model.frames) if f.type != pin.FrameType.JOINT}
        self.spare_data: list[pin.Data] = []
        missing = [f for f in (names.left_eye, names.right_eye) if f not in self.frame_ids]
        missing += [j for j in names.gaze_joints if j not in self.joint_names]
        if missing:
            raise InputError(urdf, f"lacks {', '.join(missing)}; name its own frames and joints in FrameNames")

    def _mount(self, mounted: Mapping[str, tuple[str, Array]]) -> None:
        for name, (link, T_link_frame) in mounted.items():
            if not self.model.existFrame(link, pin.FrameType.BODY):
                raise InputError(self.urdf, f"lacks link {link!r}, which is to carry {name}")
            index = self.model.getFrameId(link, pin.FrameType.BODY)
            carrier = self.model.frames[index]
            placement = carrier.placement * pin.SE3(T_link_frame)
            self.model.addFrame(pin.Frame(name, carrier.parentJoint, index, placement, pin.FrameType.OP_FRAME))

    def _rebase(self, root: str) -> None:
        """Express everything in the frame of a link that no joint moves."""
        if not self.model.existFrame(root, pin.FrameType.BODY):
            raise InputError(self.urdf, f"lacks link {root!r}, which is to be the root frame")
        frame = self.model.frames[self.model.getFrameId(root, pin.FrameType.BODY)]
        if frame.parentJoint != 0:
            raise InputError(self.urdf, f"root frame {root} is moved by joints; expected a link that none moves")
        T = frame.placement.inverse()
        for joint in range(1, self.model.njoints):
            if self.model.parents[joint] == 0:
                self.model.jointPlacements[joint] = T * self.model.jointPlacements[joint]
        for placed in (*self.model.frames, *self.geometry.geometryObjects):
            if placed.parentJoint == 0:
                placed.placement = T * placed.placement

    @property
    def n_joints(self) -> int:
        """Length of the configuration vector."""
        return len(self.joint_names)

    def indices(self, joints: tuple[str, ...]) -> list[int]:
        """Positions of named joints in the configuration vector; ValueError for an unknown one."""
        if unknown := [name for name in joints if name not in self.joint_names]:
            raise ValueError(f"no joint {unknown[0]!r}; this robot has {', '.join(self.joint_names)}")
        return [self.joint_names.index(name) for name in joints]

    def frame_id(self, frame: str) -> int:
        """Pinocchio's number of a frame; ValueError for an unknown one."""
        if frame not in self.frame_ids:
            raise ValueError(f"no frame {frame!r}; this robot has {', '.join(self.frame_ids)}")
        return self.frame_ids[frame]

    def at(self, q_rad: ArrayLike) -> "Posture":
        """The robot at configuration `q_rad` (n_joints,)."""
        return Posture(self, self._checked(q_rad))

    def eye_poses(self, q_rad: ArrayLike | None) -> tuple[Array, Array]:
        """(T_root_left, T_root_right), the form `StereoRig` asks for."""
        if q_rad is None:
            raise InputError("robot", "the frame carries no joints, but this robot's eyes move with them")
        q = self._checked(q_rad)
        (left, of_left), (right, of_right) = self._eyes
        return left.pose(q[of_left]), right.pose(q[of_right])

    @cached_property
    def _eyes(self) -> list[tuple[Chain, list[int]]]:
        """The chain of all joints that move each eye, and their positions in the configuration vector."""
        eyes = self.names.left_eye, self.names.right_eye
        return [(self.chain(self.moving(eye), eye), self.indices(self.moving(eye))) for eye in eyes]

    def chain(self, joints: tuple[str, ...], frame: str, q_base: ArrayLike | None = None) -> Chain:
        """Return the chain of the named joints that ends at `frame`, with the other joints at `q_base` (default zero).
        ValueError where the robot has no such joint or frame."""
        indices = self.indices(joints)
        q = np.zeros(self.n_joints) if q_base is None else np.array(q_base, dtype=float)
        q[indices] = 0.0
        q = self.complete(q)
        q[indices] = 0.0  # also of joints that follow
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, q)
        T_root_frame = np.ascontiguousarray(data.oMf[self.frame_id(frame)].homogeneous)
        J = pin.computeFrameJacobian(self.model, data, q, self.frame_id(frame), pin.ReferenceFrame.WORLD)
        gains = np.eye(len(joints))
        for name in self._supports(frame):
            if name in self.followers and name not in joints and self.followers[name].master in joints:
                indices.append(self.joint_names.index(name))
                gains = np.vstack(
                    [gains, self.followers[name].factor * gains[joints.index(self.followers[name].master)]]
                )
        order = tuple(int(i) for i in np.argsort(indices))  # Pinocchio numbers parents before children
        screws = np.ascontiguousarray(J.T[indices])
        return Chain(joints, order, screws, T_root_frame, gains if len(gains) > len(joints) else None)

    def moving(self, frame: str) -> tuple[str, ...]:
        """The names of the joints that move a frame, from root to tip; then the masters of followers."""
        supports = self._supports(frame)
        masters = [self.followers[name].master for name in supports if name in self.followers]
        return tuple(dict.fromkeys((*supports, *masters)))

    def _supports(self, frame: str) -> list[str]:
        """The names of the joints between the root and a frame."""
        supports = self.model.supports[self.model.frames[self.frame_ids[frame]].parentJoint]
        return [self.joint_names[joint - 1] for joint in supports if joint]

    def complete(self, q_rad: Array, is_change: bool = False) -> Array:
        """The configuration (n_joints,), or a change, with the joints that follow where their masters bring them."""
        if not self._following:
            return q_rad
        q = q_rad.copy()
        for joint, master, factor, offset in self._following:
            q[joint] = factor * q[master] + (0.0 if is_change else offset)
        return q

    def fold(self, J: Array) -> Array:
        """The Jacobian (m, n_joints) by the joints that move by themselves: the columns of others are added to their
        masters'."""
        for joint, master, factor, _ in self._following:
            J[:, master] += factor * J[:, joint]
            J[:, joint] = 0.0
        return J

    def _checked(self, q_rad: ArrayLike) -> Array:
        """A copy of a configuration (n_joints,); InputError for a wrong length or a value that is not finite."""
        q: Array = np.array(q_rad, dtype=float)
        if q.shape != (self.n_joints,) or not math.isfinite(sum(q.tolist())):
            reason = f"joints {np.array2string(q, precision=3)}"
            raise InputError("posture", f"{reason}; expected {self.n_joints} finite angles")
        return self.complete(q)

    def clamp(self, q_rad: Array) -> Array:
        """The nearest configuration within the joint limits."""
        return np.clip(q_rad, self.lower_rad, self.upper_rad)

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """The URDF's visuals; of meshes the bounding box."""
        return tuple(self._body(geometry) for geometry in self.geometry.geometryObjects)

    def _body(self, obj: Any) -> Body:
        frame = self.model.frames[obj.parentFrame]
        shape = obj.geometry
        # Pinocchio places visuals relative to the moving joint, not to their link
        T_frame_body = (frame.placement.inverse() * obj.placement).homogeneous
        kind: Any = type(shape).__name__.lower()
        if kind == "sphere":
            size = [shape.radius]
        elif kind == "cylinder":
            size = [shape.radius, 2 * shape.halfLength]
        else:
            size = (2 * shape.halfSide).tolist()
        return Body(obj.name, frame.name, kind, tuple(size), T_frame_body, tuple(obj.meshColor[:3].tolist()))


class Posture:
    """A robot at one configuration.  It owns its evaluation, so postures never alias."""

    def __init__(self, robot: Robot, q_rad: Array) -> None:
        self.robot = robot
        self.q_rad = q_rad
        self.q_rad.flags.writeable = False
        # a new one takes 50 µs, the evaluation itself 1 µs
        self._data = robot.spare_data.pop() if robot.spare_data else robot.model.createData()
        pin.framesForwardKinematics(robot.model, self._data, q_rad)

    def __del__(self) -> None:
        """Return Pinocchio's data for reuse by a later posture."""
        self.robot.spare_data.append(self._data)

    def T_root(self, frame: str) -> Array:
        """`T_root_frame` (4, 4)."""
        return np.asarray(self._data.oMf[self.robot.frame_id(frame)].homogeneous)

    def point(self, frame: str, point: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """A point (…, 3) of `frame` in root coordinates."""
        return move_points(self.T_root(frame), point)

    def jacobian(self, frame: str, point: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """(6, n_joints) ∂(position of the point, orientation of the frame)/∂q in root axes, m/rad and rad/rad.

        The point (3,) is fixed in `frame`.
        """
        index = self.robot.frame_id(frame)
        J: Array = pin.computeFrameJacobian(
            self.robot.model, self._data, self.q_rad, index, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        lever = self._data.oMf[index].rotation @ np.asarray(point, dtype=float)
        J[:3] -= pin.skew(lever) @ J[3:]
        return self.robot.fold(J)
