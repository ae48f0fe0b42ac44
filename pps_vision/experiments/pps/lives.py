"""What robots live through: the same trials as each of them takes them, and what it may make of them."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from learning.pps.joint_offsets import JointOffsetParams, joint_offsets
from learning.pps.touch_trial import TouchTrial
from learning.pps.trials import Trial
from pps_vision.experiments.pps.errors import Belief
from pps_vision.experiments.pps.held_out import Approach, approaches, displaced, of_part

Case = Literal["no errors", "before learning", "map learned anew", "joints learned too"]
"""A robot without errors; one that errs, with that one's map; with a map of its own; and with its encoders' offsets
learned from the same touches beforehand."""
CASES: tuple[Case, ...] = ("no errors", "before learning", "map learned anew", "joints learned too")
COLORS: dict[str, str] = dict(zip(CASES, ("0.55", "tab:orange", "tab:purple", "tab:blue"), strict=True))

PART = "left_forearm"
"""What is touched, on its inner side."""
TRIALS = 53


@dataclass(frozen=True)
class Life:
    """Trials as a robot took them, and what its forearm perceived in them: D and TTC, and displacements."""

    belief: Belief
    trials: tuple[TouchTrial, ...]

    @cached_property
    def approaches(self) -> tuple[Approach, ...]:
        """R's D and TTC."""
        skin = self.belief.skin
        return approaches(self.trials, self.belief.robot, of_part(skin, PART), skin)

    @cached_property
    def displaced(self) -> tuple[Trial, ...]:
        """Where things were, seen from each taxel."""
        skin = self.belief.skin
        return displaced(self.trials, self.belief.robot, of_part(skin, PART), skin)


def live(belief: Belief, trials: Iterable[TouchTrial], rng: np.random.Generator, sees: bool = True) -> Life:
    """True trials as a robot's eyes see them, or as it knows of its own finger by its joints."""
    return Life(belief, tuple(belief.tells(trial, sees, rng) for trial in trials))


def calibrated(life: Life) -> Belief:
    """The robot with what its touches say of its encoders."""
    of = life.belief
    learned = joint_offsets(JointOffsetParams(), of.robot, of.rig, of.skin, life.trials)
    return of.corrected(learned.offsets_rad)


def error_mm(true: Life, taken: Life) -> float:
    """Median distance, over all samples and taxels, of where an object is seen from a taxel to where it is."""
    seen = (np.concatenate([trial.d_m for trial in life.displaced]) for life in (true, taken))
    return 1000 * float(np.nanmedian(np.linalg.norm(np.subtract(*seen), axis=-1)))
