"""Trials as a skin perceived them: samples to learn from, and what was known of others shortly before their end."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from learning.pps.memory import MemoryParams, PPSMemory, count_samples
from learning.pps.receptive_field import ReceptiveField
from learning.pps.touch_trial import TouchTrial, perceived
from learning.pps.trials import Trial
from pps_vision.experiments.pps.touch_movements import Condition
from pps_vision.experiments.pps.touch_trials import touch_trials
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin, taxel_frame
from pps_vision.types import Array, Mask

LEAD_S = 0.15  # before a trial's end: what is known then is what a prediction may use
_EPS_S = 1e-6


@dataclass(frozen=True)
class Approach:
    """D and TTC of a trial (T, n) as its robot takes them, the time `left_s` (T,) to its end, what was `touched`
    (n,) then."""

    left_s: Array
    distance_m: Array
    ttc_s: Array
    touched: Mask


Samples = tuple[Array, Array, Mask]
"""D, TTC and what came of it (N, n)."""


@cache
def known_trials(condition: Condition, n: int, seed: int, touching: bool = True) -> tuple[TouchTrial, ...]:
    """Trials of which the robot knows all; several figures start from the same."""
    return touch_trials(condition, n, seed, touching=touching)


def of_part(skin: Skin, part: str) -> Skin:
    """One part of a skin."""
    return Skin(tuple(one for one in skin.parts if one.name == part))


def approaches(
    trials: Iterable[TouchTrial], robot: Robot, skin: Skin, whole: Skin, field: ReceptiveField | None = None
) -> tuple[Approach, ...]:
    """What `skin`, some parts of the `whole` one the trials speak of, perceived in each."""
    here = np.isin(whole.taxel_ids, skin.taxel_ids)
    return tuple(
        Approach(
            trial.stamps_s[-1] - trial.stamps_s,
            *perceived(trial, robot, skin, field or ReceptiveField()),
            trial.touched[here],
        )
        for trial in trials
    )


def samples(trials: Sequence[Approach]) -> Samples:
    """All that was perceived in trials."""
    touched = [np.broadcast_to(trial.touched, trial.distance_m.shape) for trial in trials]
    return (
        np.concatenate([trial.distance_m for trial in trials]),
        np.concatenate([trial.ttc_s for trial in trials]),
        np.concatenate(touched),
    )


def at_horizon(trials: Sequence[Approach], lead_s: float = LEAD_S) -> Samples:
    """The last that was perceived `lead_s` before the end of each trial; NaN where nothing was."""
    D, TTC = np.full((2, len(trials), len(trials[0].touched)), np.nan)
    for k, trial in enumerate(trials):
        for last in np.flatnonzero(trial.left_s >= lead_s - _EPS_S)[-1:]:
            D[k], TTC[k] = trial.distance_m[last], trial.ttc_s[last]
    return D, TTC, np.array([trial.touched for trial in trials])


def learned(skin: Skin, params: MemoryParams, trials: Iterable[Approach]) -> PPSMemory:
    """The memory of trials; those that touched nothing teach nothing (R)."""
    memory = PPSMemory.empty(skin, params)
    for trial in trials:
        memory = count_samples(memory, trial.distance_m, trial.ttc_s, trial.touched)
    return memory


def displaced(trials: Iterable[TouchTrial], robot: Robot, skin: Skin, whole: Skin) -> tuple[Trial, ...]:
    """The same trials as displacements from the taxels of `skin`, in the taxels' own frames."""
    here = np.isin(whole.taxel_ids, skin.taxel_ids)
    return tuple(_displaced(trial, robot, skin, trial.touched[here]) for trial in trials)


def _displaced(trial: TouchTrial, robot: Robot, skin: Skin, touched: Mask) -> Trial:
    d = np.zeros((len(trial.stamps_s), len(touched), 3))
    for part, of_part in ((part, skin.part_index == k) for k, part in enumerate(skin.parts)):
        T_taxel_part = inverse(
            np.array([taxel_frame(p, n) for p, n in zip(part.positions_m, part.normals, strict=True)])
        )
        for k, (q, p) in enumerate(zip(trial.joints_rad, trial.positions, strict=True)):
            in_part = move_points(inverse(robot.at(q).T_root(part.frame)), p)
            d[k, of_part] = T_taxel_part[:, :3, :3] @ in_part + T_taxel_part[:, :3, 3]
    v = np.asarray(np.gradient(d, trial.stamps_s, axis=0))
    return Trial(trial.stamps_s, d, v, touched)
