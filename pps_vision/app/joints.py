"""`pps-vision joints`: by how much an iCub's encoders are off, from recordings in which its skin is touched."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from learning.joint_offsets import JointOffsetParams, joint_offsets
from learning.touch_trial import TouchTrial
from pps_vision.app.each_recording import each_recording
from pps_vision.app.learn import touched_at
from pps_vision.app.pipeline import joints_of
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.app.track import Mode, tracker_for
from pps_vision.recordings.joint_table import write_joint_offsets
from pps_vision.recordings.outputs import whole_file
from pps_vision.recordings.taxels_ini import read_taxels, representatives
from pps_vision.recordings.yarp import open_yarp
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import Mask, StereoFrame, Track3D
from tracking.tracker import TrackerParams


@dataclass(frozen=True)
class Joints:
    """Learn by how much an iCub's encoders are off: what touches its skin must be where it is felt.

    Encoders of neck, eyes and arms; the table is for --joints of track and learn.  A dozen touches in several postures
    tell most of it.
    """

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recording folders REC …."""
    out: Path
    """Where to write the table of offsets (.csv: joint,offset_deg), to be added to what the encoders say."""
    calib: Path | None = None
    """icubEyes.ini for recordings without their own."""
    taxels: Path | None = None
    """The robot's taxels*.ini, for recordings of its own skin events: it says what virtual taxels they touch."""
    mode: Mode = "generic"
    """How the object is tracked."""
    max_skew_s: float = 0.02
    """Left and right images further apart in time are no pair."""
    seed: int = 0
    """Seed of the particles."""

    def run(self) -> None:
        """Learn from the touches of all recordings; one that cannot be read does not stop the others."""
        robot, skin = load_icub(), icub_skin()
        virtual = representatives(read_taxels(self.taxels)) if self.taxels else None
        touches: list[TouchTrial] = []
        each_recording("joints", self.recordings, lambda folder: touches.extend(self._touches(folder, skin, virtual)))
        learned = joint_offsets(JointOffsetParams(), robot, icub_rig(robot), skin, touches)
        if not len(learned.before_m):
            raise ValueError(f"joints: no touch by what was tracked in {', '.join(map(str, self.recordings))}")
        with whole_file(self.out) as partial:
            write_joint_offsets(partial, robot.joint_names, learned.offsets_rad)
        before, after = (1000 * float(np.median(missed)) for missed in (learned.before_m, learned.after_m))
        print(
            f"{len(learned.before_m)} touches seen {before:.0f} mm beside where they were felt, with these offsets "
            f"{after:.0f} → {self.out}"
        )

    def _touches(self, folder: Path, skin: Skin, virtual: Mapping[str, tuple[int, ...]] | None) -> list[TouchTrial]:
        """Of each contact in a recording the first moment at which what touches is tracked."""
        recording = open_yarp(folder, self.max_skew_s, virtual)
        tracker = tracker_for(recording, TrackerParams(mode=self.mode), self.seed, Stopwatch(), self.calib)
        touches, told = [], False
        try:
            for frame in recording:
                track, touched = tracker.step(frame).track, touched_at(recording.touches, frame.stamp_s, skin)
                if touched.any() and not told and track.is_known:
                    touches.append(_touch(frame, track, touched))
                told = bool(touched.any()) and (told or track.is_known)
        finally:
            for problem in recording.problems:
                print(f"skipped: {problem}", file=sys.stderr)
        return touches


def _touch(frame: StereoFrame, track: Track3D, touched: Mask) -> TouchTrial:
    """One moment of a contact."""
    return TouchTrial(
        np.array([frame.stamp_s]),
        joints_of(frame)[None],
        track.position[None],
        track.velocity[None],
        track.cov[None, 3:6, 3:6],
        np.array([track.radius_m]),
        touched,
        "",
    )
