"""The messages of pps_vision: one frozen dataclass per arrow of the data path.

Time is a stamp in seconds, lengths are metres, angles radians, image points pixels
(integer coordinates are pixel centres).  A name says its unit where that is not obvious.
`T_root_left` maps left-camera coordinates into the root frame.  Arrays are read-only.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
CameraName = Literal["left", "right"]


class _Message:
    """Replaces its arrays by read-only views."""

    __slots__: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if isinstance(array := getattr(self, name), np.ndarray):
                view = array.view()
                view.flags.writeable = False
                object.__setattr__(self, name, view)


class Status(StrEnum):
    """How much the tracker knows about the object."""

    SEARCHING = "searching"  # nothing tracked, the motion trigger runs
    TRACKING = "tracking"  # measured in this frame
    COASTING = "coasting"  # predicted without a measurement
    LOST = "lost"  # unseen for too long; returned once, then searching


@dataclass(frozen=True, slots=True)
class StereoFrame(_Message):
    """One image per eye, each with its own stamp and the robot's joints at that stamp.

    Images are (height, width, 3) uint8 RGB.  Joints are the robot model's configuration
    vector (rad), or None where the cameras are fixed.
    """

    left: Image
    right: Image
    stamp_left_s: float
    stamp_right_s: float
    joints_left_rad: Array | None = None
    joints_right_rad: Array | None = None

    @property
    def stamp_s(self) -> float:
        """Mean stamp of the pair; results of both eyes carry it."""
        return 0.5 * (self.stamp_left_s + self.stamp_right_s)


@dataclass(frozen=True, slots=True)
class Detection2D(_Message):
    """The object in one eye's image.

    `center_px` (2,) is the projection of the object's centre, lens distortion included; `cov_px` (2, 2) its covariance;
    `angular_radius_rad` half the angle that the object subtends; `score` in [0, 1] the similarity of its appearance.
    """

    stamp_s: float
    camera: CameraName
    center_px: Array
    cov_px: Array
    score: float
    angular_radius_rad: float
    box_px: tuple[float, float, float, float]  # x, y of the top-left corner, width, height


@dataclass(frozen=True, slots=True)
class Truth(_Message):
    """The true position of a rendered object at one stamp.

    `position` m, `velocity` m/s (3,) in the root frame; `left_px`, `right_px` (2,) projections of its
    centre, lens distortion included, NaN behind a camera; visible: the centre lies in the image and
    only the object itself occludes it.
    """

    stamp_s: float
    position: Array
    velocity: Array
    radius_m: float
    left_px: Array
    right_px: Array
    visible_left: bool
    visible_right: bool


@dataclass(frozen=True, slots=True)
class Observation3D(_Message):
    """A triangulated position in the root frame: `p_root` (3,), `cov_root` (3, 3), m and m².

    `correlated_cov_root` (3, 3) m² is the part of `cov_root` whose error is correlated from frame to frame: errors of
    calibration and poses of the cameras, and of the object's shape.
    """

    stamp_s: float
    p_root: Array
    cov_root: Array
    radius_m: float
    radius_var_m2: float
    residual_px: float  # RMS reprojection error in both images
    correlated_cov_root: Array = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True, slots=True)
class Track3D(_Message):
    """The filtered object: position, velocity, acceleration and jerk in the root frame.

    `mean` (4, 3): row k is the k-th time derivative of position; `cov` (12, 12) in the order
    of `mean.ravel()`.  A filter of lower order leaves the rows it does not model at zero.
    While `status` is searching or lost, `mean` and `cov` are NaN.  `track_id` is the object's number.
    """

    stamp_s: float
    mean: Array
    cov: Array
    radius_m: float
    radius_var_m2: float
    status: Status
    track_id: int = 0

    @property
    def position(self) -> Array:
        """(3,) m."""
        return self.mean[0]

    @property
    def velocity(self) -> Array:
        """(3,) m/s."""
        return self.mean[1]

    @property
    def is_known(self) -> bool:
        """Whether there is a position to act on."""
        return self.status in (Status.TRACKING, Status.COASTING)

    @classmethod
    def unknown(cls, stamp_s: float, status: Status = Status.SEARCHING, track_id: int = 0) -> "Track3D":
        """A track without a state: NaN everywhere."""
        return cls(stamp_s, np.full((4, 3), np.nan), np.full((12, 12), np.nan), np.nan, np.nan, status, track_id)


@dataclass(frozen=True, slots=True)
class TaxelEvents(_Message):
    """Distance, time to contact and touch of every taxel at one stamp.

    `taxel_ids` (n,) are names "part:id"; `distance_m` D and `ttc_s` TTC (n,) follow R eqs 1
    and 2, NaN outside a taxel's receptive field; `touched` (n,) the skin's report; `miss_m` (n,)
    the smallest distance from the taxel to the object's surface on its extrapolated path (None: not predicted);
    `radius_m` of the object.
    """

    stamp_s: float
    taxel_ids: tuple[str, ...]
    distance_m: Array
    ttc_s: Array
    touched: Mask
    miss_m: Array | None = None
    radius_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Activation(_Message):
    """Predicted touch of every taxel at one stamp: `probability` (n,) for the taxels `taxel_ids` (R eqs 3–5)."""

    stamp_s: float
    taxel_ids: tuple[str, ...]
    probability: Array


class ReachStatus(StrEnum):
    """Answer of the reachable-space map for the tracked object."""

    REACHABLE = "reachable"
    UNREACHABLE = "unreachable"
    NOT_FIXATED = "not fixated"  # no gaze within the map's limits fixates it
    UNKNOWN = "unknown"  # nothing is tracked


@dataclass(frozen=True, slots=True)
class Reachability(_Message):
    """Whether the hand can reach the tracked object, at one stamp.

    `gaze_rad` (3,) is the gaze posture (neck yaw, neck pitch, vergence) that fixates it; `probability` that it is
    reachable; `degree` R in [0, 1], above 0.5 where reachable (J IV.6–IV.7).  All three are NaN where the status is
    not fixated or unknown.
    """

    stamp_s: float
    gaze_rad: Array
    probability: float
    degree: float
    status: ReachStatus

    @property
    def is_reachable(self) -> bool:
        """Whether the hand may be sent there."""
        return self.status == ReachStatus.REACHABLE

    @classmethod
    def without_answer(cls, stamp_s: float, status: ReachStatus) -> "Reachability":
        """The message for an object that is not fixated or unknown."""
        return cls(stamp_s, np.full(3, np.nan), np.nan, np.nan, status)


@dataclass(frozen=True, slots=True)
class JointVelocity(_Message):
    """A velocity command for the whole robot, `dq_rad_s` (n_joints,) rad/s in the model's joint order.

    It may be held for `hold_s` from its stamp; then the robot has to stop.
    """

    stamp_s: float
    dq_rad_s: Array
    hold_s: float
