"""The reachable-space map in the running pipeline: how often it is right about what the eyes track, and what it takes.

An object crosses the left hand's workspace before the rendered eyes, which track and fixate it; the arm rests.  The
truth is the arm in closed form, at the place where the object really is.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.pps.memory import PPSMemory
from learning.reach.torso_gaze import random_gaze
from learning.reach.track_reachability import TrackReachability
from learning.reach.training import ArmLimits, MapParams, train_reachable_map
from pps_vision.app.encounter import Encounter, EncounterLog, World
from pps_vision.app.in_view import can_follow
from pps_vision.app.school import fresh_pipeline, open_world
from pps_vision.experiments.chart import panels
from pps_vision.experiments.study import Study
from pps_vision.robot.chain import Chain
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.model import Robot
from pps_vision.robot.spherical_arm import SphericalArm
from pps_vision.types import Array, Mask, ReachStatus, Status, Track3D
from rendering.motions import Linear

_DEG = np.pi / 180
_SECONDS, _SPEED_M_S, _LENGTH_M = 3.0, (0.05, 0.15), (0.10, 0.30)
_LIMITS = GazeLimits(pitch_rad=(-80 * _DEG, 40 * _DEG))
"""J's, the pitch as far down as the eyes' tilt carries the gaze, as in the demo."""
_SEEN = GazeLimits((-50 * _DEG, 50 * _DEG), (-75 * _DEG, 35 * _DEG), (5 * _DEG, 17 * _DEG))
"""Where paths begin and end: nearer the eyes hardly follow."""
_TIMED = 1000


@dataclass(frozen=True)
class InLoop(Study):
    """Reachability in every frame of closed-loop runs against closed-form inverse kinematics, and its time a frame."""

    seed: int = 0
    """Seed of the map, the paths and the images."""
    n: int = 10
    """Runs, each one path of a ball."""
    n_labels: int = 6000
    """Inverse-kinematics solutions the map is learned from."""
    max_fp: float = 1e-3
    """Share of false positives that the map is allowed."""

    def run(self) -> dict[str, object]:
        """Frames by what was said, shares right over the runs (95 % interval by resampling runs), and times."""
        if self.n < 1:
            raise ValueError(f"bench reach in_loop: --n {self.n}; expected at least 1")
        params = MapParams(
            _LIMITS, n_labels=self.n_labels, round_labels=min(MapParams().round_labels, self.n_labels // 2)
        )
        with open_world(2.0, self.seed) as world:
            learned = train_reachable_map(world.robot, "left", np.random.default_rng(self.seed), params)
            reach, runs = TrackReachability(world.robot, learned, self.max_fp), []
            for k in tqdm(range(self.n), desc="runs", unit="run", disable=None):
                pipeline = fresh_pipeline(world, PPSMemory.empty(world.skin), reachable_map=learned)
                meeting = world.meet(
                    _crossing(world, k % 2 == 0, np.random.default_rng((self.seed, k))), pipeline, avoid=False
                )
                for _ in meeting:
                    pass
                log = meeting.log()
                if any(one.status != ReachStatus.UNKNOWN for one in log.reachability):
                    runs.append(_judged(world.robot, reach, log))
            times = _times(world.robot, reach, np.random.default_rng((self.seed, self.n)))
        return {"n": self.n, "runs_tracked": len(runs), **_shares(runs, np.random.default_rng(self.seed)), **times}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Time over error of the ways to the gaze; and of each run the share of frames in which the map is right."""
        figure, (cost, right) = panels(2)
        for k, (name, way) in enumerate(numbers["gaze"].items()):
            cost.plot(way["median_ms"], max(way["worst_rad"], 1e-16), "o", ms=8, color=f"C{k}", label=name)
        cost.axvline(0.3, color="0.4", lw=1, ls="--")
        cost.set(
            xscale="log", yscale="log", xlabel="processor time a frame (ms)", ylabel="worst error of the gaze (rad)"
        )
        cost.legend(fontsize=8)
        for k, (name, label) in enumerate((("likelier", "above 0.5"), ("strict", "few false positives"))):
            shares = sorted(numbers[name]["right_by_run"])
            right.plot(np.arange(1, len(shares) + 1), shares, "o-", ms=4, color=f"C{k}", label=label)
        right.set(xlabel="run, sorted", ylabel="frames in which the map is right (%)")
        right.legend(fontsize=8)
        for axis in (cost, right):
            axis.grid(alpha=0.25)
        return figure


@dataclass(frozen=True)
class _Run:
    """Of each tracked frame: whether the hand truly gets there, the probability said (NaN: not fixated), what the
    threshold makes of it, the probability at the true place, and whether a gaze fixates that."""

    true: Mask
    probability: Array
    strict: Mask
    at_truth: Array
    fixable: Mask


def _arm(robot: Robot) -> SphericalArm:
    """The left arm within J's limits, in closed form."""
    chain = Chain.of(robot, robot.names.arm("left")[:4], robot.names.palms[0])
    return SphericalArm.of(chain, ArmLimits().lower_rad, ArmLimits().upper_rad)


