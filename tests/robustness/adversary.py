"""Control under adversarial tracks, stamps and postures: bad input is refused, and every limit holds.

A pipeline whose tracker is replaced by random, mostly impossible tracks commands a kinematic robot, which obeys for as
long as a command is valid.
"""

from collections import Counter
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from known_track import touched_by_all

from control.avoidance import AvoidanceParams
from control.limits import LimitParams
from control.reaching import ReachingParams
from pps_vision.app.pipeline import Pipeline, PipelineParams, PipelineStep
from pps_vision.errors import InputError
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.icub import HOME_ARM_RAD, home, load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import Array, JointVelocity, Mask, Reachability, ReachStatus, Status, StereoFrame, Track3D
from tracking.tracker import TrackerStep

STARTS = "home", "random", "at limits", "outside limits", "near itself"
PATHS = "through the arm", "jumping", "at rest on the arm", "far"
COVARIANCES = "zero", "small", "large", "huge", "NaN", "infinite", "indefinite"
LIMITS = LimitParams()
TOLERANCE = 1e-9  # rad, rad/s
DISTANCE_TOLERANCE_M = 1e-5


class AttackResult:
    """Findings of an attack, summed over its episodes."""

    def __init__(self) -> None:
        self.steps = 0  # frames given to the pipeline
        self.refused: Counter[str] = Counter()  # frames refused by an InputError, by its source
        self.modes: Counter[str] = Counter()  # accepted frames by the arm's mode
        self.starts: Counter[str] = Counter()  # episodes by their start
        self.faults: list[str] = []  # any other exception, and limits that were left, with the seed of the episode
        self.sudden_stops = 0  # commands that stop the arm faster than the acceleration limit
        self.smallest_distance_mm = np.inf  # self-collision distance on the way of a command given at 20 mm or more
        self.freed = 0  # episodes that started nearer and ended at 20 mm or more


@dataclass
class AdversarialTracker:
    """In place of a tracker: the next frame's track is the one assigned here."""

    track: Track3D

    def step(self, frame: StereoFrame) -> TrackerStep:
        """Return the track."""
        return TrackerStep(self.track, (), None, np.zeros((2, 3)))


