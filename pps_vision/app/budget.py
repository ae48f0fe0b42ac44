"""The fastest tracker configuration within an error limit (`track --max-error-mm`).

The configurations track the first seconds of the recording, the fastest first.  The expected error of each is that of
its covariance, times the ratio of true to reported error that `pps-vision bench budget` measured.
"""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from time import process_time

import numpy as np
from scipy.special import chdtri

from pps_vision.errors import InputError
from pps_vision.types import Observation3D, Status, StereoFrame
from tracking.kalman import KalmanParams, gate, predict, scaled, start, update
from tracking.tracker import Tracker, TrackerParams, TrackerStep

_PROBE_PAIRS = 60  # tracked from the first detection on
_SEARCH_PAIRS = 600  # searched for the first detection
_WARM_UP = 10  # pairs after the first detection until the covariance has converged
_MIN_TRACKED = 0.9  # smallest share of tracked pairs
_NARROWEST_PX = 160  # of a reduced image: in smaller ones few objects have enough pixels


@dataclass(frozen=True)
class Configuration:
    """Parameters of the tracker, and what `bench budget` measured of them."""

    name: str
    params: TrackerParams
    true_over_reported: float
    """Ratio of the true 3D RMS error to that of the covariance, in the worst scene."""


@dataclass(frozen=True)
class Probe:
    """Result of a configuration on the first seconds of the recording."""

    name: str
    ms_per_pair: float
    """Median processor time of a stereo pair."""
    tracked_share: float
    """Share of pairs tracked from the first detection on."""
    expected_mm: float
    """Expected 3D RMS error; NaN where nothing was detected."""


@dataclass(frozen=True)
class Choice:
    """The chosen configuration, with the filter's order chosen for this motion."""

    asked_mm: float
    """The limit of the 3D RMS error."""
    configuration: Configuration
    meets: bool
    """Whether its expected error is within the limit."""
    reason: str
    """Why it was chosen, in words."""
    probes: tuple[Probe, ...]
    """Results of the configurations that were tried."""

    def summary(self) -> dict[str, object]:
        """For summary.json."""
        return {
            "asked_mm": self.asked_mm,
            "configuration": self.configuration.name,
            "filter_order": self.configuration.params.kalman.order,
            "meets": self.meets,
            "why": self.reason,
            "tried": [asdict(probe) for probe in self.probes],
        }


CONFIGURATIONS = (  # ratios: the worst kind of scene of `bench budget` that is tracked in 90 % of the frames
    Configuration("marker", TrackerParams(mode="marker"), 1.5),
    Configuration("pixels 4 × 4", TrackerParams(reduction=4), 2.0),
    Configuration("pixels 2 × 2", TrackerParams(reduction=2), 2.0),
    Configuration("all pixels", TrackerParams(), 2.0),
)
"""From the fastest to the most accurate."""


def configurations(width_px: int) -> tuple[Configuration, ...]:
    """Those of `CONFIGURATIONS` that leave an image so wide at least `_NARROWEST_PX` wide."""
    return tuple(c for c in CONFIGURATIONS if c.params.reduction in range(1, max(2, width_px // _NARROWEST_PX + 1)))


def cheapest(
    frames: Iterable[StereoFrame],
    max_error_mm: float,
    tracker_for: Callable[[TrackerParams], Tracker],
    configurations: Sequence[Configuration] = CONFIGURATIONS,
) -> Choice:
    """The first configuration whose expected 3D RMS error is within `max_error_mm`, or else the most accurate one.

    `configurations` stand from the fastest to the slowest; `frames` are iterated once for each that is tried.
    """
    if not max_error_mm > 0:
        raise InputError("track", f"--max-error-mm {max_error_mm}; expected a positive number of millimetres")
    probes: list[Probe] = []
    ordered: list[Configuration] = []
    count = len(configurations)
    for configuration in configurations:
        steps, ms = _follow(frames, tracker_for(configuration.params))
        probes.append(probe := _probe(configuration, steps, ms))
        ordered.append(_with_order(configuration, steps))
        if probe.tracked_share >= _MIN_TRACKED and probe.expected_mm <= max_error_mm:
            reason = (
                f"the fastest of {count} that tracks the object and whose expected error, "
                f"{probe.expected_mm:.2g} mm, is within {max_error_mm:g} mm"
            )
            return Choice(max_error_mm, ordered[-1], True, reason, tuple(probes))
    tracking = [k for k, probe in enumerate(probes) if probe.tracked_share >= _MIN_TRACKED]
    if tracking:
        k = min(tracking, key=lambda k: probes[k].expected_mm)
        reason = f"none of {count} is within {max_error_mm:g} mm; the most accurate of those that track the object"
    else:
        k = next(i for i, c in enumerate(configurations) if c.params == TrackerParams())
        reason = f"none of {count} tracks the object in the first seconds; the default"
    return Choice(max_error_mm, ordered[k], False, reason, tuple(probes))


def _follow(frames: Iterable[StereoFrame], tracker: Tracker) -> tuple[list[TrackerStep], list[float]]:
    """The tracker's steps from the first detection on, and their processor times (ms)."""
    steps: list[TrackerStep] = []
    ms: list[float] = []
    for frame in itertools.islice(frames, _SEARCH_PAIRS):
        begun = process_time()
        step = tracker.step(frame)
        if steps or step.track.is_known:
            steps.append(step)
            ms.append(1000 * (process_time() - begun))
        if len(steps) == _PROBE_PAIRS:
            break
    return steps, ms


def _probe(configuration: Configuration, steps: Sequence[TrackerStep], ms: Sequence[float]) -> Probe:
    settled = [step.track for step in steps[_WARM_UP:]]
    variances = [float(np.trace(t.cov[:3, :3])) for t in settled if t.status == Status.TRACKING]
    share = len(variances) / len(settled) if settled else 0.0
    expected = configuration.true_over_reported * 1000 * float(np.sqrt(np.mean(variances))) if variances else np.nan
    return Probe(configuration.name, float(np.median(ms)) if ms else np.nan, share, expected)


def _with_order(configuration: Configuration, steps: Sequence[TrackerStep]) -> Configuration:
    """The configuration with the lowest order of filter, from 2 (the skin needs a velocity), whose innovations are no
    larger than expected (the mean of n squared Mahalanobis distances is below the upper end of its 95 % band about 3);
    unchanged where none is."""
    seen = [step.observation for step in steps if step.observation is not None]
    if len(seen) <= _WARM_UP:
        return configuration
    distance_m = float(np.linalg.norm(seen[0].p_root - steps[0].midpoint_root))
    for order in (2, 3, 4):
        kalman = KalmanParams.of_order(order)
        nis = _innovations(scaled(kalman, distance_m), seen)[_WARM_UP:]
        if np.mean(nis) <= chdtri(3 * len(nis), 0.025) / len(nis):
            return replace(configuration, params=replace(configuration.params, kalman=kalman))
    return configuration


def _innovations(params: KalmanParams, seen: Sequence[Observation3D]) -> list[float]:
    """Squared Mahalanobis distance of every observation from where it was expected; an outlier's is its gate's."""
    first, nis = seen[0], []
    belief = start(params, first.stamp_s, first.p_root, first.cov_root, correlated=first.correlated_cov_root)
    for one in seen[1:]:
        belief = predict(params, belief, one.stamp_s)
        measurement = one.p_root, one.cov_root, one.correlated_cov_root
        gated = gate(params, belief, *measurement)
        nis.append(gated.nis if gated and gated.belief is belief else params.gate_chi2)
        belief = update(params, belief, *measurement)
    return nis
