"""Bring what is fixated into reach by turning the torso, then send the hand there (J's outlook).

The hand and the eyes are both carried by the torso, so the reachable-space map holds whatever the torso does; only
the gaze that keeps a point fixated changes as it turns.  The torso climbs the map's degree of reachability, through
the learned relation of its turns to the gaze, and the head turns against it by the same relation.  Where climbing ends
before the map says reachable, the shortest way there over a lattice of torso postures is taken, if there is one.
"""

import heapq
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from control.head import gaze_columns
from pps_vision.robot.model import Posture, Robot
from pps_vision.types import Array, JointVelocity, Mask

_DEG = np.pi / 180
_AROUND = np.vstack([np.eye(3), -np.eye(3)])
_NEXT_TO = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j])
Mode = Literal["judging", "turning", "reaching", "there", "out of reach", "unseen"]


class Verdict(Protocol):
    """What a map says of N gaze postures: `reachable` (N,), `degree` (N,), NaN where it knows nothing."""

    @property
    def reachable(self) -> Mask: ...

    @property
    def degree(self) -> Array: ...


@dataclass(frozen=True)
class Learned:
    """What the planner knows, all of it learned or solved elsewhere.

    `judge` a map: gaze postures (N, 3) → verdict.  `keeps` the gaze (M, 3) that keeps what a gaze (3,) fixates at
    torso (2,; yaw, pitch) after turns (M, 2).  `hand_to` the best arm posture (k,) for the point a gaze (3,) fixates
    (second stage of inverse kinematics; the first k joints of the arm), and how far it leaves the hand off (m).
    """

    judge: Callable[[Array], Verdict]
    keeps: Callable[[Array, Array, Array], Array]
    hand_to: Callable[[Array], tuple[Array, float]]


@dataclass(frozen=True)
class IntoReachParams:
    """The torso turns at `torso_rad_s` in the best of `n_ways` directions, judged `ahead_rad` ahead, slower where the
    gaze, of something near, would change faster than `gaze_rad_s`; at most `most_turn_rad` in all are imagined.
    Where that leads nowhere, the way is sought over torso postures `lattice_rad` apart, with `margin_rad` between the
    gaze and the map's limits.
    Verdicts are made on a gaze that has rested for `settle_s`.  The arm nears its goal at `arm_per_s` of what is left,
    no faster than `arm_rad_s`.  A gaze that changes by more than `moved_rad` meanwhile is another question.  A hand
    that would be left more than `touch_m` off is not sent, and none is where the map's degree of reachability is not
    above `min_degree`, or no longer."""

    side: Literal["left", "right"] = "right"
    torso_rad_s: float = 15 * _DEG
    n_ways: int = 16
    ahead_rad: float = 2 * _DEG
    most_turn_rad: float = 150 * _DEG
    lattice_rad: float = 4 * _DEG
    margin_rad: float = 1 * _DEG
    gaze_rad_s: float = 12 * _DEG
    settle_s: float = 0.5
    arm_per_s: float = 4.0
    arm_rad_s: float = 60 * _DEG
    arrived_rad: float = 0.2 * _DEG
    moved_rad: float = 2 * _DEG
    touch_m: float = 0.01
    min_degree: float = 0.5


@dataclass(frozen=True, slots=True)
class IntoReachState:
    """What is being done since `since_s`; while turning where no climb leads, the `way` (T, 2) still to go; while
    reaching, the `arm_goal` (k,) for what `gaze` (3,) fixated."""

    mode: Mode = "judging"
    since_s: float = -np.inf
    way: Array | None = None
    gaze: Array | None = None
    arm_goal: Array | None = None


