"""Touches beyond the skin: a tool that is held becomes part of the skin of the hand that holds it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from learning.pps.joint_offsets import TouchTrial, seen_from
from learning.pps.memory import PPSMemory
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, TaxelEvents

_BEYOND_M = 0.08  # farther from all touched taxels, a touch is not theirs: more than robots misjudge, less than a tool
_LONGEST_M = 1.0  # an object farther away is another one than the one that touches
_SAME_M = 0.05  # touches this near each other are of one place
_FEWEST = 2  # touches that make a place
_SLOW_M_S = 0.01  # an object much slower touches with its side towards the hand, a faster one with its foremost point


class ToolTouch(NamedTuple):
    """A touch beyond the skin of a body part, in the part's frame."""

    part: int  # the body part that felt it
    point: Array  # (3,) m, of the object's surface
    towards: Array  # (3,) unit vector to the object


def touch_beyond(robot: Robot, rig: StereoRig, skin: Skin, trial: TouchTrial, offsets_rad: Array) -> ToolTouch | None:
    """The touch at the end of a trial, with `offsets_rad` (n_joints,) added to the encoders; None where there is none,
    or the object is near enough to a touched taxel of the skin to have touched it."""
    radius_m = float(trial.radius_m[-1])
    felt: list[tuple[float, int, Array, Array]] = []
    for k in np.unique(skin.part_index[trial.touched]):
        part = skin.parts[k]
        center = seen_from(robot, rig, part.frame, trial, offsets_rad)
        away = center - part.positions_m[trial.touched[skin.part_index == k]]
        distances = np.linalg.norm(away, axis=1)
        felt.append((distances.min() - radius_m, int(k), center, away[distances.argmin()] / distances.min()))
    gap_m, k, center, outwards = min(felt, key=lambda part: part[0], default=(0.0, 0, np.zeros(3), np.zeros(3)))
    if not _BEYOND_M < gap_m < _LONGEST_M:
        return None
    posture = robot.at(trial.joints_rad[-1] + offsets_rad)
    velocity = posture.T_root(skin.parts[k].frame)[:3, :3].T @ trial.velocities[-1]
    towards = _SLOW_M_S * outwards - velocity
    towards /= np.linalg.norm(towards)
    return ToolTouch(k, center - radius_m * towards, towards)


def with_tool(memory: PPSMemory, skin: Skin, touches: Sequence[ToolTouch]) -> PPSMemory:
    """The memory of a skin with the places of `touches` beyond it, itself without any.

    A new place has no samples, so that a touch is expected as its body part expects it.
    """
    known = len(memory.places)
    parts = memory.part_index[memory.n_own :].tolist()
    places = list(memory.places)
    for touch in touches:
        total = np.concatenate([touch.point, touch.towards, [1.0]])
        for k, place in enumerate(places):
            if parts[k] == touch.part and np.linalg.norm(place[:3] / place[6] - touch.point) < _SAME_M:
                places[k] = place + total
                break
        else:
            parts.append(touch.part)
            places.append(total)
    kept = [k for k, place in enumerate(places) if k < known or place[6] >= _FEWEST]
    new = kept[known:]
    if not touches or not kept:
        return memory
    counts = np.zeros((len(new), *memory.counts.shape[1:]), memory.counts.dtype)
    ids = tuple(f"{skin.parts[parts[k]].name}_tool:{known + i}" for i, k in enumerate(new))
    return replace(
        memory,
        taxel_ids=(*memory.taxel_ids, *ids),
        part_index=np.append(memory.part_index, np.array([parts[k] for k in new], dtype=np.intp)),
        counts=np.concatenate([memory.counts, counts]),
        places=np.array([places[k] for k in kept]),
    )


def attributed(memory: PPSMemory, events: TaxelEvents) -> TaxelEvents:
    """The events with a touch that is far from the taxels that feel it as one of the tool's places that are near; a
    memory without a tool takes it to be the taxels'."""
    n = memory.n_own
    felt = np.flatnonzero(events.touched[:n])
    if not len(memory.places) or not len(felt):
        return events
    D = events.distance_m
    gap_m = np.nan_to_num(np.where(D < 0, -D - 2 * events.radius_m, D), nan=np.inf)  # also to an object behind a taxel
    of_tool = np.isin(memory.part_index, memory.part_index[felt]) & (gap_m < _SAME_M)
    of_tool[:n] = False
    nearest_m = gap_m[felt].min()
    is_own = nearest_m <= _BEYOND_M or (np.isinf(nearest_m) and not of_tool.any())
    return events if is_own else replace(events, touched=of_tool)
