"""`--help` of every command loads nothing but the command line."""

import subprocess
import sys
from dataclasses import fields
from typing import get_args

from pps_vision.app.cli import COMMANDS
from pps_vision.app.cli.bench import Bench, study

HEAVY = {"torch", "kornia", "matplotlib", "pyrender", "trimesh", "pinocchio", "numba", "scipy", "cv2", "sklearn", "av"}
STUDIES = [get_args(study)[1].name for study in get_args(Bench.__annotations__["experiment"])]
HELPS = [
    [],
    *([command] for command in COMMANDS),
    *(["reach", what] for what in ("train", "query", "show")),
    *(["bench", study] for study in STUDIES),
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


def test_help_loads_no_heavy_package() -> None:
    assert len(STUDIES) >= 18
    asked = "\n".join(" ".join(words) for words in HELPS)
    done = subprocess.run([sys.executable, "-c", SCRIPT], input=asked, capture_output=True, text=True, cwd="/")
    assert done.returncode == 0, done.stderr
    loaded = [set(line.split()) for line in done.stderr.splitlines() if line.startswith("|loaded|")]
    assert len(loaded) == len(HELPS)
    for words, modules in zip(HELPS, loaded, strict=True):
        assert not modules & HEAVY, words
        assert "tyro" in modules
    assert done.stdout.count("--help") >= len(HELPS)
    assert done.stdout.count("usage: pps-vision") == len(HELPS)


def test_a_study_takes_what_its_help_shows() -> None:
    """The class that measures has no field that its parameters lack."""

    for annotated in get_args(Bench.__annotations__["experiment"]):
        kind = get_args(annotated)[0]
        if hasattr(kind, "parts"):
            assert kind().parts()
        else:
            made = study(kind())
            assert isinstance(made, kind)
            assert [f.name for f in fields(made)] == [f.name for f in fields(kind)]  # type: ignore[arg-type]
