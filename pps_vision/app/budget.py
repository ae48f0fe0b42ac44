"""No more than the scene needs: the cheapest tracker that meets an asked-for error (`track --max-error-mm`).

Every configuration, the cheapest first, follows the first seconds of the recording; its own covariance,
corrected by how far `pps-vision bench budget` found that to be from the truth, says whether it will do.
"""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from pps_vision.errors import InputError
from pps_vision.types import Observation3D, Status, StereoFrame
from tracking.image_tracker import ImageTrackerParams
from tracking.kalman import KalmanParams, gate, predict, scaled, start, update
from tracking.particle_filter import ParticleParams
from tracking.tracker import Tracker, TrackerParams, TrackerStep

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
    """The configuration to use, its filter's order for this motion included, why, and what every one that was
    tried promised."""

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
        return {
            "configuration": self.configuration.name,
            "filter_order": self.configuration.params.kalman.order,
            "meets": self.meets,
            "why": self.reason,
            "tried": tried,
        }


def _particles(count: int) -> TrackerParams:
    return TrackerParams(image=ImageTrackerParams(particles=ParticleParams(count=count)))


CONFIGURATIONS = (  # `pps-vision bench budget --seed 9000`, on a busy machine: the times count by their order
    Configuration("marker", TrackerParams(mode="marker"), 1.6, 1.0),
    Configuration("30 particles, centroid", _particles(30), 7.2, 2.4),  # 1.1 for balls and markers; a cube's is worst
    Configuration("120 particles, centroid", _particles(120), 7.3, 2.4),
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
        raise InputError("track", f"--max-error-mm {max_error_mm}; expected a positive number of millimetres")
    probes: list[Probe] = []
    ordered: list[Configuration] = []
    by_cost = sorted(configurations, key=lambda c: c.ms_per_pair)
    for configuration in by_cost:
        steps = _follow(frames, tracker_for(configuration.params))
        probes.append(probe := _probe(configuration, steps))
        ordered.append(_with_order(configuration, steps))
        if probe.tracked_share >= _MIN_TRACKED and probe.expected_mm <= max_error_mm:
            reason = (
                f"the cheapest of {len(by_cost)} that keeps the object and whose expected error, "
                f"{probe.expected_mm:.2g} mm, is within {max_error_mm:g} mm"
            )
            return Choice(ordered[-1], True, reason, tuple(probes))
    k = int(np.nanargmin([_regret(probe) for probe in probes]))
    reason = f"none of {len(by_cost)} is within {max_error_mm:g} mm; of those that keep the object, the most accurate"
    if not probes[k].tracked_share >= _MIN_TRACKED:
        reason = f"none of {len(by_cost)} keeps the object at first; our default"
        k = next(i for i, c in enumerate(by_cost) if c.params == TrackerParams())
    return Choice(ordered[k], False, reason, tuple(probes))


def _regret(probe: Probe) -> float:
    return probe.expected_mm if probe.tracked_share >= _MIN_TRACKED and np.isfinite(probe.expected_mm) else 1e9


def _follow(frames: Iterable[StereoFrame], tracker: Tracker) -> list[TrackerStep]:
    """What the tracker makes of the first pairs, from the first on which it knows the object."""
    steps: list[TrackerStep] = []
    for frame in itertools.islice(frames, _SEARCH_PAIRS):
        step = tracker.step(frame)
        if steps or step.track.is_known:
            steps.append(step)
        if len(steps) == _PROBE_PAIRS:
            break
    return steps


def _probe(configuration: Configuration, steps: Sequence[TrackerStep]) -> Probe:
    settled = [step.track for step in steps[_WARM_UP:]]
    variances = [float(np.trace(t.cov[:3, :3])) for t in settled if t.status == Status.TRACKING]
    share = len(variances) / len(settled) if settled else 0.0
    expected = configuration.true_over_reported * 1000 * float(np.sqrt(np.mean(variances))) if variances else np.nan
    return Probe(configuration.name, configuration.ms_per_pair, share, expected)


def _with_order(configuration: Configuration, steps: Sequence[TrackerStep]) -> Configuration:
    """The same with the lowest order of filter, from 2 (the skin needs a velocity), whose innovations are no larger
    than it expects: the mean of n squared Mahalanobis distances below the upper end of their 95 % band about 3."""
    seen = [step.observation for step in steps if step.observation is not None]
    default = configuration.params.kalman
    if len(seen) <= _WARM_UP:
        return configuration
    distance_m = float(np.linalg.norm(seen[0].p_root - steps[0].head))
    for order in (2, 3, 4):
        kalman = KalmanParams.of_order(order)
        nis = _innovations(scaled(kalman, distance_m), seen)[_WARM_UP:]
        if np.mean(nis) <= chi2.ppf(0.975, 3 * len(nis)) / len(nis):
            return replace(configuration, params=replace(configuration.params, kalman=kalman))
    return replace(configuration, params=replace(configuration.params, kalman=default))


def _innovations(params: KalmanParams, seen: Sequence[Observation3D]) -> list[float]:
    """Squared Mahalanobis distance of every observation from where it was expected; an outlier's is its gate's."""
    belief, nis = start(params, seen[0].stamp_s, seen[0].p_root, seen[0].cov_root), []
    for one in seen[1:]:
        belief = predict(params, belief, one.stamp_s)
        gated = gate(params, belief, one.p_root, one.cov_root)
        nis.append(gated.nis if gated and gated.belief is belief else params.gate_chi2)
        belief = update(params, belief, one.p_root, one.cov_root)
    return nis
