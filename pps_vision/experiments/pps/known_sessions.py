"""Contacts predicted in drawn sessions, whose probability of touch is known: Brier score and coverage of the intervals.

A path is drawn as its displacement from four taxels; its touches follow a probability that depends on it in one of
several ways.  Each pair of sessions is one robot: one to learn from and another to predict.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.special import expit
from tqdm import tqdm

from learning.pps.contact import learn_contact, predict_session
from learning.pps.trials import Trial, touch_rates
from pps_vision.experiments import charts
from pps_vision.experiments.pps.perceived import HORIZON_S
from pps_vision.experiments.study import SampledStudy, interval
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.types import Array

TAXELS_M = np.array([[0.0, 0.0, 0.0], [0.025, 0.0, 0.0], [-0.01, 0.025, 0.0], [0.012, -0.022, 0.0]])
_STAMPS_S = 0.1 * np.arange(20)
_MIDDLE = 16  # the middle one of the last three samples that are known 0.15 s before the end
_SPEED_M_S = 0.1
GAIN_PERCENT, COVERAGE_PERCENT = 10.0, (85.0, 95.0)
"""Goals: Brier score below the base rate's where paths say anything, and share of the 90 % intervals that hold."""


@dataclass(frozen=True)
class Kind:
    """A kind of session."""

    near: bool = False
    """Touches fall off with the distance from the taxel; else the log-odds are linear in the displacement."""
    slope: float = 1.0
    """Standard deviation of the slopes, log-odds per standard deviation of the paths (with `near`: relative)."""
    tails: bool = False
    """Paths have a t distribution with 2.5 degrees of freedom, whose tails say nothing more."""
    lost: float = 0.0
    """Share of the trials whose object is lost on the way."""
    offset_m: float = 0.0
    """Standard deviation, each axis, of the second session's displacement from the first."""
    noise_m: float = 0.0
    """Standard deviation of an additional error of every path in the second session."""
    drift_m: float = 0.0
    """Standard deviation of how far the aim drifts within a session."""


KINDS: dict[str, Kind] = {
    "paths say nothing": Kind(slope=0.0),
    "paths say little": Kind(slope=0.5),
    "paths say something": Kind(slope=1.0),
    "paths say much": Kind(slope=2.0),
    "touches near the taxel": Kind(near=True),
    "touches near the taxel, blurred": Kind(near=True, slope=0.3),
    "heavy tails": Kind(tails=True),
    "a fifth lost": Kind(slope=2.0, lost=0.2),
    "aims that drift": Kind(drift_m=0.02),
    "second session displaced": Kind(offset_m=0.015),
    "second session less exact": Kind(noise_m=0.015),
}


