"""`pps-vision learn` and `show`: PPS maps from recordings with touches, and pictures of them."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from learning.memory import PPSMemory, load_memory, save_memory
from pps_vision.app import figures
from pps_vision.app.each_recording import each_recording
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.app.track import Mode, tracker_for
from pps_vision.recordings.joint_table import read_joint_offsets
from pps_vision.recordings.outputs import whole_file
from pps_vision.recordings.recording import Touch
from pps_vision.recordings.taxels_ini import read_taxels, representatives
from pps_vision.recordings.yarp import open_yarp
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import Array, Mask
from tracking.tracker import TrackerParams


@dataclass(frozen=True)
class Learn:
    """Learn PPS maps from recordings of an iCub in which its skin is touched."""

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recording folders REC …, in the order to learn from them."""
    out: Path
    """Where to write the memory (.npz)."""
    into: Path | None = None
    """An earlier memory to go on from; default: an empty one."""
    calib: Path | None = None
    """icubEyes.ini for recordings without their own."""
    taxels: Path | None = None
    """The robot's taxels*.ini, for recordings of its own skin events: it says what virtual taxels they touch."""
    joints: Path | None = None
    """What to add to the encoders, as `pps-vision joints` writes it."""
    mode: Mode = "generic"
    """How the object is tracked."""
    max_skew_s: float = 0.02
    """Left and right images further apart in time are no pair."""
    seed: int = 0
    """Seed of the particles."""

    def run(self) -> None:
        """Learn from each recording in turn; one that cannot be read is reported and does not stop the others."""
        robot, skin = load_icub(), icub_skin()
        memory = load_memory(self.into) if self.into else PPSMemory.empty(skin)
        if memory.taxel_ids != skin.taxel_ids:
            raise ValueError(
                f"{self.into}: knows {len(memory.taxel_ids)} other taxels; expected this robot's {len(skin.taxel_ids)}"
            )
        virtual = representatives(read_taxels(self.taxels)) if self.taxels else None
        offsets = read_joint_offsets(self.joints, robot.joint_names) if self.joints else np.zeros(robot.n_joints)

        def learn_from(folder: Path) -> None:
            nonlocal memory
            memory = self._learn_from(folder, robot, skin, memory, virtual, offsets)

        before = memory
        with whole_file(self.out) as partial:
            used = each_recording("learn", self.recordings, learn_from)
            save_memory(partial, memory)
        if memory is before:
            print("nothing learned: no recording has a touch, with its images, by what was tracked", file=sys.stderr)
        print(f"{used} of {len(self.recordings)} recordings learned → {self.out}")

    def _learn_from(
        self,
        folder: Path,
        robot: Robot,
        skin: Skin,
        memory: PPSMemory,
        virtual: Mapping[str, tuple[int, ...]] | None,
        offsets_rad: Array,
    ) -> PPSMemory:
        """The memory after a recording; what was skipped in it is printed, whatever happens."""
        recording = open_yarp(folder, self.max_skew_s, virtual, offsets_rad)
        tracker = tracker_for(recording, TrackerParams(mode=self.mode), self.seed, Stopwatch(), self.calib)
        pipeline = Pipeline(PipelineParams(), robot, skin, tracker, memory, np.random.default_rng(self.seed))
        try:
            for frame in recording:
                pipeline.step(frame, touched_at(recording.touches, frame.stamp_s, skin))
        finally:
            for problem in recording.problems:
                print(f"skipped: {problem}", file=sys.stderr)
        learned = pipeline.finish()
        gained = int(learned.counts.sum() - memory.counts.sum())
        rejected = ", ".join(f"{n} {what}" for what, n in pipeline.rejected.items() if n)
        print(
            f"{folder}: {gained} samples learned, {len(recording.problems)} problems skipped"
            + (f"; rejected: {rejected}" if rejected else "")
        )
        return learned


def touched_at(touches: tuple[Touch, ...], stamp_s: float, skin: Skin, max_age_s: float = 0.06) -> Mask:
    """(n,) the taxels the skin reported at the latest stamp up to `stamp_s`; none if that is too old.

    Taxels of other skins are ignored.
    """
    stamps = np.array([touch.stamp_s for touch in touches])
    latest = int(np.searchsorted(stamps, stamp_s + 1e-6)) - 1
    if latest < 0 or stamp_s - stamps[latest] > max_age_s:
        return np.zeros(len(skin.taxel_ids), dtype=bool)
    return np.isin(skin.taxel_ids, touches[latest].taxel_ids)


@dataclass(frozen=True)
class Show:
    """Draw the landscapes a memory holds: probability of touch over distance and time to contact."""

    memory: tyro.conf.Positional[Path]
    """The memory (.npz)."""
    out: Path
    """The figure to write (.png, .svg or .pdf)."""

    def run(self) -> None:
        """Draw every taxel that has ever been stimulated; all of them if none has."""
        memory = load_memory(self.memory)
        stimulated = [i for i in range(len(memory.taxel_ids)) if memory.counts[i].any()]
        figure = figures.landscapes(memory, stimulated or None)
        with whole_file(self.out) as partial:
            figures.save(figure, partial)
        print(f"{len(stimulated)} of {len(memory.taxel_ids)} taxels were stimulated → {self.out}")
