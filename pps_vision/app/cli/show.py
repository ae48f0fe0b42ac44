"""`pps-vision show`: draw a memory."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from pps_vision.app.cli.options import RobotOptions


@dataclass(frozen=True)
class Show(RobotOptions):
    """Draw the landscapes of a memory: probability of touch over distance and time to contact.

    With --robot or --skin the memory must be of that skin.
    """

    memory: Positional[Path]
    """The memory (.npz)."""
    out: Path
    """The figure to write (.png, .svg or .pdf)."""

    def run(self) -> None:
        """Draw every stimulated taxel; all taxels if there is none."""
        from learning.pps.memory import load_memory
        from pps_vision.app.pipeline import check_memory
        from pps_vision.app.report import figures
        from pps_vision.app.report.page import save
        from pps_vision.recordings.atomic_write import whole_file

        with whole_file(self.out, [self.memory, *self.files]) as partial:
            memory = load_memory(self.memory)
            if any(self.files):
                check_memory(memory, self.setup().skin, self.memory)
            stimulated = [i for i in range(len(memory.taxel_ids)) if memory.counts[i].any()]
            save(figures.landscapes(memory, stimulated or None), partial)
        print(f"{len(stimulated)} of {len(memory.taxel_ids)} taxels were stimulated → {self.out}")