def _crossing(world: World, in_reach: bool, rng: np.random.Generator) -> Encounter:
    """A ball to and fro on a straight line from within or out of reach, where both eyes see all of it."""
    model, arm = GazeModel(world.robot), _arm(world.robot)
    while True:
        begin = model.points(random_gaze(_SEEN, 1, rng))[0]
        if np.isfinite(arm.solve(begin[None])[0, 0]) != in_reach:
            continue
        way = rng.standard_normal(3)
        end = begin + rng.uniform(*_LENGTH_M) * way / np.linalg.norm(way)
        motion = Linear(begin, end, rng.uniform(*_SPEED_M_S))
        if np.isfinite(model.gaze(end[None], _SEEN)).all() and can_follow(
            world.robot, world.rig, world.home, motion, _SECONDS
        ):
            return Encounter("crossing", "ball", motion, _SECONDS)


def _judged(robot: Robot, reach: TrackReachability, log: EncounterLog) -> _Run:
    tracked = np.array([one.status != ReachStatus.UNKNOWN for one in log.reachability])
    points = log.truth_m[tracked]
    gaze = GazeModel(robot).gaze_iteratively(points, _LIMITS)
    said = [one for one, known in zip(log.reachability, tracked, strict=True) if known]
    return _Run(
        np.isfinite(_arm(robot).solve(points)[:, 0]),
        np.array([one.probability for one in said]),
        np.array([one.is_reachable for one in said]),
        reach.map.query(gaze).probability,
        np.isfinite(gaze[:, 0]),
    )


def _shares(runs: list[_Run], rng: np.random.Generator) -> dict[str, object]:
    """Counts, and of each verdict the share that is right (percent)."""
    true = [run.true & run.fixable for run in runs]
    ways: dict[str, Callable[[_Run], Mask]] = {
        "likelier": lambda run: run.probability > 0.5,
        "strict": lambda run: run.strict,
        "likelier_at_the_true_place": lambda run: run.at_truth > 0.5,
    }
    found: dict[str, object] = {
        "frames": sum(len(run.true) for run in runs),
        "truly_reachable_frames": int(sum(t.sum() for t in true)),
        "not_fixated_frames": int(sum(np.isnan(run.probability).sum() for run in runs)),
        "not_fixated_rightly": int(sum((np.isnan(run.probability) & ~run.fixable).sum() for run in runs)),
    }
    for name, way in ways.items():
        said = [way(run) for run in runs]
        right = [100 * float(np.mean(s == t)) for s, t in zip(said, true, strict=True)]
        drawn = np.array(right)[rng.integers(0, len(right), (2000, len(right)))].mean(axis=1)
        S, T = np.concatenate(said), np.concatenate(true)
        found[name] = {
            "right": float(np.mean(right)),
            "right_95": np.percentile(drawn, (2.5, 97.5)).round(3).tolist(),
            "false_positives": int((S & ~T).sum()),
            "false_negatives": int((~S & T).sum()),
            "right_by_run": [round(share, 2) for share in right],
        }
    return found


def _times(robot: Robot, reach: TrackReachability, rng: np.random.Generator) -> dict[str, object]:
    """Median and 95th percentile of processor milliseconds a frame, all ways in turn on the same places: the gaze in
    closed form and iteratively, the query, and all that a frame takes; and how far each gaze is off."""
    model = GazeModel(robot)
    gaze = rng.uniform(_LIMITS.lower, _LIMITS.upper, (_TIMED, 3))
    q = np.zeros(robot.n_joints)
    q[robot.indices(robot.names.torso)] = 0.2
    ways: dict[str, Callable[[Array], Any]] = {
        "closed form": lambda point: model.gaze(point, _LIMITS),
        "iterative": lambda point: model.gaze_iteratively(point, _LIMITS),
    }
    spent: dict[str, list[float]] = {name: [] for name in (*ways, "query", "frame")}
    worst = dict.fromkeys(ways, 0.0)
    for one, point in zip(gaze, model.points(gaze), strict=True):
        for name, way in ways.items():
            answer, ms = _timed(way, point[None])
            spent[name].append(ms)
            worst[name] = max(worst[name], float(np.abs(answer[0] - one).max()))
        spent["query"].append(_timed(reach.map.query, one[None])[1])
        mean = np.vstack([point, np.zeros((3, 3))])
        track = Track3D(0.0, mean, np.eye(12), 0.03, 1e-4, Status.TRACKING)
        spent["frame"].append(_timed(lambda track: reach(q, track), track)[1])
    of = {
        name: {"median_ms": float(np.median(ms)), "p95_ms": float(np.percentile(ms, 95))} for name, ms in spent.items()
    }
    return {
        "timed": _TIMED,
        "gaze": {name: {**of[name], "worst_rad": worst[name]} for name in ways},
        "query": of["query"],
        "frame": of["frame"],
        "iterative_over_closed_form": of["iterative"]["median_ms"] / of["closed form"]["median_ms"],
    }


def _timed(run: Callable[[Any], Any], given: Any) -> tuple[Any, float]:
    begun = time.thread_time_ns()
    answer = run(given)
    return answer, (time.thread_time_ns() - begun) / 1e6
