"""Whether what was found elsewhere is what is tracked: there the track says nothing, so it must look the same."""

from collections.abc import Sequence
from dataclasses import dataclass

from pps_vision.types import Observation3D
from tracking.color import ColorModel


@dataclass(frozen=True)
class AgainParams:
    """Colours at least `min_likeness` alike (Bhattacharyya), where colours are known, and radii (m) that differ
    by no more than `max_ratio`."""

    min_likeness: float = 0.85
    max_ratio: float = 1.25


def is_same(
    params: AgainParams,
    known: Sequence[ColorModel | None],
    radius_m: float,
    found: Sequence[ColorModel | None],
    seen: Observation3D | None,
) -> bool:
    """Whether the colours `found` in each eye, and the object `seen` by both, are the `known` one's."""
    for before, now in zip(known, found, strict=True):
        if before and now and before.similarity(now.object) < params.min_likeness:
            return False
    if seen is None:
        return False
    ratio = seen.radius_m / radius_m
    return max(ratio, 1 / ratio) <= params.max_ratio
