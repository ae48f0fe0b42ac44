"""Read input files: only regular ones, so that no reader waits for a pipe or reads a device."""

import stat
from pathlib import Path

from pps_vision.errors import InputError, first_line


def read_bytes(file: Path, expected: str) -> bytes:
    """Return the content of a regular file.

    Raises:
        InputError: There is none, or it cannot be read; the message ends in what was `expected`.
    """
    try:
        if not stat.S_ISREG(mode := file.stat().st_mode):
            kind = "a folder" if stat.S_ISDIR(mode) else "a device, pipe or socket"
            raise InputError(file, f"is {kind}; expected {expected}")
        return file.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
        if isinstance(error, InputError):
            raise
        raise InputError(file, f"cannot be read: {first_line(error)}; expected {expected}") from error