def step(
    params: IntoReachParams,
    learned: Learned,
    state: IntoReachState,
    posture: Posture,
    gaze: Array | None,
    dt_s: float = 0.05,
    stamp_s: float = 0.0,
) -> tuple[IntoReachState, JointVelocity]:
    """One control step from the gaze (3,) that fixates the object now, None where it is not seen: then nothing moves.

    The command turns torso, head and arm; what the head does is to be added to what holds fixation.  Out of reach for
    any turn that can be imagined: said so, and nothing is commanded.
    """
    robot = posture.robot
    if gaze is None or not np.isfinite(gaze).all():
        return IntoReachState("unseen", stamp_s), JointVelocity(stamp_s, np.zeros(robot.n_joints))
    state = _next(params, learned, state, posture, gaze, stamp_s)
    dq: Array = np.zeros(robot.n_joints)
    if state.mode == "turning":
        if state.way is None:
            turn = best_turn(params, learned, robot, gaze, _torso(posture))
        else:
            state, turn = _along(state, _torso(posture), params.torso_rad_s * dt_s)
        if turn is None or learned.judge(gaze[None]).reachable[0]:
            state = IntoReachState("judging", stamp_s)
        else:
            dq = _turning(params, learned, posture, gaze, turn, dt_s)
    elif state.mode == "reaching" and state.arm_goal is not None:
        index, away = _away(params, posture, state.arm_goal)
        rates = params.arm_per_s * away
        dq[index] = rates / max(float(np.abs(rates).max()) / params.arm_rad_s, 1.0)
    return state, JointVelocity(stamp_s, dq)


def best_turn(params: IntoReachParams, learned: Learned, robot: Robot, gaze: Array, torso: Array) -> Array | None:
    """The unit turn (2,) that raises the degree most and that neither the torso's limits nor the map's forbid; None
    where none does."""
    ends = _turns(params, robot, torso)
    there = learned.judge(learned.keeps(gaze, torso, ends))
    degree = np.where(np.isfinite(there.degree), there.degree, -np.inf)
    k = int(np.argmax(degree))
    if not degree[k] > learned.judge(gaze[None]).degree[0] + 1e-6:
        return None
    turn: Array = ends[k] / max(float(np.linalg.norm(ends[k])), 1e-12)
    return turn


def imagine(params: IntoReachParams, learned: Learned, robot: Robot, gaze: Array, torso: Array) -> Array | None:
    """The torso postures (T, 2) of a climb until the map calls what `gaze` fixates reachable, or the climb's end where
    its degree still exceeds `min_degree`; else None.  Nothing moves: each gaze is what the learned relation expects."""
    path = [torso]
    for _ in range(int(params.most_turn_rad / params.ahead_rad)):
        here = learned.judge(gaze[None])
        if here.reachable[0]:
            return np.array(path)
        turn = best_turn(params, learned, robot, gaze, torso)
        if turn is None:
            return np.array(path) if here.degree[0] > params.min_degree else None
        turn = params.ahead_rad * turn
        gaze, torso = learned.keeps(gaze, torso, turn[None])[0], torso + turn
        path.append(torso)
    return None


def shortest_way(params: IntoReachParams, learned: Learned, robot: Robot, gaze: Array, torso: Array) -> Array | None:
    """The torso postures (T, 2) of the shortest way over a lattice to where the map calls what `gaze` fixates
    reachable (Dijkstra); None where there is none.  Imagined, as `imagine`."""
    start = (0, 0)
    before: dict[tuple[int, int], tuple[int, int]] = {}
    todo = [(0.0, start, start, tuple(gaze))]
    while todo:
        far, node, last, gaze_there = heapq.heappop(todo)
        if node in before:
            continue
        before[node] = last
        if learned.judge(np.array([gaze_there])).reachable[0]:
            way = [node]
            while way[-1] != start:
                way.append(before[way[-1]])
            return _cut(robot, torso + params.lattice_rad * np.array(way[::-1]))
        here = _cut(robot, torso + params.lattice_rad * np.array(node))
        ends = torso + params.lattice_rad * (np.array(node) + _NEXT_TO)
        turns = _cut(robot, ends) - here
        after = learned.keeps(np.array(gaze_there), here, turns)
        around = learned.judge((after[:, None] + params.margin_rad * _AROUND).reshape(-1, 3)).degree
        known = np.isfinite(around).reshape(len(after), -1).all(axis=1)
        known &= np.abs(_cut(robot, ends) - ends).max(axis=1) < params.lattice_rad
        for (i, j), turn, then in zip(_NEXT_TO[known].tolist(), turns[known], after[known], strict=True):
            way_so_far = far + float(np.linalg.norm(turn))
            heapq.heappush(todo, (way_so_far, (node[0] + i, node[1] + j), node, tuple(then)))
    return None


