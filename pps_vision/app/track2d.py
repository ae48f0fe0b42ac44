"""Follow a coloured object in one view."""

import numpy as np
from tqdm import tqdm

from pps_vision.recordings.images import ImageSequence
from pps_vision.recordings.tables import Box
from tracking.single import ColorTracker, ColorTrackerParams


def follow(sequence: ImageSequence, init: Box, seed: int) -> list[tuple[int, Box, float]]:
    """(frame, box, score) of every readable frame; `init` is the box in the first."""
    tracker = ColorTracker(ColorTrackerParams(), np.random.default_rng(seed))
    rows: list[tuple[int, Box, float]] = []
    for frame, image in tqdm(sequence, total=len(sequence), desc="track2d", unit="frame", disable=None):
        if not rows and sequence.problems:
            raise ValueError(f"{sequence.problems[0]}; --init is the box in that image")
        seen = tracker.step(image) if rows else tracker.start(image, init)
        rows.append((frame, seen.box_px, seen.score))
    return rows
