"""Recordings one after another, whatever is wrong with some of them."""

import sys
from collections.abc import Callable
from pathlib import Path

from tqdm import tqdm


def each_recording(command: str, folders: tuple[Path, ...], use: Callable[[Path], None]) -> int:
    """Use each; why one cannot be used is printed and does not stop the others.  Returns how many could be.

    ValueError where there is none, or none can be used.
    """
    if not folders:
        raise ValueError(f"{command}: no recording given; expected one folder or more")
    failed = []
    for folder in tqdm(folders, desc=command, unit="recording", disable=None):
        try:
            use(folder)
        except ValueError as error:
            failed.append(error)
            if len(folders) > 1:
                print(f"skipped: {error}", file=sys.stderr)
    if len(failed) == len(folders):
        raise failed[-1] if len(failed) == 1 else ValueError(f"{command}: none of {len(failed)} recordings is usable")
    return len(folders) - len(failed)
