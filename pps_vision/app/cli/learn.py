"""`pps-vision learn`: PPS maps from recordings with touches."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pps_vision.app.cli.options import RecordingOptions, RobotOptions

if TYPE_CHECKING:
    from learning.pps.joint_offsets import TouchTrial
    from pps_vision.recordings.recording import Recording


@dataclass(frozen=True)
class Learn(RobotOptions, RecordingOptions):
    """Learn PPS maps from recordings of a robot in which its skin is touched, and write the memory (.npz).

    Where the touches clearly show that encoders or taxels are off, it learns again with them corrected; the correction
    is in the memory, and `track --memory` applies it.  Touches that a hand feels more than 8 cm from it are those of a
    tool it holds: where two agree, the memory has a place of the tool, which learns and moves as the hand's taxels do.
    """

    into: Path | None = None
    """An earlier memory to continue from; default: an empty one."""
    r_map: bool = False
    """Learn R's map of distance and time to contact, in place of the probability that depends on the path too."""
    joints: Path | None = None
    """Offsets to add to the encoders, as `pps-vision joints` writes them."""
    keep_body: bool = False
    """Take encoders and taxels as they are, and no tool."""

    def run(self) -> None:
        from learning.pps.memory import MemoryParams, PPSMemory, load_memory, save_memory
        from pps_vision.app.learn import learn_again, learn_from
        from pps_vision.app.pipeline import check_memory
        from pps_vision.recordings.atomic_write import whole_file

        setup = self.setup()
        memory = PPSMemory.empty(setup.skin, MemoryParams() if self.r_map else None)
        used: list[tuple[Recording, list[TouchTrial]]] = []

        def use(recording: "Recording") -> None:
            nonlocal memory
            learned = learn_from(recording, memory, self.mode, self.seed, setup)
            memory = learned.memory
            used.append((recording, learned.touches))
            rejected = ", ".join(f"{n} {reason}" for reason, n in learned.rejected.items() if n)
            print(
                f"{recording.name}: {learned.samples} samples learned, {recording.skipped} problems skipped"
                + (f"; rejected: {rejected}" if rejected else "")
            )

        with whole_file(self.out, (*self.inputs, *self.files, self.into, self.joints)) as partial:
            if self.into:
                memory = load_memory(self.into)
                check_memory(memory, setup.skin, self.into, setup.robot)
            initial_memory = memory
            n_used = self.use_each("learn", use, self.joints, setup)
            if not self.keep_body:
                memory, body = learn_again(initial_memory, memory, used, self.mode, self.seed, setup)
                print(body)
                if len(places := memory.places):
                    print(f"tool: {len(places)} places beyond the skin, from {places[:, 6].sum():.0f} touches")
            save_memory(partial, memory)
        if memory is initial_memory:
            print("nothing learned: no recording has a touch by a tracked object", file=sys.stderr)
        print(f"{n_used} of {len(self.recordings)} recordings learned → {self.out}")
