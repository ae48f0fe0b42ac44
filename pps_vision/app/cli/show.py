"""`pps-vision show`: a figure of a memory."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional


@dataclass(frozen=True)
class Show:
    """Draw the landscapes a memory holds: probability of touch over distance and time to contact."""

    memory: Positional[Path]
    """The memory (.npz)."""
    out: Path
    """The figure to write (.png, .svg or .pdf)."""

    def run(self) -> None:
        """Draw every taxel that has ever been stimulated; all of them if none has."""
        from learning.pps.memory import load_memory
        from pps_vision.app.report import figures
        from pps_vision.recordings.outputs import whole_file

        with whole_file(self.out, [self.memory]) as partial:
            memory = load_memory(self.memory)
            stimulated = [i for i in range(len(memory.taxel_ids)) if memory.counts[i].any()]
            figures.save(figures.landscapes(memory, stimulated or None), partial)
        print(f"{len(stimulated)} of {len(memory.taxel_ids)} taxels were stimulated → {self.out}")
