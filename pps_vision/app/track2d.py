"""Track an object in the images of one camera."""

from collections.abc import Callable

import numpy as np

from pps_vision.app.progress import progress
from pps_vision.errors import InputError
from pps_vision.recordings.tables import Box
from pps_vision.recordings.video import ImageSequence
from tracking.particle_filter import ParticleFilterParams
from tracking.track2d import MAX_SIMILARITY, BoxTracker, ColorTracker, CsrtTracker, TrackerName


def track_boxes(
    sequence: ImageSequence, init: Box, name: TrackerName, seed: int, report: Callable[[str], None]
) -> list[tuple[int, Box, float]]:
    """Frame number, box and score of every readable frame; `init` is the box in the first.

    `report` is called with a warning if the object's colours do not separate it from its surroundings.
    """
    tracker: BoxTracker | None = None
    rows: list[tuple[int, Box, float]] = []
    for number, image in progress(sequence, total=len(sequence), desc="track2d", unit="frame"):
        if tracker is not None:
            rows.append((number, *tracker.step(image)))
            continue
        if sequence.problems:
            raise InputError("track2d", f"--init is the box in that image: {sequence.problems[0]}")
        rows.append((number, init, 1.0))
        if name == "csrt":
            tracker = CsrtTracker(image, init)
            continue
        tracker = ColorTracker(image, init, ParticleFilterParams(), np.random.default_rng(seed))
        if tracker.similarity > MAX_SIMILARITY:
            report(
                f"warning: the object's colours and those of its surroundings are alike (similarity "
                f"{tracker.similarity:.2f} > {MAX_SIMILARITY:g}), so it may be lost; try --tracker csrt"
            )
    return rows
