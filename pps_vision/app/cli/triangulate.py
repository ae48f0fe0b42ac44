"""`pps-vision triangulate`: image points of any detector to 3D paths with their covariance."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from tyro import MISSING
from tyro.conf import Positional

from pps_vision.app.cli.options import command_line, print_skipped
from pps_vision.errors import InputError
from pps_vision.recordings import MAX_SKEW_S, SUMMARY, CalibrationOptions, Clock, Form, TimeUnit
from tracking import DEFAULT_ORDER


@dataclass(frozen=True)
class Triangulate(CalibrationOptions):
    """Triangulate and filter points that another detector has found in the images of two fixed cameras.

    LEFT and RIGHT are tables of DeepLabCut or Lightning Pose (csv), SLEAP (analysis h5 with the extra `tables`, csv),
    COCO (json), MOTChallenge, or a csv with stamp_s, name, u_px, v_px and perhaps likelihood or covariance.  The noise
    of the points is judged by how well both images agree; outliers are left out.
    """

    left: Positional[Path]
    """Table of the left camera; pixels as recorded, the centre of the first one is (0, 0)."""
    right: Positional[Path]
    """Table of the right camera."""
    calib: tuple[Path, ...] = MISSING
    """Calibration, as of `track`."""
    out: Path = MISSING
    """Folder for detections.csv, trajectory.csv, summary.json, and optional files."""
    size: tuple[int, int] | None = None
    """WIDTH HEIGHT of the images, where the calibration does not state it or is for another size."""
    fps: float | None = None
    """Frames per second, for tables of frames."""
    times: tuple[Path, ...] = ()
    """Stamps of the frames from 0 on, a row each, in one file or in one for each camera."""
    times_unit: TimeUnit | None = None
    """Unit of the stamps, where neither a header nor their rate says it."""
    max_skew_s: float = MAX_SKEW_S
    """Points further apart in time are no pair."""
    points: tuple[str, ...] = ()
    """Names of the points to use; default: all that both tables have.  The first is the attended one."""
    clock: Clock = "stamps"
    """auto: estimate the delay and the drift of the right camera's stamps, and correct them."""
    order: int = DEFAULT_ORDER
    """Order of the Kalman filter, 1–4: position, velocity, acceleration, jerk."""
    smooth: bool = False
    """Smooth the paths with later measurements (RTS smoothing)."""
    also: tuple[Form, ...] = ()
    """Also write the forms of other tools: tum (evo), anipose (movement), ros2 (a bag; extra `ros`)."""
    report: bool = False
    """Also write report.html."""

    def run(self) -> None:
        from pps_vision.app.report.tracking import write_report
        from pps_vision.app.triangulate import triangulate
        from pps_vision.app.versions import versions
        from pps_vision.recordings.atomic_write import whole_folder, write_json
        from pps_vision.recordings.exchange import open_forms
        from pps_vision.recordings.tables import DETECTIONS, TRAJECTORY, detection_row, open_table, trajectory_row

        if boxes := [form for form in self.also if form in ("mot", "coco")]:
            raise InputError("triangulate", f"--also {boxes[0]}: points have no boxes; expected tum, anipose or ros2")
        options: Any = {field.name: getattr(self, field.name) for field in fields(CalibrationOptions)}
        options |= {
            name: getattr(self, name)
            for name in ("size", "fps", "times", "times_unit", "max_skew_s", "points", "clock")
        }
        with whole_folder(self.out) as folder:
            run = triangulate(self.left, self.right, calib=self.calib, order=self.order, **options)
            with (
                open_table(folder / "detections.csv", DETECTIONS) as add_detection,
                open_table(folder / "trajectory.csv", (*TRAJECTORY, "name")) as add_track,
                open_forms(folder, self.also, self.size or (0, 0), run.names) as add_forms,
            ):
                for number, pair in enumerate(run.pairs(self.smooth)):
                    for item, name in zip(pair.objects, run.names, strict=True):
                        add_track((*trajectory_row(item.track), name))
                        for detection in item.detections:
                            add_detection(detection_row(number, detection, item.track))
                    add_forms(pair)
            content = run.summary()
            content["smoothed"] = self.smooth
            content["versions"] = versions()
            content["command"] = command_line("triangulate", self)
            write_json(folder / SUMMARY, content)
            if self.report:
                write_report(folder)
        print_skipped(run.problems, run.warnings)
        if run.clock is not None:
            print(f"right camera's clock: {run.clock}")
        tracked, outliers = (sum(item[key] for item in run.numbers) for key in ("tracking", "outliers"))
        std = ", ".join(f"{value:.2g}" for value in run.noise.std)
        print(
            f"{tracked} points in {len(run.stamps_s)} pairs, {outliers} outliers, noise {std} px (σ), "
            f"{1000 * run.stopwatch.ms['total'][0]:.0f} µs a pair → {self.out}"
        )
