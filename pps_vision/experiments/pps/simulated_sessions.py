"""Pairs of simulated sessions like the real robot's, for choices that must not be made on real outcomes.

An object approaches four taxels 2–3 cm apart. It is aimed mostly between two of them and touches those within the
radius of a virtual taxel; some taxels report fewer touches than others. The observed paths have an offset of the
session, an error of the trial, and noise. The second session's offset differs by about a centimetre.
"""

from dataclasses import dataclass

import numpy as np

from learning.pps.trials import SAMPLE_PERIOD_S, Trial
from pps_vision.types import Array, Mask

TAXELS_M = np.array([[0.0, 0.0, 0.0], [0.012, 0.019, 0.0], [0.027, 0.014, 0.0], [-0.015, 0.026, 0.0]])
AIMED = np.array([12.0, 1.5, 1.0, 5.0])  # of a Dirichlet distribution: how often at each taxel
BETWEEN_M = np.array([-0.003, 0.005])  # aims are the mean of a taxel and this point
LANDING_M, TOUCH_M, TOUCH_SD_M, SKIN_SD_M = 0.007, (0.015, 0.020), 0.003, 0.004
SENSITIVITY = ((0.97, 0.3, 0.03, 0.6), (0.95, 0.9, 0.9, 0.9))  # probability that a touched taxel reports it
TRIAL_ERROR_M, NOISE_M = (0.007, 0.011), 0.004
OFFSET_M, CHANGE_M = 0.02, 0.01  # of a session, and from one to the next


@dataclass(frozen=True)
class SimulatedRobot:
    """What is the same in both sessions: where the experimenter aims, how taxels report, and the errors."""

    aims: Array
    sensitivity: Array
    touch_m: float
    trial_error_m: float


def two_sessions(
    rng: np.random.Generator, n: tuple[int, int] = (37, 40)
) -> tuple[tuple[Trial, ...], tuple[Trial, ...]]:
    """Return a session to train on and another to test on, with different offsets."""
    robot = SimulatedRobot(
        rng.dirichlet(AIMED), np.array(SENSITIVITY[rng.integers(2)]), rng.choice(TOUCH_M), rng.choice(TRIAL_ERROR_M)
    )
    offset = rng.normal(0, OFFSET_M, 3)
    first = tuple(_trial(robot, offset, rng) for _ in range(n[0]))
    offset = offset + rng.normal(0, CHANGE_M, 3)
    return first, tuple(_trial(robot, offset, rng) for _ in range(n[1]))


def _trial(robot: SimulatedRobot, offset: Array, rng: np.random.Generator) -> Trial:
    while True:  # only trials that end in a touch are recorded
        landing = 0.5 * (TAXELS_M[rng.choice(4, p=robot.aims), :2] + BETWEEN_M) + rng.normal(0, LANDING_M, 2)
        touched = _touched(robot, landing, rng)
        if touched.any():
            break
    error = offset + rng.normal(0, robot.trial_error_m, 3)
    stamps = SAMPLE_PERIOD_S * np.arange(12)
    before = (stamps[-1] - stamps)[:, None]
    slope = np.array([*rng.normal(0, 0.03, 2), rng.uniform(0.08, 0.14)])  # m/s, away from the landing point
    path = np.array([*landing, 0.0]) + before * slope + error + rng.normal(0, NOISE_M, (len(stamps), 3))
    d = path[:, None] - TAXELS_M
    return Trial(stamps, d, np.broadcast_to(-slope, d.shape), touched)


def _touched(robot: SimulatedRobot, landing: Array, rng: np.random.Generator) -> Mask:
    away = np.linalg.norm(landing - TAXELS_M[:, :2], axis=1) + rng.normal(0, SKIN_SD_M, 4)
    touched: Mask = (away < robot.touch_m + rng.normal(0, TOUCH_SD_M)) & (rng.random(4) < robot.sensitivity)
    return touched
