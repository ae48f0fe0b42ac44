"""Parameters and state of avoidance and reaching, and what is commanded."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from control.arm import ArmParams, MovingPoint
from pps_vision.types import Array

Mode = Literal["idle", "avoid", "reach", "hold", "return"]


@dataclass(frozen=True)
class AvoidanceParams:
    """Response of one arm to its skin (R, "Avoidance and reaching")."""

    home_arm_rad: tuple[float, ...]
    """(k,) the arm's joints at home."""
    side: Literal["left", "right"] = "left"
    """The arm."""
    behaviour: Literal["avoid", "reach"] = "avoid"
    """Move against the normal of the control point, or towards the object."""
    threshold: float = 0.4
    """Activation above which a taxel responds."""
    speed_m_s: float = 0.10
    """Speed of the control point."""
    withdraws: Literal["taxels", "point"] = "taxels"
    """Every active taxel against its normal, by least squares and free to move across, and the nearest one reaches; or
    one point of each body part does either, against the mean normal (R)."""
    weighting: Literal["sum", "count"] = "sum"
    """What Σ a n is divided by: Σ a, so that the speed is constant (the robot's code), or the number of taxels, so that
    it grows with the activation (R eq. 6 as printed).  P is divided by Σ a in both: otherwise it is no point of the
    arm."""
    radius_m: float = 0.20
    """The palm stays this near to its place at home."""
    path_m: float = 0.05
    """An arm at rest responds only to what comes so near to its skin if it moves on as it has come; inf: to every
    activation (R).  D and TTC do not tell what passes from what comes."""
    come_m: float = 0.01
    """An arm at rest responds to a tracked object only if it has come nearer to the skin by so much within half
    a second, as the positions show, and then at once; 0: its estimated velocity decides.  That of an object that stops
    overshoots and points back for a quarter of a second; the positions do not."""
    confirm_s: float = 0.15
    """Time above threshold before the arm responds to what is not seen to come nearer."""
    clear_m: float = 0.05
    """Where the taxels' withdrawal is predicted to leave less between skin and object, and moving across the object's
    path to leave more, they move across; 0: never (R)."""
    persist_s: float = 0.3
    """Time for which avoidance outlasts the activation."""
    reach_damping_m: float = 0.03
    """Damping that an arm that reaches tries beside that of `arm`: with little damping joints turn fast against each
    other, and the last stage, which proves the whole motion clear of the body, slows them all; with more the arm stops
    at singular postures."""
    arm: ArmParams = field(default_factory=ArmParams)
    """Limits and damping of the arm."""

    @property
    def each_taxel(self) -> bool:
        """Whether every active taxel is a control point of its own."""
        return self.withdraws == "taxels"

    def __post_init__(self) -> None:
        if self.side not in ("left", "right") or self.behaviour not in ("avoid", "reach"):
            raise ValueError(f"{self.behaviour!r} by the {self.side!r} arm; expected avoid or reach, left or right")
        if self.weighting not in ("sum", "count") or self.withdraws not in ("taxels", "point"):
            raise ValueError(
                f"weighting {self.weighting!r}, withdraws {self.withdraws!r}; expected sum or count, taxels or point"
            )
        if not self.home_arm_rad or not np.isfinite(self.home_arm_rad).all():
            raise ValueError(f"home_arm_rad {self.home_arm_rad}; expected an angle for each joint")
        least_0 = self.confirm_s, self.persist_s, self.come_m, self.clear_m
        above_0 = self.threshold, self.path_m, self.speed_m_s, self.radius_m, self.reach_damping_m
        if not (all(v >= 0 for v in least_0) and all(v > 0 for v in above_0) and self.threshold <= 1):
            raise ValueError(f"{self}; expected no time below 0, the rest above, a threshold of at most 1")


@dataclass(frozen=True, slots=True)
class AvoidanceState:
    """What the arm does."""

    mode: Mode = "idle"
    since_s: float = 0.0
    """Stamp of the last activation that it responds to; of a hold and of the way home, when that began."""
    active_since_s: float = np.inf
    """Since when some taxel is above threshold without a break; inf if none is."""
    points: tuple[MovingPoint, ...] = ()
    """Control points with their commanded velocities, the most activated first."""
    blocked_by: Array | None = None
    """(3,) where the object was when it interrupted the return, m."""
    aimed_at: int | None = None
    """Number of the taxel that the object's path comes nearest to, for an arm that reaches."""
    aside: Array | None = None
    """(3,) direction across the object's path in which the control points move; None: against the normals."""
    seen: tuple[tuple[float, Array], ...] = ()
    """Stamps and positions (3,) m of the object in the last half second."""
    stamp_s: float = -np.inf
    """Stamp of the last step."""


@dataclass(frozen=True, slots=True)
class Response:
    """What is commanded, for reports."""

    mode: Mode
    velocity_root: Array
    """(3,) m/s of the most activated control point; zero unless the arm avoids or reaches."""
    point_root: Array
    """(3,) that control point, m; NaN unless the arm avoids or reaches."""
