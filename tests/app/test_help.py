"""`--help` of every command loads nothing but the command line."""

import subprocess
import sys

from pps_vision.app.cli import COMMANDS

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
