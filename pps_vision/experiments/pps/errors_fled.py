"""What the robot's errors cost an arm that flees, and what learning with them gives back (R: "the learned
representations automatically compensate").

What comes slowly, and stops where the skin was, touches no arm that moves at all, errors or not (`compensation.py`).
So what is fled here comes at 25 to 60 cm/s and presses on for up to 3 cm; half of the robots err as R's sources say,
half twice as much.  R's map cannot hold an error across the approach: beside it a map of what is seen less an
offset, that is told by where objects were seen as they touched (`learning/offsets.py`).
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
from learning.offsets import seen_aside
from learning.touch_trial import TouchTrial
from pps_vision.experiments.pps.compensation import CASES, PART, TRIALS, Case, Told
from pps_vision.experiments.pps.errors import Belief, ErrorSources, only
from pps_vision.experiments.pps.flight import Fleeing
from pps_vision.experiments.pps.held_out import approaches, known_trials, learned, of_part
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.icub import home
from pps_vision.robot.skin import INNER_FOREARM, TOUCH_RADIUS_M, icub_skin
from pps_vision.types import Array
from rendering.motions import Approach

TRACK_M, TRACK_M_S = 0.004, 0.02
"""Standard deviations of the tracker's position and velocity, each axis, on what it sees worst, a cube in a hand (53
rendered trials of seed 9100: 2.3, 2.1, 5.7 mm and 1.5, 1.3, 2.8 cm/s, of which it claims 1.9; balls a tenth)."""
SPEED_M_S, PRESS_M, BESIDE_M_S = (0.25, 0.6), (0.0, 0.03), 0.25
TWICE = ErrorSources(**{name: 2 * value for name, value in vars(ErrorSources()).items()})
WAYS = {"D and TTC (R)": False, "D and TTC, offset learned": True}
"""Whether an offset is learned, by way."""
_RADIUS_M = 0.035
_PASSES_M = 0.04  # how far from where the skin is touched what passes beside stays
_RESAMPLED = 2000


@dataclass(frozen=True)
class ErrorsFled:
    """Arms that flee: without errors; with errors, by what a robot without has learned; by what it has itself."""

    robots: int = 10
    """Robots that err, each in its own way; the second half twice as much."""
    approaches: int = 10
    """Paths that each robot is to flee in each case."""
    seed: int = 0
    """Seed of trials, errors and approaches."""

    def run(self) -> dict[str, Any]:
        """By way and case touches, and what passed beside but was fled; what errors cost and learning changes."""
        if self.robots < 2 or self.approaches < 1:
            raise ValueError(f"--robots {self.robots}, --approaches {self.approaches}; expected at least 2 and 1")
        rng = np.random.default_rng(self.seed)
        perfect = self._lessons(only(), rng)
        sources = [ErrorSources()] * (self.robots // 2) + [TWICE] * (self.robots - self.robots // 2)
        erring = [self._lessons(of, np.random.default_rng((self.seed, k))) for k, of in enumerate(sources)]
        motions = self._motions(perfect[0])
        met: dict[str, dict[Case, list[Array]]] = {way: {case: [] for case in CASES} for way in WAYS}
        for way, corrects in WAYS.items():
            known = _taught(perfect, corrects)
            for number, told in enumerate(tqdm(erring, desc="fleeing", unit="robot", disable=None)):
                own = _taught(told, corrects)
                for case, belief, taught in zip(
                    CASES, (perfect[0], told[0], told[0]), (known, known, own), strict=True
                ):
                    met[way][case].append(self._flights(_fleeing(belief, *taught), motions, number))
        return {
            "seed": self.seed,
            "aside_mm": [(1000 * (_aside(told) - _aside(perfect))).round(1).tolist() for told in erring],
            "ways": {
                way: _summary({case: np.array(rows) for case, rows in of_way.items()}) for way, of_way in met.items()
            },
        }

    def _lessons(self, sources: ErrorSources, rng: np.random.Generator) -> Told:
        """What a robot has of the trials to learn from."""
        belief = Belief.draw(sources, icub_skin(), rng)
        trials = (belief.tells(trial, True, rng) for trial in known_trials("inner", TRIALS, self.seed))
        return belief, tuple(_tracked(trial, rng) for trial in trials)

    def _motions(self, belief: Belief) -> list[tuple[Approach, Approach]]:
        """What each robot is to flee, and what passes beside, by path."""
        whole, found = icub_skin(), []
        fleeing = Fleeing(belief, whole, PPSMemory.empty(whole))
        taxels, _ = whole.at(belief.true_robot.at(home(belief.true_robot)))
        for k in range(self.approaches):
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
        """By way the touches, robot by robot; and all flights together."""
        figure, axes = plt.subplots(1, 3, figsize=(14.5, 4.8), layout="constrained")
        for axis, (way, of) in zip(axes, numbers["ways"].items(), strict=False):
            _touches(axis, of, np.linalg.norm(numbers["aside_mm"], axis=1) / 10, way)
        _together(axes[2], numbers["ways"])
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=3, fontsize=9)
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


def _taught(told: Told, corrects: bool) -> tuple[PPSMemory, Array]:
    """R's map of lessons, and the offset (3,) that is taken off first."""
    (belief, trials), aside = told, _aside(told) if corrects else np.zeros(3)
    frame = of_part(belief.skin, PART).parts[0].frame
    shifts = (np.array([belief.robot.at(q).T_root(frame)[:3, :3] @ aside for q in t.joints_rad]) for t in trials)
    lessons = [replace(t, positions=t.positions - shift) for t, shift in zip(trials, shifts, strict=True)]
    return learned(belief.skin, MemoryParams(), approaches(lessons, belief.robot, belief.skin, belief.skin)), aside


