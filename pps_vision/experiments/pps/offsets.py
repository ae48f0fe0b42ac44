"""R Fig 8: how far off each taxel is, read from what it has learned, on robots whose errors are known.

Offsets are where the regression line through the positives crosses a time to contact of zero.  TTC here is
the time that was left to the touch, which a robot knows once it has been touched.  As it was perceived beforehand
(R eq. 2) it will not do: an error along the approach changes distance and TTC alike; that, on R's own map, is
shown beside.
"""

from dataclasses import dataclass, replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learning.pps.memory import MemoryParams, PPSMemory
from learning.pps.offsets import offsets
from learning.pps.touch_trial import TouchTrial
from pps_vision.experiments.pps.errors import Belief, ErrorSources
from pps_vision.experiments.pps.held_out import Approach, approaches, known_trials, learned
from pps_vision.experiments.pps.touch_movements import Condition
from pps_vision.experiments.study import Study
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array

TRIALS: dict[Condition, int] = {"inner": 53, "outer": 34, "palm": 77}  # R Table 5
PAPER_M = {"inner": 0.0211, "outer": 0.0173, "palm": 0.0116}
# The last moments alone, before which hands slow down; a bin a sample, which lies in its middle (they come each 50 ms).
LAST = MemoryParams(distance_range_m=(-0.15, 0.20), ttc_range_s=(-0.025, 0.225), bins=(140, 5))
MIN_TOUCHES = 5
_SAMPLED = ("stamps_s", "joints_rad", "positions", "velocities", "velocity_covs", "radius_m")


@dataclass(frozen=True)
class Offsets(Study):
    """Offsets of taxels on robots that err: estimated, beside the true ones."""

    robots: int = 4
    """Robots, each with errors of its own."""
    seed: int = 0
    """Seed of trials and errors."""

    def run(self) -> dict[str, Any]:
        """Taxel by taxel: the true perceived distance at the touch, the estimate, and what other ways give."""
        if self.robots < 1:
            raise ValueError(f"--robots {self.robots}; expected at least 1")
        rows = [row for k in range(self.robots) for part in TRIALS for row in self._taxels(part, k)]
        parts = {part: _summary([row for row in rows if row["part"] == part]) for part in TRIALS}
        for part, numbers in parts.items():
            numbers["paper_mm"] = 1000 * PAPER_M[part]
        return {"seed": self.seed, "robots": self.robots, "all": _summary(rows), "parts": parts, "taxels": rows}

    def _taxels(self, part: Condition, number: int) -> list[dict[str, Any]]:
        rng = np.random.default_rng((self.seed, number))
        whole = icub_skin()
        belief = Belief.draw(ErrorSources(), whole, rng)
        told = [belief.tells(_end_of(t), True, rng) for t in known_trials(part, TRIALS[part], self.seed)]
        trials = approaches(told, belief.robot, belief.skin, whole)
        true, touches = _at_the_touch(trials)
        afterwards = _memory(belief, tuple(map(_afterwards, trials)))
        found = offsets(afterwards)
        by_f = offsets(afterwards, afterwards.frequency)
        beforehand = offsets(learned(belief.skin, MemoryParams(), trials))
        return [
            {
                "robot": number,
                "part": part,
                "taxel": belief.skin.taxel_ids[i],
                "touches": int(touches[i]),
                "true_mm": 1000 * float(true[i]),
                "found_mm": 1000 * float(found[i]),
                "weighted_by_f_mm": 1000 * float(by_f[i]),
                "ttc_as_perceived_mm": 1000 * float(beforehand[i]),
            }
            for i in np.flatnonzero((touches >= MIN_TOUCHES) & np.isfinite(found))
        ]

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Left: taxel by taxel, estimated over true.  Right: the parts' means beside the paper's."""
        figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4.6), layout="constrained")
        _estimates(left, numbers)
        _parts(right, numbers["parts"])
        return figure


def _end_of(trial: TouchTrial) -> TouchTrial:
    """The last of a trial, all that is counted here."""
    last = trial.stamps_s >= trial.stamps_s[-1] - 2 * LAST.ttc_range_s[1]
    kept = {name: getattr(trial, name)[last] for name in _SAMPLED}
    return replace(trial, **kept)


def _memory(belief: Belief, trials: tuple[Approach, ...]) -> PPSMemory:
    return learned(belief.skin, LAST, trials)


def _afterwards(trial: Approach) -> Approach:
    """The trial with the time that was left to the touch for its TTC."""
    left = np.where(np.isfinite(trial.distance_m), trial.left_s[:, None], np.nan)
    return Approach(trial.left_s, trial.distance_m, left, trial.touched)


def _at_the_touch(trials: tuple[Approach, ...]) -> tuple[Array, Array]:
    """Mean perceived D (n,) at the moment a taxel is touched, and how many touches that is."""
    last = np.array([np.where(trial.touched, trial.distance_m[-1], np.nan) for trial in trials])
    known = np.isfinite(last)
    touches = known.sum(axis=0)
    return np.where(touches > 0, np.nansum(last, axis=0) / np.maximum(touches, 1), np.nan), touches


def _summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Means, and how far each way is off (mm)."""
    true = np.array([row["true_mm"] for row in rows])
    ways = {way: np.array([row[f"{way}_mm"] for row in rows]) for way in _WAYS}
    return {
        "taxels": len(rows),
        "true_mean_mm": float(true.mean()),
        "mean_mm": float(ways["found"].mean()),
        "std_mm": float(ways["found"].std()),
        "off_median_mm": {way: float(np.median(np.abs(found - true))) for way, found in ways.items()},
        "within_3_mm": {way: float(np.mean(np.abs(found - true) <= 3)) for way, found in ways.items()},
    }


