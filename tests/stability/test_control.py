"""Control where it may fail: rates, limits and distances hold, nothing oscillates, and in the end the arm is at rest.

Kinematic closed loops at 20 Hz through the whole pipeline but for the tracker, whose place the truth takes.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from known_track import DT, KnownTrack, frame_at

from control import avoidance, limits
from control.avoidance import ArmInput, ArmState, AvoidanceParams
from control.fixation import FixationParams, fixation_error, gaze_at
from control.limits import LimitParams
from control.neck_and_eyes import NeckAndEyesParams
from learning.pps.memory import PPSMemory
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.robot.icub import HOME_ARM_RAD, home, icub_rig, load_icub
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array, Track3D

ROBOT = load_icub()
SKIN = icub_skin(("left_forearm", "left_palm"))
DEG = np.pi / 180
BODIES = SelfCollision(ROBOT)
ARM = ROBOT.indices(ROBOT.names.arm("left"))
HEAD = ROBOT.indices(("neck_pitch", "neck_roll", "neck_yaw", "eyes_tilt", "left_eye_pan", "right_eye_pan"))
GAZES = {"J IV.1": FixationParams(), "neck and eyes": NeckAndEyesParams()}
FASTEST = np.where(np.isin(np.arange(ROBOT.n_joints), HEAD[3:]), 180 * DEG, 60 * DEG)
MEMORY = PPSMemory.constant(SKIN)  # all that came touched


@dataclass
class Log:
    """Modes, rates and postures of a run."""

    modes: list[str] = field(default_factory=list)
    q: list[Array] = field(default_factory=list)
    dq: list[Array] = field(default_factory=list)

    def add(self, mode: str, q: Array, dq: Array) -> None:
        """Check a command that is obeyed for a period."""
        assert np.isfinite(dq).all()
        assert np.all(np.abs(dq) <= FASTEST + 1e-9)
        end = q + DT * dq
        assert np.all(end <= np.maximum(q, ROBOT.upper_rad) + 1e-9)
        assert np.all(end >= np.minimum(q, ROBOT.lower_rad) - 1e-9)
        if len(self.q) % 4 == 0:
            assert BODIES.distance_m(q) > 0.02 - 1e-5
        self.modes.append(mode)
        self.q.append(q)
        self.dq.append(dq)

    def reversals(self) -> int:
        """How often the fastest joint of the arm turns round."""
        arm = np.array(self.dq)[:, ARM]
        rates = arm[:, np.abs(arm).max(axis=0).argmax()]
        signs = np.sign(rates[np.abs(rates) > 0.5 * DEG])
        return int(np.count_nonzero(np.diff(signs)))

    def at_rest_at_home(self, within_rad: float = 0.3 * DEG) -> None:
        """Idle at the end, the arm at home and still."""
        assert self.modes[-1] == "idle"
        assert not np.any(np.array(self.dq)[-10:, ARM])
        np.testing.assert_allclose(self.q[-1][ARM], HOME_ARM_RAD, atol=within_rad)


def taxel_at(q: Array) -> tuple[Array, Array]:
    """Place and normal (3,) of a taxel of the forearm."""
    positions, normals = SKIN.at(ROBOT.at(q))
    k = SKIN.index("left_forearm:3")
    return positions[k], normals[k]


HOME = taxel_at(home(ROBOT))
STRAIGHT_DEG = (-30, 20, 0, 5.5, 0, 0, 0)


def away_from_home(posture_deg: tuple[float, ...]) -> tuple[Array, tuple[Array, Array]]:
    """A configuration with these angles of the arm, and where the taxel is then."""
    start = home(ROBOT)
    start[ARM] = np.deg2rad(posture_deg)
    return start, taxel_at(start)


def visit(t: float, point: Array = HOME[0], normal: Array = HOME[1]) -> tuple[Array, Array]:
    """A ball of 2 cm comes to 6 cm from a taxel's place, by default at home, and goes again from 2 s on."""
    away, sign = (0.26 - 0.1 * t, -1) if t < 2.0 else (0.06 + 0.1 * min(t - 2.0, 2.0), float(2.0 < t < 4.0))
    return point + away * normal, sign * 0.1 * normal


