"""Commands killed at random moments: nothing earlier is damaged, nothing looks finished that is not, and a re-run
succeeds and cleans up."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from commands import COMMANDS, CommandUnderTest, argv, prepare, run
from data import SEED

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
ENDS_WITHIN_S = 60.0  # after the signal, on a busy machine
LAST_STEP_S = 2.0  # a run that ends well within this time of the signal was ending already
EARLIER = b'{"earlier": 1}\n'  # an output of an earlier run
QUICK = "convert-taxels"


def kill(command: CommandUnderTest, folder: Path, kills: int, signals: tuple[int, ...] = SIGNALS) -> list[str]:
    """Kill a command at uniformly random moments of its run until so many kills have struck, run it once more, and
    return its faults."""
    rng = np.random.default_rng(SEED)
    shutil.rmtree(folder / Path(command.out).parts[0], ignore_errors=True)  # another command's folder
    duration_s = run(command.words, folder)
    whole = contents(folder / command.out)
    inputs = inputs_of(command, folder)
    faults = []
    struck = 0
    while struck < kills:
        earlier = clear_output(command, folder)
        with subprocess.Popen(
            argv(command.words),
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=command.resumes,
        ) as process:
            time.sleep(float(rng.uniform(0, duration_s)))
            was_running = process.poll() is None
            process.send_signal(signals[int(rng.integers(len(signals)))])
            sent_s = time.monotonic()
            try:
                code = process.wait(ENDS_WITHIN_S)
            except subprocess.TimeoutExpired:
                process.kill()
                return [*faults, "runs on after the signal"]
        if command.resumes and not group_ends(process.pid):
            faults.append("its processes run on after the signal")
        if code == 0 and time.monotonic() - sent_s > LAST_STEP_S:
            faults.append("runs on after the signal")
        if code == 0:
            duration_s *= 0.9  # it finished before the signal; the first run may have compiled
            continue
        struck += 1
        output = contents(folder / command.out)
        if not was_running:
            faults.append("failed without a signal")
        if inputs_of(command, folder) != inputs:
            faults.append("damaged its inputs")
        if output != earlier and not is_like(output, whole, in_part=command.resumes):
            faults.append("left its output half-written")
        if command.resumes:
            faults += rerun_faults(command, folder, whole)
    clear_output(command, folder)
    faults += rerun_faults(command, folder, whole)
    return faults + [f"left {file.name}" for file in folder.rglob("*") if file.name.startswith(".")]


def rerun_faults(command: CommandUnderTest, folder: Path, whole: Mapping[str, bytes]) -> list[str]:
    try:
        run(command.words, folder)
    except RuntimeError as error:
        return [f"failed again: {error}"]
    return [] if is_like(contents(folder / command.out), whole) else ["wrote something else again"]


def group_ends(group: int) -> bool:
    """Whether the processes that were started by a killed process end too; the others are killed."""
    until_s = time.monotonic() + ENDS_WITHIN_S
    with suppress(ProcessLookupError):
        while time.monotonic() < until_s:
            os.killpg(group, 0)
            time.sleep(0.02)
        os.killpg(group, signal.SIGKILL)
        return False
    return True


def clear_output(command: CommandUnderTest, folder: Path) -> dict[str, bytes]:
    """Remove the output of the last run; a file becomes an earlier one, which may be written over."""
    out = folder / command.out
    if command.is_folder:
        shutil.rmtree(out, ignore_errors=True)
    else:
        out.write_bytes(EARLIER)
    return contents(out)


def contents(path: Path) -> dict[str, bytes]:
    """Bytes of a file, or of all files of a folder by name, without hidden ones."""
    if path.is_file():
        return {"": path.read_bytes()}
    files = {file.relative_to(path): file for file in path.rglob("*") if file.is_file()}
    return {str(name): file.read_bytes() for name, file in files.items() if not any(p[0] == "." for p in name.parts)}


def inputs_of(command: CommandUnderTest, folder: Path) -> dict[str, bytes]:
    """Everything in the folder but the output."""
    top = Path(command.out).parts[0]
    return {name: data for name, data in contents(folder).items() if Path(name).parts[0] != top}


def is_like(output: Mapping[str, bytes], whole: Mapping[str, bytes], in_part: bool = False) -> bool:
    """Whether the same files are there, each to its end, and tables the same to the byte; times of stages in other
    files, and in a batch's table, may differ.  With `in_part` whole folders may be missing."""
    if in_part:
        present = {Path(name).parts[0] for name in output}
        whole = {name: data for name, data in whole.items() if Path(name).parts[0] in present}
    return output.keys() == whole.keys() and all(
        data == whole[name] if name.endswith(".csv") and name != "batch.csv" else data[-2:] == whole[name][-2:]
        for name, data in output.items()
    )


@pytest.mark.parametrize(
    "command", [pytest.param(c, marks=[pytest.mark.long] * (c.name != QUICK), id=c.name) for c in COMMANDS]
)
def test_a_killed_command_damages_nothing_and_runs_again(tmp_path, command):
    prepare(tmp_path, [command])
    kills = {QUICK: 1, "batch": 10}.get(command.name, 3)
    assert kill(command, tmp_path, kills, (signal.SIGTERM,) if command.name == QUICK else SIGNALS) == []
