"""Control under adversarial tracks, stamps and postures: what is refused, and whether every limit holds.

A pipeline whose tracker is replaced by random, mostly impossible tracks commands a kinematic robot, which obeys for as
long as a command is valid.
"""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from scipy.special import chdtri

from control.avoidance import AvoidanceParams
from control.limits import LimitParams
from control.reaching import ReachingParams
from learning.pps.memory import PPSMemory
from pps_vision.app.pipeline import Pipeline, PipelineParams, PipelineStep
from pps_vision.errors import InputError
from pps_vision.experiments.study import Study, run_parts
from pps_vision.experiments.tables import Table
from pps_vision.robot.icub import HOME_ARM_RAD, home, load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import Array, JointVelocity, Reachability, ReachStatus, Status, StereoFrame, Track3D
from tracking.tracker import TrackerStep

STARTS = "home", "random", "at limits", "outside limits", "near itself"
PATHS = "through the arm", "jumping", "at rest on the arm", "far"
COVARIANCES = "zero", "small", "large", "huge", "NaN", "infinite", "indefinite"
_COUNTERS = "refused", "modes", "starts"
_LIMITS = LimitParams()
_TOLERANCE = 1e-9  # rad, rad/s
_DISTANCE_TOLERANCE_M = 1e-5
_EPISODE = 400  # frames
_PART = 50 * _EPISODE  # frames that are kept when a run is interrupted; every kind of start and path is in it