@dataclass(frozen=True)
class Robot:
    """Drawn constants of one robot."""

    kind: Kind
    rate: Array
    """(4,) log-odds of touch at the mean path."""
    slopes: Array
    """(4, 3) log-odds per standard deviation."""
    spread_m: float
    offset_m: Array
    """(3,) error of kinematics and cameras."""
    aims: Array
    """(4,) how often each taxel is aimed at."""

    @classmethod
    def draw(cls, kind: Kind, rng: np.random.Generator) -> "Robot":
        """Return a robot of this kind."""
        slopes = kind.slope * rng.normal(0, (1, 1, 0.5), (4, 3))
        offset = rng.normal(0, (0.012, 0.012, 0.0))
        return cls(kind, rng.normal(-1.2, 1.3, 4), slopes, rng.uniform(0.008, 0.02), offset, rng.dirichlet(np.ones(4)))

    def session(self, n: int, rng: np.random.Generator, second: bool = False) -> tuple[tuple[Trial, ...], Array]:
        """Return `n` trials, and the probabilities of touch (n, 4) given the path, or that it is lost."""
        kind, trials, known = self.kind, [], []
        drift = kind.drift_m * np.cumsum(rng.normal(0, 1 / np.sqrt(n), (n, 3)), axis=0)
        offset = self.offset_m + second * rng.normal(0, kind.offset_m, 3)
        usual = np.mean([self._path(np.zeros(3), rng)[1] for _ in range(2000)], axis=0) if kind.lost else np.zeros(4)
        for k in range(n):
            u, p = self._path(drift[k], rng)
            seen = u + offset + second * rng.normal(0, kind.noise_m, 3)
            d = seen + ((_STAMPS_S - _STAMPS_S[_MIDDLE])[:, None] * np.array([0.0, 0.0, -_SPEED_M_S]))[:, None]
            is_lost = rng.random() < kind.lost
            if is_lost:
                d[10:] = np.nan
            touched = rng.random(4) < p
            trials.append(Trial(_STAMPS_S, d, np.tile([0.0, 0.0, -_SPEED_M_S], (len(d), 4, 1)), touched))
            known.append(usual if is_lost else p)
        return tuple(trials), np.array(known)

    def _path(self, drift_m: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """A true displacement (4, 3) m and the probabilities of touch (4,) given it."""
        if self.kind.near:
            at = TAXELS_M[rng.choice(4, p=self.aims)] + rng.normal(0, (0.008, 0.008, 0.006)) + drift_m
            u = at - TAXELS_M + np.array([0.0, 0.0, 0.03])
            return u, expit((0.016 - np.linalg.norm(u[:, :2], axis=1)) * self.kind.slope / 0.004)
        z = rng.standard_t(2.5, 3) if self.kind.tails else rng.standard_normal(3)
        z = z + drift_m / self.spread_m
        u = self.spread_m * z - TAXELS_M + np.array([0.0, 0.0, 0.05])
        return u, expit(self.rate + self.slopes @ (np.clip(z, -2.5, 2.5) if self.kind.tails else z))


@dataclass(frozen=True)
class KnownSessions(SampledStudy):
    """Contacts predicted in drawn sessions whose probability of touch is known, beside the base rate."""

    n: int = 60
    """Robots of each kind, with one session to learn from and another to predict."""
    trials: int = 37
    """Trials of a session (as in the authors' data)."""

    def run(self) -> dict[str, Any]:
        """Return by kind: Brier scores of ours, the base rate and the known probability, and coverage (%)."""
        found = {}
        for k, (name, kind) in enumerate(KINDS.items()):
            rngs = [np.random.default_rng((self.seed, k, i)) for i in range(self.n)]
            rows = [self._robot(kind, rng) for rng in tqdm(rngs, name, unit="robot", disable=None)]
            relative = [[row["ours"], row["base_rate"]] for row in rows]
            found[name] = {
                "n": self.n,
                **{key: interval([[row[key]] for row in rows]) for key in rows[0]},
                "percent_below": interval(relative, lambda v: 100 * (1 - v[::2].sum() / v[1::2].sum())),
            }
        return {"kinds": found}

    def _robot(self, kind: Kind, rng: np.random.Generator) -> Mapping[str, float]:
        """Expected Brier scores given the known probability, and the share of the intervals that hold it (%)."""
        robot = Robot.draw(kind, rng)
        (training, _), (test, known) = robot.session(self.trials, rng), robot.session(self.trials, rng, second=True)
        p = predict_session(HORIZON_S, learn_contact(HORIZON_S, training), test)
        best = float(np.mean(known * (1 - known)))
        return {
            "ours": best + float(np.mean((p.probability - known) ** 2)),
            "base_rate": best + float(np.mean((touch_rates(training) - known) ** 2)),
            "known": best,
            "coverage": 100 * float(np.mean((p.lower <= known) & (known <= p.upper))),
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw how far the Brier score is below the base rate's, and the coverage of the intervals; dashed: goals."""
        figure, (gain, coverage) = charts.panels(2, width=5.6)
        kinds = numbers["kinds"]
        charts.bars(gain, list(kinds), {"": [of["percent_below"] for of in kinds.values()]}, "below the base rate (%)")
        charts.bars(coverage, list(kinds), {"": [of["coverage"] for of in kinds.values()]}, "90 % intervals hold (%)")
        for axis, goals in ((gain, (GAIN_PERCENT,)), (coverage, COVERAGE_PERCENT)):
            for goal in goals:
                axis.axhline(goal, color="k", lw=0.8, ls="--")
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the Brier scores and the coverage by kind beside their goals; what misses its goal is bold."""
        rows = []
        for name, of in numbers["kinds"].items():
            gain, coverage, (low, high) = of["percent_below"][0], of["coverage"][0], COVERAGE_PERCENT
            with_goal = KINDS[name].slope > 0
            rows.append([
                name,
                *(estimate(of[key]) for key in ("ours", "base_rate", "known")),
                judged(estimate(of["percent_below"]), with_goal and gain < GAIN_PERCENT),
                f"≥ {GAIN_PERCENT:g}" if with_goal else "–",
                judged(estimate(of["coverage"]), not low <= coverage <= high),
                f"{low:g}–{high:g}",
            ])  # fmt: skip
        header = ["Brier score", "ours", "base rate", "known probability", "below the base rate (%)", "goal"]
        return {"": Table([*header, "90 % interval holds (%)", "goal"], rows)}
