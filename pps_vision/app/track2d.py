"""Track a coloured object in the images of one camera."""

import numpy as np
from tqdm import tqdm

from pps_vision.errors import InputError
from pps_vision.recordings.image_sequence import ImageSequence
from pps_vision.recordings.tables import Box
from tracking.image_tracker import BoxTracker, ImageTrackerParams


def follow(sequence: ImageSequence, init: Box, seed: int) -> list[tuple[int, Box, float]]:
    """Frame number, box and score of every readable frame; `init` is the box in the first."""
    tracker = BoxTracker(ImageTrackerParams(), np.random.default_rng(seed))
    rows: list[tuple[int, Box, float]] = []
    for number, image in tqdm(sequence, total=len(sequence), desc="track2d", unit="frame", disable=None):
        if rows:
            found = tracker.step(image)
        elif sequence.problems:
            raise InputError("track2d", f"--init is the box in that image: {sequence.problems[0]}")
        else:
            found = tracker.start(image, init)
        rows.append((number, found.box_px, found.score))
    return rows