def _along(state: IntoReachState, torso: Array, near_rad: float) -> tuple[IntoReachState, Array | None]:
    """The unit turn (2,) to the next posture of the way that is not near already; None at its end."""
    way = np.zeros((0, 2)) if state.way is None else state.way
    far = np.linalg.norm(way - torso, axis=1) > near_rad
    if not far.any():
        return state, None
    way = way[int(np.argmax(far)) :]
    turn: Array = (way[0] - torso) / np.linalg.norm(way[0] - torso)
    return replace(state, way=way), turn


def _next(
    params: IntoReachParams, learned: Learned, state: IntoReachState, posture: Posture, gaze: Array, stamp_s: float
) -> IntoReachState:
    """Judge what rests, turn while that helps, reach, and begin anew when what is fixated moves or is seen again."""
    if state.mode == "unseen":
        return IntoReachState("judging", stamp_s)
    if state.gaze is not None and np.abs(gaze - state.gaze).max() > params.moved_rad:
        return IntoReachState("judging", stamp_s)
    if state.mode == "judging":
        since = stamp_s if state.since_s == -np.inf else state.since_s
        if stamp_s - since < params.settle_s - 1e-9:
            return replace(state, since_s=since)
        return _judged(params, learned, posture, gaze, stamp_s)
    if state.mode == "reaching" and state.arm_goal is not None:
        if not learned.judge(gaze[None]).degree[0] > params.min_degree:
            return IntoReachState("judging", stamp_s)
        _, away = _away(params, posture, state.arm_goal)
        if np.abs(away).max() < params.arrived_rad:
            return replace(state, mode="there", since_s=stamp_s)
    return state


def _judged(params: IntoReachParams, learned: Learned, posture: Posture, gaze: Array, stamp_s: float) -> IntoReachState:
    """What to do about what rests: reach where no turn is needed (or none helps), else turn."""
    asked = params, learned, posture.robot, gaze, _torso(posture)
    climb = imagine(*asked)
    way = shortest_way(*asked) if climb is None else None
    if (climb is not None and len(climb) > 1) or way is not None:
        return IntoReachState("turning", stamp_s, way)
    if climb is not None:
        goal, off_m = learned.hand_to(gaze)
        if off_m <= params.touch_m:
            return IntoReachState("reaching", stamp_s, None, gaze, goal)
    return IntoReachState("out of reach", stamp_s, None, gaze)


def _turning(
    params: IntoReachParams, learned: Learned, posture: Posture, gaze: Array, turn: Array, dt_s: float
) -> Array:
    """Joint rates that turn the torso and, by the learned relation, the head against it."""
    robot, torso = posture.robot, _torso(posture)
    turned = _cut(robot, torso + params.torso_rad_s * dt_s * turn) - torso
    change = learned.keeps(gaze, torso, turned[None])[0] - gaze
    share = min(1.0, params.gaze_rad_s * dt_s / max(float(np.abs(change).max()), 1e-9))
    dq: Array = gaze_columns(robot) @ np.insert(change, 2, 0.0)  # the eyes' tilt stays
    dq[robot.indices(robot.names.torso)] = turned
    return dq * share / dt_s


def _turns(params: IntoReachParams, robot: Robot, torso: Array) -> Array:
    """(n_ways, 2) turns of `ahead_rad` in all directions, cut at the torso's limits."""
    angle = 2 * np.pi * np.arange(params.n_ways) / params.n_ways
    ends = torso + params.ahead_rad * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return _cut(robot, ends) - torso


def _cut(robot: Robot, torso: Array) -> Array:
    """Torso postures (…, 2) within the robot's limits."""
    index = robot.indices(robot.names.torso)
    within: Array = np.clip(torso, robot.lower_rad[index], robot.upper_rad[index])
    return within


def _torso(posture: Posture) -> Array:
    """(2,) yaw and pitch, rad."""
    torso: Array = posture.q_rad[posture.robot.indices(posture.robot.names.torso)]
    return torso


def _away(params: IntoReachParams, posture: Posture, goal: Array) -> tuple[list[int], Array]:
    """The arm's joints, and how far they are from the goal, the joints it does not name from zero."""
    index = posture.robot.indices(posture.robot.names.arm(params.side))
    whole = np.zeros(len(index))
    whole[: len(goal)] = goal
    return index, whole - posture.q_rad[index]
