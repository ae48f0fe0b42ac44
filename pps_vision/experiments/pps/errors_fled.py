"""What the robot's errors cost an arm that flees, and what learning with them gives back (R: "the learned
representations automatically compensate").

What comes slowly, and stops where the skin was, touches no arm that moves at all, errors or not.  So what is fled here
comes at 25 to 60 cm/s and presses on for up to 3 cm; half of the robots err as R's sources say, half twice as much.
R's map expects a touch wherever in a taxel's cone something comes, so errors cost what they move out of the cone, and
that no map learned inside it gives back; encoders whose offsets touches tell (`learning/joint_offsets.py`) may.
"""

from dataclasses import dataclass, replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import binomtest
from tqdm import tqdm

from learning.memory import MemoryParams, PPSMemory
from learning.touch_trial import TouchTrial
from pps_vision.experiments.pps.errors import Belief, ErrorSources, only
from pps_vision.experiments.pps.flight import Fleeing
from pps_vision.experiments.pps.held_out import approaches, known_trials, learned
from pps_vision.experiments.pps.lives import CASES, COLORS, PART, TRIALS, Case, Life, calibrated, error_mm, live
from pps_vision.robot.icub import home
from pps_vision.robot.skin import INNER_FOREARM, TOUCH_RADIUS_M, icub_skin
from pps_vision.types import Array
from rendering.motions import Approach

TRACK_M, TRACK_M_S = 0.004, 0.02
"""Standard deviations of the tracker's position and velocity, each axis, on what it sees worst, a cube in a hand (53
rendered trials of seed 9100: 2.3, 2.1, 5.7 mm and 1.5, 1.3, 2.8 cm/s, of which it claims 1.9; balls a tenth)."""
SPEED_M_S, PRESS_M, BESIDE_M_S = (0.25, 0.6), (0.0, 0.03), 0.25
TWICE = ErrorSources(**{name: 2 * value for name, value in vars(ErrorSources()).items()})
_RADIUS_M = 0.035
_PASSES_M = 0.04  # how far from where the skin is touched what passes beside stays
_RESAMPLED = 2000


@dataclass(frozen=True)
class ErrorsFled:
    """Arms that flee: of a robot without errors, and of robots that err, before and after learning."""

    robots: int = 20
    """Robots that err, each in its own way; the second half twice as much."""
    approaches: int = 5
    """Paths that each robot is to flee, the same in each case."""
    seed: int = 0
    """Seed of trials, errors and approaches."""

    def run(self) -> dict[str, Any]:
        """By case touches, and what passed beside but was fled; what errors cost and learning gives back."""
        if self.robots < 2 or self.approaches < 1:
            raise ValueError(f"--robots {self.robots}, --approaches {self.approaches}; expected at least 2 and 1")
        perfect = self._life(Belief.draw(only(), icub_skin(), np.random.default_rng(self.seed)), self.robots)
        known = _map(perfect)
        sources = [ErrorSources()] * (self.robots // 2) + [TWICE] * (self.robots - self.robots // 2)
        met: dict[Case, list[Array]] = {case: [] for case in CASES}
        off_mm = []
        for k, of in enumerate(tqdm(sources, desc="fleeing", unit="robot", disable=None)):
            erring = self._life(Belief.draw(of, icub_skin(), np.random.default_rng((self.seed, k))), k)
            better = self._life(calibrated(erring), k)
            off_mm.append([error_mm(perfect, life) for life in (erring, better)])
            motions = self._motions(perfect.belief, k)
            robots = ((perfect, known), (erring, known), (erring, _map(erring)), (better, _map(better)))
            for case, (life, memory) in zip(CASES, robots, strict=True):
                met[case].append(self._flights(_fleeing(life.belief, memory), motions, k))
        return {"seed": self.seed, "off_mm": off_mm, **_summary({case: np.array(of) for case, of in met.items()})}

    def _life(self, belief: Belief, k: int) -> Life:
        """What a robot has of the trials to learn from."""
        rng = np.random.default_rng((self.seed, k, 1))
        seen = live(belief, known_trials("inner", TRIALS, self.seed), rng)
        return replace(seen, trials=tuple(_tracked(trial, rng) for trial in seen.trials))

    def _motions(self, belief: Belief, number: int) -> list[tuple[Approach, Approach]]:
        """What a robot is to flee, and what passes beside, by path."""
        whole, found = icub_skin(), []
        fleeing = _fleeing(belief, PPSMemory.empty(whole))
        taxels, _ = whole.at(belief.true_robot.at(home(belief.true_robot)))
        for k in range(number * self.approaches, (number + 1) * self.approaches):
            rng = np.random.default_rng((self.seed, k))
            path = fleeing.approach(f"{PART}:{INNER_FOREARM[k % len(INNER_FOREARM)]}", _RADIUS_M, 0.1, rng)
            beside = pressing(passing_beside(path, taxels, _RADIUS_M, PRESS_M[1], rng), BESIDE_M_S, PRESS_M[1])
            found.append((pressing(path, rng.uniform(*SPEED_M_S), rng.uniform(*PRESS_M)), beside))
        return found

    def _flights(self, fleeing: Fleeing, motions: list[tuple[Approach, Approach]], number: int) -> Array:
        """(paths, 3) whether what came touched, how long before the arm moved (0: too late or never), and whether it
        fled what passed beside."""
        rows = []
        for k, of_path in enumerate(motions):
            came, passed = (
                fleeing.meet(motion, _RADIUS_M, np.random.default_rng((self.seed, number, k))) for motion in of_path
            )
            rows.append((came.touched, np.nan_to_num(came.moved_before_s), np.isfinite(passed.moved_before_s)))
        return np.array(rows, dtype=float)

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """How early robots move; all flights together."""
        figure, axes = plt.subplots(1, 2, figsize=(11.5, 4.6), layout="constrained", width_ratios=(1.3, 1))
        _by_robot(axes[0], numbers)
        _together(axes[1], numbers)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=len(CASES), fontsize=9)
        return figure


