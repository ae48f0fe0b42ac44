"""`pps-vision truth`: the true path of a stimulus from a tag on it."""

import sys
from dataclasses import dataclass
from pathlib import Path

from tyro import MISSING

from pps_vision.app.cli.options import RecordingSource, print_skipped

_SIDE_TOLERANCE = 0.05  # relative error of the tag's measured side, above which unit or calibration is wrong


@dataclass(frozen=True)
class Truth(RecordingSource):
    """Write the path of a point that is rigid to an ArUco tag, as TUM's "stamp x y z 0 0 0 1", for `evaluate`.

    The corners of the tag are triangulated from both images of a pair.
    """

    out: Path = MISSING
    """File to write."""
    aruco: int = MISSING
    """Number of the tag."""
    tag_mm: float = MISSING
    """Side of its black square."""
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """From the tag's centre to the point: to the tag's right, to its top, and out of it (0 0 -30 for the
    middle of a ball of 30 mm radius under the tag)."""
    dictionary: str = "4X4_50"
    """Dictionary of the tag, as OpenCV calls it without DICT_."""

    def run(self) -> None:
        import numpy as np

        from pps_vision.app.tag_truth import tag_path
        from pps_vision.recordings.atomic_write import whole_file
        from pps_vision.recordings.exchange import write_tum_rows

        with whole_file(self.out, [self.rec]) as partial:
            recording = self.open()
            offset_m = np.array(self.offset_mm) / 1000
            stamps_s, position, sides_m = tag_path(recording, self.aruco, self.tag_mm / 1000, offset_m, self.dictionary)
            write_tum_rows(partial, stamps_s, position)
        print_skipped(recording.problems, recording.warnings)
        side_mm = 1000 * float(np.median(sides_m))
        if abs(side_mm / self.tag_mm - 1) > _SIDE_TOLERANCE:
            print(f"warning: the tag measures {side_mm:.1f} mm, not {self.tag_mm:g}: wrong unit?", file=sys.stderr)
        print(f"tag {self.aruco} in {len(stamps_s)} of {len(recording)} pairs, {side_mm:.2f} mm → {self.out}")
