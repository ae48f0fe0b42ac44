"""A made-up log of an episode."""

import numpy as np

from pps_vision.app.simulation import EpisodeLog
from pps_vision.types import Reachability, ReachStatus, Status

T = 11
STAMPS = 5.0 + 0.1 * np.arange(T)


def episode_log(with_reach: bool) -> EpisodeLog:
    """Two taxels, the second touched at the fifth and sixth stamp; reachable from the eighth stamp on."""
    rng = np.random.default_rng(0)
    truth = np.column_stack([0.01 * np.arange(T), np.zeros(T), np.full(T, 0.3)])
    touched = np.zeros((T, 2), bool)
    touched[4:6, 1] = True
    status = [ReachStatus.UNKNOWN] * 2 + [ReachStatus.UNREACHABLE] * 5 + [ReachStatus.REACHABLE] * 4
    reach = [Reachability(STAMPS[k], np.zeros(3), 0.5, k / 10, status[k]) for k in range(T)]
    return EpisodeLog(
        *("approach", ("arm:1", "arm:2"), STAMPS, (Status.TRACKING,) * T),
        *(truth, truth + np.array([0.003, 0.0, 0.004]), np.full((T, 3), 0.002), rng.uniform(0, 0.2, (T, 2))),
        *(rng.uniform(0, 1, (T, 2)), rng.uniform(0, 0.1, T), np.zeros(T, bool), touched, np.zeros((T, 3)), np.zeros(T)),
        tuple(reach) if with_reach else (),
    )