def pressing(path: Approach, speed_m_s: float, press_m: float) -> Approach:
    """The same path at another speed, which goes on for `press_m` where it would have stopped."""
    way = path.end - path.start
    return replace(path, end=path.end + press_m * way / np.linalg.norm(way), speed_m_s=speed_m_s)


def passing_beside(
    path: Approach, taxels: Array, radius_m: float, press_m: float, rng: np.random.Generator
) -> Approach:
    """The same path moved aside, as little as keeps it, and where it presses on to, off the taxels (n, 3)."""
    way = path.end - path.start
    aside = np.cross(way, rng.standard_normal(3))
    aside /= np.linalg.norm(aside)
    along = path.start + np.linspace(0, 1 + press_m / np.linalg.norm(way), 80)[:, None] * way
    by = 0.0
    while np.linalg.norm(along[:, None] + by * aside - taxels, axis=2).min() < radius_m + TOUCH_RADIUS_M + _PASSES_M:
        by += 0.01
    return replace(path, start=path.start + by * aside, end=path.end + by * aside)


def _tracked(trial: TouchTrial, rng: np.random.Generator) -> TouchTrial:
    """A trial with the tracker's noise, and what the tracker says of it."""
    noise = rng.standard_normal((2, *trial.positions.shape))
    return replace(
        trial,
        positions=trial.positions + TRACK_M * noise[0],
        velocities=trial.velocities + TRACK_M_S * noise[1],
        velocity_covs=np.tile(TRACK_M_S**2 * np.eye(3), (len(trial.stamps_s), 1, 1)),
    )


def _map(life: Life) -> PPSMemory:
    """R's map of a robot's trials."""
    skin = life.belief.skin
    return learned(skin, MemoryParams(), approaches(life.trials, life.belief.robot, skin, skin))


def _fleeing(belief: Belief, memory: PPSMemory) -> Fleeing:
    return Fleeing(belief, icub_skin(), memory, TRACK_M, TRACK_M_S)


def _summary(met: dict[Case, Array]) -> dict[str, Any]:
    """Of flights (robots, paths, 3) by case; what changes, with 95 % intervals over robots."""
    by_case = {
        case: {
            "touched": _share(of[..., 0]),
            "moved_before_s": float(np.median(of[..., 1])),
            "moved_before_s_by_robot": of[..., 1].mean(axis=1).tolist(),
            "fled_beside": _share(of[..., 2]),
        }
        for case, of in met.items()
    }
    names = {"touched": 0, "moved_before_s": 1, "fled_beside": 2}
    changes = {name: _changes({case: of[..., k].mean(axis=1) for case, of in met.items()}) for name, k in names.items()}
    return {"cases": by_case, "changes": changes}


