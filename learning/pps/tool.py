"""Touches beyond the skin: a tool that is held becomes part of the skin of the hand that holds it."""

from dataclasses import dataclass, replace

import numpy as np

from learning.pps.memory import PPSMemory
from pps_vision.robot.skin import Skin, SkinPart
from pps_vision.types import Array, Mask, TaxelEvents

_BEYOND_M = 0.08  # farther from all touched taxels, a touch is not theirs: more than robots misjudge, less than a tool
_SAME_M = 0.05  # touches this near each other are of one place


@dataclass(frozen=True)
class Tools:
    """Places beyond a skin of n taxels at which k groups of touches happened."""

    skin: Skin  # the robot's own
    parts: tuple[int, ...] = ()  # (k,) the body part that felt each
    sums: tuple[Array, ...] = ()
    """(k) arrays (7,) in the part's frame: sums of the points of touch and the directions to the objects, number."""

    @property
    def extended(self) -> Skin:
        """The skin with the k places as further taxels."""
        places = []
        for k, (part, total) in enumerate(zip(self.parts, self.sums, strict=True)):
            own = self.skin.parts[part]
            normal = total[3:6] / np.linalg.norm(total[3:6])
            places.append(SkinPart(f"{own.name}_tool_{k}", own.frame, (0,), total[None, :3] / total[6], normal[None]))
        return Skin((*self.skin.parts, *places))

    def own_touches(self, events: TaxelEvents) -> Mask:
        """(n,) the touches that objects near the touched body parts explain."""
        n = len(self.skin.taxel_ids)
        own = events.touched[:n].copy()
        for k in range(len(self.skin.parts)):
            of_part = own & (self.skin.part_index == k)
            distance_m = np.abs(events.distance_m[:n][of_part])
            if np.isfinite(distance_m).any() and np.nanmin(distance_m) > _BEYOND_M:
                own &= ~of_part
        return own

    def attributed(self, events: TaxelEvents) -> TaxelEvents:
        """What an `extended` skin perceives, with touches that are not the skin's own attributed to the places."""
        n = len(self.skin.taxel_ids)
        own = self.own_touches(events)
        felt_by = {int(self.skin.part_index[i]) for i in np.flatnonzero(events.touched[:n] & ~own)}
        near = np.nan_to_num(np.abs(events.distance_m[n:]), nan=np.inf) < _SAME_M
        places = near & np.array([part in felt_by for part in self.parts], dtype=bool)
        return replace(events, touched=np.concatenate([own, places]))

    def with_touch(self, part: int, point: Array, towards: Array) -> "Tools":
        """With one more touch beyond the skin of a part, at a point (3,) of an object in a direction (3,), both in the
        part's frame."""
        touch = np.concatenate([point, towards / np.linalg.norm(towards), [1.0]])
        for k, total in enumerate(self.sums):
            if self.parts[k] == part and np.linalg.norm(total[:3] / total[6] - point) < _SAME_M:
                return replace(self, sums=(*self.sums[:k], total + touch, *self.sums[k + 1 :]))
        return replace(self, parts=(*self.parts, part), sums=(*self.sums, touch))


def extend(memory: PPSMemory, tools: Tools) -> PPSMemory:
    """The memory with taxels for new places: without samples, so that they expect what their body part does."""
    ids = tools.extended.taxel_ids
    known = len(memory.taxel_ids)
    counts = np.zeros((len(ids), *memory.counts.shape[1:]), memory.counts.dtype)
    counts[:known] = memory.counts
    part_index = np.concatenate([tools.skin.part_index, np.array(tools.parts, dtype=np.intp)])
    return replace(memory, taxel_ids=ids, part_index=part_index, counts=counts)
