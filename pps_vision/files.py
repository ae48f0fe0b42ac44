"""Open input files: only regular ones, so that no reader waits for a pipe or reads a device."""

import stat
from pathlib import Path

from pps_vision.errors import InputError, first_line

MOST_BYTES = 2**28


def check_regular(file: Path, expected: str) -> None:
    """Raise InputError unless there is a regular file; the message ends in `expected`."""
    try:
        mode = file.stat().st_mode
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
        raise InputError(file, f"cannot be read: {first_line(error)}; expected {expected}") from error
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "a device, pipe or socket"
        raise InputError(file, f"is {kind}; expected {expected}")


def read_bytes(file: Path, expected: str, most: int = MOST_BYTES) -> bytes:
    """Return the content of a regular file of at most `most` bytes; InputError if there is none, or it cannot be
    read."""
    check_regular(file, expected)
    try:
        if (n := file.stat().st_size) > most:
            raise InputError(file, f"is of {n} bytes; expected {expected} of at most {most}")
        return file.read_bytes()
    except MemoryError as error:
        raise InputError(file, f"does not fit into memory; expected {expected}") from error
    except OSError as error:
        raise InputError(file, f"cannot be read: {first_line(error)}; expected {expected}") from error
