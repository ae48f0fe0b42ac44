"""Whether what the tracker says it does not know is what it does not know: NEES, NIS, coverage, time to contact."""

from collections.abc import Sequence as Listed
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import chi2, norm

from learning.pps.receptive_field import ReceptiveField, distance_and_ttc, distance_and_ttc_variance
from pps_vision.experiments.chart import panels
from pps_vision.experiments.filter_methods import measured
from pps_vision.experiments.filter_scenes import (
    MOTIONS,
    SETTLED,
    TRACKED,
    Sequence,
    approach_sequences,
    rendered_sequences,
    tracking_steps,
)
from pps_vision.experiments.scene_sources import by_source
from pps_vision.experiments.study import Scenes, SceneSource, Study
from pps_vision.types import Array, Track3D
from tracking.kalman import KalmanParams, scaled, start
from tracking.smoother import follow

SPEEDS_M_S = (0.05, 0.1, 0.2, 0.3)
_SIGMAS = {"68": float(norm.ppf(0.84)), "95": float(norm.ppf(0.975))}
_SPANS_S = ((0.3, 0.5), (0.2, 0.3), (0.1, 0.2), (0.02, 0.1))  # before the touch
_ASIDE_M = np.array([0.0, 0.0, -0.15])  # of the path's middle: a point whose distance is asked for
_WITHIN = {"68": 5.0, "95": 2.0}  # percent, the goal
_FIELD = ReceptiveField(np.pi / 2 - 1e-9, length_m=10.0, subtract_radius=True, min_closing_sigmas=0.0)  # all of space


