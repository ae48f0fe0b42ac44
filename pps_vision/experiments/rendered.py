"""Rendered recordings with their truth, for experiments that run many variants on the same frames."""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from pps_vision.app.render import Render
from pps_vision.errors import InputError
from pps_vision.experiments.peers import BoxPx, sphere_box
from pps_vision.experiments.scene_sources import eyes_of, own_body_of
from pps_vision.experiments.study import SceneSource
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.yarp import open_yarp
from pps_vision.robot.model import Robot
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import StereoFrame, Truth


@dataclass(frozen=True)
class Rendered:
    """A recording held in memory: `frames` (n) with their `truth` (n), the robot and its eyes, the true
    boxes (n) around the object in the left and the right image, None where it is not seen, and where the robot sees
    itself."""

    frames: tuple[StereoFrame, ...]
    truth: tuple[Truth, ...]
    robot: Robot
    rig: StereoRig
    boxes: tuple[tuple[BoxPx | None, BoxPx | None], ...]
    own_body: Silhouette


def rendered(what: Render, source: SceneSource = "rendered") -> Rendered:
    """What `pps-vision render` would have written, or the same by ray casting; `what.out` is not used."""
    with TemporaryDirectory() as place:
        folder = Path(place) / "recording"
        Render(**{**vars(what), "out": folder}).record(eyes_of(source, what.seed))
        recording = open_yarp(folder)
        robot, rig = recording.robot, recording.rig
        if robot is None or rig is None:
            raise InputError(folder, "holds no icubEyes.ini; expected the one that was written with it")
        frames = tuple(recording)
    boxes = tuple(_boxes(rig, frame, row) for frame, row in zip(frames, recording.truth, strict=True))
    return Rendered(frames, recording.truth, robot, rig, boxes, own_body_of(source, robot))


def _boxes(rig: StereoRig, frame: StereoFrame, row: Truth) -> tuple[BoxPx | None, BoxPx | None]:
    view = rig.view_of(frame)
    return (
        sphere_box(view.left, row.position, row.radius_m) if row.visible_left else None,
        sphere_box(view.right, row.position, row.radius_m) if row.visible_right else None,
    )
