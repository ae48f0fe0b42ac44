"""Bring what is fixated into reach by turning the torso, then send the hand there (J's outlook).

The torso carries hand and eyes alike, so the reachable-space map holds whatever the torso does; only the gaze that
keeps a point fixated changes as it turns.  The shortest way to a torso posture from which the map calls the point
reachable is planned on a lattice, with the learned relation of torso turns to gaze; the head turns against the torso
by the same relation.
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
_NEIGHBOURS = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j])
Mode = Literal["judging", "turning", "reaching", "there", "out of reach", "unseen"]


class Verdict(Protocol):
    """What a map predicts of N gaze postures: `reachable` (N,), `degree` (N,), NaN where it knows nothing."""

    @property
    def reachable(self) -> Mask: ...

    @property
    def degree(self) -> Array: ...


@dataclass(frozen=True)
class Learned:
    """What the planner knows, all of it learned or solved elsewhere."""

    judge: Callable[[Array], Verdict]
    """The map: gaze postures (N, 3) → verdict."""
    keeps: Callable[[Array, Array, Array], Array]
    """Gaze (3,), torso (2,; yaw, pitch), turns (M, 2) → gaze (M, 3) that keeps the same point fixated after them."""
    hand_to: Callable[[Array], tuple[Array, float]]
    """Gaze (3,) → posture (k,) of the arm's first k joints for the fixated point, and the distance left (m)."""


@dataclass(frozen=True)
class IntoReachParams:
    """How the torso turns and the arm moves."""

    side: Literal["left", "right"] = "right"
    """The arm."""
    torso_rad_s: float = 15 * _DEG
    """Speed of the torso."""
    gaze_rad_s: float = 12 * _DEG
    """The torso turns slower where the gaze, of something near, would change faster."""
    lattice_rad: float = 4 * _DEG
    """Spacing of the torso postures that are planned over."""
    margin_rad: float = 1 * _DEG
    """Distance that the planned gaze keeps from the map's limits."""
    settle_s: float = 0.5
    """A plan is made on a gaze that has rested for so long."""
    moved_rad: float = 2 * _DEG
    """A gaze that changes by more while the arm moves is planned for anew."""
    arm_per_s: float = 4.0
    """Rate at which the arm nears its goal, of the angles left."""
    arm_rad_s: float = 60 * _DEG
    """Speed limit of the arm's joints."""
    arrived_rad: float = 0.2 * _DEG
    """Angle left at which the arm has arrived."""
    touch_m: float = 0.01
    """A hand that would be left further off is not sent."""
    min_degree: float = 0.5
    """Degree of reachability from which on a point is tried although the map does not call it reachable (J IV.7)."""


@dataclass(frozen=True, slots=True)
class IntoReachState:
    """What is being done."""

    mode: Mode = "judging"
    since_s: float = -np.inf
    """Since when."""
    way: Array | None = None
    """While turning: torso postures (T, 2) still to go."""
    gaze: Array | None = None
    """While reaching and afterwards: the gaze (3,) of what the plan was made for."""
    arm_goal: Array | None = None
    """While reaching: posture (k,) of the arm's first joints."""


def step(
    params: IntoReachParams,
    learned: Learned,
    state: IntoReachState,
    posture: Posture,
    gaze: Array | None,
    dt_s: float = 0.05,
    stamp_s: float = 0.0,
) -> tuple[IntoReachState, JointVelocity]:
    """One control step.

    `gaze` (3,) fixates the object now; None or NaN where it is not seen: then nothing moves.  The command turns torso,
    head and arm; its head rates compensate the torso and are added to those of the fixation controller.
    """
    robot = posture.robot
    if gaze is None or not np.isfinite(gaze).all():
        return IntoReachState("unseen", stamp_s), JointVelocity(stamp_s, np.zeros(robot.n_joints))
    state = _next(params, learned, state, posture, gaze, stamp_s)
    dq: Array = np.zeros(robot.n_joints)
    if state.mode == "turning" and state.way is not None:
        way, torso = state.way, _torso(posture)
        far = np.linalg.norm(way - torso, axis=1) > params.torso_rad_s * dt_s
        if not far.any() or learned.judge(gaze[None]).reachable[0]:
            state = IntoReachState("judging", stamp_s)
        else:
            way = way[int(np.argmax(far)) :]
            state = replace(state, way=way)
            dq = _turn(params, learned, posture, gaze, way[0] - torso, dt_s)
    elif state.mode == "reaching" and state.arm_goal is not None:
        index, left = _left_to_go(params, posture, state.arm_goal)
        rates = params.arm_per_s * left
        dq[index] = rates / max(float(np.abs(rates).max()) / params.arm_rad_s, 1.0)
    return state, JointVelocity(stamp_s, dq)


