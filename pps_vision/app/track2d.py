"""`pps-vision track2d`: follow a coloured object in one view."""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from tqdm import tqdm

from pps_vision.recordings.images import ImageSequence, open_frames
from pps_vision.recordings.outputs import whole_file
from pps_vision.recordings.results import Box, write_boxes
from tracking.single import ColorTracker, ColorTrackerParams


@dataclass(frozen=True)
class Track2d:
    """Follow a coloured object through the images of a folder, given its box in the first."""

    frames_dir: tyro.conf.Positional[Path]
    """Folder of images, taken in the natural order of their names; the first is frame 1."""
    init: tuple[float, float, float, float]
    """X Y W H of the object in the first image: top-left corner and size, pixels."""
    out: Path
    """Where to write frame,x,y,w,h,score."""
    seed: int = 0
    """Seed of the particles."""

    def run(self) -> None:
        """Track through all frames; what could not be read is reported and left out."""
        sequence = open_frames(self.frames_dir)
        with whole_file(self.out) as partial:
            rows = follow(sequence, self.init, self.seed)
            write_boxes(partial, rows)
        for problem in sequence.problems:
            print(f"skipped: {problem}", file=sys.stderr)
        found = sum(score > 0 for _, _, score in rows)
        print(f"seen in {found} of {len(rows)} frames → {self.out}")


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
