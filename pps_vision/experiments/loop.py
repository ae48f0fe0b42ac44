"""The closed loop, many times: who is touched, and who moves without cause."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from tqdm import tqdm

from learning.pps.memory import PPSMemory
from pps_vision.app.simulation import (
    SPEED_M_S,
    EpisodeLog,
    Kind,
    TrainingParams,
    World,
    log_of,
    make_episode,
    new_pipeline,
    open_world,
    simulate,
    train,
)
from pps_vision.experiments.study import SampledStudy
from pps_vision.experiments.tables import Table
from pps_vision.robot.skin import INNER_FOREARM

Case = Literal["avoidance on", "avoidance off", "receding", "static", "own arm"]
CASES: dict[Case, tuple[Kind, bool]] = {
    "avoidance on": ("approach", True),
    "avoidance off": ("approach", False),
    "receding": ("recede", True),
    "static": ("static", True),
    "own arm": ("own_arm", True),
}


@dataclass(frozen=True)
class Loop(SampledStudy):
    """Episodes with an octopus at 5–15 cm/s after learning from ball and cube: who is touched, who moves
    without cause.

    Cases: approach with avoidance on and off, receding, standing still, own arm moving with nothing near.
    """

    n: int = 20
    """Episodes of every case."""
    training_trials: int = 24
    """Approaches that end in a touch, learned from before the episodes."""

    def run(self) -> dict[str, object]:
        """Counts by case, with what the tracker was worth meanwhile."""
        training = TrainingParams(self.training_trials)
        with open_world(training.noise_sigma, self.seed) as world:
            memory = train(world, training)
            logs = {
                case: [self.episode(world, memory, case, k) for k in tqdm(range(self.n), case, disable=None)]
                for case in CASES
            }
        return {"seed": self.seed, "n": self.n, **{case: _counts(of_case) for case, of_case in logs.items()}}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one row a case."""
        rows = []
        for case in CASES:
            counts = numbers[case]
            gaps = [gap for gap in counts["smallest_gap_mm"] if gap is not None]
            shares = (f"{counts[key]} of {counts['episodes']}" for key in ("touched", "commanded"))
            rows.append([case, *shares, f"{np.median(gaps):.0f}" if gaps else "–", f"{min(gaps):.0f}" if gaps else "–"])
        return {"": Table(["case", "touched", "arm commanded", "smallest gap (mm), median", "smallest"], rows)}

    def episode(self, world: World, memory: PPSMemory, case: Case, number: int) -> EpisodeLog:
        """One episode; approaches of the same number are the same with avoidance on and off."""
        kind, avoid = CASES[case]
        rng = np.random.default_rng((self.seed, number, sorted({k for k, _ in CASES.values()}).index(kind)))
        taxel = f"left_forearm:{INNER_FOREARM[number % len(INNER_FOREARM)]}"
        episode = make_episode(kind, world, taxel, "octopus", rng, rng.uniform(*SPEED_M_S))
        return log_of(world, episode, simulate(world, episode, new_pipeline(world, memory).step, avoid), avoid)


def _counts(logs: list[EpisodeLog]) -> dict[str, object]:
    errors = np.concatenate([np.linalg.norm(log.track_m - log.truth_m, axis=1) for log in logs])
    known = np.isfinite(errors)
    return {
        "episodes": len(logs),
        "touched": sum(log.was_touched for log in logs),
        "commanded": sum(log.was_commanded for log in logs),
        "smallest_gap_mm": [
            round(1000 * float(np.nanmin(log.surface_gap_m)), 1) if np.isfinite(log.surface_gap_m).any() else None
            for log in logs
        ],
        "highest_activation": [round(float(log.activations.max()), 3) for log in logs],
        "track_rms_mm": 1000 * float(np.sqrt(np.mean(errors[known] ** 2))) if known.any() else None,
    }
