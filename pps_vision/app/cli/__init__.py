"""The command line: every command is a frozen dataclass with a `run`; bad input ends in one line.

A command's file imports only the modules that its `--help` needs; `run` imports the others.
"""

import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Protocol, Union

import tyro
from tyro.conf import OmitSubcommandPrefixes, subcommand

from pps_vision.errors import InputError

COMMANDS = (
    *("render", "session", "info", "clock", "calibrate", "track", "triangulate", "track2d", "batch", "evaluate"),
    *("truth", "learn", "joints", "report", "show", "convert-taxels", "reach", "demo", "encounters", "bench"),
)
_DESCRIPTION = (
    "Stereo vision for robots that feel what is about to touch them. `pps-vision --version` says which version."
)


class Command(Protocol):
    """One command with its options."""

    def run(self) -> None:
        """Run the command; InputError or OSError for unusable input."""
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
        if "" in args:
            raise InputError("command line", "a word is empty, as of a variable that is not set; expected none")
        for k, word in enumerate(args):
            if word.lower().lstrip("+-") in ("nan", "inf", "infinity"):
                option = next((other for other in args[k::-1] if other.startswith("--")), "command line")
                raise InputError(option, f"{word} is no finite number; expected one (./{word} for a file)")
        command = _parsed(args)
        seed = getattr(getattr(command, "subcommand", command), "seed", None)
        if seed is not None and seed < 0:
            raise InputError("command line", f"--seed {seed}; expected a number of at least 0")
        command.run()
    except (InputError, OSError, MemoryError) as error:
        message = "out of memory; expected smaller files, or more memory" if isinstance(error, MemoryError) else error
        print(f"pps-vision: {' '.join(str(message).split())}", file=sys.stderr)
        sys.exit(2)


def _parsed(args: list[str]) -> Command:
    """Parse the arguments; only the parser of the given command is built, for an overview the parsers of all."""
    config = (OmitSubcommandPrefixes,)
    command: Command
    if args and args[0] in COMMANDS:
        command = tyro.cli(_class(args[0]), prog=f"pps-vision {args[0]}", args=args[1:], config=config)
    else:
        commands: Any = Union[*(Annotated[_class(name), subcommand(name)] for name in COMMANDS)]
        command = tyro.cli(commands, prog="pps-vision", description=_DESCRIPTION, args=args, config=config)
    return command


def _class(name: str) -> type[Command]:
    """Import the dataclass of a command: "convert-taxels" is convert_taxels.ConvertTaxels."""
    words = name.split("-")
    module = import_module(f"{__name__}.{'_'.join(words)}")
    command: type[Command] = getattr(module, "".join(map(str.capitalize, words)))
    return command


def _refuse_python_control() -> None:
    """Raise InputError if python-control is installed, whose top-level package `control` hides ours."""
    for folder in filter(Path.is_dir, map(Path, sys.path)):
        if next(folder.glob("control-*.*-info"), None):  # importlib.metadata takes 60 ms to load
            reason = "python-control is installed here and hides our package `control`"
            raise InputError(folder, f"{reason}; give pps-vision an environment of its own")
