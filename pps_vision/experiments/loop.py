"""The closed loop, many times: who is touched, and who moves without cause."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Literal

import numpy as np
from tqdm import tqdm

from learning.pps.memory import PPSMemory
from pps_vision.app.pipeline import PipelineStep
from pps_vision.app.simulation import (
    SPEED_M_S,
    EpisodeLog,
    Kind,
    World,
    log_of,
    make_episode,
    new_pipeline,
    open_world,
    simulate,
    train,
)
from pps_vision.experiments.study import NOISE_SIGMA, SampledStudy, percent_of
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.experiments.timing import timed
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.skin import INNER_FOREARM
from pps_vision.types import Mask, Status, StereoFrame

LoopCase = Literal["avoidance on", "avoidance off", "receding", "static", "own arm"]
LOOP_CASES: dict[LoopCase, tuple[Kind, bool]] = {
    "avoidance on": ("approach", True),
    "avoidance off": ("approach", False),
    "receding": ("recede", True),
    "static": ("static", True),
    "own arm": ("own_arm", True),
}

_MOST_MS = 8.0, 20.0
"""Goals of a frame's processor time: median and 99th percentile."""


@dataclass(frozen=True)
class Loop(SampledStudy):
    """Episodes with an octopus at 5–15 cm/s after learning from ball and cube: who is touched, who moves
    without cause.

    Cases: approach with avoidance on and off, receding, standing still, own arm moving with nothing near.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"training_trials": 2}

    n: int = 20
    """Episodes of every case."""
    training_trials: int = 24
    """Approaches that end in a touch, learned from before the episodes."""

    def run(self) -> dict[str, object]:
        """Counts by case, with what the tracker was worth meanwhile."""
        with open_world(NOISE_SIGMA, self.seed) as world:
            memory = train(world, self.training_trials)
            counts: dict[str, object] = {}
            for case in LOOP_CASES:
                ms: list[float] = []
                logs = [self.episode(world, memory, case, k, ms) for k in tqdm(range(self.n), case, disable=None)]
                counts[case] = (
                    _counts(logs) | _seen(world.rig, logs) | {"ms": np.percentile(ms, (50, 99)).round(2).tolist()}
                )
        return {"seed": self.seed, "n": self.n, **counts}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one row a case."""
        rows = []
        for case in LOOP_CASES:
            counts = numbers[case]
            gaps = [gap for gap in counts["smallest_gap_mm"] if np.isfinite(gap)]
            n = counts["episodes"]
            both = ((counts[key], estimate(percent_of(counts[key], n))) for key in ("touched", "commanded"))
            shares = (f"{counted} of {n}: {percentage} %" for counted, percentage in both)
            ms = (judged(f"{ms:.1f}", ms > most) for ms, most in zip(counts["ms"], _MOST_MS, strict=True))
            least = (f"{np.median(gaps):.0f}", f"{min(gaps):.0f}") if gaps else ("–", "–")
            rows.append([case, *shares, *least, *ms])
        gap = "smallest gap (mm), median", "smallest"
        time = f"ms a frame, median (≤ {_MOST_MS[0]:g})", f"99th percentile (≤ {_MOST_MS[1]:g})"
        avoiding = {case: numbers[case]["seen_percent"] for case in LOOP_CASES if "seen_percent" in numbers[case]}
        seen = [[case, *(f"{share:.1f}" for share in shares)] for case, shares in avoiding.items()]
        return {
            "": Table(["case", "touched", "arm commanded", *gap, *time], rows),
            "view": Table(["frames in which the arm avoids", "in the images of both eyes (%)", "tracked (%)"], seen),
        }

    def episode(
        self, world: World, memory: PPSMemory, case: LoopCase, number: int, ms: list[float] | None = None
    ) -> EpisodeLog:
        """One episode; approaches of the same number are the same with avoidance on and off.

        To `ms` come the processor times of the frames: perception, prediction and control, without rendering.
        """
        kind, avoid = LOOP_CASES[case]
        rng = np.random.default_rng((self.seed, number, sorted({k for k, _ in LOOP_CASES.values()}).index(kind)))
        taxel = f"left_forearm:{INNER_FOREARM[number % len(INNER_FOREARM)]}"
        episode = make_episode(kind, world, taxel, "octopus", rng, rng.uniform(*SPEED_M_S))
        pipeline = new_pipeline(world, memory)

        def step(frame: StereoFrame, touched: Mask) -> PipelineStep:
            result, spent = timed(partial(pipeline.step, frame, touched))
            if ms is not None:
                ms.append(spent)
            return result

        return log_of(world, episode, simulate(world, episode, step, avoid), avoid)


def _seen(rig: StereoRig, logs: list[EpisodeLog]) -> dict[str, list[float]]:
    """Of the frames in which the arm avoids: the share in which the object's centre is in the images of both eyes, and
    the share in which it is tracked, which it is not where the arm hides it; nothing without such frames."""
    seen: list[tuple[bool, bool]] = []
    for log in logs:
        for k in np.flatnonzero(log.speed_m_s > 0):
            view, p = rig.view(log.q_rad[k]), log.truth_m[k]
            seen.append((view.left.sees(p) and view.right.sees(p), log.status[k] is Status.TRACKING))
    return {"seen_percent": (100 * np.mean(seen, axis=0)).tolist()} if seen else {}


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
