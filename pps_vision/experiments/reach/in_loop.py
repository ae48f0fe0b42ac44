"""The reachable-space map asked in every frame of the closed loop: how often it is right, and what it costs.

A ball crosses the left hand's workspace before the rendered eyes, which track and fixate it while the arm rests.  The
truth is closed-form inverse kinematics at the ball's true position.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from tqdm import tqdm

from learning.pps.memory import PPSMemory
from learning.reach.map import ReachableMap
from learning.reach.params import MapParams
from learning.reach.track_reachability import TrackReachability
from learning.reach.training import train_reachable_map
from pps_vision.app.simulation import Episode, EpisodeLog, World, can_follow, log_of, new_pipeline, open_world, simulate
from pps_vision.experiments.baselines.inverse_kinematics import gaze_by_least_squares
from pps_vision.experiments.reach.map_truth import closed_form, random_gaze
from pps_vision.experiments.study import NOISE_SIGMA, SampledStudy, Values, interval, percent
from pps_vision.experiments.tables import Table, estimate
from pps_vision.experiments.timing import timed
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.model import Robot
from pps_vision.types import ReachStatus, Status, Track3D
from rendering.motions import Linear

_DEG = np.pi / 180
_SECONDS, _SPEED_M_S, _LENGTH_M = 3.0, (0.05, 0.15), (0.10, 0.30)
_LIMITS = GazeLimits(pitch_rad=(-80 * _DEG, 40 * _DEG))  # J's, the pitch down to where the eyes' tilt carries the gaze
_ENDS = GazeLimits(
    (-50 * _DEG, 50 * _DEG), (-75 * _DEG, 35 * _DEG), (5 * _DEG, 17 * _DEG)
)  # of paths; nearer, eyes lag
_N_TIMED = 1000
_VERDICTS = {"right": "asked at the track", "right_at_true_position": "asked at the true position"}


@dataclass(frozen=True)
class InLoop(SampledStudy):
    """Reachability in every frame of closed-loop runs against exact inverse kinematics, and its time per frame."""

    n: int = 10
    """Runs, each one path of a ball; the independent units."""
    n_labels: int = 6000
    """Inverse-kinematics solutions the map is learned from."""
    max_fp: float = 1e-3
    """Share of false positives that the map is allowed."""

    def run(self) -> dict[str, Any]:
        """Return the share of frames judged rightly (%, with the interval over runs), counts, and processor times."""
        params = MapParams(_LIMITS, n_labels=self.n_labels, round_labels=min(1500, self.n_labels // 2))
        with open_world(NOISE_SIGMA, self.seed) as world:
            learned = train_reachable_map(world.robot, "left", np.random.default_rng(self.seed), params)
            runs = []
            for k in tqdm(range(self.n), desc="runs", disable=None):
                pipeline = new_pipeline(world, PPSMemory.empty(world.skin), reachable_map=learned)
                episode = crossing(world, k % 2 == 0, np.random.default_rng((self.seed, k)))
                log = log_of(world, episode, simulate(world, episode, pipeline.step, avoid=False), avoid=False)
                runs.append(judge(world.robot, learned, log))
            times = frame_ms(world.robot, learned, self.max_fp, np.random.default_rng((self.seed, self.n)))
        counts = {name: int(sum(np.sum(run[name]) for run in runs)) for name in runs[0] if name not in _VERDICTS}
        shares = {name: interval([run[name] for run in runs], percent) for name in _VERDICTS}
        return {**counts, **shares, "processor_ms": {"all": times}}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the share of frames judged rightly, and the processor time per frame."""
        rows = [
            [f"frames judged rightly, {label} (%)", estimate(numbers[name], 4)] for name, label in _VERDICTS.items()
        ]
        rows.append(["processor time per frame (ms)", f"{numbers['processor_ms']['all'][1]:.2g}"])
        return {"": Table(["map in the loop", "mean (95 % interval) or median"], rows)}


def crossing(world: World, reachable: bool, rng: np.random.Generator) -> Episode:
    """Return a ball on a straight line from within or out of reach, where both eyes see all of the line."""
    model, arm = GazeModel(world.robot), closed_form(world.robot, "left")
    while True:
        begin = model.points(random_gaze(_ENDS, 1, rng))[0]
        if np.isfinite(arm.solve(begin[None])[0, 0]) != reachable:
            continue
        direction = rng.standard_normal(3)
        end = begin + rng.uniform(*_LENGTH_M) * direction / np.linalg.norm(direction)
        motion = Linear(begin, end, rng.uniform(*_SPEED_M_S))
        visible = np.isfinite(model.gaze(end[None], _ENDS)).all()
        if visible and can_follow(world.robot, world.rig, world.home, motion, _SECONDS):
            return Episode("crossing", "ball", motion, _SECONDS)


def judge(robot: Robot, learned: ReachableMap, log: EpisodeLog) -> Values:
    """Return (T,) booleans of the tracked frames of a run: whether each verdict is right, and in which way it is not.

    What no gaze within the map's limits fixates counts as unreachable.
    """
    tracked = np.array([one.status != ReachStatus.UNKNOWN for one in log.reachability])
    said = [one for one, known in zip(log.reachability, tracked, strict=True) if known]
    points = log.truth_m[tracked]
    gaze = gaze_by_least_squares(GazeModel(robot), points, _LIMITS)
    reachable = np.isfinite(closed_form(robot, "left").solve(points)[:, 0]) & np.isfinite(gaze[:, 0])
    verdict = np.array([one.is_reachable for one in said], dtype=bool)
    return {
        "frames": np.ones(len(points), bool),
        "truly_reachable": reachable,
        "not_fixated": np.array([one.status == ReachStatus.NOT_FIXATED for one in said], dtype=bool),
        "false_positives": verdict & ~reachable,
        "false_negatives": ~verdict & reachable,
        "right": verdict == reachable,
        "right_at_true_position": (learned.query(gaze).probability > 0.5) == reachable,
    }


def frame_ms(robot: Robot, learned: ReachableMap, max_fp: float, rng: np.random.Generator) -> list[float]:
    """Return quartiles of the processor time (ms) per frame, asked about 1000 positions."""
    reach, q, ms = TrackReachability(robot, learned, max_fp), np.zeros(robot.n_joints), []
    q[robot.indices(robot.names.torso)] = 0.2
    for point in GazeModel(robot).points(rng.uniform(_LIMITS.lower, _LIMITS.upper, (_N_TIMED, 3))):
        track = Track3D(0.0, np.vstack([point, np.zeros((3, 3))]), np.eye(12), 0.03, 1e-4, Status.TRACKING)
        ms.append(timed(partial(reach, q, track))[1])
    quartiles: list[float] = np.percentile(ms, (25, 50, 75)).tolist()
    return quartiles