def attack(
    steps: int, seed: int, episode_steps: int, new: "type[Episode] | None" = None, result: AttackResult | None = None
) -> AttackResult:
    """Run `new` episodes of at most `episode_steps` frames until `steps` frames were given, which add to a `result`;
    every kind of start and path."""
    robot = load_icub()
    skin = icub_skin()
    self_collision = SelfCollision(robot), SelfCollision(robot)
    new = new or Episode
    result = result or AttackResult()
    number = 0
    while result.steps < steps:
        side = ("left", "right")[number % 2]
        kind = STARTS[number % len(STARTS)], PATHS[number // len(STARTS) % len(PATHS)]
        episode = new(robot, skin, side, self_collision, kind, (seed, number), result)
        episode.run(min(episode_steps, steps - result.steps))
        number += 1
    return result


class Anywhere:
    """In place of a map that calls all reachable, now better by one hand, now by the other."""

    def __init__(self, robot: Robot, rng: np.random.Generator) -> None:
        self.gaze_model = GazeModel(robot)
        self.map = SimpleNamespace(limits=GazeLimits())
        self.rng = rng

    def __call__(self, q_rad: Array, track: Track3D) -> Reachability:
        return Reachability(track.stamp_s, np.zeros(3), 1.0, self.rng.choice((0.6, 0.9)), ReachStatus.REACHABLE)

    def reachable(self, gaze: Array) -> Mask:
        return np.isfinite(gaze[:, 0])


class Episode:
    """One start, one kind of path."""

    latency_s = 0.0  # as the pipeline assumes it

    def __init__(
        self,
        robot: Robot,
        skin: Skin,
        side: str,
        self_collision: tuple[SelfCollision, SelfCollision],
        kind: tuple[str, str],
        seeds: tuple[int, int],
        result: AttackResult,
    ) -> None:
        rng = np.random.default_rng(seeds)
        self.robot = robot
        self.skin = skin
        self.rng = rng
        self.name = f"seed {seeds[0]}, episode {seeds[1]}"
        self.result = result
        self.self_collision, of_pipeline = self_collision
        self.start, self.path = kind
        self.disturbed = bool(rng.random() < 0.1)  # the robot stands where it was not sent
        self.q = self._start()
        behaviour = str(rng.choice(("avoid", "reach")))
        self.tracker = AdversarialTracker(Track3D.unknown(0.0))
        waits = {"confirmation_s": float(rng.choice((0.0, 0.15)))}
        arm = AvoidanceParams(HOME_ARM_RAD, side=side, **waits)
        other_arm = replace(arm, side="right" if side == "left" else "left") if rng.random() < 0.3 else None
        hold_s = float(rng.choice((0.5, 0.5, 0.2, 0.05)))
        params = PipelineParams(arm=arm, other_arm=other_arm, hold_s=hold_s, latency_s=self.latency_s)
        self.pipeline = Pipeline(params, robot, skin, self.tracker, touched_by_all(skin), rng)
        self.pipeline._self_collision = of_pipeline  # making one takes as long as twenty frames
        if behaviour == "reach":
            self.pipeline._arms = self.pipeline._hands = [
                own._replace(params=ReachingParams(HOME_ARM_RAD, side=own.params.side, **waits))
                for own in self.pipeline._arms
            ]
            self.pipeline._reachability = [Anywhere(robot, rng)] * len(self.pipeline._arms)
        self.stamp_s = 0.0
        self.command = JointVelocity(-10.0, np.zeros(robot.n_joints), params.hold_s)
        self.taxels = skin.at(robot.at(self.q))
        result.starts[self.start] += 1
        self._watch()

    def run(self, steps: int) -> None:
        """Let the adversary act for `n` frames."""
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
            step = self._step(StereoFrame(BLACK, BLACK, given_s, given_s, joints, joints))
            self.result.steps += 1
            if step is not None:
                self._check(step.command, as_predicted=in_order and not self.disturbed)
                self.result.modes[step.response.mode] += 1
                self.command, self.taxels = step.command, self.skin.at(step.posture)
        self._watch()
        self.result.freed += self.start == "near itself" and self.clear_m == LIMITS.clearance_m

    def _step(self, frame: StereoFrame) -> PipelineStep | None:
        try:
            return self.pipeline.step(frame, self.rng.random(len(self.skin.taxel_ids)) < 0.01)
        except InputError as error:
            self.result.refused[str(error.args[0])] += 1
        except Exception as error:
            self._fault(f"{type(error).__name__} {error}")
        return None

    def _fault(self, text: str) -> None:
        self.result.faults.append(f"{self.name} ({self.start}, {self.path}), frame {self.result.steps}: {text}")

    def _start(self) -> Array:
        """A posture (n_joints,); random ones keep 20 mm of distance unless they start "near itself"."""
        robot = self.robot
        rng = self.rng
        for _ in range(2000):
            q = home(robot) if self.start == "home" else rng.uniform(robot.lower_rad, robot.upper_rad)
            chosen = rng.random(robot.n_joints) < 0.3
            if self.start in ("at limits", "outside limits"):
                outwards = rng.uniform(0.0, 0.3, robot.n_joints) * (self.start == "outside limits")
                up = rng.random(robot.n_joints) < 0.5
                q = np.where(chosen, np.where(up, robot.upper_rad + outwards, robot.lower_rad - outwards), q)
            if (self.self_collision.distance_m(q) < LIMITS.clearance_m) == (self.start == "near itself"):
                return q
        raise ValueError(f"no posture {self.start}")

    def _watch(self) -> None:
        """Remember by how much limits are exceeded."""
        self.clear_m = min(LIMITS.clearance_m, self.self_collision.distance_m(self.q))

    def _obey(self, until_s: float) -> None:
        """Move for as long as the command is valid, and check the distance on the way."""
        held_s = min(until_s - self.command.stamp_s, self.command.hold_s)
        before_s = min(self.stamp_s - self.command.stamp_s, self.command.hold_s)
        self.q = self.q + (held_s - before_s) * self.command.dq_rad_s
        self.stamp_s = until_s

    def _check(self, command: JointVelocity, as_predicted: bool) -> None:
        """Check a command over the whole time for which it may be held."""
        robot = self.robot
        q = self.q
        dq = command.dq_rad_s
        end = q + command.hold_s * dq
        excess = [np.maximum(np.maximum(p - robot.upper_rad, robot.lower_rad - p), 0.0) for p in (q, end)]
        if np.any(excess[1] > excess[0]):
            self._fault(f"joint limits left by {np.max(excess[1] - excess[0]):.3g} rad")
        fastest = np.full(robot.n_joints, LIMITS.joint_rad_s)
        fastest[robot.indices(robot.names.gaze_joints[2:])] = LIMITS.eyes_rad_s
        if np.any(np.abs(dq) > fastest + TOLERANCE):
            self._fault(f"rate {np.max(np.abs(dq) / fastest):.6g} times its limit")
        elapsed_s = command.stamp_s - self.command.stamp_s
        if elapsed_s < self.command.hold_s:
            change = np.abs(dq - self.command.dq_rad_s)
            sudden = change > fastest / LIMITS.speed_up_s * elapsed_s + TOLERANCE
            if np.any(sudden & (np.abs(dq) > np.abs(self.command.dq_rad_s) + TOLERANCE)):
                self._fault("acceleration limit left by a joint that speeds up")
            self.result.sudden_stops += bool(sudden.any())
            if sudden.any() and as_predicted:
                self._fault("sudden stop")
        if not np.any(dq[self.self_collision.moving]):
            return
        if self.clear_m < LIMITS.clearance_m and as_predicted:
            last_m = self.clear_m
            self._watch()
            self.clear_m = max(self.clear_m, last_m)  # does not go back
        shares = np.append(self.rng.random(2), 1.0)
        distance_m = min(self.self_collision.distance_m(q + s * command.hold_s * dq) for s in shares)
        if distance_m < self.clear_m - DISTANCE_TOLERANCE_M:
            self._fault(f"self-collision distance {1000 * distance_m:.4f} of {1000 * self.clear_m:.4f} mm")
        if self.clear_m == LIMITS.clearance_m:
            self.result.smallest_distance_mm = min(self.result.smallest_distance_mm, 1000 * distance_m)

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
            mean[0] = positions[0] + (0.2 - 0.1 * phase) * normals[0]
            mean[1] = -0.1 * normals[0]
        elif self.path == "at rest on the arm":
            mean[0] = positions[k] + rng.uniform(-0.02, 0.1) * normals[k]
        elif self.path == "jumping":
            mean[0] = positions[k] + 0.1 * rng.standard_normal(3)
            mean[1] = rng.standard_normal(3) * 10.0 ** rng.uniform(-3, 4)
        else:
            mean[0] = rng.standard_normal(3) * 10.0 ** rng.uniform(0, 9)
            mean[1] = rng.standard_normal(3) * 10.0 ** rng.uniform(-3, 9)
        if rng.random() < 0.02:
            mean[tuple(rng.integers((4, 3)))] = rng.choice((np.nan, np.inf, 1e308))
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


BLACK = np.zeros((2, 2, 3), np.uint8)