def encounter(
    motion: Callable[[float], tuple[Array, Array] | None] = visit,
    seconds: float = 7.0,
    start: Array | None = None,
    latency_s: float = 0.0,
    known_latency_s: float | None = None,
    disturb: Callable[[float, Array, Array], Array] = lambda t, old, after: after,
    **params: object,
) -> Log:
    """A robot that obeys `latency_s` late; `disturb` maps its old and its commanded posture to the new one.

    If the pipeline assumes another latency, the robot's end stops keep its limits.
    """
    stated_s = latency_s if known_latency_s is None else known_latency_s
    pipeline_params = PipelineParams(latency_s=stated_s, hold_s=0.2, **params)
    pipeline = Pipeline(pipeline_params, ROBOT, SKIN, KnownTrack(motion), MEMORY, np.random.default_rng(0))
    q = home(ROBOT) if start is None else start
    log = Log()
    late = round(latency_s / DT)
    waiting = [np.zeros(ROBOT.n_joints)] * late
    for k in range(int(seconds / DT)):
        step = pipeline.step(frame_at(k * DT, q))
        waiting.append(step.command.dq_rad_s)
        dq = waiting.pop(0)
        if stated_s != latency_s:
            dq = (ROBOT.clamp(q + DT * dq) - q) / DT
        log.add(step.response.mode, q, dq)
        q = disturb(k * DT, q, q + DT * dq)
    return log


@pytest.mark.parametrize(("latency_s", "latency"), [(0.0, "known"), (0.2, "known"), (0.2, "unknown")])
def test_commands_that_take_effect_late(latency_s, latency):
    """Up to 0.2 s, predicted or not: the arm withdraws, returns and rests; it does not swing."""
    log = encounter(latency_s=latency_s, known_latency_s=latency_s if latency == "known" else 0.0)
    assert "avoid" in log.modes
    log.at_rest_at_home((0.3 if latency == "known" else 5.0) * DEG)
    assert log.reversals() <= (3 if latency == "known" else 4)


@pytest.mark.parametrize("gaze", GAZES)
def test_the_eyes_keep_the_object_in_view_while_the_arm_avoids(gaze):
    """Eyes that stay where they were when it came lose it."""
    start = gaze_at(ROBOT, home(ROBOT), visit(0.0)[0])
    rig = icub_rig(ROBOT)
    log = encounter(start=start, fixation=GAZES[gaze])
    avoiding = [k for k, mode in enumerate(log.modes) if mode == "avoid"]
    assert len(avoiding) > 20
    for qs, expected in ((log.q, True), ([start] * len(log.q), False)):
        views = [(rig.view(qs[k]), visit(k * DT)[0]) for k in avoiding]
        assert all(view.left.sees(p) and view.right.sees(p) for view, p in views) == expected


@pytest.mark.parametrize("posture_deg", [STRAIGHT_DEG, (-30, 23, -8, 106, -46, 0, 0)])
def test_an_arm_that_is_straight_and_an_elbow_at_its_limit(posture_deg):
    start, place = away_from_home(posture_deg)
    log = encounter(lambda t: visit(t, *place), start=start)
    assert "avoid" in log.modes
    log.at_rest_at_home()
    assert log.reversals() <= 3
    assert np.linalg.norm(place[0] - HOME[0]) > 0.02, "else it is home"


def test_an_object_that_stays_on_the_way_home():
    """The arm stops before it, and waits there without swinging to and fro."""
    start, place = away_from_home(STRAIGHT_DEG)

    def stays(t: float) -> tuple[Array, Array]:
        """A ball of 2 cm comes to 2 cm from the place where the taxel was, when the arm has left it."""
        at, velocity = visit(min(t, 2.0), *place)
        return at - 0.04 * place[1], velocity

    log = encounter(stays, start=start, seconds=10.0)
    gaps = [np.linalg.norm(SKIN.at(ROBOT.at(q))[0] - stays(DT * k)[0], axis=1).min() for k, q in enumerate(log.q)]
    assert "return" in log.modes
    assert min(gaps) - 0.02 > 0.02, "no touch"
    assert not np.any(np.array(log.dq)[-20:, ARM])
    assert log.reversals() <= 4


def test_a_joint_that_is_stuck():
    """The elbow does not move: the others withdraw and return; the return is given up, and all rest."""
    elbow = ARM[3]

    def hold(t: float, old: Array, after: Array) -> Array:
        after[elbow] = old[elbow] if t > 1.5 else after[elbow]
        return after

    log = encounter(disturb=hold, seconds=14.0)
    assert "avoid" in log.modes
    assert log.modes[-1] == "idle"
    assert not np.any(np.array(log.dq)[-10:, ARM])
    assert log.reversals() <= 2


def test_a_torso_that_turns_during_avoidance():
    """The arm is at home in its own joints, wherever the torso is."""
    torso = ROBOT.indices(("torso_yaw", "torso_pitch"))

    def turn(t: float, old: Array, after: Array) -> Array:
        after[torso] += DT * np.deg2rad([20.0, 8.0]) * (0.8 < t < 1.8)
        return after

    log = encounter(disturb=turn, seconds=9.0)
    assert "avoid" in log.modes
    log.at_rest_at_home()