def _fleeing(belief: Belief, memory: PPSMemory, aside_m: Array) -> Fleeing:
    x, y, z = map(float, aside_m)
    return Fleeing(belief, icub_skin(), memory, (x, y, z), TRACK_M, TRACK_M_S)


def _aside(told: Told) -> Array:
    """(3,) what touches say that the robot sees beside itself, in the frame of the part."""
    belief, trials = told
    part = of_part(belief.skin, PART).parts[0]
    here = np.isin(belief.skin.taxel_ids, [f"{PART}:{i}" for i in part.ids])
    ends = [move_points(inverse(belief.robot.at(t.joints_rad[-1]).T_root(part.frame)), t.positions[-1]) for t in trials]
    touched, radii = np.array([t.touched[here] for t in trials]), np.array([t.radius_m[-1] for t in trials])
    return seen_aside(np.array(ends), part.positions_m, part.normals, touched, radii)


def _summary(met: dict[Case, Array]) -> dict[str, Any]:
    """Of flights (robots, paths, 3) by case; 95 % intervals of changes over robots."""
    found: dict[str, Any] = {
        case: {
            "touched": _share(of[..., 0]),
            "touched_by_robot": of[..., 0].mean(axis=1).tolist(),
            "moved_before_s": float(np.median(of[..., 1])),
            "fled_beside": _share(of[..., 2]),
        }
        for case, of in met.items()
    }
    names = {"touched": 0, "moved_before_s": 1, "fled_beside": 2}
    return found | {
        name: _cost({case: of[..., k].mean(axis=1) for case, of in met.items()}) for name, k in names.items()
    }


def _share(happened: Array) -> dict[str, Any]:
    """How many of how many, with Wilson's 95 % interval."""
    n, of = int(happened.sum()), happened.size
    share = binomtest(n, of).proportion_ci(method="wilson")
    return {"n": n, "of": of, "share_95": [float(share.low), float(share.high)]}


def _cost(by_case: dict[Case, Array]) -> dict[str, Any]:
    """What errors cost and what learning gives back of it, of a score by robot (robots,); 95 % intervals over robots
    drawn with replacement."""
    none, before, after = (by_case[case] for case in CASES)
    drawn = np.random.default_rng(0).integers(0, len(none), (_RESAMPLED, len(none)))
    return {
        name: {"mean": float(of.mean()), "interval_95": np.percentile(of[drawn].mean(axis=1), (2.5, 97.5)).tolist()}
        for name, of in {"errors_cost": before - none, "learning_changes": after - before}.items()
    }


_COLORS: dict[str, str] = dict(zip(CASES, ("0.55", "tab:orange", "tab:blue"), strict=True))


def _touches(axis: Axes, of: dict[str, Any], off_cm: Array, way: str) -> None:
    """Robot by robot, over how far beside itself it sees things."""
    for case in CASES:
        share = 100 * np.array(of[case]["touched_by_robot"])
        axis.plot(off_cm, share, "o", color=_COLORS[case], alpha=0.6, ms=6, label=case)
        axis.axhline(share.mean(), color=_COLORS[case], lw=1.2, ls="--")
    axis.set_ylim(-3, 103)
    axis.set_title(f"{way}\n{_said(of['touched'])}", fontsize=10)
    axis.set_xlabel("a robot sees what touches it this far off (cm)")
    axis.set_ylabel("touches the fleeing arm (%; dashed: mean)")
    axis.grid(alpha=0.25)


def _together(axis: Axes, ways: dict[str, Any]) -> None:
    """All flights by way and case: touched, and fled though it passed beside."""
    kinds = {"touched": "touched", "fled_beside": "passes beside,\nfled"}
    for y, (kind, way) in enumerate((kind, way) for kind in kinds for way in ways):
        for shift, case in zip((-0.22, 0.0, 0.22), CASES, strict=True):
            row = ways[way][case][kind]
            axis.plot(100 * np.array(row["share_95"]), [y + shift] * 2, color=_COLORS[case], lw=2, alpha=0.6)
            axis.plot(100 * row["n"] / row["of"], y + shift, "o", color=_COLORS[case])
    axis.set_yticks(range(4), [f"{label}\n{way}" for label in kinds.values() for way in ways], fontsize=8)
    axis.invert_yaxis()
    axis.set_xlim(-2, 102)
    axis.set_title("All flights together (bar: Wilson's 95 %)", fontsize=10)
    axis.set_xlabel("share of flights (%)")
    axis.grid(alpha=0.25, axis="x")


def _said(of: dict[str, Any]) -> str:
    """What errors cost and learning changes, in a line."""
    parts = []
    for label, key in (("errors", "errors_cost"), ("learning", "learning_changes")):
        low, high = (100 * bound for bound in of[key]["interval_95"])
        parts.append(f"{label} {100 * of[key]['mean']:+.0f} points [{low:+.0f}, {high:+.0f}]")
    return ", ".join(parts)
