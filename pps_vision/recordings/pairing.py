"""Which left and which right image belong together, by their stamps."""

import numpy as np

from pps_vision.recordings.image_file import ImageFile
from pps_vision.recordings.problems import Problem, ProblemKind
from pps_vision.recordings.recording import Pair


def pair_by_stamp(
    left: list[ImageFile], right: list[ImageFile], max_skew_s: float, problems: list[Problem]
) -> tuple[Pair, ...]:
    """As many images as possible in pairs at most `max_skew_s` apart, as close as possible.

    Both lists are in the order of their stamps; pairs are one to one and never cross.  The
    unpaired are noted.
    """
    if not 0 <= max_skew_s < float("inf"):
        raise ValueError(f"max_skew_s {max_skew_s}: expected a finite time of at least 0 s")
    matches = _match([file.stamp_s for file in left], [file.stamp_s for file in right], max_skew_s)
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


Chain = tuple[int, int, "Chain"] | None  # the last pair (places in left and right), and those before it


def _match(left: list[float], right: list[float], max_skew_s: float) -> list[tuple[int, int]]:
    """The pairs of places with the least sum of skews, an unpaired image costing `max_skew_s`.

    Dynamic programming over the left images; mutual nearness instead would lose most pairs of
    eyes that are half a frame apart.
    """
    first = np.searchsorted(right, np.subtract(left, max_skew_s), "left")
    end = np.searchsorted(right, np.add(left, max_skew_s), "right")
    saved_by_pair = 2 * max_skew_s + 1e-9  # two images are no longer unpaired; a tie goes to the pair
    best: list[tuple[float, Chain]] = [(0.0, None)]  # saving and chain with the first j right images only
    for i, stamp_s in enumerate(left):
        best += [best[-1]] * (int(end[i]) + 1 - len(best))
        within = range(int(first[i]), int(end[i]))
        longer: list[tuple[float, Chain]] = [
            (best[j][0] + saved_by_pair - abs(stamp_s - right[j]), (i, j, best[j][1])) for j in within
        ]
        for j, chain in zip(within, longer, strict=True):
            best[j + 1] = max(best[j + 1], best[j], chain, key=lambda option: option[0])
    matches, link = [], best[-1][1]
    while link is not None:
        i, j, link = link
        matches.append((i, j))
    return matches[::-1]
