"""Encounters with an object to reach for: whether it is within reach, by maps of the arm's body parts and by a search,
and whether the arm touches it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
from scipy.optimize import least_squares

from control import reaching
from control.arm import ArmParams
from control.avoidance import ArmInput, ArmState
from control.reaching import ReachingParams
from learning.reach.labels import Labels, ReachOracle, hand_and_params
from learning.reach.map import ReachableMap, TrackReachability
from learning.reach.params import ArmLimits, MapParams
from learning.reach.training import learned_from
from pps_vision.app.encounters.encounter import Encounter, EncounterScene, Part, draw
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import NONE, OURS, RADIUS_M, TRUE, ArmScene, Controller
from pps_vision.app.encounters.suite import Rows, Task, memories, rows_of_task, scene, track_rng
from pps_vision.app.encounters.tracks import track_of, true_track_of
from pps_vision.app.simulation import Side
from pps_vision.robot.bare_links import BareLinks
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.model import Posture, Robot
from pps_vision.robot.skin import TOUCH_RADIUS_M
from pps_vision.types import Array, Track3D

REACHING = (OURS, "R eq. 6", "distance only", TRUE)
"""Controllers that can reach as well."""
HOLD_S = 0.2
"""Time for which a command may be held: a short one lets a joint come to its limit sooner."""
_ARM = ArmParams()
_LABELS = 1500  # labels of a body part's map of reachable space, times the share of the training
_FEWEST_LABELS = 200
_EXACT_M = 0.1  # more than an object's radius and the distance of a touch
_DEG = np.pi / 180
_GAZE = GazeLimits((-65 * _DEG, 65 * _DEG), (-110 * _DEG, 0.0), (7 * _DEG, 40 * _DEG))
"""Of all objects near the arms: down to their elbows."""
_TOLERANCE_RAD = 1e-6  # within a joint limit
_REACHED_M = 1e-4  # residual of a posture that touches
_STARTS = 3  # random start postures of the search for a touch
_CLEARANCE_M = 0.025  # self-collision distance that our arm keeps


def rows_of(task: Task, folder: Path) -> Rows:
    """Return the rows of a task of the suite, or of one to reach, whose rows also say whether a touch is possible."""
    if task.condition != "reach":
        return rows_of_task(task, folder)
    rows: Rows = []
    for number in range(task.first, task.first + task.n):
        encounter = draw(scene(), task.condition, number, task.seed)
        seeds = task.seed, task.condition, number
        reachable = can_touch(scene(), encounter, track_rng(*seeds))
        tracks = track_of(scene(), encounter, track_rng(*seeds))
        for name, entry in task.controllers.items():
            if name not in (*REACHING, NONE):
                continue
            seen = true_track_of(encounter) if name == TRUE else tracks
            memory = entry.memory_of(memories(folder)[encounter.side])
            new: Any = entry.new
            if name in (OURS, TRUE):
                new = partial(ours_reaching, reachability=_maps(folder)[encounter.side])
            elif name != NONE:
                new = partial(new, sign=1.0)
            arguments = memory, encounter, name, new, seen
            result = simulate_encounter(scene(), *arguments, field=entry.field, hold_s=HOLD_S)
            rows.append({**asdict(result), "reachable": reachable})
    return rows


def ours_reaching(
    scene: ArmScene, reachability: Mapping[str, TrackReachability] | None = None, arm: ArmParams = _ARM
) -> Controller:
    """Return our controller of an arm that reaches. `reachability`: by taxel, the reachable-space map of its body part;
    None: everything is taken to be within reach."""
    home = tuple(scene.home_rad[scene.arm].tolist())
    params = ReachingParams(home, scene.side, radius_m=RADIUS_M, arm=arm)
    body = scene.self_collision, BareLinks(scene.robot, scene.skin, scene.side)
    state = ArmState()

    def act(activations: Array, track: Track3D, posture: Posture) -> Array:
        nonlocal state

        def within_reach(taxel: int) -> bool:
            name = scene.skin.taxel_ids[taxel]
            return reachability is None or reachability[name](posture.q_rad, track).is_reachable

        step = ArmInput(track.stamp_s, posture, scene.skin, activations, track, scene.hold_s, *body)
        state, response = reaching.step(params, state, step, within_reach)
        return response.command.dq_rad_s

    return act


def train_maps(folder: Path, seed: int, share: float) -> None:
    """Learn the map of each body part that objects come to into a folder, unless it is there."""
    for side, part in scene().targets:
        if not (file := _map_file(folder, side, part)).exists():
            reachable_part(scene(), side, part, np.random.default_rng(seed), share).save(file)


def reachable_part(
    scene: EncounterScene, side: Side, part: Part, rng: np.random.Generator, share: float = 1.0
) -> ReachableMap:
    """Return the map of the points that any taxel of a body part can be brought to, with a share of the labels."""
    n = max(round(share * _LABELS), _FEWEST_LABELS)
    arm_limits = ArmLimits.of(scene.robot, side)
    params = MapParams(_GAZE, arm_limits, n, n // 2, n_babble=20_000, lattice=0.05, exact_m=_EXACT_M)
    taxels = [taxel for taxel in scene.skins[side].taxel_ids if scene.body_part(taxel) == part]
    return train_part_map(scene.robot, side, taxels, rng, params)


def train_part_map(
    robot: Robot, side: str, taxels: Sequence[str], rng: np.random.Generator, params: MapParams
) -> ReachableMap:
    """Learn the map of a body part: which points any of its `taxels` (such as "left_forearm:27") can be brought to."""
    hands = [hand_and_params(robot, side, taxel, "joint-limits", params)[0] for taxel in taxels]
    oracles = [ReachOracle(robot, side, params, rng, hand) for hand in hands]
    return learned_from(lambda gaze: _of_nearest([oracle.label(gaze) for oracle in oracles]), side, rng, params)


def _of_nearest(labels: Sequence[Labels]) -> Labels:
    """The labels of several points of the arm for the same gaze postures, each of the point that comes nearest; of
    those that reach, of the one in the best posture."""
    error = np.array([np.where(one.answered, one.error_m, np.inf) for one in labels])
    good = np.array([np.where(one.reachable, one.optimality, -np.inf) for one in labels])
    best = np.where(np.isfinite(good).any(axis=0), good.argmax(axis=0), error.argmin(axis=0))
    at = best, np.arange(error.shape[1])
    return Labels(**{f.name: np.stack([getattr(one, f.name) for one in labels])[at] for f in fields(Labels)})


@cache
def _maps(folder: Path) -> dict[Side, dict[str, TrackReachability]]:
    """By arm and taxel, the map of the taxel's body part."""
    robot = scene().robot
    asked = {
        target: TrackReachability(robot, ReachableMap.load(_map_file(folder, *target)), 1e-3, TOUCH_RADIUS_M)
        for target in scene().targets
    }
    return {
        side: {taxel: asked[side, scene().body_part(taxel)] for taxel in scene().skins[side].taxel_ids}
        for side in get_args(Side)
    }


