"""The reachable-space map asked in every frame of the closed loop: how often it is right, and what it costs.

A ball crosses the left hand's workspace before the rendered eyes, which track and fixate it while the arm rests.  The
truth is closed-form inverse kinematics at the ball's true position.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import thread_time_ns
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.pps.memory import PPSMemory
from learning.reach.map import ReachableMap
from learning.reach.track_reachability import TrackReachability
from learning.reach.training import MapParams, train_reachable_map
from pps_vision.app.simulation import Episode, EpisodeLog, World, can_follow, log_of, new_pipeline, open_world, simulate
from pps_vision.experiments import charts
from pps_vision.experiments.baselines.inverse_kinematics import gaze_by_least_squares
from pps_vision.experiments.reach.map_truth import closed_form, random_gaze
from pps_vision.experiments.study import Study, Values, interval, percent
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.model import Robot
from pps_vision.types import ReachStatus, Status, Track3D
from rendering.motions import Linear

_DEG = np.pi / 180
_NOISE_SIGMA = 2.0  # grey levels
_SECONDS, _SPEED_M_S, _LENGTH_M = 3.0, (0.05, 0.15), (0.10, 0.30)
_LIMITS = GazeLimits(pitch_rad=(-80 * _DEG, 40 * _DEG))  # J's, the pitch down to where the eyes' tilt carries the gaze
_ENDS = GazeLimits(
    (-50 * _DEG, 50 * _DEG), (-75 * _DEG, 35 * _DEG), (5 * _DEG, 17 * _DEG)
)  # of paths; nearer, eyes lag
_N_TIMED = 1000
_VERDICTS = {
    "right": "at the threshold of --max-fp",
    "right_if_likelier": "at probability 0.5",
    "right_at_true_position": "at probability 0.5, asked at the true position",
}


@dataclass(frozen=True)
class InLoop(Study):
    """Reachability in every frame of closed-loop runs against exact inverse kinematics, and its time per frame."""

    seed: int = 0
    """Seed of the map, the paths and the images."""
    n: int = 10
    """Runs, each one path of a ball; the independent units."""
    n_labels: int = 6000
    """Inverse-kinematics solutions the map is learned from."""
    max_fp: float = 1e-3
    """Share of false positives that the map is allowed."""

    def run(self) -> dict[str, Any]:
        """Return the share of frames judged rightly (%, with the interval over runs), counts, and processor times."""
        params = MapParams(_LIMITS, n_labels=self.n_labels, round_labels=min(1500, self.n_labels // 2))
        with open_world(_NOISE_SIGMA, self.seed) as world:
            learned = train_reachable_map(world.robot, "left", np.random.default_rng(self.seed), params)
            runs = []
            for k in tqdm(range(self.n), desc="runs", disable=None):
                pipeline = new_pipeline(world, PPSMemory.empty(world.skin), reachable_map=learned)
                episode = crossing(world, k % 2 == 0, np.random.default_rng((self.seed, k)))
                log = log_of(world, episode, simulate(world, episode, pipeline.step, avoid=False), avoid=False)
                runs.append(judge(world.robot, learned, log))
            times = frame_times(world.robot, learned, self.max_fp, np.random.default_rng((self.seed, self.n)))
        counts = {name: int(sum(np.sum(run[name]) for run in runs)) for name in runs[0] if name not in _VERDICTS}
        shares = {name: interval([run[name] for run in runs], percent) for name in _VERDICTS}
        each = {name: [percent(np.asarray(run[name])) for run in runs] for name in _VERDICTS}
        return {**counts, **shares, "each_run": each, "processor_ms": times}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw for each run the share of frames judged rightly."""
        figure, (axis,) = charts.panels(1, width=5.4)
        for name, label in _VERDICTS.items():
            values = np.sort(np.array(numbers["each_run"][name], dtype=float))
            charts.curves(
                axis,
                np.arange(1, len(values) + 1),
                {label: values.tolist()},
                "run, sorted",
                "frames judged rightly (%)",
            )
        axis.legend(fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the share of frames judged rightly, and the processor time per frame."""
        rows = [
            [f"frames judged rightly, {label} (%)", estimate(numbers[name], 4)] for name, label in _VERDICTS.items()
        ]
        rows += [[f"processor time, {name} (ms)", f"{ms[1]:.2g}"] for name, ms in numbers["processor_ms"].items()]
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
    strict = np.array([one.is_reachable for one in said], dtype=bool)
    likelier = np.array([one.probability for one in said]) > 0.5
    return {
        "frames": np.ones(len(points), bool),
        "truly_reachable": reachable,
        "not_fixated": np.array([one.status == ReachStatus.NOT_FIXATED for one in said], dtype=bool),
        "false_positives": strict & ~reachable,
        "false_negatives": ~strict & reachable,
        "right": strict == reachable,
        "right_if_likelier": likelier == reachable,
        "right_at_true_position": (learned.query(gaze).probability > 0.5) == reachable,
    }


def frame_times(robot: Robot, learned: ReachableMap, max_fp: float, rng: np.random.Generator) -> dict[str, list[float]]:
    """Return quartiles of processor time (ms) of the gaze, of a query, and of all that a frame takes.

    All are asked in turn about the same 1000 positions.
    """
    model, reach = GazeModel(robot), TrackReachability(robot, learned, max_fp)
    gaze = rng.uniform(_LIMITS.lower, _LIMITS.upper, (_N_TIMED, 3))
    q = np.zeros(robot.n_joints)
    q[robot.indices(robot.names.torso)] = 0.2
    spent: dict[str, list[float]] = {"gaze of fixation": [], "query of the map": [], "all": []}
    for one, point in zip(gaze, model.points(gaze), strict=True):
        track = Track3D(0.0, np.vstack([point, np.zeros((3, 3))]), np.eye(12), 0.03, 1e-4, Status.TRACKING)
        calls: tuple[Callable[[], object], ...] = (
            partial(model.gaze, point[None], _LIMITS),
            partial(learned.query, one[None]),
            partial(reach, q, track),
        )
        for ms, call in zip(spent.values(), calls, strict=True):
            begun = thread_time_ns()
            call()
            ms.append((thread_time_ns() - begun) / 1e6)
    return {name: np.percentile(ms, (25, 50, 75)).tolist() for name, ms in spent.items()}
