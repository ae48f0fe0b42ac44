"""No more than the scene needs: the cheapest tracker that meets an asked-for error (`track --max-error-mm`).

Every configuration, the cheapest first, follows the first seconds of the recording; its own covariance,
corrected by how far `pps-vision bench budget` found that to be from the truth, says whether it will do.
"""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pps_vision.types import Status, StereoFrame, Track3D
from tracking.eye import EyeParams
from tracking.particles import ParticleParams
from tracking.tracker import Tracker, TrackerParams

_PROBE_PAIRS = 60  # since the object was found
_SEARCH_PAIRS = 600
_WARM_UP = 10  # pairs after the first tracked one before the covariance has settled
_MIN_TRACKED = 0.9


@dataclass(frozen=True)
class Configuration:
    """One way to track: what it cost a pair and how its true 3D RMS error compared with the one it reports
    itself (the worst scene), both measured by `bench budget`."""

    name: str
    params: TrackerParams
    ms_per_pair: float
    true_over_reported: float


@dataclass(frozen=True)
class Probe:
    """What a configuration made of the recording's first seconds: the share of pairs tracked since it had the
    object, and the 3D error (mm, RMS) to be expected; NaN where it never had it."""

    name: str
    ms_per_pair: float
    tracked_share: float
    expected_mm: float


@dataclass(frozen=True)
class Choice:
    """The configuration to use, why, and what every one that was tried promised."""

    configuration: Configuration
    meets: bool
    reason: str
    probes: tuple[Probe, ...]

    def summary(self) -> dict[str, object]:
        """For summary.json."""
        tried = [
            {
                "name": p.name,
                "ms_per_pair": p.ms_per_pair,
                "tracked_share": p.tracked_share,
                "expected_mm": p.expected_mm,
            }
            for p in self.probes
        ]
        return {"configuration": self.configuration.name, "meets": self.meets, "why": self.reason, "tried": tried}


def _particles(count: int) -> TrackerParams:
    return TrackerParams(eye=EyeParams(particles=ParticleParams(count=count)))


CONFIGURATIONS = (
    Configuration("marker", TrackerParams(mode="marker"), 1.0, 1.0),
    Configuration("30 particles, centroid", _particles(30), 2.4, 1.0),
    Configuration("120 particles, centroid", _particles(120), 3.0, 1.0),
    Configuration("120 particles, disparity", replace(_particles(120), depth="disparity"), 4.0, 1.0),
)


def cheapest(
    frames: Iterable[StereoFrame],
    max_error_mm: float,
    tracker_for: Callable[[TrackerParams], Tracker],
    configurations: Sequence[Configuration] = CONFIGURATIONS,
) -> Choice:
    """The cheapest configuration whose 3D RMS error will be `max_error_mm` or less, from the first of a
    recording's `frames` (iterated anew for each); the most accurate one, saying so, where none will."""
    if not max_error_mm > 0:
        raise ValueError(f"--max-error-mm {max_error_mm}; expected a positive number of millimetres")
    probes: list[Probe] = []
    by_cost = sorted(configurations, key=lambda c: c.ms_per_pair)
    for configuration in by_cost:
        probe = _probe(configuration, frames, tracker_for(configuration.params))
        probes.append(probe)
        if probe.tracked_share >= _MIN_TRACKED and probe.expected_mm <= max_error_mm:
            reason = (
                f"the cheapest of {len(by_cost)} that keeps the object and whose expected error, "
                f"{probe.expected_mm:.2g} mm, is within {max_error_mm:g} mm"
            )
            return Choice(configuration, True, reason, tuple(probes))
    k = int(np.nanargmin([_regret(probe) for probe in probes]))
    reason = f"none of {len(by_cost)} is within {max_error_mm:g} mm; of those that keep the object, the most accurate"
    if not probes[k].tracked_share >= _MIN_TRACKED:
        reason = f"none of {len(by_cost)} keeps the object at first; our default"
        k = next(i for i, c in enumerate(by_cost) if c.params == TrackerParams())
    return Choice(by_cost[k], False, reason, tuple(probes))


def _regret(probe: Probe) -> float:
    return probe.expected_mm if probe.tracked_share >= _MIN_TRACKED and np.isfinite(probe.expected_mm) else 1e9


def _probe(configuration: Configuration, frames: Iterable[StereoFrame], tracker: Tracker) -> Probe:
    tracks: list[Track3D] = []
    for frame in itertools.islice(frames, _SEARCH_PAIRS):
        track = tracker.step(frame).track
        if tracks or track.is_known:
            tracks.append(track)
        if len(tracks) == _PROBE_PAIRS:
            break
    settled = tracks[_WARM_UP:]
    variances = [float(np.trace(t.cov[:3, :3])) for t in settled if t.status == Status.TRACKING]
    share = len(variances) / len(settled) if settled else 0.0
    expected = configuration.true_over_reported * 1000 * float(np.sqrt(np.mean(variances))) if variances else np.nan
    return Probe(configuration.name, configuration.ms_per_pair, share, expected)
