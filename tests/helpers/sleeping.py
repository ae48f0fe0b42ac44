"""A task that never ends, for workers to be killed."""

import os
import time
from pathlib import Path


def sleep(file: str) -> None:
    """Write the process's number into a file, and sleep."""
    Path(file).write_text(str(os.getpid()))
    time.sleep(300)
