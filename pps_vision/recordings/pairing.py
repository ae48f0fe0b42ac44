"""Which left and which right image belong together, by their stamps."""

import numpy as np

from pps_vision.recordings.image_file import ImageFile
from pps_vision.recordings.problems import Problem, ProblemKind
from pps_vision.recordings.recording import Pair
from pps_vision.types import Array


def pair_by_stamp(
    left: list[ImageFile], right: list[ImageFile], max_skew_s: float, problems: list[Problem]
) -> tuple[Pair, ...]:
    """Images that are each other's nearest in time and at most `max_skew_s` apart, one to one.

    Both lists in the order of their stamps, and so are the pairs.  The unpaired are noted.
    """
    if not max_skew_s >= 0:
        raise ValueError(f"max_skew_s {max_skew_s}: expected a time of at least 0 s")
    matches = _mutually_nearest(left, right, max_skew_s) if left and right else []
    wanted = f"image within {1000 * max_skew_s:g} ms"
    note_unpaired(left, {i for i, _ in matches}, f"right {wanted}", problems)
    note_unpaired(right, {j for _, j in matches}, f"left {wanted}", problems)
    return tuple((left[i], right[j]) for i, j in matches)


def note_unpaired(files: list[ImageFile], paired: set[int], wanted: str, problems: list[Problem]) -> None:
    """A problem for every file whose place is not in `paired`."""
    problems += [
        Problem(ProblemKind.UNPAIRED, file.cited, file.line, f"{file.path.name} is unpaired; expected a {wanted}")
        for place, file in enumerate(files)
        if place not in paired
    ]


def _mutually_nearest(left: list[ImageFile], right: list[ImageFile], max_skew_s: float) -> list[tuple[int, int]]:
    """Pairs of places; mutual nearness makes them one to one and keeps them from crossing."""
    stamps_left, stamps_right = (np.array([file.stamp_s for file in files]) for files in (left, right))
    to_right, to_left = _nearest(stamps_left, stamps_right), _nearest(stamps_right, stamps_left)
    mutual = to_left[to_right] == np.arange(len(left))
    close = np.abs(stamps_left - stamps_right[to_right]) <= max_skew_s
    return [(int(i), int(to_right[i])) for i in np.flatnonzero(mutual & close)]


def _nearest(stamps: Array, among: Array) -> Array:
    """(n,) the place of the nearest of `among` (sorted) for each of `stamps`, the first of equals."""
    first = np.searchsorted(among, among)  # of several equal stamps, the first one's place
    after = np.minimum(np.searchsorted(among, stamps), len(among) - 1)
    before = first[np.maximum(after - 1, 0)]
    return np.where(np.abs(stamps - among[before]) <= np.abs(among[after] - stamps), before, after)