@pytest.mark.parametrize("gaze", GAZES)
@pytest.mark.parametrize("latency_s", [0.0, 0.2])
def test_a_target_at_rest_is_fixated_without_overshoot_or_limit_cycle(gaze, latency_s):
    p = np.array([-0.35, -0.15, 0.2])
    log = encounter(lambda t: (p, np.zeros(3)), 2.5, latency_s=latency_s, fixation=GAZES[gaze])
    errors = np.array([fixation_error(ROBOT.at(q), p) for q in log.q]) / DEG
    reached = int(np.argmax(errors < 0.5))
    assert 0 < reached < 1.2 / DT
    assert errors[reached:].max() < 1.0
    late = np.array(log.dq)[-15:, HEAD]
    assert np.all(late.min(axis=0) * late.max(axis=0) > -((0.1 * DEG) ** 2)), "a limit cycle"


@pytest.mark.parametrize("gaze", GAZES)
@pytest.mark.parametrize("place", ["at the eye", "between the eyes", "across the midline"])
def test_a_target_where_no_eye_can_follow(gaze, place):
    """At 2 cm before an eye and between the eyes; across the midline at 40 cm/s, 15 cm before the eyes."""
    eyes = [ROBOT.at(home(ROBOT)).point(eye, (0, 0, 0.02)) for eye in (ROBOT.names.left_eye, ROBOT.names.right_eye)]

    def motion(t: float) -> tuple[Array, Array]:
        if place == "across the midline":
            return np.array([-0.22, -0.3 + 0.4 * t, 0.33]), np.array([0.0, 0.4, 0.0])
        return (eyes[0] if place == "at the eye" else 0.5 * (eyes[0] + eyes[1])), np.zeros(3)

    log = encounter(motion, 3.0, gaze_at(ROBOT, home(ROBOT), motion(0.0)[0]), fixation=GAZES[gaze])
    if place != "across the midline":
        late = np.array(log.dq)[-20:, HEAD]
        assert np.abs(np.diff(np.sign(np.where(np.abs(late) > 2 * DEG, late, 0)), axis=0)).sum() == 0, "a limit cycle"


def drive(activations: Callable[[int], Array], steps: int = 200) -> Log:
    """An arm with these activations by an object of unknown position."""
    q = home(ROBOT)
    state = ArmState()
    log = Log()
    last = None
    last_q = None
    params = AvoidanceParams(HOME_ARM_RAD)
    for k in range(steps):
        posture = ROBOT.at(q)
        track = Track3D.unknown(k * DT)
        arm = ArmInput(k * DT, posture, SKIN, activations(k), track, self_collision=BODIES)
        state, response = avoidance.step(params, state, arm)
        command = limits.limit(LimitParams(), BODIES, posture, response.command, last, last_q)
        log.add(response.mode, q, command.dq_rad_s)
        last, last_q, q = command, q, q + DT * command.dq_rad_s
    return log


@pytest.mark.parametrize("period", [2, 3, 8, 16])
def test_activation_that_flickers_about_the_threshold(period):
    """The arm moves there and back within its sphere; then it rests."""
    a = np.where(np.arange(16) == 2, 1.0, 0.0)
    log = drive(lambda k: a * (0.41 if k % period < (period + 1) // 2 else 0.39) * (k < 80))
    palm = np.array([ROBOT.at(q).point("left_palm") for q in log.q])
    assert np.linalg.norm(palm - palm[0], axis=1).max() < 0.205
    assert "avoid" in log.modes
    log.at_rest_at_home()
    assert log.reversals() <= 2 * 80 // period


@pytest.mark.parametrize("ratio", [1.0, 0.999])
def test_opposite_normals_cancel(ratio):
    """Two stimuli on opposite sides: the arm does not change sides with their noise."""
    normals = SKIN.at(ROBOT.at(home(ROBOT)))[1]
    near = SKIN.index("left_forearm:3")
    opposite = int(np.argmin(normals[:12] @ normals[near]))
    assert np.linalg.norm(normals[near] + normals[opposite]) < 1.0, "else this is no test"
    rng = np.random.default_rng(0)
    mean = 0.9 * (np.eye(16)[near] + ratio * np.eye(16)[opposite])
    log = drive(lambda k: (mean + 0.01 * rng.standard_normal(16) * (mean > 0)) * (k < 60))
    log.at_rest_at_home()
    assert log.reversals() <= 3


def test_all_taxels_active():
    log = drive(lambda k: np.full(16, float(k < 60)))
    assert "avoid" in log.modes
    log.at_rest_at_home()
    assert log.reversals() <= 2
