"""The round of mutants: mutants that fail a test are killed, others survive, and the tree is restored."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


def test_what_no_test_notices_survives(tmp_path):
    """Of all four mutants of a gate at 3, tests far from it notice only the two that do not keep its sense."""
    source = '"""A gate."""\n\n\ndef is_far(x: float = "no") -> bool:\n    """Whether it is."""\n    return x > 3\n'
    files = {"pps_vision/gate.py": source, "tests/test_gate.py": "from pps_vision.gate import is_far\n\n\n"}
    files["tests/test_gate.py"] += "def test_both_sides():\n    assert is_far(5) and not is_far(1)\n"
    for name, text in files.items():
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(text)
    mutants = mutate(tmp_path, "found.json", "--n", "4", "--seed", "1", "--only", "pps_vision")
    assert {mutant["mutation"]: mutant["outcome"] for mutant in mutants} == {
        "x > 3 -> (x >= 3)": "survived",
        "x > 3 -> (x < 3)": "killed",
        "3 -> (4)": "survived",
        "return x > 3 -> return None": "killed",
    }
    assert {(mutant["file"], mutant["line"]) for mutant in mutants} == {("pps_vision/gate.py", 6)}
    assert (tmp_path / "pps_vision/gate.py").read_text() == source

    # a round is replayed where its line still stands, also if it has moved to another file
    moved = source.replace("def is_far", "def is_near") + "\n\nX = 3\n"
    (tmp_path / "pps_vision/moved.py").write_text(moved)
    (tmp_path / "pps_vision/gate.py").unlink()
    (tmp_path / "tests/test_gate.py").unlink()
    replayed = mutate(tmp_path, "again.json", "--from", str(tmp_path / "found.json"))
    assert [(mutant["file"], mutant["mutation"]) for mutant in replayed] == [
        ("pps_vision/moved.py", mutant["mutation"]) for mutant in mutants
    ]
    assert {mutant["outcome"] for mutant in replayed} == {"survived"}


def mutate(tree: Path, out: str, *words: str) -> list[dict[str, Any]]:
    """Run a round of mutants on a tree and return its results."""
    env = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [sys.executable, "-m", "tests.mutants", "--root", str(tree), "--out", str(tree / out), *words]
    subprocess.run(command, cwd=ROOT, env=env, check=True)
    mutants: list[dict[str, Any]] = json.loads((tree / out).read_text())["mutants"]
    return mutants
