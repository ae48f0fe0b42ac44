"""Track an object in the images of one camera."""

from collections.abc import Callable

import numpy as np

from pps_vision.app.progress import progress
from pps_vision.errors import InputError
from pps_vision.recordings.image_sequence import ImageSequence
from pps_vision.recordings.tables import Box
from tracking.box_tracker import ALIKE, Appearance, BoxTracker
from tracking.image_tracker import ImageTrackerParams


def follow(
    sequence: ImageSequence, init: Box, seed: int, appearance: Appearance | None, report: Callable[[str], None]
) -> list[tuple[int, Box, float]]:
    """Frame number, box and score of every readable frame; `init` is the box in the first.

    What the object is followed by (None: the cheapest that tells it apart) is reported at the first frame, with a
    warning where object and surroundings look alike.
    """
    tracker = BoxTracker(ImageTrackerParams(), np.random.default_rng(seed), appearance)
    rows: list[tuple[int, Box, float]] = []
    for number, image in progress(sequence, total=len(sequence), desc="track2d", unit="frame"):
        if rows:
            found = tracker.step(image)
        elif sequence.problems:
            raise InputError("track2d", f"--init is the box in that image: {sequence.problems[0]}")
        else:
            found = tracker.start(image, init)
            report(_summary(tracker))
        rows.append((number, found.box_px, found.score))
    return rows


def _summary(tracker: BoxTracker) -> str:
    by = "its colours" if tracker.appearance == "colour" else "a spatial template and its colours"
    text = f"the object is followed by {by} (similarity to its surroundings' colours {tracker.similarity:.2f})"
    if tracker.similarity < ALIKE:
        return text
    return f"warning: object and surroundings look alike, so it may be lost; {text}"
