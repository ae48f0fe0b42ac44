"""A child of `batch`: it ends with its parent and tells it that the work goes on.

Its standard input is one end of a pair of sockets, of which the parent holds the other: it is closed when the parent
ends, even by SIGKILL, and carries a byte for every stereo pair that is read.
"""

import os
import signal
from contextlib import suppress
from threading import Thread

FOLLOWS_PARENT = "PPS_VISION_FOLLOWS_PARENT"
"""Environment variable: the standard input is such a socket."""

_follows = False


def follow_parent() -> None:
    """End, as by SIGTERM, when the parent ends, if there is one that asks for it."""
    global _follows
    if os.environ.pop(FOLLOWS_PARENT, None):
        _follows = True
        Thread(target=_end_with_parent, daemon=True).start()


def tell_progress() -> None:
    """Tell the parent, if there is one that listens, that the work goes on."""
    if _follows:
        with suppress(OSError):  # the parent has ended
            os.write(0, b".")


def _end_with_parent() -> None:
    while os.read(0, 1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
