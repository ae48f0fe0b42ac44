"""The command line: every command is a frozen dataclass with a `run`; bad input ends in one line."""

import signal
import sys
from importlib.metadata import PackageNotFoundError, distribution
from typing import Annotated

import tyro
from tyro.conf import OmitSubcommandPrefixes, subcommand

from pps_vision.app.bench import Bench
from pps_vision.app.convert_taxels import ConvertTaxels
from pps_vision.app.demo import Demo
from pps_vision.app.joints import Joints
from pps_vision.app.learn import Learn, Show
from pps_vision.app.reach import Reach
from pps_vision.app.render import Render
from pps_vision.app.track import Track
from pps_vision.app.track2d import Track2d
from pps_vision.app.trials import Trials

Command = (
    Annotated[Render, subcommand("render")]
    | Annotated[Track, subcommand("track")]
    | Annotated[Track2d, subcommand("track2d")]
    | Annotated[Learn, subcommand("learn")]
    | Annotated[Joints, subcommand("joints")]
    | Annotated[Trials, subcommand("trials")]
    | Annotated[Show, subcommand("show")]
    | Annotated[ConvertTaxels, subcommand("convert-taxels")]
    | Annotated[Reach, subcommand("reach")]
    | Annotated[Demo, subcommand("demo")]
    | Annotated[Bench, subcommand("bench")]
)


_WHAT = "Stereo vision for robots that feel what is about to touch them."


def main(args: list[str] | None = None) -> None:
    """Run one command; exit code 2 and one line on the error stream for bad input."""
    for ended in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ended, _end)
    try:
        _refuse_python_control()
        command = tyro.cli(Command, config=(OmitSubcommandPrefixes,), prog="pps-vision", description=_WHAT, args=args)
        command.run()
    except (ValueError, OSError, OverflowError) as error:
        first_line = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        print(f"pps-vision: {first_line}", file=sys.stderr)
        sys.exit(2)


def _end(signum: int, frame: object) -> None:
    """Leave by way of every `finally`, so that nothing half-written stays behind."""
    sys.exit(128 + signum)


def _refuse_python_control() -> None:
    """python-control installs a top-level `control` over ours; working with the wrong one would be worse."""
    try:
        distribution("control")
    except PackageNotFoundError:
        return
    raise ValueError(
        "the distribution 'control' (python-control) is installed here and hides our package of that name; "
        "give pps-vision an environment of its own"
    )
