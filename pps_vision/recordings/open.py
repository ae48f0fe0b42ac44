"""Open a recording, however it is stored: `pps_vision.open_recording`."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.images import open_stereo_images
from pps_vision.recordings.opencv_calibration import read_stereo_calibration
from pps_vision.recordings.recording import Recording
from pps_vision.recordings.tables import read_joint_offsets
from pps_vision.recordings.taxels_ini import read_taxels, representatives
from pps_vision.recordings.yarp import open_yarp
from pps_vision.robot.icub import load_icub


def open_recording(
    folder: Path | str | None = None,
    *,
    left: Sequence[str] = (),
    right: Sequence[str] = (),
    calib: Sequence[Path | str] = (),
    fps: float = 30.0,
    unit_m: float = 1.0,
    joints: Path | str | None = None,
    taxels: Path | str | None = None,
    max_skew_s: float = 0.02,
) -> Recording:
    """Open the recording of an iCub, or any stereo images with a calibration.

    Iterating the recording decodes its frames one at a time; it also holds `rig`, `robot`, `touches`, `truth` and
    `problems` (what was skipped, and why).

    Args:
        folder: Folder of an iCub's recording in yarpdatadumper layout, as `render` writes it.
        left: Instead of `folder`: left images, as file names or patterns such as "seq/left*.png".
        right: Right images, paired with the left ones by the last number in their names.
        calib: OpenCV calibration of `left` and `right`; with `folder` an icubEyes.ini instead of its own.
        fps: Frames per second of `left` and `right`.
        unit_m: Metres per length unit of the OpenCV calibration.
        joints: Offsets to add to the encoders, as `pps-vision joints` writes them.
        taxels: The robot's taxels*.ini, for a recording of its own skin events.
        max_skew_s: Left and right images further apart in time are no pair.

    Raises:
        InputError: Nothing usable is there; names the file, the line and what was expected.
    """
    calibration = tuple(map(Path, calib))
    if (folder is None) == (not left and not right):
        raise InputError("recording", "expected either a folder REC, or left and right images with calib")
    if folder is not None:
        if len(calibration) > 1:
            raise InputError("recording", f"calib has {len(calibration)} files; expected one icubEyes.ini with REC")
        names = load_icub().joint_names
        offsets = read_joint_offsets(Path(joints), names) if joints else np.zeros(len(names))
        virtual = representatives(read_taxels(Path(taxels))) if taxels else None
        return open_yarp(Path(folder), max_skew_s, virtual, offsets, *calibration)
    if joints:
        raise InputError("recording", f"joints {joints} with left and right images; expected it with a folder REC")
    if not (left and right and calibration):
        raise InputError("recording", "left, right and calib go together; one is missing")
    recording = open_stereo_images(left, right, fps)
    cameras = read_stereo_calibration(calibration, recording.image_size, unit_m)
    return replace(recording, rig=StereoRig.fixed(*cameras))
