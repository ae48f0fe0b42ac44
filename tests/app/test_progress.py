"""Progress on a terminal and in a log."""

import io
import re
import time

import pytest

from pps_vision.app import progress as module
from pps_vision.app.progress import progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def quick(monkeypatch) -> None:
    """A line every 50 ms."""
    monkeypatch.setattr(module, "_EVERY_S", 0.05)


@pytest.mark.usefixtures("quick")
def test_a_log_has_whole_lines_now_and_then(capsys):
    for _ in progress(range(50), "training", "approach", after_s=0.0):
        time.sleep(0.005)  # a quarter of a second or more
    with progress(desc="map", total=1, after_s=0.0) as bar:
        bar.update()
    *training, map_line = capsys.readouterr().err.split("\n")[:-1]
    numbers = [int(re.fullmatch(r"training: (\d+) of 50 after 00:0\d", line)[1]) for line in training]
    assert numbers == sorted(set(numbers))
    assert numbers[0] == 0
    assert 2 <= len(numbers) < 50
    assert map_line == "map: 0 of 1 after 00:00"


@pytest.mark.usefixtures("quick")
def test_what_fails_says_nothing_after_its_reason(capsys):
    """A batch takes the last line of a recording's error stream for the reason."""
    bar = progress(range(3), "track", after_s=0.0)
    for _ in bar:
        time.sleep(0.06)
        break
    print("reason", file=module.sys.stderr)
    bar.close()
    assert capsys.readouterr().err.splitlines()[-1] == "reason"


def test_a_terminal_has_a_bar(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    assert list(progress(range(3), "track", "pair")) == [0, 1, 2]
    assert re.search(r"\rtrack: 100%\|[#█]+\| 3/3 .*pair", terminal.getvalue())
