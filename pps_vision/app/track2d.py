"""Track an object in the images of one camera."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pps_vision.app.progress import progress
from pps_vision.errors import InputError
from pps_vision.recordings.tables import Box
from pps_vision.recordings.video import ImageSequence
from pps_vision.types import Image
from tracking.particle_filter import ParticleFilterParams
from tracking.track2d import MAX_SIMILARITY, BoxTracker, ColorTracker, ScoredTracker, csrt_tracker, nano_tracker

Start = Callable[[Image, Box], BoxTracker]  # starts a tracker of the object in a box of the first image


def start_of(name: str, nano_weights: Path | None, seed: int) -> Start:
    """Return the start of a tracker: `colour`, `csrt`, or NanoTrack with weights.

    A warning is printed if the object's colours do not separate it from its surroundings.
    """
    if nano_weights is not None:
        weights = nano_weights
        return lambda image, box: nano_tracker(image, box, weights)
    if name == "csrt":
        return csrt_tracker

    def by_color(image: Image, box: Box) -> BoxTracker:
        tracker = ColorTracker(image, box, ParticleFilterParams(), np.random.default_rng(seed))
        if tracker.similarity > MAX_SIMILARITY:
            similarity = f"similarity {tracker.similarity:.2f} > {MAX_SIMILARITY:g}"
            alike = f"the object's colours and those of its surroundings are alike ({similarity})"
            print(f"warning: {alike}, so it may be lost; try --tracker csrt", file=sys.stderr)
        return tracker

    return by_color


def track_boxes(sequence: ImageSequence, init: Box, start: Start) -> list[tuple[int, Box, float]]:
    """Frame number, box and score of every readable frame; `init` is the box in the first."""
    tracker: ScoredTracker | None = None
    rows: list[tuple[int, Box, float]] = []
    for number, image in progress(sequence, total=len(sequence), desc="track2d", unit="frame"):
        if tracker is not None:
            rows.append((number, *tracker.step(image)))
            continue
        if sequence.problems:
            raise InputError("track2d", f"--init is the box in that image: {sequence.problems[0]}")
        rows.append((number, init, 1.0))
        tracker = ScoredTracker(start(image, init), image, init)
    return rows
