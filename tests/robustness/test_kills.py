"""Commands killed at random moments, a handful; `pps-vision bench robustness` kills every command."""

import signal
from pathlib import Path

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments import kills
from pps_vision.experiments.kills import COMMANDS, COUNTS, Writing, kill_at_random, prepare, run

KILLED = {"convert-taxels": (), "render": pytest.mark.long, "batch": pytest.mark.long}
COUNTED = {"kills": 1, **dict.fromkeys(COUNTS[2:], 0)}


@pytest.mark.parametrize(
    "command", [pytest.param(one, marks=KILLED[one.name], id=one.name) for one in COMMANDS if one.name in KILLED]
)
def test_a_killed_command_damages_nothing_and_runs_again(tmp_path: Path, command: Writing) -> None:
    prepare(tmp_path, [command])
    sent = signal.SIGTERM if command.name == "convert-taxels" else signal.SIGKILL
    found = kill_at_random(command, tmp_path, 1, np.random.default_rng(SEED), (sent,))
    del found["finished"]
    assert found == COUNTED | {"kills": 1}


CARELESS = """
import signal, sys, time
from pathlib import Path
signal.signal(signal.SIGTERM, signal.SIG_IGN)
out = Path("out.csv")
{first}
time.sleep(0.3)
{last}
"""


@pytest.mark.parametrize(
    ("first", "last", "wrong"),
    [
        ("out.write_text('half')", "out.write_text('whole.')", "half_written"),
        ("out.write_text('other.' if Path('b').exists() else 'whole.'); Path('b').touch()", "", "failed_reruns"),
        ("Path('in.csv').open('a').write('x')", "out.write_text('whole.')", "damaged"),
        ("Path('.a').touch()", "out.write_text('whole.')", "left_over"),
        ("sys.exit(1) if Path('b').exists() else Path('b').touch()", "out.write_text('whole.')", "failed_reruns"),
        ("", "time.sleep(1.0); out.write_text('whole.')", "running_on"),
    ],
)
def test_a_careless_command_is_found_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: str, last: str, wrong: str
) -> None:
    """Programs that write in place, change their input, leave files behind, fail after a kill, or ignore SIGTERM."""
    (tmp_path / "in.csv").write_text("mine")
    (tmp_path / "program.py").write_text(CARELESS.format(first=first, last=last))
    monkeypatch.setattr(kills, "_words", lambda words: [kills.sys.executable, words])
    monkeypatch.setattr(kills, "_LAST_STEP_S", 0.3)
    signals = (signal.SIGTERM,) if wrong == "running_on" else (signal.SIGKILL,)
    found = kill_at_random(Writing("program.py", "out.csv"), tmp_path, 3, np.random.default_rng(0), signals)
    assert found[wrong] > 0


def test_a_background_job_hands_no_ignored_signal_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "program.py").write_text("import time; time.sleep(0.5); open('out.csv', 'w').write('whole.')")
    monkeypatch.setattr(kills, "_words", lambda words: [kills.sys.executable, words])
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        rng = np.random.default_rng(SEED)
        found = kill_at_random(Writing("program.py", "out.csv"), tmp_path, 1, rng, (signal.SIGINT,))
    finally:
        signal.signal(signal.SIGINT, before)
    assert (found["kills"], found["running_on"]) == (1, 0)


def test_a_command_that_fails_says_what_it_printed(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=r"(?s)exit code 2.*nowhere"):
        run("track nowhere --out out", tmp_path)