def _share(happened: Array) -> dict[str, Any]:
    """How many of how many, with Wilson's 95 % interval."""
    n, of = int(happened.sum()), happened.size
    share = binomtest(n, of).proportion_ci(method="wilson")
    return {"n": n, "of": of, "share_95": [float(share.low), float(share.high)]}


def _changes(by_case: dict[Case, Array]) -> dict[str, Any]:
    """What errors cost and learning changes, of a score by robot (robots,); 95 % intervals over robots drawn with
    replacement."""
    none, before, anew, joints = (by_case[case] for case in CASES)
    drawn = np.random.default_rng(0).integers(0, len(none), (_RESAMPLED, len(none)))
    changes = {"errors": before - none, "map learned anew": anew - before, "joints learned too": joints - before}
    return {
        name: {"mean": float(of.mean()), "interval_95": np.percentile(of[drawn].mean(axis=1), (2.5, 97.5)).tolist()}
        for name, of in changes.items()
    }


def _by_robot(axis: Axes, numbers: dict[str, Any]) -> None:
    """How much sooner than a robot without errors each moves, over how far off it sees things before it has learned."""
    off_cm = np.array(numbers["off_mm"])[:, 0] / 10
    moves = {case: 1000 * np.array(of["moved_before_s_by_robot"]) for case, of in numbers["cases"].items()}
    sooner = {case: of - moves["no errors"] for case, of in moves.items()}
    axis.vlines(off_cm, sooner["before learning"], sooner["joints learned too"], color="0.85", lw=2, zorder=1)
    axis.axhline(0, color=COLORS["no errors"], lw=1.2, label="no errors")
    for case in CASES[1:]:
        axis.plot(off_cm, sooner[case], "o", color=COLORS[case], alpha=0.7, ms=6, label=case)
    late = ", ".join(f"{case} {np.maximum(-sooner[case], 0).mean():.0f}" for case in CASES[1:])
    axis.set_title(f"Later than without errors, mean over robots (ms):\n{late}", fontsize=9)
    axis.set_xscale("log")
    axis.set_xticks([2, 3, 5, 10, 20, 30], ["2", "3", "5", "10", "20", "30"])
    axis.minorticks_off()
    axis.set_xlabel("how far off it sees things from its skin before learning (cm, median)")
    axis.set_ylabel("the arm moves so much sooner (ms, mean of its paths)")
    axis.grid(alpha=0.25)


def _together(axis: Axes, numbers: dict[str, Any]) -> None:
    """All flights: touched, and fled though it passed beside."""
    kinds = {"touched": "touched", "fled_beside": "passes 4 cm\nbeside, fled"}
    for y, kind in enumerate(kinds):
        for shift, case in zip(np.linspace(-0.24, 0.24, len(CASES)), CASES, strict=True):
            row = numbers["cases"][case][kind]
            axis.plot(100 * np.array(row["share_95"]), [y + shift] * 2, color=COLORS[case], lw=2, alpha=0.6)
            axis.plot(100 * row["n"] / row["of"], y + shift, "o", color=COLORS[case])
    axis.set_yticks(range(len(kinds)), list(kinds.values()))
    axis.invert_yaxis()
    axis.set_xlim(-2, 102)
    axis.set_title(_said(numbers["changes"]["touched"]), fontsize=9)
    axis.set_xlabel("share of flights (%, bar: Wilson's 95 %)")
    axis.grid(alpha=0.25, axis="x")


def _said(changes: dict[str, Any]) -> str:
    """What errors cost in touches and learning changes, in a line."""
    parts = []
    for label, of in changes.items():
        low, high = (100 * bound for bound in of["interval_95"])
        parts.append(f"{label} {100 * of['mean']:+.0f} [{low:+.0f}, {high:+.0f}]")
    return f"Touched, in points: {parts[0]}\n{', '.join(parts[1:])}"