def _map_file(folder: Path, side: Side, part: Part) -> Path:
    return folder / f"{side} {part}.npz"


def can_touch(scene: EncounterScene, encounter: Encounter, rng: np.random.Generator) -> bool:
    """Return whether some posture of the arm, within its limits and the palm's sphere and clear of the body, brings a
    taxel of the part aimed at to the waiting object.

    Least squares over the arm's joints, from the start posture and random ones; shares only the robot's kinematics with
    the controllers.
    """
    robot = scene.robot
    arm = scene.arm(encounter.side)
    skin = scene.skins[encounter.side]
    palm = robot.names.palm(encounter.side)
    center = encounter.motion(encounter.contact_s)[0]
    palm_home = robot.at(encounter.q_rad).point(palm)
    lower = robot.lower_rad[arm]
    upper = robot.upper_rad[arm]
    touching_m = encounter.radius_m + TOUCH_RADIUS_M

    def residuals(joints: Array, taxel: int) -> Array:
        q = encounter.q_rad.copy()
        q[arm] = joints
        posture = robot.at(q)
        d = skin.at(posture)[0][taxel] - center
        outside = float(np.linalg.norm(posture.point(palm) - palm_home)) - RADIUS_M
        too_near = _CLEARANCE_M - scene.self_collision.distance_m(q)
        return np.append(d * max(1 - touching_m / np.linalg.norm(d), 0.0), np.maximum([outside, too_near], 0.0))

    taxels = [index for index, taxel in enumerate(skin.taxel_ids) if scene.body_part(taxel) == encounter.part]
    starts = [encounter.q_rad[arm], *rng.uniform(lower, upper, (_STARTS, len(arm)))]
    for taxel, start in product(taxels, starts):
        inside = np.clip(start, lower + _TOLERANCE_RAD, upper - _TOLERANCE_RAD)
        solution = least_squares(residuals, inside, bounds=(lower, upper), args=(taxel,))
        if np.abs(solution.fun).max() < _REACHED_M:
            return True
    return False
