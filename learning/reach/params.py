"""Parameters of the reachable-space map's training."""

from dataclasses import dataclass, field

import numpy as np

from pps_vision.errors import InputError
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.model import Robot
from pps_vision.robot.self_motion import DirectionCoverage, Measure, TwoStageParams

MAP = "reachable-space map"
_DEG = np.pi / 180
N_NEAR = 16  # babbled postures nearest to a point, among which inverse kinematics chooses its two starts


@dataclass(frozen=True)
class ArmLimits:
    """J's limits of the first four arm joints in the order of the chain (shoulder, elbow)."""

    lower_rad: tuple[float, ...] = (-95 * _DEG, 0.0, -20 * _DEG, 15 * _DEG)
    upper_rad: tuple[float, ...] = (10 * _DEG, 160 * _DEG, 80 * _DEG, 105 * _DEG)

    @classmethod
    def of(cls, robot: Robot, side: str) -> "ArmLimits":
        """The limits of all joints of an arm by the robot's URDF."""
        joints = robot.indices(robot.names.arm(side))
        return cls(tuple(robot.lower_rad[joints].tolist()), tuple(robot.upper_rad[joints].tolist()))


@dataclass(frozen=True)
class MapParams:
    """Extent and cost of the training."""

    gaze_limits: GazeLimits = field(default_factory=GazeLimits)
    """Gaze postures that the map covers."""
    arm_limits: ArmLimits = field(default_factory=ArmLimits)
    """Limits of the arm's joints."""
    n_labels: int = 6000
    """Largest number of labels."""
    round_labels: int = 1500
    """Labels per round, at least a sixteenth of those so far; the first round is uniform over all gaze postures."""
    max_error: float = 0.0
    """Training ends when tests show, with `confidence`, that no larger share of gaze postures is misjudged."""
    n_test: int = 0
    """Gaze postures of a test, none of which is learned from; 0: 10 / `max_error`, and no test without that."""
    confidence: float = 0.95
    """Probability that the bound of a map's error holds, whatever the number of tests."""
    n_babble: int = 100_000
    """Random arm postures among which inverse kinematics finds its starts."""
    inverse: TwoStageParams = field(default_factory=TwoStageParams)
    """Of inverse kinematics."""
    measure: Measure | DirectionCoverage | None = None
    """Measure that the second stage optimises; None: `FarFromLimits` (J IV.5)."""
    border_band: tuple[float, float] = (-0.14, 0.05)
    """Signed distances, in isotropic coordinates, between which later labels are drawn."""
    inside_share: float = 0.05
    """Share of the later labels drawn inside, beyond that band, for the degree of reachability: its RMSE there is 0.016
    without and 0.0034 with it (24 000 labels, two maps); with twice the share a sixth more are misjudged."""
    border_clearance: float = 0.017
    """Labels closer to the border than this, in isotropic coordinates, are no nodes of the spline; 0 misjudges a tenth
    more (6000 labels, three seeds)."""
    exact_m: float = 0.0
    """Distances left between end point and fixation point are as exact as the border up to this one."""
    lattice: float = 0.04
    """Step of the map's lattice in isotropic coordinates."""

    def __post_init__(self) -> None:
        if not 2 <= 2 * self.round_labels <= self.n_labels:
            rounds = f"{self.n_labels} labels in rounds of {self.round_labels}"
            raise InputError(MAP, f"{rounds}: expected at least two rounds, the later ones to test the earlier ones")
        if self.n_babble < N_NEAR:
            raise InputError(MAP, f"{self.n_babble} random arm postures: expected at least {N_NEAR}")
        if not (self.n_test >= 0 and 0 < self.confidence < 1):
            test = f"{self.n_test} test postures, confidence {self.confidence}"
            raise InputError(MAP, f"{test}: expected 0 or more, and 0 to 1")
        if not 0 <= self.max_error < 1:
            raise InputError(MAP, f"a share of {self.max_error} misjudged: expected at least 0 and below 1")

    @property
    def test_postures(self) -> int:
        """Number of gaze postures of a test: enough that a map with a third of the errors allowed usually passes."""
        return self.n_test or (int(np.ceil(10 / self.max_error)) if self.max_error else 0)
