"""Start commands as copies of one process that has loaded their modules, which takes a new interpreter a second.

Each command still has its own process: one that crashes ends alone.
"""

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, suppress
from importlib import import_module
from typing import IO

from pps_vision.parent import FOLLOWS_PARENT

_MODULES = ("app.cli.track", "app.progress", "app.track_files", "recordings.formats.stereo_video")
_ENDS_S = 5.0  # in which a process that is told to end removes its unfinished files


class Starter(AbstractContextManager["Starter"]):
    """Runs one command at a time.  Its process begins with the first one and ends with this context."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._control, self._theirs = socket.socketpair()
        self._replies = self._control.makefile("rb")

    def __exit__(self, *error: object) -> None:
        self._replies.close()
        self._control.close()
        self._theirs.close()
        if self._process:
            self._process.wait()

    def run(self, words: Sequence[str], stderr: IO[bytes], stalled_s: float) -> int | None:
        """Run a command; return its exit code (-n: ended by signal n), or None if it was ended because it told of no
        progress for `stalled_s`."""
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__],
                env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONIOENCODING": "utf-8"},
                stdin=self._theirs.fileno(),
                stdout=subprocess.DEVNULL,
            )
            self._theirs.close()
        ours, theirs = socket.socketpair()
        is_stalled = False
        with ours:
            with theirs:
                socket.send_fds(self._control, [b"."], [theirs.fileno(), stderr.fileno()])
            self._control.sendall(json.dumps(words).encode() + b"\n")
            pid = int(self._replies.readline())
            try:
                _wait_for_end(ours, stalled_s)
            except TimeoutError:
                is_stalled = True
                os.kill(pid, signal.SIGTERM)
                with suppress(TimeoutError):
                    _wait_for_end(ours, _ENDS_S)
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
        code = int(self._replies.readline())
        return None if is_stalled else code


def _wait_for_end(progress: socket.socket, stalled_s: float) -> None:
    """Wait until a command closes its end; TimeoutError if it tells of no progress for `stalled_s`."""
    progress.settimeout(stalled_s)
    while progress.recv(2**12):
        pass


def _serve() -> bool:
    """Copy this process for every command that comes by standard input; return True in the copy, False at the end."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    control = socket.socket(fileno=os.dup(0))
    requests = control.makefile("rb")
    _load()
    while True:
        message, fds, _, _ = socket.recv_fds(control, 1, 2)
        if not message:
            return False
        sys.argv[1:] = json.loads(requests.readline())
        pid = os.fork()
        if not pid:
            control.detach()  # stays open in the starter
            for fd, stream in zip(fds, (0, 2), strict=True):
                os.dup2(fd, stream)
                os.close(fd)
            os.environ[FOLLOWS_PARENT] = "1"
            return True
        for fd in fds:
            os.close(fd)
        control.sendall(b"%d\n" % pid)
        _, status = os.waitpid(pid, 0)
        control.sendall(b"%d\n" % os.waitstatus_to_exitcode(status))


def _load() -> None:
    """Load what every command takes long to load; the command itself reports a missing module."""
    with suppress(ImportError):
        for name in _MODULES:
            import_module(f"pps_vision.{name}")
        from pps_vision.geometry.camera import Camera

        Camera(2, 2, 1.0, 1.0, 0.5, 0.5).project((0.0, 0.0, 1.0))  # numba loads its libraries with the first function


if __name__ == "__main__":
    with suppress(BrokenPipeError):  # whoever gave the commands has ended
        if _serve():
            from pps_vision.__main__ import main

            main()
