"""What the skin perceives of trials: samples of D and TTC to learn from, and what is known shortly before the end."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from learning.pps.memory import MemoryParams, PPSMemory, count_samples
from learning.pps.receptive_field import ReceptiveField
from learning.pps.touch_trial import TouchTrial, perceived
from learning.pps.trials import Trial
from pps_vision.experiments.pps.movements import AIMED, SessionName
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin, SkinPart, icub_skin, taxel_frame
from pps_vision.types import Array, Mask

HORIZON_S = 0.15  # a prediction uses what is known this long before a trial's end (the number)
FOREARM = "left_forearm"
_EPS_S = 1e-6


@dataclass(frozen=True)
class PerceivedTrial:
    """D in m and TTC in s (T, n) that n taxels perceive, the time to the trial's end `left_s` (T,), and which of them
    are touched then, `touched` (n,)."""

    left_s: Array
    distance_m: Array
    ttc_s: Array
    touched: Mask


def skin_part(skin: Skin, part: str) -> Skin:
    """Return the skin of one body part."""
    return Skin(tuple(one for one in skin.parts if one.name == part))


def perceive_trials(
    trials: Iterable[TouchTrial], robot: Robot, skin: Skin, part: str = FOREARM, field: ReceptiveField | None = None
) -> tuple[PerceivedTrial, ...]:
    """Return what the taxels of one part of a skin perceive of trials."""
    on_part, of_part = skin_part(skin, part), _taxels_of(skin, part)
    field = field or ReceptiveField()
    return tuple(
        PerceivedTrial(t.stamps_s[-1] - t.stamps_s, *perceived(t, robot, on_part, field), t.touched[of_part])
        for t in trials
    )


def at_horizon(trials: Sequence[PerceivedTrial], horizon_s: float = HORIZON_S) -> tuple[Array, Array, Mask]:
    """Return D, TTC and outcomes (trials, n) of the last sample known `horizon_s` before the end; NaN without one."""
    D, TTC = np.full((2, len(trials), len(trials[0].touched)), np.nan)
    for k, trial in enumerate(trials):
        for last in np.flatnonzero(trial.left_s >= horizon_s - _EPS_S)[-1:]:
            D[k], TTC[k] = trial.distance_m[last], trial.ttc_s[last]
    return D, TTC, np.array([trial.touched for trial in trials])


def train_memory(
    trials: Iterable[PerceivedTrial], params: MemoryParams | None = None, taxel_ids: tuple[str, ...] | None = None
) -> PPSMemory:
    """Return R's map of the taxels of one part after trials; a trial without a touch counts for nothing (R)."""
    trials, params = list(trials), params or MemoryParams()
    taxel_ids = taxel_ids or tuple(map(str, range(len(trials[0].touched))))
    n = len(taxel_ids)
    memory = PPSMemory(taxel_ids, np.zeros(n, np.intp), np.zeros((n, *params.bins, 2), np.int64), params)
    for trial in trials:
        memory = count_samples(memory, trial.distance_m, trial.ttc_s, trial.touched)
    return memory


def displacements(trials: Iterable[TouchTrial], robot: Robot, skin: Skin, part: str = FOREARM) -> tuple[Trial, ...]:
    """Return trials as displacements from the taxels of one part, in the taxels' frames."""
    (body,) = skin_part(skin, part).parts
    return tuple(_displacements(trial, robot, body, trial.touched[_taxels_of(skin, part)]) for trial in trials)


def _displacements(trial: TouchTrial, robot: Robot, part: SkinPart, touched: Mask) -> Trial:
    frames = [taxel_frame(p, n) for p, n in zip(part.positions_m, part.normals, strict=True)]
    T_taxel_part = inverse(np.array(frames))
    d = np.zeros((len(trial.stamps_s), len(touched), 3))
    for k, (q, p) in enumerate(zip(trial.joints_rad, trial.positions, strict=True)):
        in_part = move_points(inverse(robot.at(q).T_root(part.frame)), p)
        d[k] = T_taxel_part[:, :3, :3] @ in_part + T_taxel_part[:, :3, 3]
    v = np.asarray(np.gradient(d, trial.stamps_s, axis=0))
    return Trial(trial.stamps_s, d, v, touched)


def _taxels_of(skin: Skin, part: str) -> Mask:
    """Which taxels (n,) of a skin are on a part."""
    return np.isin(skin.taxel_ids, skin_part(skin, part).taxel_ids)


@dataclass(frozen=True)
class Session:
    """Trials of one of R's sessions and what `skin`, the part aimed at, perceives; `aimed` are indices in that skin."""

    skin: Skin
    aimed: tuple[int, ...]
    trials: tuple[TouchTrial, ...]
    perceived: tuple[PerceivedTrial, ...]

    @classmethod
    def of(
        cls, name: SessionName, trials: tuple[TouchTrial, ...], robot: Robot | None = None, skin: Skin | None = None
    ) -> "Session":
        """Return a session as a robot and its skin perceive it (default: the iCub)."""
        robot, whole = robot or load_icub(), skin or icub_skin()
        part, ids = AIMED[name]
        on_part = skin_part(whole, part)
        aimed = tuple(on_part.index(f"{part}:{i}") for i in ids)
        return cls(on_part, aimed, trials, perceive_trials(trials, robot, whole, part))

    def memory(self, params: MemoryParams | None = None, n: int | None = None) -> PPSMemory:
        """Return R's map after the first `n` trials (default: all)."""
        return train_memory(self.perceived[:n], params, self.skin.taxel_ids)

    def shown_taxel(self, memory: PPSMemory) -> int:
        """Return the taxel with the most samples, which R shows."""
        return max(self.aimed, key=lambda i: int(memory.counts[i].sum()))
