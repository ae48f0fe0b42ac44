"""What several commands share: options of recordings of a robot, and how problems are reported."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from pps_vision.errors import InputError
from tracking.names import Mode

if TYPE_CHECKING:
    from pps_vision.recordings.recording import Recording


@dataclass(frozen=True)
class RecordingOptions:
    """Recordings of an iCub in which its skin is touched, and how they are read and tracked."""

    recordings: Positional[tuple[Path, ...]]
    """Recording folders REC …, used in this order."""
    out: Path
    """File to write."""
    calib: Path | None = None
    """icubEyes.ini for recordings without their own."""
    taxels: Path | None = None
    """The robot's taxels*.ini, for recordings of its own skin events: which virtual taxel each physical one is of."""
    mode: Mode = "generic"
    """How the object is tracked: generic (whatever moves) or marker (a green marker)."""
    max_skew_s: float = 0.02
    """Largest difference of the stamps of a pair of left and right image."""
    seed: int = 0
    """Seed of the particle filter."""

    def use_each(self, command: str, use: "Callable[[Recording], None]", joints: Path | None = None) -> int:
        """Open and use every recording, and print what was skipped; returns the number of usable ones.

        Raises:
            InputError: There is no recording, or none can be used.
        """
        from tqdm import tqdm

        from pps_vision.recordings.open import open_recording

        if not self.recordings:
            raise InputError(command, "no recording given; expected one folder or more")
        failed: list[InputError] = []
        for folder in tqdm(self.recordings, desc=command, unit="recording", disable=None):
            try:
                recording = open_recording(
                    folder,
                    calib=[self.calib] if self.calib else (),
                    joints=joints,
                    taxels=self.taxels,
                    max_skew_s=self.max_skew_s,
                )
                try:
                    use(recording)
                finally:
                    print_skipped(recording.problems)
            except InputError as error:
                failed.append(error)
                if len(self.recordings) > 1:
                    print_skipped([error])
        n = len(self.recordings)
        if len(failed) == n:
            raise failed[-1] if n == 1 else InputError(command, f"none of {n} recordings is usable")
        return n - len(failed)


def print_skipped(problems: Sequence[object]) -> None:
    """Print what was skipped on the error stream."""
    for problem in problems:
        print(f"skipped: {problem}", file=sys.stderr)


@contextmanager
def options_of(command: str) -> Iterator[None]:
    """Turn the ValueError of parameters made from options into an InputError of the command."""
    try:
        yield
    except InputError:
        raise
    except ValueError as error:
        raise InputError(command, str(error)) from error
