"""The command line: every command is a frozen dataclass with a `run`; bad input ends in one line.

A command's file holds only what its `--help` needs; what it works with is imported when it runs.
"""

import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Protocol, Union

import tyro
from tyro.conf import OmitSubcommandPrefixes, subcommand

from pps_vision.errors import InputError

COMMANDS = (
    *("render", "info", "calibrate", "track", "track2d", "batch", "evaluate", "truth", "learn", "joints"),
    *("report", "show", "convert-taxels", "reach", "demo", "bench"),
)
_WHAT = "Stereo vision for robots that feel what is about to touch them. `pps-vision --version` says which version."


class Command(Protocol):
    """One command with its options."""

    def run(self) -> None:
        """Do it; InputError or OSError for what cannot be used."""
        ...


def main(args: list[str] | None = None) -> None:
    """Run one command; bad input ends with exit code 2 and one line on the error stream, a bug with a traceback."""
    args = sys.argv[1:] if args is None else args
    if args == ["--version"]:
        from importlib.metadata import version

        print(f"pps-vision {version('pps-vision')}")
        return
    try:
        _refuse_python_control()
        _parsed(args).run()
    except (InputError, OSError) as error:
        print(f"pps-vision: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2)


def _parsed(args: list[str]) -> Command:
    """The command that is asked for; only its own parser is built, and all of them for an overview."""
    asked: Any
    if args and args[0] in COMMANDS:
        asked, prog, what, args = _class(args[0]), f"pps-vision {args[0]}", None, args[1:]
    else:
        asked, prog, what = Union[*(Annotated[_class(n), subcommand(n)] for n in COMMANDS)], "pps-vision", _WHAT
    command: Command = tyro.cli(asked, prog=prog, description=what, args=args, config=(OmitSubcommandPrefixes,))
    return command


def _class(name: str) -> type[Command]:
    """The dataclass of a command, in the file of the same name: "convert-taxels" is convert_taxels.ConvertTaxels."""
    words = name.split("-")
    found: type[Command] = getattr(import_module(f"{__name__}.{'_'.join(words)}"), "".join(map(str.capitalize, words)))
    return found


def _refuse_python_control() -> None:
    """python-control installs a top-level `control` over ours; working with the wrong one would be worse."""
    for place in filter(Path.is_dir, map(Path, sys.path)):
        if next(place.glob("control-*.*-info"), None):  # importlib.metadata says the same and takes 60 ms to load
            raise InputError(
                place,
                "python-control is installed here and hides our package `control`; give pps-vision an environment of "
                "its own",
            )
