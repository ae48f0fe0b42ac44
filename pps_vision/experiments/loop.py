"""Many episodes of the rendered closed loop: touched, commanded, and the time of a frame."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from tqdm import tqdm

from learning.pps.memory import PPSMemory
from pps_vision.app.intervals import percent_of
from pps_vision.app.pipeline import PipelineStep
from pps_vision.app.simulation import (
    SPEED_M_S,
    EpisodeLog,
    Kind,
    SimulationScene,
    log_of,
    make_episode,
    new_pipeline,
    open_scene,
    simulate,
    train,
)
from pps_vision.experiments.study import NOISE_SIGMA, SampledStudy
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.experiments.timing import timed
from pps_vision.recordings.robot_file import read_robot
from pps_vision.types import Mask, StereoFrame

LoopCase = Literal[
    "avoidance on",
    "avoidance off",
    "receding",
    "static",
    "own arm",
    "constant 1",
    "constant 1, receding",
    "constant 1, static",
]
LOOP_CASES: dict[LoopCase, tuple[Kind, bool]] = {
    "avoidance on": ("approach", True),
    "avoidance off": ("approach", False),
    "receding": ("recede", True),
    "static": ("static", True),
    "own arm": ("own_arm", True),
    "constant 1": ("approach", True),
    "constant 1, receding": ("recede", True),
    "constant 1, static": ("static", True),
}
"""Kind of episode, and whether the arm obeys; "constant 1": with a memory that has learned nothing,"""
GOALS_MS = 8.0, 20.0  # goals of a frame's processor time: median and 99th percentile


@dataclass(frozen=True)
class Loop(SampledStudy):
    """Episodes with an octopus at 5–15 cm/s after learning from ball and cube.

    Cases: approach with avoidance on and off, receding, standing still, own arm moving with nothing near.
    """

    MINUTES: ClassVar[int] = 20
    SHORT: ClassVar[Mapping[str, Any]] = {"training_trials": 2}

    n: int = 20  # episodes of every case
    training_trials: int = 24  # approaches that end in a touch, learned from before the episodes
    robot: Path | None = None  # robot.toml of another robot

    def run(self) -> dict[str, Any]:
        """Return the counts by case."""
        with open_scene(NOISE_SIGMA, self.seed, read_robot(self.robot) if self.robot else None) as scene:
            memory = train(scene, self.training_trials)
            cases: dict[str, Any] = {}
            for case in LOOP_CASES:
                ms: list[float] = []
                logs = [self.episode(scene, memory, case, k, ms) for k in tqdm(range(self.n), case, disable=None)]
                gaps_m = [log.surface_gap_m for log in logs]
                cases[case] = {
                    "episodes": len(logs),
                    "touched": sum(log.was_touched for log in logs),
                    "commanded": sum(log.was_commanded for log in logs),
                    "smallest_gap_mm": [1000 * float(np.nanmin(g)) if np.isfinite(g).any() else None for g in gaps_m],
                    "ms": np.percentile(ms, (50, 99)).round(2).tolist(),
                }
        return {"n": self.n, **cases}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one row a case."""
        rows = []
        for case in (case for case in LOOP_CASES if case in numbers):
            cell = numbers[case]
            shares = (estimate(percent_of(cell[key], cell["episodes"])) for key in ("touched", "commanded"))
            gaps_mm = [gap for gap in cell["smallest_gap_mm"] if np.isfinite(gap)]
            ms = (judged(f"{ms:.1f}", ms > goal) for ms, goal in zip(cell["ms"], GOALS_MS, strict=True))
            rows.append([case, *shares, f"{min(gaps_mm):.0f}" if gaps_mm else "–", *ms])
        time = f"ms, median (≤ {GOALS_MS[0]:g})", f"99 % (≤ {GOALS_MS[1]:g})"
        return {"": Table(["case", "touched (%)", "commanded (%)", "smallest gap (mm)", *time], rows)}

    def episode(
        self, scene: SimulationScene, memory: PPSMemory, case: LoopCase, number: int, ms: list[float] | None = None
    ) -> EpisodeLog:
        """Run one episode; approaches of the same number are the same with avoidance on and off.

        Appends to `ms` the processor times of the frames: perception, prediction and control, without rendering.
        """
        kind, avoid = LOOP_CASES[case]
        kinds = sorted({kind for kind, _ in LOOP_CASES.values()})
        rng = np.random.default_rng((self.seed, number, kinds.index(kind)))
        taxel = scene.trained_taxels[number % len(scene.trained_taxels)]
        episode = make_episode(kind, scene, taxel, "octopus", rng, rng.uniform(*SPEED_M_S))
        memory = PPSMemory.constant(scene.skin) if case.startswith("constant") else memory
        pipeline = new_pipeline(scene, memory)

        def step(frame: StereoFrame, touched: Mask) -> PipelineStep:
            result, frame_ms = timed(partial(pipeline.step, frame, touched))
            if ms is not None:
                ms.append(frame_ms)
            return result

        return log_of(scene, episode, simulate(scene, episode, step, avoid), avoid)
