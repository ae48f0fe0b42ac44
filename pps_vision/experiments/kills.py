"""Kill commands at random moments: nothing earlier may be damaged, nothing may look finished that is not, and a re-run
must succeed and clean up."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from learning.pps.memory import PPSMemory, save_memory
from pps_vision.recordings.taxels_ini import PartMap, write_taxels
from pps_vision.robot.skin import icub_skin

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
COUNTS = ("kills", "finished", "running_on", "damaged", "half_written", "failed_reruns", "left_over")
_ENDS_WITHIN_S = 60.0  # of the signal, on a busy machine
_MOST_STARTS = 5  # for each kill that is to strike
_LAST_STEP_S = 2.0  # a run that ends well this long after the signal was ending already
_EARLIER = b'{"earlier": 1}\n'  # an output of some earlier run


@dataclass(frozen=True)
class Writing:
    """A command that writes `out`, a file or a folder in the folder it runs in; its words name its inputs there."""

    words: str
    out: str
    is_folder: bool = False
    resumes: bool = False
    """Whether it goes on where it was killed, with the processes that it had started."""

    @property
    def name(self) -> str:
        """The command with its subcommand, without arguments."""
        words = self.words.split()
        return " ".join(words[:2]) if words[0] == "reach" else words[0]


COMMANDS = (
    Writing("render --stimulus ball --motion circle --seconds 0.5 --out out", "out", True),
    Writing("track rec --video --out out", "out", True),
    Writing("track2d rec/cam/left --init 100 80 40 40 --out out.csv", "out.csv"),
    Writing("learn rec --out out.npz", "out.npz"),
    Writing("joints rec --out out.csv", "out.csv"),
    Writing("show memory.npz --out out.png", "out.png"),
    Writing("convert-taxels memory.npz out.ini --like robot.ini", "out.ini"),
    Writing("reach train --arm left --ik-budget 600 --out out.npz", "out.npz"),
    Writing("reach query map.npz gaze.csv --out out.csv", "out.csv"),
    Writing("reach show map.npz --out out.png", "out.png"),
    Writing("bench stereo --n 1 --out out", "out/results/stereo.json"),
    Writing("demo --trials 1 --out out", "out", True),
    Writing("batch list.csv --workers 2 --out out", "out", True, resumes=True),
)


def prepare(folder: Path, commands: Sequence[Writing] = COMMANDS) -> None:
    """Write what the commands read: a memory, a robot's map, gaze postures, and, as they take longest, a
    recording with a touch and a reachable-space map only where one of them reads it."""
    (folder / "list.csv").write_text("name,rec\nfirst,rec\nsecond,rec\nthird,rec\n")
    if any({"rec", "list.csv"} & set(command.words.replace("/", " ").split()) for command in commands):
        run(
            "render --stimulus ball --motion approach --target left_forearm:3 --speed 0.15 --seconds 3 --out rec",
            folder,
        )
    if any("map.npz" in command.words for command in commands):
        run("reach train --arm left --ik-budget 600 --out map.npz", folder)
    skin = icub_skin(("left_forearm",))
    save_memory(folder / "memory.npz", PPSMemory.empty(skin))
    counts = {int(name.split(":")[1]): np.zeros((8, 4, 2), np.int64) for name in skin.taxel_ids}
    write_taxels(folder / "robot.ini", [PartMap("l_forearm", (-0.1, 0.2, 0.0, 3.0), (8, 4), tuple(range(400)), counts)])
    (folder / "gaze.csv").write_text("yaw_deg,pitch_deg,vergence_deg\n" + "0,-20,20\n" * 1000)


def run(words: str, folder: Path) -> float:
    """Run a command to its end in a folder; its duration in s.  RuntimeError with what it printed if it fails."""
    begun = time.monotonic()
    done = subprocess.run(_words(words), cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{words}: exit code {done.returncode}\n{done.stderr[-2000:]}")
    return time.monotonic() - begun


def kill_at_random(
    command: Writing, folder: Path, kills: int, rng: np.random.Generator, signals: Sequence[signal.Signals] = SIGNALS
) -> Counter[str]:
    """Kill a command so often at uniformly random moments of its run, run it once more, and count what went wrong.

    Args:
        command: What is killed; its inputs lie in `folder` (`prepare`).
        folder: Where it runs.
        kills: How many are to strike it while it runs; it is started at most five times as often.
        rng: Draws the moments and the signals.
        signals: Signals to choose from.

    Returns:
        "kills" that ended a running process; runs that "finished" before or all the same; those that were "running_on"
        after the signal; "damaged" inputs and earlier outputs; "half_written" outputs; "failed_reruns", and runs that
        failed without a signal; hidden files "left_over" after the last run.
    """
    found: Counter[str] = Counter(dict.fromkeys(COUNTS, 0))
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell's background jobs hand this on to the command
        signal.signal(signal.SIGINT, signal.default_int_handler)
    shutil.rmtree(folder / Path(command.out).parts[0], ignore_errors=True)  # another command's folder
    duration_s = run(command.words, folder)
    whole, inputs = _contents(folder / command.out), _inputs(command, folder)
    for _ in range(_MOST_STARTS * kills):
        if found["kills"] == kills or found["running_on"]:
            break
        earlier = _begin_anew(command, folder)
        begun = time.monotonic()
        process = subprocess.Popen(
            _words(command.words),
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=command.resumes,
        )
        time.sleep(float(rng.uniform(0, duration_s)))
        running = process.poll() is None
        signum = signals[int(rng.integers(len(signals)))]
        process.send_signal(signum)
        sent_s = time.monotonic()
        try:
            code = process.wait(_ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        if command.resumes and not _group_ends(process.pid):
            found["running_on"] += 1
        lasted_s = time.monotonic() - sent_s
        output = _contents(folder / command.out)
        if code == 0:
            duration_s = min(duration_s, time.monotonic() - begun)  # the first run may have compiled
        found["kills"] += running and code != 0
        found["finished"] += code == 0
        found["failed_reruns"] += not running and code != 0
        found["running_on"] += lasted_s > _ENDS_WITHIN_S or (code == 0 and lasted_s > _LAST_STEP_S)
        found["damaged"] += _inputs(command, folder) != inputs
        found["half_written"] += output != earlier and not _is_like(output, whole, in_part=command.resumes)
        if command.resumes:
            found["failed_reruns"] += _fails(command, folder, whole)
    _begin_anew(command, folder)
    found["failed_reruns"] += _fails(command, folder, whole)
    found["left_over"] += sum(file.name.startswith(".") for file in folder.rglob("*"))
    return found


def _fails(command: Writing, folder: Path, whole: Mapping[str, bytes]) -> bool:
    """Run a command to its end, and whether that fails or does not give the same."""
    try:
        run(command.words, folder)
    except RuntimeError as error:
        print(error, file=sys.stderr)
        return True
    return not _is_like(_contents(folder / command.out), whole)


def _group_ends(group: int) -> bool:
    """Whether the processes that were started by one that was killed end too; those that do not are killed."""
    until_s = time.monotonic() + _ENDS_WITHIN_S
    with suppress(ProcessLookupError):
        while time.monotonic() < until_s:
            os.killpg(group, 0)
            time.sleep(0.02)
        os.killpg(group, signal.SIGKILL)
        return False
    return True


def _words(words: str) -> list[str]:
    return [sys.executable, "-m", "pps_vision", *words.split()]


def _begin_anew(command: Writing, folder: Path) -> dict[str, bytes]:
    """Remove the output of the last run; a file is an earlier one then, as it may be written over.  What is there."""
    out = folder / command.out
    if command.is_folder:
        shutil.rmtree(out, ignore_errors=True)
    else:
        out.write_bytes(_EARLIER)
    return _contents(out)


def _contents(path: Path) -> dict[str, bytes]:
    """What files there are and what they hold; of a folder without hidden ones."""
    if path.is_file():
        return {"": path.read_bytes()}
    files = (file for file in sorted(path.rglob("*")) if file.is_file())
    names = {str(file.relative_to(path)): file for file in files}
    return {name: file.read_bytes() for name, file in names.items() if not any(p[0] == "." for p in Path(name).parts)}


def _inputs(command: Writing, folder: Path) -> dict[str, bytes]:
    """Everything in the folder but the output."""
    top = Path(command.out).parts[0]
    return {name: data for name, data in _contents(folder).items() if Path(name).parts[0] != top}


def _is_like(output: Mapping[str, bytes], whole: Mapping[str, bytes], in_part: bool = False) -> bool:
    """Whether the same files are there, each to its end, and tables the same to the byte; times of stages in other
    files, and in a batch's table, may differ.

    With `in_part` folders of the whole may be missing, but not one of their files.
    """
    if in_part:
        there = {Path(name).parts[0] for name in output}
        whole = {name: data for name, data in whole.items() if Path(name).parts[0] in there}
    return output.keys() == whole.keys() and all(
        data == whole[name] if name.endswith(".csv") and name != "batch.csv" else data[-2:] == whole[name][-2:]
        for name, data in output.items()
    )