@dataclass(frozen=True)
class Consistency(Study):
    """Rendered balls and markers (noisy images, head moving): errors against the covariances that come with them.

    Judged from the tenth measurement on; where the velocity jumps at once, which nothing in a hand does, not in
    that frame and the next (`with_jumps` counts them too).
    """

    n: int = 4
    """Recordings of each object on each motion, and of each at each speed of approach."""
    seconds: float = 5.0
    """Length of the recordings that are no approaches."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the first recordings; the others count up."""
    scenes: Scenes = "both"
    """Rendered scenes, independent ones, or both."""

    def run(self) -> dict[str, object]:
        """By motion and over all: mean NEES (position and velocity, 6 expected) and NIS (3) with the 95 % bands of
        as many independent samples as there are recordings (within one errors go on from frame to frame);
        coverage in percent; and by speed the errors of the time to contact."""
        if self.n < 1 or self.seconds < 1:
            raise ValueError(f"bench consistency: --n {self.n}, --seconds {self.seconds}; expected at least 1 of each")
        return by_source(self.scenes, self._measure)

    def _measure(self, source: SceneSource) -> dict[str, Any]:
        in_the_air = rendered_sequences(self.n, self.seconds, self.noise, self.seed, source)
        onto_skin = approach_sequences(self.n, SPEEDS_M_S, self.noise, self.seed, source)
        return {
            "consistency": {
                "all": consistency(in_the_air),
                **{f"{s} {m}": consistency(_named(in_the_air, f"{s} {m}")) for s, _ in TRACKED for m in MOTIONS},
            },
            "coverage": coverage(in_the_air, onto_skin),
            "coverage_by_object": {s: coverage(_named(in_the_air, s), _named(onto_skin, s)) for s, _ in TRACKED},
            "ttc": {
                f"{100 * speed:g}": ttc_errors(_named(onto_skin, f" {100 * speed:g} cm/s")) for speed in SPEEDS_M_S
            },
            "ttc_median_percent": ttc_errors(onto_skin)["median_percent"],
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """NEES and NIS by motion, coverage by quantity, time to contact by speed."""
        figure, axes = panels(4, width=4.6, height=4.2)
        _consistency_panel(axes[0], numbers["consistency"], "nees", "mean NEES of position and velocity")
        _consistency_panel(axes[1], numbers["consistency"], "nis", "mean NIS")
        _coverage_panel(axes[2], numbers["coverage"])
        _ttc_panel(axes[3], numbers["ttc"])
        return figure


def consistency(sequences: list[Sequence]) -> dict[str, Any]:
    """Mean squared Mahalanobis distances of recordings, their bands, and NEES with the jumps."""
    nees, with_jumps, nis = [], [], []
    for sequence in sequences:
        steps = list(tracking_steps(sequence))
        state = [(k, step.track.mean[:2].ravel(), step.track.cov[:6, :6]) for k, step in steps]
        true = np.hstack([sequence.path, sequence.velocity])
        values = {k: float((x - true[k]) @ np.linalg.solve(P, x - true[k])) for k, x, P in state}
        with_jumps.append(np.mean(list(values.values())))
        nees.append(np.mean([value for k, value in values.items() if not sequence.jumped[k]]))
        nis.append(np.mean(_nis(sequence)[SETTLED:][~sequence.jumped[SETTLED:]]))
    n = len(sequences)
    return {
        "nees": float(np.mean(nees)),
        "nees_band": (chi2.ppf([0.025, 0.975], 6 * n) / n).round(2).tolist(),
        "nees_with_jumps": float(np.mean(with_jumps)),
        "nis": float(np.mean(nis)),
        "nis_band": (chi2.ppf([0.025, 0.975], 3 * n) / n).round(2).tolist(),
    }


def _nis(sequence: Sequence) -> Array:
    """(n,) of the tracker's own filter, run again on what it measured."""
    params = scaled(KalmanParams(), sequence.distance_m)
    begin = start(params, float(sequence.stamps_s[0]), sequence.positions[0], sequence.covs[0])
    return np.array([passage.belief.nis for passage in follow(params, begin, measured(sequence))])


def coverage(in_the_air: list[Sequence], onto_skin: list[Sequence]) -> dict[str, dict[str, float]]:
    """Percent of true values inside the intervals that should hold 68 and 95 % of them."""
    z: dict[str, list[float]] = {"position": [], "velocity": [], "distance": []}
    for sequence in [*in_the_air, *onto_skin]:
        point = sequence.path.mean(axis=0) + _ASIDE_M
        for k, step in tracking_steps(sequence):
            if not sequence.jumped[k]:
                true = float(np.linalg.norm(sequence.path[k] - point)) - sequence.radius_m
                distance, _, distance_std, _ = contact(step.track, point)
                z["distance"].append(abs(distance - true) / distance_std)
                std = np.sqrt(np.diag(step.track.cov)[:6])
                z["position"].extend(np.abs(step.track.position - sequence.path[k]) / std[:3])
                z["velocity"].extend(np.abs(step.track.velocity - sequence.velocity[k]) / std[3:])
    inside: dict[str, list[bool]] = {"68": [], "95": []}
    for sequence in onto_skin:
        for k, (_, ttc, _, ttc_std) in _contacts(sequence):
            for share, sigmas in _SIGMAS.items():
                inside[share].append(abs(ttc - sequence.ttc_s[k]) <= sigmas * ttc_std)
    found = {
        name: {share: 100 * float(np.mean(np.array(values) < s)) for share, s in _SIGMAS.items()}
        for name, values in z.items()
    }
    return {**found, "time to contact": {share: 100 * float(np.mean(hits)) for share, hits in inside.items()}}


def ttc_errors(sequences: list[Sequence]) -> dict[str, Any]:
    """Median and quartiles of the relative error, percent, in the last half second, and by the time left."""
    left, error = [], []
    for sequence in sequences:
        for k, (_, ttc, _, _) in _contacts(sequence):
            if sequence.late[k]:
                left.append(sequence.ttc_s[k])
                error.append(100 * abs(ttc / sequence.ttc_s[k] - 1))
    remaining, percent = np.array(left), np.array(error)
    spans = [percent[(remaining >= a) & (remaining < b)] for a, b in _SPANS_S]
    return {
        "median_percent": float(np.median(percent)) if len(percent) else np.nan,
        "q75_percent": float(np.percentile(percent, 75)) if len(percent) else np.nan,
        "by_time_left": [float(np.median(span)) if len(span) else np.nan for span in spans],
        "samples": len(percent),
    }


def contact(track: Track3D, point: Array) -> tuple[float, float, float, float]:
    """Distance (m) from the track's surface to a point (3,) and time to contact (s), and their standard deviations."""
    d = (track.position - point)[None]
    normal = d / np.linalg.norm(d)
    means = distance_and_ttc(_FIELD, d, normal, track.velocity, track.radius_m)
    variances = distance_and_ttc_variance(
        _FIELD, d, normal, track.velocity, track.cov[:6, :6], track.radius_m, track.radius_var_m2
    )
    D, ttc, D_var, ttc_var = (float(values[0]) for values in (*means, *variances))
    return D, ttc, D_var**0.5, ttc_var**0.5


def _contacts(sequence: Sequence) -> list[tuple[int, tuple[float, float, float, float]]]:
    """What the track says of the touch to come, at every settled step before it."""
    return [
        (k, contact(step.track, sequence.touched))
        for k, step in tracking_steps(sequence)
        if sequence.ttc_s[k] > 0.02 and not sequence.jumped[k]
    ]


def _named(sequences: Listed[Sequence], what: str) -> list[Sequence]:
    return [sequence for sequence in sequences if what in sequence.name]


def _consistency_panel(axis: Axes, numbers: dict[str, Any], key: str, label: str) -> None:
    names = list(numbers)[::-1]
    for y, name in enumerate(names):
        low, high = numbers[name][f"{key}_band"]
        axis.plot([low, high], [y, y], color="0.8", lw=7, solid_capstyle="butt")
        axis.plot(numbers[name][key], y, "o", color="tab:blue", ms=5)
    axis.axvline(6 if key == "nees" else 3, color="0.25", lw=1, ls="--")
    axis.set_yticks(range(len(names)), names, fontsize=8)
    axis.set_xlim(left=0)
    axis.set_xlabel(f"{label}\n(dashed: expected; grey: 95 % band)")
    axis.grid(alpha=0.25, axis="x")


def _coverage_panel(axis: Axes, numbers: dict[str, Any]) -> None:
    for color, (share, width) in zip(("tab:blue", "tab:green"), _WITHIN.items(), strict=True):
        axis.axhspan(float(share) - width, float(share) + width, color=color, alpha=0.15, lw=0)
        values = [of[share] for of in numbers.values()]
        axis.plot(range(len(values)), values, "o", color=color, ms=6, label=f"{share} % intervals")
    axis.set_xticks(range(len(numbers)), [name.replace(" to ", "\nto ") for name in numbers], fontsize=8)
    axis.set_xlim(-0.5, len(numbers) - 0.5)
    axis.set_ylim(40, 101)
    axis.set_ylabel("true values inside (%)")
    axis.set_xlabel("shaded: goal")
    axis.legend(fontsize=8, loc="lower right")
    axis.grid(alpha=0.25, axis="y")


def _ttc_panel(axis: Axes, numbers: dict[str, Any]) -> None:
    middle = [1000 * 0.5 * (a + b) for a, b in _SPANS_S]
    for speed, of in numbers.items():
        axis.plot(middle, [np.nan if e is None else e for e in of["by_time_left"]], "o-", ms=4, label=f"{speed} cm/s")
    axis.axhline(10, color="0.25", lw=1, ls="--")
    axis.annotate("goal", (1, 10), xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize=8)
    axis.set_xlim(450, 0)
    axis.set_ylim(bottom=0)
    axis.set_xlabel("time left before the touch (ms)")
    axis.set_ylabel("error of the time to contact (median, %)")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.25)
