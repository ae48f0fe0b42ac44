"""`pps-vision track2d`: track an object in the images of one camera."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from pps_vision.app.cli.options import print_skipped

_FOUND = 0.5  # score from which the object counts as found


@dataclass(frozen=True)
class Track2d:
    """Track an object through the images of a folder or a video, given its box in the first."""

    frames_dir: Positional[Path]
    """Folder of images, taken in the natural order of their names, or a video; the first image is frame 1."""
    init: tuple[float, float, float, float]
    """X Y W H of the object in the first image: top-left corner and size, pixels."""
    out: Path
    """Where to write frame,x,y,w,h,score. The score is the probability that the box still holds the object, whichever
    tracker placed it; 0 where the tracker reports none."""
    tracker: Literal["colour", "csrt"] = "colour"
    """Colour particle filter, or OpenCV's CSRT, for objects that colour does not separate from their surroundings."""
    nano_weights: Path | None = None
    """Folder with your ONNX files of NanoTrack (*backbone*, *head*): follow with it instead."""
    form: Literal["csv", "mot", "coco"] = "csv"
    """What to write: csv as said, or the form of MOTChallenge or COCO."""
    seed: int = 0
    """Seed of the particles."""

    def run(self) -> None:
        """Track through all frames; unreadable frames are reported and skipped."""
        from pps_vision.app.track2d import start_of, track_boxes
        from pps_vision.recordings.atomic_write import whole_file
        from pps_vision.recordings.exchange import SeenBox, open_coco, write_mot
        from pps_vision.recordings.tables import write_boxes
        from pps_vision.recordings.video import open_frames

        with whole_file(self.out, [self.frames_dir]) as partial:
            sequence = open_frames(self.frames_dir)
            start = start_of(self.tracker, self.nano_weights, self.seed)
            rows = track_boxes(sequence, self.init, start)
            boxes = [SeenBox(frame, 1, box, score) for frame, box, score in rows]
            if self.form == "csv":
                write_boxes(partial, rows)
            elif self.form == "mot":
                write_mot(partial, boxes)
            else:
                box_of_frame = {box.frame: box for box in boxes}
                with open_coco(partial, sequence.image_size) as add:
                    for frame, file in enumerate(sequence.files, start=1):
                        add("", frame, file.path, [box_of_frame[frame]] if frame in box_of_frame else [])
        print_skipped(sequence.problems)
        found = sum(score >= _FOUND for _, _, score in rows)
        print(f"found in {found} of {len(rows)} frames (score ≥ {_FOUND:g}) → {self.out}")
