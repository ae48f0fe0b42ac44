"""Trackers with a constant answer are not judged stable."""

from collections.abc import Callable

import numpy as np
import pytest
from films import circle
from judge import Demand, check
from test_past_the_break import DISTURBANCES, LEAP, leaping
from tracks import track_at

from pps_vision.types import Array, Status, Track3D

STAMPS = np.arange(80) / 20
Position = Callable[[float], Array]


def track(stamp_s: float, position: Array, std_m: float = 0.0005, status: Status = Status.TRACKING) -> Track3D:
    return track_at(position, stamp_s=stamp_s, cov=std_m**2, status=status)


def unknown(demand: Demand, position: Position) -> list[Track3D]:
    return [Track3D.unknown(t) for t in STAMPS]


def last_known(demand: Demand, position: Position) -> list[Track3D]:
    """Right before and after."""
    last = max(t for t in STAMPS if t < demand.from_s - 1e-6)
    return [track(t, position(last if demand.from_s - 1e-6 < t < demand.to_s - 1e-6 else t)) for t in STAMPS]


def as_sure_as_ever(demand: Demand, position: Position) -> list[Track3D]:
    """Right all the time."""
    return [track(t, position(t)) for t in STAMPS]


def honest(demand: Demand, position: Position) -> list[Track3D]:
    """Coasts, and gives up in time."""
    tracks = []
    for t in STAMPS:
        since = t - demand.from_s + 0.05
        if not 0.01 < since < demand.to_s - demand.from_s + 0.04:
            tracks.append(track(t, position(t)))
        elif since < 0.51 or demand.during == "degraded":
            tracks.append(track(t, position(t), 0.002 + 0.01 * since, Status.COASTING))
        else:
            tracks.append(Track3D.unknown(t, Status.LOST if since < 0.56 else Status.SEARCHING))
    return tracks


DEMANDS = {name: (value.demand, circle) for name, value in DISTURBANCES.items()} | {"leap": (LEAP, leaping)}


@pytest.mark.parametrize("name", DEMANDS)
def test_only_an_honest_tracker_passes(name):
    demand, position = DEMANDS[name]
    truth = np.array([position(t) for t in STAMPS])
    check(demand, honest(demand, position), truth)
    for fake in (unknown, last_known, as_sure_as_ever):
        with pytest.raises(AssertionError):
            check(demand, fake(demand, position), truth)
