"""`pps-vision learn` and `show`: PPS maps from recordings with touches, and pictures of them."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from tqdm import tqdm

from learning.memory import PPSMemory, load_memory, save_memory
from pps_vision.app import figures
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.recordings.calibration import read_icub_eyes
from pps_vision.recordings.outputs import whole_file
from pps_vision.recordings.problems import BadInput
from pps_vision.recordings.recording import Recording, Touch
from pps_vision.recordings.yarp import open_yarp
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.silhouette import Silhouette
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import Mask
from tracking.tracker import Tracker, TrackerParams


@dataclass(frozen=True)
class Learn:
    """Learn PPS maps from recordings of an iCub in which its skin is touched."""

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recording folders REC …, in the order to learn from them."""
    out: Path
    """Where to write the memory (.npz)."""
    into: Path | None = None
    """An earlier memory to go on from; default: an empty one."""
    mode: Literal["generic", "marker"] = "generic"
    """How the object is tracked."""
    seed: int = 0
    """Seed of the particles."""

    def run(self) -> None:
        """Learn from each recording in turn; one that cannot be read is reported and does not stop the others."""
        if not self.recordings:
            raise ValueError("learn: no recording given; expected one folder or more")
        robot, skin = load_icub(), icub_skin()
        memory = load_memory(self.into) if self.into else PPSMemory.empty(skin)
        if memory.taxel_ids != skin.taxel_ids:
            raise ValueError(
                f"{self.into}: knows {len(memory.taxel_ids)} other taxels; expected this robot's {len(skin.taxel_ids)}"
            )
        failed = 0
        with whole_file(self.out) as partial:
            for folder in tqdm(self.recordings, desc="learn", unit="recording", disable=None):
                try:
                    memory, contacts = learn_recording(open_yarp(folder), robot, skin, memory, self.mode, self.seed)
                except BadInput as error:
                    failed += 1
                    print(f"skipped: {error}", file=sys.stderr)
                else:
                    print(f"{folder}: {contacts} contacts, {int(memory.counts.sum())} samples so far")
            if failed == len(self.recordings):
                raise ValueError(f"learn: none of the {failed} recordings could be read")
            save_memory(partial, memory)
        print(f"→ {self.out}")


def learn_recording(
    recording: Recording, robot: Robot, skin: Skin, memory: PPSMemory, mode: Literal["generic", "marker"], seed: int
) -> tuple[PPSMemory, int]:
    """The memory after a recording, and how many contacts it held; problems are printed."""
    if recording.calibration is None:
        raise BadInput(recording.name, "holds no icubEyes.ini; expected the calibration of its eyes")
    rig = icub_rig(robot, *read_icub_eyes(recording.calibration, recording.image_size))
    tracker = Tracker(TrackerParams(mode=mode), rig, np.random.default_rng(seed), own_body=Silhouette(robot))
    pipeline = Pipeline(PipelineParams(), robot, skin, tracker, memory, np.random.default_rng(seed))
    contacts, touching = 0, False
    for frame in recording:
        touched = touched_at(recording.touches, frame.stamp_s, skin)
        contacts += bool(touched.any()) and not touching
        touching = bool(touched.any())
        pipeline.step(frame, touched)
    for problem in recording.problems:
        print(f"skipped: {problem}", file=sys.stderr)
    return pipeline.finish(), contacts


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
