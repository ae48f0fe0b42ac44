"""What the taxels of one body part perceive of trials, and R's map learned from it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from learning.pps.memory import MemoryParams, PPSMemory, count_samples
from learning.pps.receptive_field import ReceptiveField, distance_and_ttc
from learning.pps.trials import TouchTrial
from pps_vision.experiments.baselines.single_taxel import empty_map
from pps_vision.experiments.pps.movements import AIMED, SessionName
from pps_vision.experiments.pps.taxel_trials import Trial
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin, SkinPart, icub_skin, taxel_frame
from pps_vision.types import Array, Mask

HORIZON_S = 0.15  # a prediction uses what is known this long before a trial's end (the goal of the study `calibration`)
FOREARM = "left_forearm"
_UP = np.array([0.0, 0.0, 1.0])  # normal of a taxel in its own frame
_EPS_S = 1e-6


def in_taxel_frames(
    trials: Iterable[TouchTrial], robot: Robot | None = None, skin: Skin | None = None, part: str = FOREARM
) -> tuple[Trial, ...]:
    """Return trials relative to the taxels of one part of a skin (default: the iCub's), which move with the joints."""
    robot, skin = robot or load_icub(), skin or icub_skin()
    k = [one.name for one in skin.parts].index(part)
    return tuple(_in_taxel_frames(t, robot, skin.parts[k], t.touched[skin.part_index == k]) for t in trials)


def _in_taxel_frames(trial: TouchTrial, robot: Robot, part: SkinPart, touched: Mask) -> Trial:
    frames = [taxel_frame(p, n)[:3, :3] for p, n in zip(part.positions_m, part.normals, strict=True)]
    T_root_part = np.array([robot.at(q).T_root(part.frame) for q in trial.joints_rad])[:, None]
    R_root_taxel = T_root_part[..., :3, :3] @ np.array(frames)  # (T, n, 3, 3)
    taxels = (T_root_part[..., :3, :3] @ part.positions_m[..., None])[..., 0] + T_root_part[..., :3, 3]
    moving = np.gradient(taxels, trial.stamps_s, axis=0)
    R_taxel_root = R_root_taxel.swapaxes(-1, -2)
    d, v = trial.positions[:, None] - taxels, trial.velocities[:, None] - moving
    covs = R_taxel_root @ trial.velocity_covs[:, None] @ R_root_taxel
    known = trial.radius_m[known_at(trial.stamps_s, HORIZON_S) & np.isfinite(trial.radius_m)]
    radius_m = float(np.median(known)) if len(known) else 0.0
    d, v = ((R_taxel_root @ a[..., None])[..., 0] for a in (d, v))
    return Trial(trial.stamps_s, d, v, touched, radius_m, covs)


def known_at(stamps_s: Array, horizon_s: float) -> Mask:
    """Return which samples (T,) are known `horizon_s` before the last."""
    known: Mask = stamps_s <= stamps_s[-1] - horizon_s + _EPS_S
    return known


def perceive(trial: Trial, field: ReceptiveField | None = None) -> tuple[Array, Array]:
    """Return D in m and TTC in s (T, n) of a trial."""
    return distance_and_ttc(field or ReceptiveField(), trial.d_m, _UP, trial.v_m_s, trial.radius_m, trial.velocity_covs)


def at_horizon(
    trials: Sequence[Trial], horizon_s: float = HORIZON_S, field: ReceptiveField | None = None
) -> tuple[Array, Array]:
    """Return D and TTC (trials, n) of the last sample known `horizon_s` before the end; NaN without one."""
    found = np.full((2, len(trials), len(trials[0].touched)), np.nan)
    for k, trial in enumerate(trials):
        known = known_at(trial.stamps_s, horizon_s)
        if known.any():
            found[:, k] = [samples[known][-1] for samples in perceive(trial, field)]
    return found[0], found[1]


def train_memory(
    trials: Sequence[Trial], params: MemoryParams | None = None, field: ReceptiveField | None = None
) -> PPSMemory:
    """Return R's map of the taxels after trials; a trial without a touch counts for nothing (R)."""
    memory = empty_map(len(trials[0].touched), params or MemoryParams())
    for trial in trials:
        memory = count_samples(memory, *perceive(trial, field), trial.touched)
    return memory


@dataclass(frozen=True)
class Session:
    """Trials of one of R's sessions as the part of the skin aimed at perceives them."""

    part: SkinPart
    aimed: tuple[int, ...]
    """Indices of the taxels aimed at."""
    trials: tuple[Trial, ...]

    @classmethod
    def of(
        cls, name: SessionName, trials: Iterable[TouchTrial], robot: Robot | None = None, skin: Skin | None = None
    ) -> "Session":
        """Return a session as a robot and its skin perceive it (default: the iCub)."""
        aimed, ids = AIMED[name]
        (part,) = (one for one in (skin or icub_skin()).parts if one.name == aimed)
        return cls(part, tuple(part.ids.index(i) for i in ids), in_taxel_frames(trials, robot, skin, aimed))

    def name(self, taxel: int) -> str:
        """Return the name "part:id" of a taxel."""
        return f"{self.part.name}:{self.part.ids[taxel]}"

    def shown_taxel(self, memory: PPSMemory) -> int:
        """Return the taxel with the most samples, which R shows."""
        return max(self.aimed, key=lambda i: int(memory.counts[i].sum()))