def plan(params: IntoReachParams, learned: Learned, robot: Robot, gaze: Array, torso: Array) -> Array | None:
    """The torso postures (T, 2) of the shortest way to where the map calls what `gaze` (3,) fixates reachable.

    Dijkstra over a lattice around the present `torso` (2,); each gaze is what the learned relation predicts.  If the
    map calls it reachable from nowhere, the way to the nearest posture where its degree exceeds `min_degree`; None if
    there is none.
    """
    start = (0, 0)
    previous: dict[tuple[int, int], tuple[int, int]] = {}
    likely: tuple[int, int] | None = None
    queue = [(0.0, start, start, tuple(gaze))]
    while queue:
        length, node, last, gaze_here = heapq.heappop(queue)
        if node in previous:
            continue
        previous[node] = last
        verdict = learned.judge(np.array([gaze_here]))
        if verdict.reachable[0]:
            return _way(params, robot, torso, previous, node)
        if likely is None and verdict.degree[0] > params.min_degree:
            likely = node
        here = _clip(robot, torso + params.lattice_rad * np.array(node))
        ends = torso + params.lattice_rad * (np.array(node) + _NEIGHBOURS)
        turns = _clip(robot, ends) - here
        gaze_after = learned.keeps(np.array(gaze_here), here, turns)
        margin = params.margin_rad * np.vstack([np.eye(3), -np.eye(3)])
        degrees = learned.judge((gaze_after[:, None] + margin).reshape(-1, 3)).degree.reshape(len(ends), -1)
        within = np.abs(_clip(robot, ends) - ends).max(axis=1) < params.lattice_rad
        for k in np.flatnonzero(np.isfinite(degrees).all(axis=1) & within):
            neighbour = node[0] + int(_NEIGHBOURS[k, 0]), node[1] + int(_NEIGHBOURS[k, 1])
            there = length + float(np.linalg.norm(turns[k]))
            heapq.heappush(queue, (there, neighbour, node, tuple(gaze_after[k])))
    return None if likely is None else _way(params, robot, torso, previous, likely)


def _way(
    params: IntoReachParams,
    robot: Robot,
    torso: Array,
    previous: dict[tuple[int, int], tuple[int, int]],
    node: tuple[int, int],
) -> Array:
    """Torso postures (T, 2) from the start of the lattice to a node."""
    nodes = [node]
    while nodes[-1] != (0, 0):
        nodes.append(previous[nodes[-1]])
    return _clip(robot, torso + params.lattice_rad * np.array(nodes[::-1]))


def _next(
    params: IntoReachParams, learned: Learned, state: IntoReachState, posture: Posture, gaze: Array, stamp_s: float
) -> IntoReachState:
    """Plan when the gaze has rested, and anew when the object moves or is seen again."""
    if state.mode == "unseen" or (state.gaze is not None and np.abs(gaze - state.gaze).max() > params.moved_rad):
        return IntoReachState("judging", stamp_s)
    if state.mode == "judging":
        since = stamp_s if state.since_s == -np.inf else state.since_s
        if stamp_s - since < params.settle_s - 1e-9:
            return replace(state, since_s=since)
        return _planned(params, learned, posture, gaze, stamp_s)
    if state.mode == "reaching" and state.arm_goal is not None:
        if not learned.judge(gaze[None]).degree[0] > params.min_degree:
            return IntoReachState("judging", stamp_s)
        if np.abs(_left_to_go(params, posture, state.arm_goal)[1]).max() < params.arrived_rad:
            return replace(state, mode="there", since_s=stamp_s)
    return state


def _planned(
    params: IntoReachParams, learned: Learned, posture: Posture, gaze: Array, stamp_s: float
) -> IntoReachState:
    """Turn where a turn is needed, else reach if the hand gets near enough."""
    way = plan(params, learned, posture.robot, gaze, _torso(posture))
    if way is not None and len(way) > 1:
        return IntoReachState("turning", stamp_s, way)
    if way is not None:
        goal, off_m = learned.hand_to(gaze)
        if off_m <= params.touch_m:
            return IntoReachState("reaching", stamp_s, None, gaze, goal)
    return IntoReachState("out of reach", stamp_s, None, gaze)


def _turn(
    params: IntoReachParams, learned: Learned, posture: Posture, gaze: Array, towards: Array, dt_s: float
) -> Array:
    """Joint rates that turn the torso in the direction `towards` (2,) and the head against it."""
    robot, torso = posture.robot, _torso(posture)
    turn = params.torso_rad_s * dt_s * towards / np.linalg.norm(towards)
    change = learned.keeps(gaze, torso, turn[None])[0] - gaze
    share = min(1.0, params.gaze_rad_s * dt_s / max(float(np.abs(change).max()), 1e-9))
    dq: Array = gaze_columns(robot) @ np.insert(change, 2, 0.0)  # the eyes' tilt stays
    dq[robot.indices(robot.names.torso)] = turn
    return dq * share / dt_s


def _clip(robot: Robot, torso: Array) -> Array:
    """Torso postures (…, 2) within the robot's limits."""
    index = robot.indices(robot.names.torso)
    within: Array = np.clip(torso, robot.lower_rad[index], robot.upper_rad[index])
    return within


def _torso(posture: Posture) -> Array:
    """(2,) yaw and pitch, rad."""
    torso: Array = posture.q_rad[posture.robot.indices(posture.robot.names.torso)]
    return torso


def _left_to_go(params: IntoReachParams, posture: Posture, goal: Array) -> tuple[list[int], Array]:
    """The arm's joints, and their angles to the goal; joints that it does not name go to zero."""
    index = posture.robot.indices(posture.robot.names.arm(params.side))
    whole = np.zeros(len(index))
    whole[: len(goal)] = goal
    return index, whole - posture.q_rad[index]
