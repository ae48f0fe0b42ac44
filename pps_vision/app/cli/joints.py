"""`pps-vision joints`: by how much an iCub's encoders are off, from recordings in which its skin is touched."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from tracking.names import Mode

if TYPE_CHECKING:
    from learning.pps.touch_trial import TouchTrial
    from pps_vision.robot.skin import Skin


@dataclass(frozen=True)
class Joints:
    """Learn by how much an iCub's encoders are off: what touches its skin must be where it is felt.

    Encoders of neck, eyes and arms; the table is for --joints of track and learn.  A dozen touches in several postures
    tell most of it.
    """

    recordings: Positional[tuple[Path, ...]]
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
        import numpy as np

        from learning.pps.joint_offsets import JointOffsetParams, joint_offsets
        from pps_vision.app.each_recording import each_recording
        from pps_vision.recordings.outputs import whole_file
        from pps_vision.recordings.tables import write_joint_offsets
        from pps_vision.robot.icub import icub_rig, load_icub
        from pps_vision.robot.skin import icub_skin

        robot, skin = load_icub(), icub_skin()
        touches: list[TouchTrial] = []
        each_recording("joints", self.recordings, lambda folder: touches.extend(self._touches(folder, skin)))
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

    def _touches(self, folder: Path, skin: "Skin") -> "list[TouchTrial]":
        """The touches of a recording; what was skipped in it is printed, whatever happens."""
        from pps_vision.app.joints import touches_seen
        from pps_vision.app.open_recording import open_recording

        calib = [self.calib] if self.calib else ()
        recording = open_recording(folder, calib=calib, taxels=self.taxels, max_skew_s=self.max_skew_s)
        try:
            return touches_seen(recording, skin, self.mode, self.seed)
        finally:
            for problem in recording.problems:
                print(f"skipped: {problem}", file=sys.stderr)
