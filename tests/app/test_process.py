"""The process of the command line: signals, its output streams, progress and help."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from videos import write_video

from pps_vision.app import progress as module
from pps_vision.app.cli import COMMANDS
from pps_vision.app.progress import progress

STAND_IN = """
import pps_vision.app.cli
from pps_vision.__main__ import main
{function}
pps_vision.app.cli.main = run
main()
"""


def start(function: str, **options: Any) -> subprocess.Popen[str]:
    """A process of pps-vision in which `run` replaces the command."""
    code = STAND_IN.format(function=function)
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | options
    return subprocess.Popen([sys.executable, "-c", code], **streams)


@pytest.mark.parametrize("signum", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_the_program_even_where_exceptions_are_swallowed(tmp_path, signum):
    """As numba swallows them while it loads; a signal that a shell's background job ignores stays ignored."""
    program = f"""
import signal
from pathlib import Path
from pps_vision.recordings.atomic_write import whole_file, whole_folder
def run():
    with whole_file(Path({str(tmp_path / "a.csv")!r})) as file, whole_folder(Path({str(tmp_path / "b")!r})) as folder:
        file.write_text("half")
        (folder / "c").write_text("half")
        try:
            signal.raise_signal({int(signum)})
        except BaseException:
            print("swallowed")
    print("ran on")
"""
    process = start(program, preexec_fn=lambda: signal.signal(signum, signal.SIG_DFL))
    printed, _ = process.communicate()
    assert (process.returncode, printed) == (-signum, "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("stream", "where"), [("stdout", "full"), ("stdout", "broken pipe"), ("stdout", "closed"), ("stderr", "closed")]
)
def test_a_stream_that_takes_nothing_does_not_stop_the_work(tmp_path, stream, where):
    """A full disk is reported at the end."""
    out = tmp_path / "out.txt"
    function = f"""
import sys
from pathlib import Path
def run():
    for _ in range(1000):
        print("x" * 100, file=sys.{stream}, flush=True)
    Path({str(out)!r}).write_text("whole")
"""
    read, write = os.pipe()
    os.close(read)
    options: dict[str, Any] = {stream: write}
    if where == "full":
        with Path("/dev/full").open("wb") as full:
            process = start(function, **{stream: full})
    elif where == "closed":
        number = {"stdout": 1, "stderr": 2}[stream]
        process = start(function, **{stream: None}, preexec_fn=lambda: os.close(number))
    else:
        process = start(function, **options)
    os.close(write)
    said = "".join(filter(None, process.communicate()))
    full_disk = 2, "pps-vision: standard output: [Errno 28] No space left on device\n"
    assert (process.returncode, said) == (full_disk if where == "full" else (0, ""))
    assert out.read_text() == "whole"


def test_characters_that_a_terminal_lacks_are_escaped():
    function = "def run():\n    print('3 pairs → caf\\udce9')"
    process = start(function, env=os.environ | {"PYTHONIOENCODING": "latin-1"}, encoding="latin-1")
    assert process.communicate() == ("3 pairs \\u2192 caf\\udce9\n", "")
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("body", "line", "code"),
    [
        ("import warnings; warnings.warn('two\\nlines', RuntimeWarning)", "RuntimeWarning: two lines", 0),
        (
            "raise ImportError('libEGL.so.1: cannot open shared object file')",
            "libEGL.so.1: cannot open shared object file",
            2,
        ),
        (
            "import not_installed.part",
            "No module named 'not_installed'; requirements-track.txt is for tracking only",
            2,
        ),
    ],
)
def test_a_warning_or_a_missing_library_is_one_line(body, line, code):
    process = start(f"def run():\n    {body}")
    errors = process.communicate()[1]
    assert errors.startswith(f"pps-vision: {line}")
    assert (errors.count("\n"), process.returncode) == (1, code)


@pytest.mark.parametrize("bug", ["from pathlib import nothing", "1 / 0"])
def test_a_bug_shows_its_traceback_and_has_a_code_of_its_own(bug):
    """1 is that of a batch of which some recordings failed, 2 that of bad input."""
    process = start(f"def run():\n    {bug}")
    assert process.communicate()[1].startswith("Traceback")
    assert process.returncode == 70


def test_folders_whose_names_are_not_utf8(tmp_path, calib):
    name = os.fsdecode(b"caf\xe9")
    write_video(tmp_path / "a.mp4", [0.05 * k for k in range(4)])
    (tmp_path / "a.mp4").rename(tmp_path / name)
    words = ["track", name, "--calib", str(calib), "--video", "--out", f"{name}-out"]
    command = [sys.executable, "-m", "pps_vision", *words]
    finished = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr
    assert "→ caf\\udce9-out\n" in finished.stdout
    out = tmp_path / f"{name}-out"
    assert json.loads((out / "summary.json").read_text(encoding="utf-8"))["source"] == name
    assert (out / "overlay.mp4").stat().st_size > 1000


HEAVY = {"torch", "kornia", "matplotlib", "pyrender", "trimesh", "pinocchio", "numba", "scipy", "cv2", "sklearn", "av"}
HELPS = [
    [],
    *([command] for command in COMMANDS),
    *(["reach", action] for action in ("train", "query", "show")),
    ["bench", "tracking"],
]

SCRIPT = """
import sys
from pps_vision.app.cli import main
for line in sys.stdin.read().splitlines():
    try:
        main([*line.split(), "--help"])
    except SystemExit as end:
        assert not end.code, (line, end.code)
    print("|loaded|", *sys.modules, file=sys.stderr)
"""


def test_help_loads_no_heavy_package():
    lines = "\n".join(" ".join(words) for words in HELPS)
    process = subprocess.run([sys.executable, "-c", SCRIPT], input=lines, capture_output=True, text=True, cwd="/")
    assert process.returncode == 0, process.stderr
    loaded = [set(line.split()) for line in process.stderr.splitlines() if line.startswith("|loaded|")]
    assert len(loaded) == len(HELPS)
    for words, modules in zip(HELPS, loaded, strict=True):
        assert not modules & HEAVY, words
        assert "tyro" in modules
    assert process.stdout.count("--help") >= len(HELPS)
    assert process.stdout.count("usage: pps-vision") == len(HELPS)
    assert "pps-vision --version" in process.stdout


def test_tracking_loads_no_package_of_the_report_or_the_robot(tmp_path, calib):
    write_video(tmp_path / "a.mp4", [0.0, 0.1])
    words = ["track", str(tmp_path / "a.mp4"), "--calib", str(calib), "--out", str(tmp_path / "out")]
    script = f"import sys; from pps_vision.app.cli import main; main({words!r}); print(*sys.modules, file=sys.stderr)"
    process = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    loaded = set(process.stderr.split())
    assert not loaded & {"torch", "matplotlib", "scipy.optimize", "scipy.spatial", "pinocchio", "trimesh"}
    assert "numba" in loaded


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