@dataclass(frozen=True)
class AdversarialControl(Study):
    """Impossible tracks, stamps and postures for the control: what is refused, and whether every limit holds.

    A fault is any exception but InputError, a limit of the robot that is left, or an earlier violation that grows.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"steps": 200}

    steps: int = 300_000
    """Frames."""
    seed: int = 0
    """Seed of the episodes."""

    def run(self) -> dict[str, Any]:
        """Return what the attack found; an interrupted run goes on."""
        parts: dict[str, Callable[[], Any]] = {
            f"control {begun}": partial(_attack_json, min(_PART, self.steps - begun), self.seed, begun // _EPISODE)
            for begun in range(0, self.steps, _PART)
        }
        found = Outcome()
        for part in run_parts(self, parts).values():
            found.add(Outcome.of_json(part))
        return found.to_json()

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return one row: frames, faults, what they exclude, the smallest self-distance from a start above the limit.

        The largest rates of frames, and of episodes of 400 frames, with a fault that these counts do not refute with
        95 % (Poisson; without a fault the rule of three, 3/n).
        """
        refused = sum(numbers["refused"].values())
        smallest = f"{numbers['smallest_distance_mm']:.2f}"
        faults, episodes = len(numbers["faults"]), -(-numbers["steps"] // _EPISODE)
        most = [f"{100 * chdtri(2 * faults + 2, 0.05) / 2 / n:.2g} %" for n in (numbers["steps"], episodes)]
        cells = numbers["steps"] - refused, refused, faults, " / ".join(most), smallest, numbers["freed"]
        header = ["frames accepted", "refused", "faults", "with a fault at most: frames / episodes (95 %)"]
        header += ["smallest self-distance (mm)", "episodes freed from nearer"]
        return {"": Table(header, [[*map(str, cells)]])}


def _attack_json(steps: int, seed: int, first: int) -> dict[str, Any]:
    return attack(steps, seed, _EPISODE, first).to_json()


@dataclass
class Outcome:
    """What an attack found."""

    steps: int = 0
    """Frames given to the pipeline."""
    refused: Counter[str] = field(default_factory=Counter)
    """Frames refused by an InputError, by its source."""
    modes: Counter[str] = field(default_factory=Counter)
    """Accepted frames by what the arm did."""
    starts: Counter[str] = field(default_factory=Counter)
    """Episodes by where they started."""
    faults: list[str] = field(default_factory=list)
    """Any other exception, and limits that were left; with the seed of the episode."""
    sudden_stops: int = 0
    """Commands that stop the arm faster than the acceleration limit, because the robot stood where it was not sent."""
    slowest_ms: float = 0.0
    """Longest time of a frame."""
    smallest_distance_mm: float = np.inf
    """Smallest self-collision distance on the way of a command given at 20 mm or more."""
    freed: int = 0
    """Episodes that started nearer and ended at 20 mm or more."""

    def add(self, other: "Outcome") -> None:
        """Add another attack's findings."""
        self.steps += other.steps
        self.refused += other.refused
        self.modes += other.modes
        self.starts += other.starts
        self.faults += other.faults
        self.sudden_stops += other.sudden_stops
        self.freed += other.freed
        self.slowest_ms = max(self.slowest_ms, other.slowest_ms)
        self.smallest_distance_mm = min(self.smallest_distance_mm, other.smallest_distance_mm)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON object, which `of_json` reads."""
        counts = {name: dict(getattr(self, name)) for name in _COUNTERS}
        return {**vars(self), **counts, "smallest_distance_mm": float(self.smallest_distance_mm)}

    @classmethod
    def of_json(cls, found: dict[str, Any]) -> "Outcome":
        """Return what `to_json` gave; JSON has no infinity."""
        counts = {name: Counter(found[name]) for name in _COUNTERS}
        smallest = np.inf if found["smallest_distance_mm"] is None else found["smallest_distance_mm"]
        return cls(**{**found, **counts, "smallest_distance_mm": smallest})


@dataclass
class AdversarialTracker:
    """In place of a tracker: the next frame's track is what was put here."""

    track: Track3D

    def step(self, frame: StereoFrame) -> TrackerStep:
        """Return the track."""
        return TrackerStep(self.track, (), None, np.zeros(3))


def attack(steps: int, seed: int, episode_steps: int = 400, first: int = 0) -> Outcome:
    """Run episodes from number `first` on, of at most so many frames, until `steps` frames were given; every kind of
    start and path in turn."""
    robot, skins = load_icub(), {s: icub_skin((f"{s}_forearm", f"{s}_palm")) for s in ("left", "right")}  # type: ignore[arg-type]
    self_collision, found, number = (SelfCollision(robot), SelfCollision(robot)), Outcome(), first
    while found.steps < steps:
        rng = np.random.default_rng((seed, number))
        side = ("left", "right")[number % 2]
        n = min(episode_steps, steps - found.steps)
        kind = STARTS[number % len(STARTS)], PATHS[number // len(STARTS) % len(PATHS)]
        episode = _Episode(robot, skins[side], side, self_collision, rng, kind, f"seed {seed}, episode {number}")
        found.add(episode.run(n))
        number += 1
    return found


class _Episode:
    """One start, one kind of path."""

    def __init__(
        self,
        robot: Robot,
        skin: Skin,
        side: str,
        self_collision: tuple[SelfCollision, SelfCollision],
        rng: np.random.Generator,
        kind: tuple[str, str],
        name: str,
    ) -> None:
        self.robot, self.skin, self.rng, self.name = robot, skin, rng, name
        self.self_collision, of_pipeline = self_collision
        self.start, self.path = kind
        self.disturbed = bool(rng.random() < 0.1)  # the robot stands where it was not sent
        self.q = self._start()
        behaviour = str(rng.choice(("avoid", "reach")))
        self.tracker = AdversarialTracker(Track3D.unknown(0.0))
        waits = {"confirmation_s": float(rng.choice((0.0, 0.15))), "min_approach_m": float(rng.choice((0.0, 0.01)))}
        arm = AvoidanceParams(HOME_ARM_RAD, side=side, **waits)  # type: ignore[arg-type]
        other = replace(arm, side="right" if side == "left" else "left") if rng.random() < 0.3 else None
        params = PipelineParams(arm=arm, other_arm=other, hold_s=float(rng.choice((0.5, 0.5, 0.2, 0.05))))
        self.pipeline = Pipeline(params, robot, skin, self.tracker, _anxious(skin), rng)  # type: ignore[arg-type]
        self.pipeline._self_collision = of_pipeline  # making one takes as long as twenty frames
        if behaviour == "reach":  # as with a map that calls everything reachable
            first, *others = self.pipeline._arms
            self.pipeline._arms = [first._replace(params=ReachingParams(HOME_ARM_RAD, side=side, **waits)), *others]  # type: ignore[arg-type]
            anywhere = Reachability(0.0, np.zeros(3), 1.0, 1.0, ReachStatus.REACHABLE)
            self.pipeline._reachability = lambda q, track: anywhere  # type: ignore[assignment]
        self.stamp_s, self.command = 0.0, JointVelocity(-10.0, np.zeros(robot.n_joints), params.hold_s)
        self.taxels = skin.at(robot.at(self.q))
        self.found = Outcome(starts=Counter([self.start]))
        self._watch()

    def run(self, steps: int) -> Outcome:
        """Let the adversary act for so many frames."""
        for _ in range(steps):
            given_s = self._next_stamp()
            in_order = given_s >= self.stamp_s  # else, after a refused frame, an accepted stamp may belie the posture
            if np.isfinite(given_s) and in_order:
                self._obey(given_s)
            if self.disturbed:
                self.q = self.q + 0.02 * (self.rng.random() < 0.05) * self.rng.standard_normal(self.robot.n_joints)
                self._watch()  # a command that is held on from there knows nothing of it
            self.tracker.track = self._track(given_s)
            joints = np.full_like(self.q, np.nan) if self.rng.random() < 0.005 else self.q
            begin = time.perf_counter()
            step = self._step(StereoFrame(_BLACK, _BLACK, given_s, given_s, joints, joints))
            self.found.slowest_ms = max(self.found.slowest_ms, 1000 * (time.perf_counter() - begin))
            self.found.steps += 1
            if step is not None:
                self._check(step.command, as_predicted=in_order and not self.disturbed)
                self.found.modes[step.response.mode] += 1
                self.command, self.taxels = step.command, self.skin.at(step.posture)
        self._watch()
        self.found.freed += self.start == "near itself" and self.clear_m == _LIMITS.clearance_m
        return self.found

    def _step(self, frame: StereoFrame) -> PipelineStep | None:
        try:
            return self.pipeline.step(frame, self.rng.random(len(self.skin.taxel_ids)) < 0.01)
        except InputError as error:
            self.found.refused[str(error.args[0])] += 1
        except Exception as error:
            self._fault(f"{type(error).__name__} {error}")
        return None

    def _fault(self, text: str) -> None:
        self.found.faults.append(f"{self.name} ({self.start}, {self.path}), frame {self.found.steps}: {text}")

    def _start(self) -> Array:
        """A posture (n_joints,); random ones keep 20 mm of distance unless they start "near itself"."""
        robot, rng = self.robot, self.rng
        for _ in range(2000):
            q = home(robot) if self.start == "home" else rng.uniform(robot.lower_rad, robot.upper_rad)
            chosen = rng.random(robot.n_joints) < 0.3
            if self.start in ("at limits", "outside limits"):
                outwards = rng.uniform(0.0, 0.3, robot.n_joints) * (self.start == "outside limits")
                up = rng.random(robot.n_joints) < 0.5
                q = np.where(chosen, np.where(up, robot.upper_rad + outwards, robot.lower_rad - outwards), q)
            if (self.self_collision.distance_m(q) < _LIMITS.clearance_m) == (self.start == "near itself"):
                return q
        raise ValueError(f"no posture {self.start}")

    def _watch(self) -> None:
        """Remember by how much limits are exceeded."""
        self.clear_m = min(_LIMITS.clearance_m, self.self_collision.distance_m(self.q))

    def _obey(self, until_s: float) -> None:
        """Move for as long as the command is valid, and check the distance on the way."""
        held_s = min(until_s - self.command.stamp_s, self.command.hold_s)
        before_s = min(self.stamp_s - self.command.stamp_s, self.command.hold_s)
        self.q = self.q + (held_s - before_s) * self.command.dq_rad_s
        self.stamp_s = until_s

    def _check(self, command: JointVelocity, as_predicted: bool) -> None:
        """Check a command over the whole time for which it may be held."""
        robot, q, dq = self.robot, self.q, command.dq_rad_s
        end = q + command.hold_s * dq
        excess = [np.maximum(np.maximum(p - robot.upper_rad, robot.lower_rad - p), 0.0) for p in (q, end)]
        if np.any(excess[1] > excess[0]):
            self._fault(f"joint limits left by {np.max(excess[1] - excess[0]):.3g} rad")
        fastest = np.full(robot.n_joints, _LIMITS.joint_rad_s)
        fastest[robot.indices(robot.names.gaze_joints[2:])] = _LIMITS.eyes_rad_s
        if np.any(np.abs(dq) > fastest + _TOLERANCE):
            self._fault(f"rate {np.max(np.abs(dq) / fastest):.6g} times its limit")
        elapsed_s = command.stamp_s - self.command.stamp_s
        if elapsed_s < self.command.hold_s:
            change = np.abs(dq - self.command.dq_rad_s)
            sudden = change > fastest / _LIMITS.speed_up_s * elapsed_s + _TOLERANCE
            if np.any(sudden & (np.abs(dq) > np.abs(self.command.dq_rad_s) + _TOLERANCE)):
                self._fault("acceleration limit left by a joint that speeds up")
            self.found.sudden_stops += bool(sudden.any())
            if sudden.any() and as_predicted:
                self._fault("sudden stop")
        if not np.any(dq[self.self_collision.moving]):
            return
        if self.clear_m < _LIMITS.clearance_m and as_predicted:
            last_m = self.clear_m
            self._watch()
            self.clear_m = max(self.clear_m, last_m)  # what was gained is not given up
        shares = np.append(self.rng.random(2), 1.0)
        distance_m = min(self.self_collision.distance_m(q + s * command.hold_s * dq) for s in shares)
        if distance_m < self.clear_m - _DISTANCE_TOLERANCE_M:
            self._fault(f"self-collision distance {1000 * distance_m:.4f} of {1000 * self.clear_m:.4f} mm")
        if self.clear_m == _LIMITS.clearance_m:
            self.found.smallest_distance_mm = min(self.found.smallest_distance_mm, 1000 * distance_m)

    def _next_stamp(self) -> float:
        """The next frame's stamp: mostly 0–0.5 s later, now and then equal, before, much later or not a number."""
        rng = self.rng
        kind = rng.random()
        if kind < 0.03:
            return float(rng.choice((np.nan, np.inf, -np.inf, self.stamp_s - rng.uniform(0, 2))))
        if kind < 0.9:
            return self.stamp_s + float(rng.choice((0.05, rng.uniform(0, 0.5), 0.5, 10.0 ** rng.uniform(-9, -1))))
        return self.stamp_s + float(rng.choice((0.0, rng.uniform(0.5, 10.0))))

    def _track(self, stamp_s: float) -> Track3D:
        """A track that no tracker should give."""
        rng = self.rng
        if rng.random() < 0.1:
            return Track3D.unknown(stamp_s, Status(rng.choice(("searching", "lost"))))
        positions, normals = self.taxels
        k = int(rng.integers(len(positions)))
        mean = np.zeros((4, 3))
        if self.path == "through the arm":
            phase = (stamp_s if np.isfinite(stamp_s) else 0.0) % 3.0
            mean[0], mean[1] = positions[0] + (0.2 - 0.1 * phase) * normals[0], -0.1 * normals[0]
        elif self.path == "at rest on the arm":
            mean[0] = positions[k] + rng.uniform(-0.02, 0.1) * normals[k]
        elif self.path == "jumping":
            mean[0] = positions[k] + 0.1 * rng.standard_normal(3)
            mean[1] = rng.standard_normal(3) * 10.0 ** rng.uniform(-3, 4)
        else:
            mean[0] = rng.standard_normal(3) * 10.0 ** rng.uniform(0, 9)
            mean[1] = rng.standard_normal(3) * 10.0 ** rng.uniform(-3, 9)
        if rng.random() < 0.02:
            mean[tuple(rng.integers((2, 3)))] = rng.choice((np.nan, np.inf, 1e300))
        late_s = rng.uniform(0, 1) if rng.random() < 0.02 else 0.0
        radius = float(rng.choice((0.02, 0.0, 1.0, np.nan, -0.02)))
        return Track3D(stamp_s - late_s, mean, self._cov(), radius, 1e-8, Status.TRACKING)

    def _cov(self) -> Array:
        """A covariance (12, 12), mostly a possible one."""
        kind = str(self.rng.choice(COVARIANCES, p=(0.2, 0.4, 0.2, 0.11, 0.03, 0.03, 0.03)))
        scale = {"zero": 0.0, "small": 1e-6, "large": 1.0, "huge": 1e150, "NaN": np.nan, "infinite": np.inf}
        if kind == "indefinite":
            return np.diag(self.rng.standard_normal(12))
        return np.eye(12) * scale[kind] if np.isfinite(scale[kind]) else np.full((12, 12), scale[kind])


_BLACK = np.zeros((2, 2, 3), np.uint8)


def _anxious(skin: Skin) -> PPSMemory:
    """A skin that was touched by whatever came near."""
    empty = PPSMemory.empty(skin)
    counts = empty.counts.copy()
    counts[..., 0] = 1
    return replace(empty, counts=counts)
