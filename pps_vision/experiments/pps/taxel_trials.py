"""Trials as the taxels of one body part perceive them, the authors' trials, and R's map learned from trials."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from learning.archive import read_arrays
from learning.pps.joint_offsets import TouchTrial
from learning.pps.memory import MemoryParams, PPSMemory, count_samples
from learning.pps.receptive_field import ReceptiveField
from pps_vision.app.encounters.encounter import SessionName
from pps_vision.app.sessions import AIMED
from pps_vision.experiments.baselines.single_taxel import empty_map, from_taxel
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin, SkinPart, icub_skin, taxel_frame
from pps_vision.types import Array, Mask

HORIZON_S = 0.15  # A prediction uses samples up to this time before a trial's end
FOREARM = "left_forearm"
_SAMPLE_PERIOD_S = 0.1  # the released positions and velocities are resampled
_SAMPLES = ("position_m", "velocity_m_s")
_EPS_S = 1e-6


@dataclass(frozen=True)
class Trial:
    """One approach to n taxels, T samples; NaN while the object is unknown."""

    stamps_s: Array  # (T,)
    d_m: Array  # (T, n, 3) displacement from taxel to object in the taxel's frame, z along its normal
    v_m_s: Array  # (T, n, 3) velocity of the object relative to the taxel, in the taxel's frame
    touched: Mask  # (n,) taxels touched at the end
    radius_m: float = 0.0  # radius of the object
    velocity_covs: Array | None = None  # (T, n, 3, 3) m²/s², covariance of `v_m_s`; None where it is not known


def load_trials(path: Path) -> tuple[Trial, ...]:
    """Read a file of the authors' trials.

    The rows of `position_m` and `velocity_m_s` (m, 3) follow each other by trial and taxel; pair k has the rows
    `offsets[k]` to `offsets[k + 1]`. `outcome` (trials, taxels) is 1 (touched) or -1.
    """
    data = read_arrays(path, "trials", (*_SAMPLES, "offsets", "outcome"))
    is_touched = data["outcome"].astype(int) > 0
    n_taxels = is_touched.shape[1]
    ends = data["offsets"].astype(int)[n_taxels:-1:n_taxels]
    trials = []
    for touched, *samples in zip(is_touched, *(np.split(data[name], ends) for name in _SAMPLES), strict=True):
        d_m, v_m_s = (values.astype(float).reshape(n_taxels, -1, 3).swapaxes(0, 1) for values in samples)
        trials.append(Trial(_SAMPLE_PERIOD_S * np.arange(len(d_m)), d_m, v_m_s, touched))
    return tuple(trials)


def in_taxel_frames(
    trials: Iterable[TouchTrial], robot: Robot | None = None, skin: Skin | None = None, part_name: str = FOREARM
) -> tuple[Trial, ...]:
    """Return trials relative to the taxels of one part of a skin (default: the iCub's), which move with the joints."""
    robot = robot or load_icub()
    skin = skin or icub_skin()
    k = [part.name for part in skin.parts].index(part_name)
    return tuple(_in_taxel_frames(t, robot, skin.parts[k], t.touched[skin.part_index == k]) for t in trials)


def _in_taxel_frames(trial: TouchTrial, robot: Robot, part: SkinPart, touched: Mask) -> Trial:
    frames = [taxel_frame(p, n)[:3, :3] for p, n in zip(part.positions_m, part.normals, strict=True)]
    T_root_part = np.array([robot.at(q).T_root(part.frame) for q in trial.joints_rad])[:, None]
    R_root_taxel = T_root_part[..., :3, :3] @ np.array(frames)  # (T, n, 3, 3)
    R_taxel_root = R_root_taxel.swapaxes(-1, -2)
    taxels = (T_root_part[..., :3, :3] @ part.positions_m[..., None])[..., 0] + T_root_part[..., :3, 3]
    d = trial.positions[:, None] - taxels
    v = trial.velocities[:, None] - np.gradient(taxels, trial.stamps_s, axis=0)
    radii = trial.radius_m[known_at_horizon(trial.stamps_s) & np.isfinite(trial.radius_m)]
    return Trial(
        stamps_s=trial.stamps_s,
        d_m=(R_taxel_root @ d[..., None])[..., 0],
        v_m_s=(R_taxel_root @ v[..., None])[..., 0],
        touched=touched,
        radius_m=float(np.median(radii)) if len(radii) else 0.0,
        velocity_covs=R_taxel_root @ trial.velocity_covs[:, None] @ R_root_taxel,
    )


def known_at_horizon(stamps_s: Array) -> Mask:
    """Return which samples (T,) are known at the horizon."""
    mask: Mask = stamps_s <= stamps_s[-1] - HORIZON_S + _EPS_S
    return mask


def perceive(trial: Trial) -> tuple[Array, Array]:
    """Return D in m and TTC in s (T, n) of a trial."""
    return from_taxel(trial.d_m, trial.v_m_s, ReceptiveField(), trial.radius_m, trial.velocity_covs)


def at_horizon(trials: Sequence[Trial]) -> tuple[Array, Array]:
    """Return D and TTC (trials, n) of the last sample known at the horizon; NaN without one."""
    D, TTC = np.full((2, len(trials), len(trials[0].touched)), np.nan)
    for k, trial in enumerate(trials):
        in_time = np.flatnonzero(known_at_horizon(trial.stamps_s))
        if len(in_time):
            D[k], TTC[k] = (values[in_time[-1]] for values in perceive(trial))
    return D, TTC


def train_memory(trials: Sequence[Trial], params: MemoryParams | None = None) -> PPSMemory:
    """Return R's map of the taxels after trials; trials without a touch are not counted (R)."""
    memory = empty_map(len(trials[0].touched), params or MemoryParams())
    for trial in trials:
        memory = count_samples(memory, *perceive(trial), trial.touched)
    return memory


@dataclass(frozen=True)
class Session:
    """Trials of one of R's sessions as the part of the skin aimed at perceives them."""

    part: SkinPart
    aimed: tuple[int, ...]  # indices of the taxels aimed at
    trials: tuple[Trial, ...]

    @classmethod
    def of(
        cls, name: SessionName, trials: Iterable[TouchTrial], robot: Robot | None = None, skin: Skin | None = None
    ) -> "Session":
        """Return a session as a robot and its skin perceive it (default: the iCub)."""
        part_name, ids = AIMED[name]
        (part,) = (part for part in (skin or icub_skin()).parts if part.name == part_name)
        return cls(part, tuple(part.ids.index(i) for i in ids), in_taxel_frames(trials, robot, skin, part_name))

    def name(self, taxel: int) -> str:
        """Return the name "part:id" of a taxel."""
        return f"{self.part.name}:{self.part.ids[taxel]}"

    def shown_taxel(self, memory: PPSMemory) -> int:
        """Return the taxel with the most samples, which R shows."""
        return max(self.aimed, key=lambda taxel: int(memory.counts[taxel].sum()))