_WAYS = {"found": "positives (ours)", "weighted_by_f": "weights f (R)", "ttc_as_perceived": "TTC as perceived"}


def _estimates(axis: Axes, numbers: dict[str, Any]) -> None:
    true = [row["true_mm"] for row in numbers["taxels"]]
    for (way, label), color, mark in zip(_WAYS.items(), ("tab:blue", "tab:orange", "0.6"), "o^x", strict=True):
        share = 100 * numbers["all"]["within_3_mm"][way]
        found = [row[f"{way}_mm"] for row in numbers["taxels"]]
        axis.plot(true, found, mark, color=color, ms=4, alpha=0.8, label=f"{label}: {share:.0f} % within 3 mm")
    span = np.array([min(true) - 5, max(true) + 5])
    axis.fill_between(span, span - 3, span + 3, color="0.85", lw=0)
    axis.plot(span, span, color="0.3", lw=1)
    axis.set_ylim(span[0] - 25, span[1] + 35)
    axis.set_xlabel("distance perceived at the touch (mm)")
    axis.set_ylabel("offset: where the line crosses TTC = 0 (mm)")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.25)


def _parts(axis: Axes, parts: dict[str, Any]) -> None:
    for x, (_part, of) in enumerate(parts.items()):
        axis.errorbar(x, of["mean_mm"], of["std_mm"], fmt="o", color="tab:blue", capsize=4, label=_once(x, "estimated"))
        axis.plot(x + 0.12, of["true_mean_mm"], "_", color="0.2", ms=16, mew=2, label=_once(x, "true"))
        axis.plot(x + 0.24, of["paper_mm"], "D", color="tab:orange", ms=5, label=_once(x, "R, on the robot"))
    axis.set_xticks(range(len(parts)), [f"{part}\n{of['taxels']} taxels" for part, of in parts.items()])
    axis.set_xlim(-0.5, len(parts) - 0.5)
    axis.set_ylabel("offset to the object's centre (mm, mean ± std over taxels)")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.25, axis="y")


def _once(x: int, label: str) -> str | None:
    return label if x == 0 else None
