"""`pps-vision calibrate`: a stereo camera from images of a board."""

from dataclasses import dataclass
from pathlib import Path

from pps_vision.app.cli.options import print_skipped
from pps_vision.recordings import MAX_SKEW_S, SUMMARY


@dataclass(frozen=True, kw_only=True)
class Calibrate:
    """Calibrate a stereo camera from pairs of images of a chessboard or charuco board.

    Writes calibration.yml (for `track --calib`, in metres), reprojection.png and summary.json.  Show the board in at
    least 10 poses: tilted, near, and in all corners of the images.
    """

    left: tuple[str, ...]
    """Left images: a folder, a pattern in quotes such as 'seq/left*.png', or the files themselves; or a video."""
    right: tuple[str, ...]
    """Right images, paired with the left ones by the last number in their names; or a video, paired by stamp."""
    board: tuple[int, int]
    """Inner corners of the chessboard along its two sides; with --marker-mm the squares of the charuco board."""
    square_mm: float
    """Side of a square; measure it on the print."""
    out: Path
    """Folder to write to."""
    marker_mm: float | None = None
    """Side of the markers of a charuco board; default: a chessboard."""
    dictionary: str = "5X5_100"
    """Dictionary of a charuco board's markers, as OpenCV calls it without DICT_."""
    fps: float | None = None
    """Frames per second of videos without stamps of their own."""
    max_skew_s: float = MAX_SKEW_S
    """Frames of two videos further apart in time are no pair."""

    def run(self) -> None:
        from pps_vision.app.calibrate import WARNED_RMS_PX, Board, board_pairs, calibrate, find_views
        from pps_vision.app.versions import versions
        from pps_vision.recordings.atomic_write import whole_folder, write_json
        from pps_vision.recordings.warnings import Problem

        with whole_folder(self.out) as folder:
            marker_m = None if self.marker_mm is None else self.marker_mm / 1000
            board = Board(*self.board, self.square_mm / 1000, marker_m, self.dictionary)
            problems: list[Problem] = []
            pairs = board_pairs(self.left, self.right, self.fps, self.max_skew_s, problems)
            size, views, skipped = find_views(board, pairs)
            print_skipped([*problems, *skipped])
            result = calibrate(size, views)
            if result.rms_px >= WARNED_RMS_PX:
                reason = f"the RMS reprojection error is {result.rms_px:.1f} px; expected below {WARNED_RMS_PX:g}"
                print_skipped((), [f"{reason}: see reprojection.png for views to leave out"])
            print_skipped((), result.faults())
            result.write(folder / "calibration.yml")
            result.figure().savefig(folder / "reprojection.png", dpi=130)
            write_json(folder / SUMMARY, result.summary() | {"skipped": skipped, "versions": versions()})
        baseline_mm = 1000 * float((result.T @ result.T) ** 0.5)
        focal_lengths = " and ".join(
            f"{K[0, 0]:.1f} ± {std_px:.1f}" for K, std_px in zip(result.K, result.focal_std_px, strict=True)
        )
        print(
            f"{len(views)} of {len(pairs)} pairs; RMS left {result.rms_of(0):.3f}, right {result.rms_of(1):.3f}, "
            f"stereo {result.rms_px:.3f} px; baseline {baseline_mm:.2f} mm, focal lengths {focal_lengths} px "
            f"→ {self.out}"
        )
