"""`pps-vision learn`: PPS maps from recordings with touches."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from tracking.names import Mode

if TYPE_CHECKING:
    from learning.pps.memory import PPSMemory


@dataclass(frozen=True)
class Learn:
    """Learn PPS maps from recordings of an iCub in which its skin is touched."""

    recordings: Positional[tuple[Path, ...]]
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
        from learning.pps.memory import PPSMemory, load_memory, save_memory
        from pps_vision.app.each_recording import each_recording
        from pps_vision.recordings.outputs import whole_file
        from pps_vision.robot.skin import icub_skin

        skin = icub_skin()
        memory = load_memory(self.into) if self.into else PPSMemory.empty(skin)
        if memory.taxel_ids != skin.taxel_ids:
            raise ValueError(
                f"{self.into}: knows {len(memory.taxel_ids)} other taxels; expected this robot's {len(skin.taxel_ids)}"
            )

        def learn_from(folder: Path) -> None:
            nonlocal memory
            memory = self._learn_from(folder, memory)

        before = memory
        with whole_file(self.out) as partial:
            used = each_recording("learn", self.recordings, learn_from)
            save_memory(partial, memory)
        if memory is before:
            print("nothing learned: no recording has a touch, with its images, by what was tracked", file=sys.stderr)
        print(f"{used} of {len(self.recordings)} recordings learned → {self.out}")

    def _learn_from(self, folder: Path, memory: "PPSMemory") -> "PPSMemory":
        """The memory after a recording; what was skipped in it is printed, whatever happens."""
        from pps_vision.app.learn import learn_from
        from pps_vision.app.open_recording import open_recording

        recording = open_recording(
            folder,
            calib=[self.calib] if self.calib else (),
            joints=self.joints,
            taxels=self.taxels,
            max_skew_s=self.max_skew_s,
        )
        try:
            learned = learn_from(recording, memory, self.mode, self.seed)
        finally:
            for problem in recording.problems:
                print(f"skipped: {problem}", file=sys.stderr)
        rejected = ", ".join(f"{n} {what}" for what, n in learned.rejected.items() if n)
        print(
            f"{folder}: {learned.samples} samples learned, {len(recording.problems)} problems skipped"
            + (f"; rejected: {rejected}" if rejected else "")
        )
        return learned.memory
