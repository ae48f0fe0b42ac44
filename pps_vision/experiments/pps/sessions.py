"""R's five sessions: the trials of each condition, as many as R made, and what its part of the skin perceived."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from learning.pps.memory import MemoryParams, PPSMemory
from learning.pps.touch_trial import TouchTrial
from pps_vision.experiments.pps.held_out import Approach, approaches, known_trials, learned, of_part
from pps_vision.experiments.pps.touch_movements import TRIALS, Condition
from pps_vision.experiments.pps.touch_trials import touch_trials
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import INNER_FOREARM, OUTER_FOREARM, Skin, icub_skin

TRAINED: dict[Condition, tuple[str, tuple[int, ...]]] = {
    "motor": ("left_forearm", INNER_FOREARM),
    "visual": ("left_forearm", INNER_FOREARM),
    "inner": ("left_forearm", INNER_FOREARM),
    "outer": ("left_forearm", OUTER_FOREARM),
    "palm": ("right_palm", (101, 103, 118, 137)),
}
"""The part of the skin and its taxels that each session aims at."""


@dataclass(frozen=True)
class Session:
    """Trials of one condition and what `skin`, the body part they aim at, perceived in each; `aimed` are the indices
    in that skin of the taxels that they aim at."""

    condition: Condition
    skin: Skin
    aimed: tuple[int, ...]
    trials: tuple[TouchTrial, ...]
    approaches: tuple[Approach, ...]

    def memory(self, params: MemoryParams | None = None, first: int | None = None) -> PPSMemory:
        """What is learned from the `first` trials (default: all)."""
        return learned(self.skin, params or MemoryParams(), self.approaches[:first])

    def taxel_with_most_samples(self, memory: PPSMemory) -> int:
        """R shows one taxel of each session: one with the most samples."""
        return max(self.aimed, key=lambda i: int(memory.counts[i].sum()))


def session(condition: Condition, seed: int, seen: bool, folder: Path) -> Session:
    """A session as the robot saw it, or as it truly was; motor trials are blind in any case."""
    n = TRIALS[condition]
    is_seen = seen and condition != "motor"
    return session_of(
        condition, touch_trials(condition, n, seed, True, folder) if is_seen else known_trials(condition, n, seed)
    )


def session_of(
    condition: Condition, trials: Sequence[TouchTrial], robot: Robot | None = None, whole: Skin | None = None
) -> Session:
    """What the part that a condition aims at perceived of trials, by a robot and its skin (default: the iCub)."""
    robot, whole = robot or load_icub(), whole or icub_skin()
    part, ids = TRAINED[condition]
    skin = of_part(whole, part)
    perceived = approaches(trials, robot, skin, whole)
    return Session(condition, skin, tuple(skin.index(f"{part}:{i}") for i in ids), tuple(trials), perceived)


def samples_per_trial(session: Session) -> list[int]:
    """Steps of 50 ms in which some taxel of the part perceived the object."""
    return [int(np.isfinite(one.distance_m).any(axis=1).sum()) for one in session.approaches]
