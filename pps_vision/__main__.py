"""`python -m pps_vision`, and the command `pps-vision`: signals, output streams and exit codes of the process.

Exit codes: 0 done; 1 some recordings of a batch failed; 2 bad input, in one line; 70 a bug, with its traceback.
"""

import gc
import io
import os
import signal
import sys
import traceback
import warnings
from typing import TextIO

from pps_vision.parent import follow_parent

_BUG = 70  # exit code; sysexits' EX_SOFTWARE
_COLLECTED = 20_000  # new objects, after which cycles are looked for: 700 take 70 ms while modules are loaded
_SWITCH_S = 5e-4  # for which a thread that decodes may keep the one that tracks from going on
_OURS = "pps_vision", "rendering", "tracking", "learning", "control"


def main() -> None:
    """Run the command line; report a missing package or system library in one line, a bug by its traceback."""
    for signum in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(signum) is not signal.SIG_IGN:  # as under nohup
            signal.signal(signum, _end)
    follow_parent()
    gc.set_threshold(_COLLECTED)
    sys.setswitchinterval(_SWITCH_S)
    sys.stdout = output = _Output.instead_of(sys.stdout)
    sys.stderr = _Output.instead_of(sys.stderr)
    warnings.formatwarning = _on_one_line
    try:
        from pps_vision.app.cli import main as run  # here, so that a signal or a missing library is caught

        run()
        output.flush()
        if output.error is not None and not isinstance(output.error, BrokenPipeError):
            print(f"pps-vision: standard output: {output.error}", file=sys.stderr)
            sys.exit(2)
    except Exception as error:
        message = _missing_dependency(error)
        if message is None:
            traceback.print_exc()
            sys.exit(_BUG)
        print(f"pps-vision: {message}", file=sys.stderr)
        sys.exit(2)
    finally:
        gc.freeze()  # else the interpreter's last collection goes through all modules' objects: 0.3 s


def _missing_dependency(error: Exception) -> str | None:
    """The package or the system library that could not be imported; None for another error."""
    if not isinstance(error, ImportError):
        return None
    missing = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if (not missing or missing in _OURS) and ".so" not in str(error):
        return None
    more = "; requirements-track.txt is for tracking only, expected the whole package (make setup)" if missing else ""
    return f"{error}{more}"


def _end(signum: int, frame: object) -> None:
    """Remove unfinished files, then end by the signal's default action.

    An exception could be swallowed by the interrupted code (imports, callbacks, finalizers).
    """
    atomic_write = sys.modules.get("pps_vision.recordings.atomic_write")
    remove_unfinished = getattr(atomic_write, "remove_unfinished", None)  # None: not loaded, no unfinished files
    if remove_unfinished is not None:
        remove_unfinished()
    signal.signal(signum, signal.SIG_DFL)
    signal.raise_signal(signum)


class _Output(io.TextIOWrapper):
    """A standard stream that drops its output after an error (closed pipe, full disk) instead of stopping the work."""

    error: OSError | None = None  # after which output was dropped

    @classmethod
    def instead_of(cls, stream: TextIO | None) -> "_Output":
        """Replace a stream; characters that it cannot encode are escaped."""
        if not isinstance(stream, io.TextIOWrapper):  # None: it was closed before the start
            return cls(open(os.devnull, "wb"), encoding="utf-8")
        encoding = stream.encoding
        line_buffering = stream.line_buffering
        return cls(stream.detach(), encoding, "backslashreplace", line_buffering=line_buffering)

    def write(self, text: str) -> int:
        """Write, or drop what cannot be written."""
        try:
            return super().write(text) if self.error is None else len(text)
        except OSError as error:
            self.error = error
            return len(text)

    def flush(self) -> None:
        """Flush, or drop what cannot be written."""
        try:
            if self.error is None:
                super().flush()
        except OSError as error:
            self.error = error


def _on_one_line(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    """Format a library's warning."""
    return f"pps-vision: {category.__name__}: {' '.join(str(message).split())}\n"


if __name__ == "__main__":
    main()
