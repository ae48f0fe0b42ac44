"""The commands that write, and the files that they read."""

import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from learning.pps.memory import PPSMemory, save_memory
from pps_vision.recordings.taxels_ini import PartMap, write_taxels
from pps_vision.robot.skin import icub_skin


@dataclass(frozen=True)
class CommandUnderTest:
    """A command that writes `out`, a file or a folder in the folder it runs in; its words name its inputs there."""

    words: str
    out: str
    is_folder: bool = False
    resumes: bool = False
    """Whether it goes on where it was killed, with processes of its own."""

    @property
    def name(self) -> str:
        """The command with its subcommand, without arguments."""
        words = self.words.split()
        return " ".join(words[:2]) if words[0] == "reach" else words[0]


COMMANDS = (
    CommandUnderTest("render --stimulus ball --motion circle --seconds 0.5 --out out", "out", True),
    CommandUnderTest("track rec --video --out out", "out", True),
    CommandUnderTest("track2d rec/cam/left --init 100 80 40 40 --out out.csv", "out.csv"),
    CommandUnderTest("learn rec --out out.npz", "out.npz"),
    CommandUnderTest("joints rec --out out.csv", "out.csv"),
    CommandUnderTest("show memory.npz --out out.png", "out.png"),
    CommandUnderTest("convert-taxels memory.npz out.ini --like robot.ini", "out.ini"),
    CommandUnderTest("reach train --arm left --ik-budget 600 --out out.npz", "out.npz"),
    CommandUnderTest("reach query map.npz gaze.csv --out out.csv", "out.csv"),
    CommandUnderTest("reach show map.npz --out out.png", "out.png"),
    CommandUnderTest("demo --trials 1 --out out", "out", True),
    CommandUnderTest("batch list.csv --workers 2 --out out", "out", True, resumes=True),
)


def prepare(folder: Path, commands: Sequence[CommandUnderTest] = COMMANDS) -> None:
    """Write the input of the commands: a memory, a robot's map, gaze postures, and, as they take longest, a
    recording with a touch and a reachable-space map only where one of them reads it."""
    (folder / "list.csv").write_text("name,rec\nfirst,rec\nsecond,rec\nthird,rec\n")
    words = {word for command in commands for word in command.words.replace("/", " ").split()}
    if words & {"rec", "list.csv"}:
        motion = "--motion approach --target left_forearm:3 --speed 0.15 --seconds 3"
        run(f"render --stimulus ball {motion} --out rec", folder)
    if "map.npz" in words:
        run("reach train --arm left --ik-budget 600 --out map.npz", folder)
    skin = icub_skin(("left_forearm",))
    save_memory(folder / "memory.npz", PPSMemory.empty(skin))
    counts = {int(name.split(":")[1]): np.zeros((8, 4, 2), np.int64) for name in skin.taxel_ids}
    write_taxels(folder / "robot.ini", [PartMap("l_forearm", (-0.1, 0.2, 0.0, 3.0), (8, 4), tuple(range(400)), counts)])
    (folder / "gaze.csv").write_text("yaw_deg,pitch_deg,vergence_deg\n" + "0,-20,20\n" * 1000)


def argv(words: str) -> list[str]:
    return [sys.executable, "-m", "pps_vision", *words.split()]


def run(words: str, folder: Path) -> float:
    """Run a command to its end in a folder; its duration in s.  RuntimeError with its output if it fails."""
    start_s = time.monotonic()
    process = subprocess.run(argv(words), cwd=folder, capture_output=True, text=True, check=False)
    if process.returncode:
        raise RuntimeError(f"{words}: exit code {process.returncode}\n{process.stderr[-2000:]}")
    return time.monotonic() - start_s
